// A whole planet as the map that packing knows: with a margin of samples that go on over the seam and over
// the poles (relief_format.h), each pole one height. SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_RELIEF_PLANET_SOURCE_H
#define COMMON_TERRAIN_RELIEF_PLANET_SOURCE_H

#include "common/terrain/relief/relief_format.h"
#include "common/terrain/relief/relief_source.h"

struct planet_source {
    struct relief_source map; // with the margin; give this to what packs
    struct relief_planet planet;
    int32_t pole_q[2]; // of level 0: south, north
    const struct relief_source *from;
};

// `from` has a radius and is kept by the caller; `reach` is that of the layout's filter.  False after one
// line on stderr.
bool planet_source_init(struct planet_source *source, const struct relief_source *from, int reach);

#endif
