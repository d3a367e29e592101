// A rectangle of a map on its way into tiles: reduced level by level from the fine end, then coded from the
// coarse end as a decoder will see it.  With margins of its own wide enough, a region gives bit for bit what
// the whole map would give there; a region may be the whole map. SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_RELIEF_PACK_REGION_H
#define COMMON_TERRAIN_RELIEF_PACK_REGION_H

#include "common/terrain/relief/pack_method.h"
#include "common/terrain/relief/pack_squares.h"

#include <stddef.h>

struct pack_poles { // of a planet: what stands in the rows of its poles (relief_format.h)
    bool planet;
    int coarsest;
    int64_t margin;              // of level 0
    int32_t q[LAYOUT_LEVELS][2]; // quanta, south and north
    int known;                   // levels below this have theirs
};

struct pack_coder { // what all regions of a map share
    struct grid grid;
    enum layout layout;
    const struct pack_method *method;
    int fraction_bits;    // internal units are quanta * 2^fraction_bits
    int32_t lambda_65536; // these two as coder_rate has them
    bool uneven;
    int32_t step[LAYOUT_LEVELS][CODER_BANDS];
    struct pack_poles poles;
    struct coder_counts *counts; // NULL, or what the coder saw (one thread)
};

struct packed_tile {
    uint8_t *data;
    uint32_t bytes, error_q;
    int32_t min_q, max_q;
};

struct region_level {
    struct rect core;                // samples of the level that are the region's own
    struct rect tiles;               // coded here: those of the core and those that its samples hang on
    struct rect core_tiles;          // the region's own
    struct patch wanted;             // what the level should be
    struct patch bands[CODER_BANDS]; // smooth methods: details wanted, and as decoded
    struct patch coded[CODER_BANDS];
    struct patch decoded;       // the core, a sample more to the east and north, and what finer levels need
    struct packed_tile *packed; // of core_tiles, row by row
};

struct region {
    const struct pack_coder *coder;
    int fine, coarse; // levels fine..coarse-1 are coded
    struct region_level level[LAYOUT_LEVELS];
    squares_wide squares[LAYOUT_LEVELS]; // region_errors
    int threads;
    bool failed; // memory ran out
};

// Chooses the rectangles of a region whose core is `core` of level `fine`.  A region that is not to be coded
// is only reduced, down to its core of level `coarse`.
void region_plan(struct region *region, const struct pack_coder *coder, int fine, int coarse,
                 const struct rect *core, bool coded);
size_t region_room(const struct region *region); // bytes of samples that it needs
void region_place(struct region *region, void *room);
void region_finish(struct region *region); // frees the tiles; the room is the caller's

// From level[fine].wanted, which the caller has filled, the other levels' `wanted` and `bands`.
bool region_reduce(struct region *region);
// The coarsest level of all, from what is wanted: multiples of its step.
void region_code_base(struct region *region);
// Codes levels coarse-1..fine from level[coarse].decoded; with `write` the tiles' bytes are kept in `packed`,
// their extrema too.
bool region_code(struct region *region, bool write);

int32_t region_quanta(int32_t value, int fraction_bits); // of internal units, limited

// Row of a level in which a planet's pole stands: end 0 the south one.
int64_t region_pole_row(const struct pack_coder *coder, int level, int end);

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
