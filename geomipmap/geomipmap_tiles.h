// The tiles of a terrain: where they are, how high, and how wrong each is at each level.  No GL.
//
// Tile (column, row) covers 2^bits cells of the finest level from sample (x0 + column 2^bits, y0 + row
// 2^bits); neighbours share a row of samples.  Tiles that stick out of the map's north and east edge repeat
// its last samples, which the exact outline cuts away again.  Tiles are grouped into map blocks (Brodersen
// 2005, section 3) for culling. SPDX-License-Identifier: MIT
#ifndef GEOMIPMAP_GEOMIPMAP_TILES_H
#define GEOMIPMAP_GEOMIPMAP_TILES_H

#include "common/terrain/terrain.h"
#include "geomipmap/geomipmap_lod.h"

enum {
    GEOMIPMAP_BLOCK_BITS = 3,
    GEOMIPMAP_BLOCK = 1 << GEOMIPMAP_BLOCK_BITS
}; // tiles on a side of a map block

struct geomipmap_range { // lowest and highest height, quanta
    int32_t low, high;
};

struct geomipmap_grid { // of tiles, or of map blocks
    int columns, rows;
    struct geomipmap_range *range; // row by row, row 0 south
};

struct geomipmap_tiles {
    const struct terrain *terrain; // borrowed
    int bits, levels;              // levels == bits
    int finest;                    // level of the terrain that is drawn
    int64_t x0, y0;                // its south-west sample
    double spacing_m[2];           // between its samples
    double quantum_m, offset_m;
    struct geomipmap_grid tiles, blocks;
    struct geomipmap_range range; // of the whole terrain
    float *error;                 // quanta, [tile * levels + level]
    bool wide; // some tile is higher than 65,535 quanta: its heights need more than 16 bits
};

// Measures all tiles on `threads` threads (<= 0: one a processor); the same result for any number.  False
// after one line on stderr.
bool geomipmap_tiles_init(struct geomipmap_tiles *tiles, const struct terrain *terrain, int bits,
                          enum geomipmap_delta delta, int threads);
void geomipmap_tiles_finish(struct geomipmap_tiles *tiles); // accepts zeroed tiles

// Reads the (2^bits + 1)^2 heights of a tile, quanta.
void geomipmap_tiles_read(const struct geomipmap_tiles *tiles, int tile, int32_t *heights);

size_t geomipmap_tiles_bytes(const struct geomipmap_tiles *tiles);

#endif
