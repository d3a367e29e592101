// What a region of level 0 that is coded differs from what was wanted, and its levels from level 0.
// SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_RELIEF_PACK_ERRORS_H
#define COMMON_TERRAIN_RELIEF_PACK_ERRORS_H

#include "common/terrain/relief/pack_region.h"

// What decoding gives against what was wanted, over the core of level 0 without a planet's margin.
struct region_sums {
    squares_wide squares;
    int64_t samples, most;
    int32_t min_q, max_q;
};
void region_measure(const struct region *region, struct region_sums *sums); // adds

// A region of level 0: the largest difference of each level's surface from level 0 over each tile, rounded
// up. Levels below `coarse` are exact and go to `packed`.  For coarser ones the cells of `coarse` are gone
// through: |their surface - that of `coarse`| + |that of `coarse` - level 0|, never too small; `beyond`
// receives them for the tiles under the core, level by level from `coarse`, row by row.  `read` gives decoded
// samples, internal units, of levels from `coarse` (NULL: the region has them).  region->squares receives the
// squares of each level's differences at the samples that region_measure counts, in (quanta / 2^level)^2.
// False when memory runs out.
struct region_reader {
    bool (*read)(void *user, int level, const struct patch *to);
    void *user;
};
struct rect region_tiles_above(const struct region *region, int level); // tiles of a level under the core
size_t region_beyond(const struct region *region);                      // how many `beyond` holds
bool region_errors(struct region *region, const struct region_reader *reader, uint32_t *beyond);

#endif
