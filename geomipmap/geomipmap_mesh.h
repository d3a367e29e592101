// The index sets of one tile, for every combination of its own level and its four neighbours' (Brodersen
// 2005, sections 4 and 5).  No GL.
//
// A tile has 2^bits cells a side and (2^bits + 1)^2 vertices, numbered row by row from the south-west
// corner. At level l it draws every 2^l-th vertex; the coarsest level, bits - 1, still has 2 x 2 cells.
// Each cell is split along the diagonal (i, j)-(i+1, j+1), so that triangles of a coarse level are unions
// of fine ones.  Where neighbours differ, the border changes in one of two ways:
//   add:    the missing vertices are ADDED to the coarser side: the border triangle that owns the edge
//           becomes a fan.  A neighbour that is coarser adapts itself, so it counts as "same level".
//   remove: the finer side leaves out the vertices that the coarser one lacks (de Boer 2000): fewer
//           triangles, and a border as wrong as the coarser level.  Finer neighbours count as "same level".
// A neighbour that is not drawn counts as "same level", too.
//
// Sets: sum of k^4 for k = 1..bits (354 for 17 x 17).  Every set covers the tile exactly once,
// counter-clockwise seen from above.
//
// `regions` draws the sets of `add`, triangle for triangle, in up to five parts: the centre and the four
// borders (Figure 3), each of which depends on its own neighbour alone and is stored once.  Two corner
// triangles lie on two sides; south and north own them and depend on east and west as well.
//
// Lists are in columns that vertex caches like.  Strips are joined by triangles without area.
// SPDX-License-Identifier: MIT
#ifndef GEOMIPMAP_GEOMIPMAP_MESH_H
#define GEOMIPMAP_GEOMIPMAP_MESH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum geomipmap_side { GEOMIPMAP_SOUTH, GEOMIPMAP_EAST, GEOMIPMAP_NORTH, GEOMIPMAP_WEST, GEOMIPMAP_SIDES };

enum geomipmap_borders { GEOMIPMAP_ADD, GEOMIPMAP_REGIONS, GEOMIPMAP_REMOVE };

enum {
    GEOMIPMAP_MIN_BITS = 2,
    GEOMIPMAP_MAX_BITS = 6,
    GEOMIPMAP_MAX_LEVELS = GEOMIPMAP_MAX_BITS, // levels 0 .. bits - 1
    GEOMIPMAP_MAX_PARTS = GEOMIPMAP_SIDES + 1,
};

struct geomipmap_part {
    size_t first; // of its indices in geomipmap_mesh.indices
    int count;    // of its indices
};

struct geomipmap_mesh {
    int bits;
    enum geomipmap_borders borders;
    bool strips; // indices are strips, not lists
    int set_count;
    int part_count; // one a set; of regions: one a region and what it depends on
    struct geomipmap_part *parts;
    uint16_t *indices; // all parts, one after the other
    size_t index_count;
};

// Builds the sets for tiles of 2^bits cells a side.  False after one line on stderr.
bool geomipmap_mesh_init(struct geomipmap_mesh *mesh, int bits, enum geomipmap_borders borders, bool strips);
void geomipmap_mesh_finish(struct geomipmap_mesh *mesh);  // accepts a zeroed mesh
void geomipmap_mesh_release(struct geomipmap_mesh *mesh); // of the indices, once a buffer holds them

// Number of the set for a tile at `level` beside neighbours at `neighbours` (by enum geomipmap_side; any
// level).
int geomipmap_mesh_set(int bits, enum geomipmap_borders borders, int level,
                       const int neighbours[GEOMIPMAP_SIDES]);

// The parts that draw a set, those without triangles left out.  Returns their number.
int geomipmap_mesh_parts(const struct geomipmap_mesh *mesh, int set,
                         struct geomipmap_part parts[GEOMIPMAP_MAX_PARTS]);

// Triangles that a part submits, those that join strips included.
static inline int geomipmap_mesh_triangles(const struct geomipmap_mesh *mesh, struct geomipmap_part part)
{
    return mesh->strips ? part.count - 2 : part.count / 3;
}

// Writes the triangles of one set as a list to `out` (room for geomipmap_mesh_bound(bits) indices); returns
// the number of indices.  Sides have the vertices of their neighbours' levels: finer ones add, coarser ones
// remove.
int geomipmap_mesh_write(int bits, int level, const int neighbours[GEOMIPMAP_SIDES], uint16_t *out);
size_t geomipmap_mesh_bound(int bits); // more indices than any list has

#endif
