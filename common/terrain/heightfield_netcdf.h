// The reader for maps in NetCDF's classic format (".nc", ".cdf"): what NOAA and Debian's ferret-datasets
// distribute.  The format is public: a header of dimensions, attributes and variables, then big-endian
// numbers. SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_HEIGHTFIELD_NETCDF_H
#define COMMON_TERRAIN_HEIGHTFIELD_NETCDF_H

#include "common/terrain/heightfield.h"

// Fills a zeroed, named heightfield from the first variable over two dimensions, heights in metres over
// (latitude, longitude), which are named by variables of one dimension in degrees.  A map all around the
// planet, from pole to pole, becomes one: its columns are turned so that the first is at 180 W.  False after
// one line on stderr.
bool heightfield_load_netcdf(struct heightfield *field, const char *path, const unsigned char *data,
                             size_t size);

#endif
