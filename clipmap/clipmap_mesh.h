// The index lists that every level is drawn with (Losasso & Hoppe 2004, sections 6.1 and 6.2).  PURE.
//
// A render region is cut into blocks of at most CLIPMAP_BLOCK x CLIPMAP_BLOCK cells.  A block's vertices are
// numbered y * CLIPMAP_ROW + x from its south-west corner, so that one list serves all blocks of its size, at
// every level.  Cells are split along (i, j)-(i+1, j+1), counter-clockwise seen from above.
//
// A stitch closes the T-junctions of a stretch of an active region's open side with one triangle of no area
// for each pair of edges.  It is wound as part of the closed surface: where rounding to the pixel grid leaves
// a gap the triangle faces up and fills it, where it leaves an overlap the triangle faces down.  So culling
// back faces is right for stitches, and keeps them from covering what lies in front (numerics.md, B3).
// SPDX-License-Identifier: MIT
#ifndef CLIPMAP_CLIPMAP_MESH_H
#define CLIPMAP_CLIPMAP_MESH_H

#include "clipmap/clipmap_levels.h"

#include <stddef.h>
#include <stdint.h>

enum {
    CLIPMAP_BLOCK =
        16, // cells; measured best: smaller blocks cost draws, larger ones triangles outside the frustum
    CLIPMAP_ROW = 32, // vertex numbers a row
    CLIPMAP_BLOCK_KINDS = CLIPMAP_BLOCK * CLIPMAP_BLOCK,
    CLIPMAP_STITCH_KINDS = CLIPMAP_SIDES * (CLIPMAP_BLOCK / 2),
    CLIPMAP_KINDS = CLIPMAP_BLOCK_KINDS + CLIPMAP_STITCH_KINDS,
};

int clipmap_block_kind(int width, int height);               // in cells, 1 .. CLIPMAP_BLOCK
int clipmap_stitch_kind(enum clipmap_side side, int length); // in cells, even, 2 .. CLIPMAP_BLOCK

struct clipmap_mesh {
    uint16_t *indices; // all lists, one after the other; owned
    size_t count;
    struct clipmap_list {
        uint32_t first, count; // in indices
    } lists[CLIPMAP_KINDS];
};
bool clipmap_mesh_init(struct clipmap_mesh *mesh);
void clipmap_mesh_finish(struct clipmap_mesh *mesh);

// One use of a list: its vertices 0 .. are the samples from `corner` on.
struct clipmap_piece {
    int64_t corner[2];
    int kind;
    int extent[2]; // cells in x and y; a stitch has 0 across
};
typedef void clipmap_piece_fn(void *user, const struct clipmap_piece *piece);

// Cuts the render region into blocks of nearly equal size.  Each cell of active less hole is in exactly one
// block.  finer: the next finer region, NULL or empty when there is none.
void clipmap_cut_blocks(const struct clipmap_region *region, const struct clipmap_region *finer,
                        clipmap_piece_fn *take, void *user);

// Stitches of the region's open sides.
void clipmap_cut_stitches(const struct clipmap_region *region, clipmap_piece_fn *take, void *user);

#endif
