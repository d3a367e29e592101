// The reader for everything that GDAL knows, where the program is built with it (RELIEF_GDAL).
// SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_HEIGHTFIELD_GDAL_H
#define COMMON_TERRAIN_HEIGHTFIELD_GDAL_H

#include "common/terrain/heightfield.h"

// Fills a zeroed, named heightfield from the first band.  False after one line on stderr.
bool heightfield_load_gdal(struct heightfield *field, const char *path);

#endif
