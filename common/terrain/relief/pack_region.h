// A rectangle of a map on its way into tiles: reduced level by level from the fine end, then coded from the
// coarse end as a decoder will see it.  With margins of its own wide enough, a region gives bit for bit what
// the whole map would give there; a region may be the whole map. SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_RELIEF_PACK_REGION_H
#define COMMON_TERRAIN_RELIEF_PACK_REGION_H

#include "common/terrain/relief/pack_method.h"
#include "common/terrain/relief/pack_squares.h"
#include "common/terrain/upsample.h"

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

enum { REGION_TILE_SHIFT = 6 }; // LAYOUT_SAMPLES

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

static inline int32_t region_quanta(int32_t value, int fraction_bits) // of internal units, limited
{
    int32_t round = fraction_bits ? 1 << (fraction_bits - 1) : 0, q = (value + round) >> fraction_bits;
    return q > QUANTA_LIMIT ? QUANTA_LIMIT : q < -QUANTA_LIMIT ? -QUANTA_LIMIT : q;
}

// Of the region's own tiles, once they are written; NULL: another's.
struct packed_tile *region_own_tile(const struct region_level *at, int64_t tx, int64_t ty);

// Row of a level in which a planet's pole stands: end 0 the south one.
int64_t region_pole_row(const struct pack_coder *coder, int level, int end);
// The pole's height where a row is one that is known; else NULL.
const int32_t *region_pole(const struct pack_coder *coder, int level, int64_t y);
// A pole is one height on all meridians; `bits`: of the patch's fraction.
void region_flatten_poles(const struct pack_coder *coder, int level, int bits, const struct patch *patch);

#endif
