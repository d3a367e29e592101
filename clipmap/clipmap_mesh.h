// The index lists that every level is drawn with (Losasso & Hoppe 2004, sections 6.1 and 6.2).  PURE.
//
// A render region is cut into blocks of at most CLIPMAP_BLOCK x CLIPMAP_BLOCK cells.  A block's vertices are
// numbered y * CLIPMAP_ROW + x from its south-west corner, so that one list serves all blocks of its size, at
// every level.  Cells are split along (i, j)-(i+1, j+1), counter-clockwise seen from above.
//
// The finer level has a vertex in the middle of each edge of its hole.  Two ways to close these T-junctions:
//   CLIPMAP_STITCH_ZERO_AREA  section 6.2: a triangle of no area over each pair of edges, drawn by the finer
//   level.  Where
//                             it fills a dropped pixel it may count as facing down: it must not be culled.
//   CLIPMAP_STITCH_SPLIT      the coarse cells round the hole are drawn with that vertex in their edge, three
//   triangles
//                             instead of two (numerics.md, B3): no sliver, no overlap, every edge shared by
//                             two triangles.
// Vertices of split cells are numbered in half cells, y * CLIPMAP_HALF_ROW + x.
// SPDX-License-Identifier: MIT
#ifndef CLIPMAP_CLIPMAP_MESH_H
#define CLIPMAP_CLIPMAP_MESH_H

#include "clipmap/clipmap_levels.h"

#include <stddef.h>
#include <stdint.h>

enum clipmap_stitch { CLIPMAP_STITCH_NONE, CLIPMAP_STITCH_ZERO_AREA, CLIPMAP_STITCH_SPLIT };

enum {
    CLIPMAP_BLOCK = 8,     // cells: measured best of 4, 8 and 16 for every n
    CLIPMAP_ROW = 32,      // vertex numbers a row
    CLIPMAP_HALF_ROW = 64, // in split cells
    CLIPMAP_BLOCK_KINDS = CLIPMAP_BLOCK * CLIPMAP_BLOCK,
    CLIPMAP_ZERO_AREA_KINDS = CLIPMAP_SIDES * (CLIPMAP_BLOCK / 2),
    CLIPMAP_SPLIT_KINDS = CLIPMAP_SIDES * CLIPMAP_BLOCK,
    CLIPMAP_KINDS = CLIPMAP_BLOCK_KINDS + CLIPMAP_ZERO_AREA_KINDS + CLIPMAP_SPLIT_KINDS,
};

// Which list: blocks of width x height cells, 1 .. CLIPMAP_BLOCK; zero-area stitches of `length` cells, even,
// along a side of the active region; split cells, 1 .. CLIPMAP_BLOCK, along a side of the hole, outside it.
int clipmap_block_kind(int width, int height);
int clipmap_zero_area_kind(enum clipmap_side side, int length);
int clipmap_split_kind(enum clipmap_side side, int length);

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
    int extent[2]; // cells in x and y; a zero-area stitch has 0 across
};

// Takes pieces.  A group of neighbouring pieces is shown as one box of samples before it is looked into, so
// that it can be taken or left whole: `enter` (may be NULL) gets the planes that the group around is still to
// be tested against, and returns those that are left, or CLIPMAP_LEAVE.  `take` gets what `enter` returned
// for the group that the piece is in.
enum { CLIPMAP_LEAVE = 1 << 30 };
struct clipmap_taker {
    unsigned (*enter)(void *user, const struct clipmap_box *group, unsigned planes);
    void (*take)(void *user, const struct clipmap_piece *piece, unsigned planes);
    void *user;
    unsigned planes; // for the outermost groups
};

// Cuts the render region into blocks of nearly equal size: each cell of active less hole is in exactly one
// block, but, with CLIPMAP_STITCH_SPLIT, the cells that share an edge with an open side of the hole are left
// to clipmap_cut_stitches. finer: the next finer region; NULL when there is none.  Returns the number of
// blocks, those left included.
int clipmap_cut_blocks(const struct clipmap_region *region, const struct clipmap_region *finer,
                       enum clipmap_stitch stitch, const struct clipmap_taker *taker);

// Stitches of the region's open sides (ZERO_AREA), or split cells round its hole (SPLIT), one by one. Returns
// their number.
int clipmap_cut_stitches(const struct clipmap_region *region, const struct clipmap_region *finer,
                         enum clipmap_stitch stitch, const struct clipmap_taker *taker);

#endif
