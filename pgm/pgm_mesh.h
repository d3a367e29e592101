// The persistent grid: its vertices and its index list, made once.  PURE: no GL.
// Livny et al. 2008, section 3.1.
//
// The grid has rows x columns quads.  Vertex (j, i) of row j = 0 (farthest) .. rows and column i = 0 (left)
// .. columns is number j * stride + i and holds (j, X), X = -1 .. 1 across, even or drawn together.  Quads
// come in tiles of 16 x 16, nearest tiles first, each quad as two triangles, counter-clockwise from above,
// split along the diagonal from near left to far right. SPDX-License-Identifier: MIT
#ifndef PGM_PGM_MESH_H
#define PGM_PGM_MESH_H

#include <stddef.h>
#include <stdint.h>

enum { PGM_TILE = 16 };

// Vertices a row, those that only pad included: a vertex cache mapped on the number's last 8 bits then keeps
// a whole tile's row beside the next.
int pgm_mesh_stride(int columns);
size_t pgm_mesh_vertex_count(int rows, int columns);
// focus, width: as in pgm_focus, of the columns from left to right.
void pgm_mesh_vertices(int rows, int columns, double focus, double width, float (*vertices)[2]);

// The parameterised subdivision of Figure 20: the place in 0 .. 1 of share u of the vertices, drawn together
// about `focus` within `width`; width 0: even.  Strictly increasing, 0 at 0 and 1 at 1.
double pgm_focus(double u, double focus, double width);

// X of column i.
double pgm_mesh_across(int columns, double focus, double width, int i);

size_t pgm_mesh_index_count(int rows, int columns);
void pgm_mesh_indices(int rows, int columns, uint32_t *indices);

struct pgm_tile {
    int row, column;     // first quad: the farthest row, the leftmost column
    int rows, columns;   // quads
    size_t first, count; // in the index list
};
int pgm_mesh_tile_count(int rows, int columns);
struct pgm_tile pgm_mesh_tile(int rows, int columns, int tile); // in the order of the index list

#endif
