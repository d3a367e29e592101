// The index lists that every level is drawn with (Losasso & Hoppe 2004, sections 6.1 and 6.2).  PURE.
//
// A render region is cut into blocks of at most CLIPMAP_BLOCK x CLIPMAP_BLOCK cells.  A block's vertices are
// numbered y * CLIPMAP_ROW + x from its south-west corner, so that one list serves all blocks of its size, at
// every level.  Cells are split along (i, j)-(i+1, j+1), counter-clockwise seen from above.
//
// As published (section 6.1, figure 3), a region is four rectangles, or one, and each is cut into columns of
// at most CLIPMAP_COLUMN cells, few enough that a row finds the vertices of the row before in the vertex
// cache. (The paper's rows are of about 20 triangles; 19 cells draw faster than 10, with fewer triangles
// between rows.)  A column is one triangle strip, row
// after row northwards, joined by triangles of repeated vertices.  Its vertices are numbered as a block's, so
// that a column of fewer rows is the beginning of the list, and cropping a rectangle (section 6.4) needs no
// new indices.
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

enum clipmap_layout { CLIPMAP_LAYOUT_BLOCKS, CLIPMAP_LAYOUT_STRIPS };
enum clipmap_stitch { CLIPMAP_STITCH_NONE, CLIPMAP_STITCH_ZERO_AREA, CLIPMAP_STITCH_SPLIT };

enum {
    CLIPMAP_BLOCK = 8,     // cells: measured best of 4, 8 and 16 for every n
    CLIPMAP_ROW = 32,      // vertex numbers a row
    CLIPMAP_HALF_ROW = 64, // in split cells
    CLIPMAP_BLOCK_KINDS = CLIPMAP_BLOCK * CLIPMAP_BLOCK,
    CLIPMAP_ZERO_AREA_KINDS = CLIPMAP_SIDES * (CLIPMAP_BLOCK / 2),
    CLIPMAP_SPLIT_KINDS = CLIPMAP_SIDES * CLIPMAP_BLOCK,
    CLIPMAP_COLUMN = 19, // cells: 20 vertices a row
    CLIPMAP_STRIP_KINDS = CLIPMAP_COLUMN,
    CLIPMAP_FIRST_STRIP = CLIPMAP_BLOCK_KINDS + CLIPMAP_ZERO_AREA_KINDS + CLIPMAP_SPLIT_KINDS,
    CLIPMAP_KINDS = CLIPMAP_FIRST_STRIP + CLIPMAP_STRIP_KINDS, // triangle lists, then strips
    CLIPMAP_COLUMN_ROWS = 65536 / CLIPMAP_ROW - 1,             // that 16-bit vertex numbers allow
    CLIPMAP_RECTANGLES = 8,                                    // most that a region is cut into
};

// Which list: blocks of width x height cells, 1 .. CLIPMAP_BLOCK; zero-area stitches of `length` cells, even,
// along a side of the active region; split cells, 1 .. CLIPMAP_BLOCK, along a side of the hole, outside it;
// columns 1 .. CLIPMAP_COLUMN cells wide.
int clipmap_block_kind(int width, int height);
int clipmap_zero_area_kind(enum clipmap_side side, int length);
int clipmap_split_kind(enum clipmap_side side, int length);
int clipmap_column_kind(int width);

struct clipmap_mesh {
    uint16_t *indices; // all lists, one after the other; owned
    size_t count;
    struct clipmap_list {
        uint32_t first, count; // in indices
        uint32_t triangles;    // with those that join the rows of a strip
    } lists[CLIPMAP_KINDS];
};
// rows: of the tallest column, at most CLIPMAP_COLUMN_ROWS; 0 when none is drawn.
bool clipmap_mesh_init(struct clipmap_mesh *mesh, int rows);
void clipmap_mesh_finish(struct clipmap_mesh *mesh);
// The list of a kind; of a column the part for `rows` rows, which other kinds do not look at.
struct clipmap_list clipmap_mesh_list(const struct clipmap_mesh *mesh, int kind, int rows);

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

// The rectangles that the render region consists of: one without a hole, else south, north, west and east of
// it. Each cell of active less hole is in exactly one, but, with CLIPMAP_STITCH_SPLIT, the cells that share
// an edge with an open side of the hole are left to clipmap_cut_stitches, and those that touch it in a corner
// are rectangles too.  finer: the next finer region; NULL when there is none.  Returns their number; none is
// empty.
int clipmap_rectangles(const struct clipmap_region *region, const struct clipmap_region *finer,
                       enum clipmap_stitch stitch, struct clipmap_box rectangles[CLIPMAP_RECTANGLES]);

// Cuts a rectangle into columns of nearly equal width.  Returns their number.  clipmap_columns: that alone.
int clipmap_cut_columns(const struct clipmap_box *rectangle, const struct clipmap_taker *taker);
int clipmap_columns(const struct clipmap_box *rectangle);

// Cuts the rectangles into blocks of nearly equal size.  Returns the number of blocks, those left included.
int clipmap_cut_blocks(const struct clipmap_region *region, const struct clipmap_region *finer,
                       enum clipmap_stitch stitch, const struct clipmap_taker *taker);

// Stitches of the region's open sides (ZERO_AREA), or split cells round its hole (SPLIT), one by one. Returns
// their number.
int clipmap_cut_stitches(const struct clipmap_region *region, const struct clipmap_region *finer,
                         enum clipmap_stitch stitch, const struct clipmap_taker *taker);

#endif
