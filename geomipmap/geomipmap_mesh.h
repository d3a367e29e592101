// The index sets of one tile, for every combination of its own level and its four neighbours' (Brodersen
// 2005, sections 4 and 5).  No GL.
//
// A tile has 2^bits cells a side and (2^bits + 1)^2 vertices, numbered row by row from the south-west
// corner. At level l it draws every 2^l-th vertex; the coarsest level, bits - 1, still has 2 x 2 cells.
// Each cell is split along the diagonal (i, j)-(i+1, j+1), so that triangles of a coarse level are unions
// of fine ones. Where a neighbour is finer, the missing vertices are ADDED to the shared edge: the border
// triangle that owns the edge becomes a fan.  A neighbour that is coarser adapts itself, so it counts as
// "same level", and so does a neighbour that is not drawn.
//
// Sets: sum of k^4 for k = 1..bits (354 for 17 x 17).  Every set covers the tile exactly once,
// counter-clockwise seen from above.
// SPDX-License-Identifier: MIT
#ifndef GEOMIPMAP_GEOMIPMAP_MESH_H
#define GEOMIPMAP_GEOMIPMAP_MESH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum geomipmap_side { GEOMIPMAP_SOUTH, GEOMIPMAP_EAST, GEOMIPMAP_NORTH, GEOMIPMAP_WEST, GEOMIPMAP_SIDES };

enum {
    GEOMIPMAP_MIN_BITS = 2,
    GEOMIPMAP_MAX_BITS = 6,
    GEOMIPMAP_MAX_LEVELS = GEOMIPMAP_MAX_BITS, // levels 0 .. bits - 1
};

struct geomipmap_set {
    size_t first; // of its indices in geomipmap_mesh.indices
    int count;    // of its indices: 3 a triangle
};

struct geomipmap_mesh {
    int bits;
    int set_count;
    struct geomipmap_set *sets;
    uint16_t *indices; // all sets, one after the other
    size_t index_count;
};

// Builds the sets for tiles of 2^bits cells a side.  False after one line on stderr.
bool geomipmap_mesh_init(struct geomipmap_mesh *mesh, int bits);
void geomipmap_mesh_finish(struct geomipmap_mesh *mesh); // accepts a zeroed mesh

// Number of the set for a tile at `level` beside neighbours at `neighbours` (by enum geomipmap_side; any
// level).
int geomipmap_mesh_set(int level, const int neighbours[GEOMIPMAP_SIDES]);

// Writes the triangles of one set to `out` (room for geomipmap_mesh_bound(bits) indices); returns the
// number of indices.
int geomipmap_mesh_write(int bits, int level, const int neighbours[GEOMIPMAP_SIDES], uint16_t *out);
size_t geomipmap_mesh_bound(int bits); // more indices than any set has

#endif
