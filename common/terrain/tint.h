// A colour image for a map that has none: tints by height, as atlases have them.
// SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_TINT_H
#define COMMON_TERRAIN_TINT_H

#include "common/terrain/heightfield.h"

// Writes a PNG of width x height pixels over the map from edge to edge, north at its top: blues below 0 m,
// then green, ochre, brown and white.  False after one line on stderr.
bool tint_save(const struct heightfield *field, const char *path, int width, int height);

#endif
