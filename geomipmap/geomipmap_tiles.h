// The tiles of a terrain: where they are, how high, and how wrong each is at each level.  No GL.
//
// A tile of height 0 covers 2^bits cells of the finest level and holds every sample of them; neighbours
// share a row of samples. 2 x 2 tiles merge into a tile of the next height, which covers twice the ground
// with the same number of vertices: every 2^height-th sample.  Distant ground is drawn with those, so that
// it costs neither a draw call nor eight triangles for every small tile (merge 0 is Brodersen 2005 as
// published). Where no tile may be drawn any more, the tree goes on for culling alone: its nodes are the
// paper's map blocks.
//
// A tile may also be drawn with the filtered levels of the terrain's pyramid instead of its finest samples:
// where it draws every 2^step-th sample, with those of level finest + step, which lie nearer to the ground
// between them.  Along a border both tiles take the level of the finer one, at a corner all tiles around it
// that of the finest.  The heights then depend on the neighbours: they are the form of a tile.
//
// Tile (column, row) of height h covers 2^(bits + h) cells from sample (x0 + column 2^(bits+h), y0 + row
// 2^(bits+h)).  Tiles that stick out of the map's north and east edge repeat its last samples, which the
// exact outline cuts away again.
// SPDX-License-Identifier: MIT
#ifndef GEOMIPMAP_GEOMIPMAP_TILES_H
#define GEOMIPMAP_GEOMIPMAP_TILES_H

#include "common/terrain/reader.h"
#include "geomipmap/geomipmap_lod.h"

// Without merging, culling begins with blocks of 8 x 8 tiles.
enum { GEOMIPMAP_BLOCK_HEIGHT = 3, GEOMIPMAP_MAX_HEIGHTS = 5 };

struct geomipmap_range { // lowest and highest sample, quanta
    int32_t low, high;
};

struct geomipmap_grid { // the tiles of one height
    int columns, rows;
    int first;                     // number of its first tile; the others follow row by row, row 0 south
    struct geomipmap_range *range; // by tile
    float *error;                  // quanta, [tile * levels + level]; NULL: not drawn at this height
};

struct geomipmap_tiles {
    const struct terrain *terrain; // borrowed
    int bits, levels;              // levels == bits
    int merge;                     // greatest height that may be drawn
    int top;                       // greatest height
    struct geomipmap_grid grid[GEOMIPMAP_MAX_HEIGHTS];
    int drawable;        // tiles of heights 0..merge
    int finest;          // level of the terrain that is drawn
    bool filtered;       // drawn with the levels of the pyramid
    int64_t x0, y0;      // south-west sample of the tiles: the map's, or a multiple of every step before it
    double spacing_m[2]; // between its samples
    double quantum_m, offset_m;
    bool wide; // some tile spans more than 65,535 quanta: its heights need more than 16 bits
};

struct geomipmap_form { // steps that a tile's heights come from: inside, on the sides, at the corners
    uint8_t inside, side[GEOMIPMAP_SIDES];
    uint8_t corner[GEOMIPMAP_SIDES]; // where a side ends that runs counter-clockwise: south-east first
};

struct geomipmap_place { // of a tile
    int height, column, row;
};

// Measures all tiles on `threads` threads (<= 0: one a processor); the same result for any number.  bits +
// merge is at most GEOMIPMAP_MAX_EXTENT.  False after one line on stderr.
bool geomipmap_tiles_init(struct geomipmap_tiles *tiles, const struct terrain *terrain, int bits, int merge,
                          enum geomipmap_delta delta, bool filtered, int threads);
void geomipmap_tiles_finish(struct geomipmap_tiles *tiles); // accepts zeroed tiles

// Tiles that may be drawn have one number, 0 .. drawable - 1.
struct geomipmap_place geomipmap_tiles_place(const struct geomipmap_tiles *tiles, int tile);

static inline int geomipmap_tiles_number(const struct geomipmap_tiles *tiles, struct geomipmap_place place)
{
    const struct geomipmap_grid *grid = &tiles->grid[place.height];
    return grid->first + place.row * grid->columns + place.column;
}

struct geomipmap_range geomipmap_tiles_range(const struct geomipmap_tiles *tiles,
                                             struct geomipmap_place place);
// Its errors, by level.
const float *geomipmap_tiles_error(const struct geomipmap_tiles *tiles, struct geomipmap_place place);

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
