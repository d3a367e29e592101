// The tiles of a terrain: where they are, how high, and how wrong each is at each level.  No GL.
//
// A tile of height 0 covers 2^bits cells of the finest level and holds every sample of them; neighbours
// share a row of samples. 2 x 2 tiles merge into a tile of the next height, which covers twice the ground
// with the same number of vertices: every 2^height-th sample.  Distant ground is drawn with those, so that
// it costs neither a draw call nor eight triangles for every small tile (merge 0 is Brodersen 2005 as
// published).  One tile of height `top` covers the map; where no tile may be drawn, the tree goes on for
// culling alone: its nodes are the paper's map blocks.
//
// A tile may also be drawn with the filtered levels of the terrain's pyramid instead of its finest samples:
// where it draws every 2^step-th sample, with those of level finest + step, which lie nearer to the ground
// between them.  Along a border both tiles take the level of the finer one, at a corner all tiles around it
// that of the finest.  The heights then depend on the neighbours: they are the form of a tile.
//
// Tile (column, row) of height h covers 2^(bits + h) cells from sample (x0 + column 2^(bits+h), y0 + row
// 2^(bits+h)).  Tiles that stick out of the map's north and east edge repeat its last samples, which the
// exact outline cuts away again.
//
// Nothing is listed: what is known of a tile is found out when it is first asked for, and kept for a while.
// Time and memory follow what is looked at, not the size of the map.  Tiles up to height `merge` are
// measured, sample by sample.  Those above, which only terrain on disk draws, are bounded by what the
// terrain carries of its levels:
//
// Let f be the surface of the finest level, f_j that of level j, e_j(P) the most that |f_j - f| is over P,
// for which terrain_error stands.  A tile of height h draws its level l with the samples of level L = h + l;
// along a side those of some level h <= j <= L, at a corner those of some level j <= L.  Call the drawn
// surface g and a drawn vertex (v, z).  Added vertices cut triangles of level L into fans, so every drawn
// triangle T lies within one triangle of level L, over which f_L is linear.  g - f_L is linear over T, then,
// and is largest at a vertex:
//     |g - f_L| <= max |z - f_L(v)| <= max (|f_j(v) - f(v)| + |f(v) - f_L(v)|) <= max_j e_j + e_L
//     |g - f|   <= |g - f_L| + |f_L - f| <= 2 e_L + max_j e_j,      j < L,
// with e_j over the tile for j >= h and at its four corners for j < h.  (Where z = f_L(v) at all three, as
// nearly everywhere inside, e_L alone is left; the bound is that of the border.)  Levels that the pyramid
// has not are as wrong as can be.
// SPDX-License-Identifier: MIT
#ifndef GEOMIPMAP_GEOMIPMAP_TILES_H
#define GEOMIPMAP_GEOMIPMAP_TILES_H

#include "common/terrain/reader.h"
#include "geomipmap/geomipmap_cache.h"
#include "geomipmap/geomipmap_lod.h"

enum {
    GEOMIPMAP_MAX_MERGE = 4,
    GEOMIPMAP_MAX_HEIGHTS = 32,
    GEOMIPMAP_GROUP_ACROSS = 4, // tiles are found out about in groups of 4 x 2
    GEOMIPMAP_GROUP_UP = GEOMIPMAP_LANES / GEOMIPMAP_GROUP_ACROSS,
};

struct geomipmap_range { // lowest and highest sample, quanta
    int32_t low, high;
};

struct geomipmap_grid { // the tiles of one height
    int columns, rows;
};

struct geomipmap_facts { // of a group of tiles
    uint8_t known;       // by tile, a bit each
    struct geomipmap_range range[GEOMIPMAP_LANES];
};

struct geomipmap_tiles {
    const struct terrain *terrain; // borrowed
    int bits, levels;              // levels == bits
    int merge;                     // greatest height that is measured
    int drawn;                     // greatest height that may be drawn
    int top;                       // greatest height
    struct geomipmap_grid grid[GEOMIPMAP_MAX_HEIGHTS];
    int finest;          // level of the terrain that is drawn
    bool filtered;       // drawn with the levels of the pyramid
    int64_t x0, y0;      // south-west sample of the tiles: the map's, or a multiple of every step before it
    double spacing_m[2]; // between its samples
    double quantum_m, offset_m;
    bool wide; // some tile may span more than 65,535 quanta, by the terrain's bounds
    enum geomipmap_delta delta;
    int threads;
    struct geomipmap_plan plans[GEOMIPMAP_MAX_MERGE + 1]; // by height

    struct geomipmap_cache groups;
    struct geomipmap_facts *facts; // by slot of the cache
    float *errors;                 // by slot, tile and level, quanta
    int *asked;                    // slots that wait to be measured
    int asked_count, room;         // room: of the three lists
    bool failed;                   // no memory
};

struct geomipmap_form { // steps that a tile's heights come from: inside, on the sides, at the corners
    uint8_t inside, side[GEOMIPMAP_SIDES];
    uint8_t corner[GEOMIPMAP_SIDES]; // where a side ends that runs counter-clockwise: south-east first
};

struct geomipmap_place { // of a tile
    int height, column, row;
};

// merge, at most GEOMIPMAP_MAX_MERGE: greatest height that is measured, and that may be drawn unless filtered
// terrain is on disk, where every height may; bits + merge is at most GEOMIPMAP_MAX_EXTENT.  Measuring runs
// on `threads` threads (<= 0: one a processor), with the same result for any number.  False after one line on
// stderr.
bool geomipmap_tiles_init(struct geomipmap_tiles *tiles, const struct terrain *terrain, int bits, int merge,
                          enum geomipmap_delta delta, bool filtered, int threads);
void geomipmap_tiles_finish(struct geomipmap_tiles *tiles); // accepts zeroed tiles

// A number for every tile.
static inline uint64_t geomipmap_tiles_name(struct geomipmap_place place)
{
    return (uint64_t)place.height << 56 | (uint64_t)place.row << 28 | (uint64_t)place.column;
}

// Begins a selection: what was known of tiles not asked for lately may be forgotten.
void geomipmap_tiles_begin(struct geomipmap_tiles *tiles);

// What is known of a tile: its range, which holds all that it or any tile in it may draw, and its errors by
// level, valid until the next call.  False: it has to be measured, and is asked for now.
bool geomipmap_tiles_know(struct geomipmap_tiles *tiles, struct geomipmap_place place,
                          struct geomipmap_range *range, const float **error);

// Measures what was asked for.  False after one line on stderr.
bool geomipmap_tiles_measure(struct geomipmap_tiles *tiles);

// As the range above, or wider, without measuring.
struct geomipmap_range geomipmap_tiles_bounds(const struct geomipmap_tiles *tiles,
                                              struct geomipmap_place place);

// Whether what a filtered tile draws inside at one of its levels has arrived; else it is asked for.  reader
// NULL: all is there.
bool geomipmap_tiles_ready(const struct geomipmap_tiles *tiles, struct terrain_reader *reader,
                           struct geomipmap_place place, int level);

// Reads the (2^bits + 1)^2 heights that a tile holds, quanta.  form: of filtered tiles, of which only the
// vertices drawn are written; else NULL.  reader: what has arrived comes from it, what has not is waited for;
// may be NULL.
void geomipmap_tiles_read(const struct geomipmap_tiles *tiles, struct terrain_reader *reader,
                          struct geomipmap_place place, const struct geomipmap_form *form, int32_t *heights);

size_t geomipmap_tiles_bytes(const struct geomipmap_tiles *tiles);

#endif
