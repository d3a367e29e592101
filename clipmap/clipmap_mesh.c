// SPDX-License-Identifier: MIT
#include "clipmap/clipmap_mesh.h"

#include "common/report.h"

#include <stdlib.h>

int clipmap_block_kind(int width, int height)
{
    return (height - 1) * CLIPMAP_BLOCK + width - 1;
}

int clipmap_zero_area_kind(enum clipmap_side side, int length)
{
    return CLIPMAP_BLOCK_KINDS + (int)side * (CLIPMAP_BLOCK / 2) + length / 2 - 1;
}

int clipmap_split_kind(enum clipmap_side side, int length)
{
    return CLIPMAP_BLOCK_KINDS + CLIPMAP_ZERO_AREA_KINDS + (int)side * CLIPMAP_BLOCK + length - 1;
}

int clipmap_column_kind(int width)
{
    return CLIPMAP_FIRST_STRIP + width - 1;
}

// ---- index lists -----------------------------------------------------------

static void add_triangle(struct clipmap_mesh *mesh, int a, int b, int c)
{
    mesh->indices[mesh->count++] = (uint16_t)a;
    mesh->indices[mesh->count++] = (uint16_t)b;
    mesh->indices[mesh->count++] = (uint16_t)c;
}

static void begin_list(struct clipmap_mesh *mesh, int kind)
{
    mesh->lists[kind].first = (uint32_t)mesh->count;
}

static void end_list(struct clipmap_mesh *mesh, int kind)
{
    struct clipmap_list *list = &mesh->lists[kind];
    list->count = (uint32_t)mesh->count - list->first;
    list->triangles = list->count / 3;
}

static void add_block(struct clipmap_mesh *mesh, int width, int height)
{
    begin_list(mesh, clipmap_block_kind(width, height));
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            int south_west = y * CLIPMAP_ROW + x, north_east = south_west + CLIPMAP_ROW + 1;
            add_triangle(mesh, south_west + CLIPMAP_ROW, south_west, north_east);
            add_triangle(mesh, north_east, south_west, south_west + 1);
        }
    end_list(mesh, clipmap_block_kind(width, height));
}

static void add_zero_area(struct clipmap_mesh *mesh, enum clipmap_side side, int length)
{
    bool along_x = side == CLIPMAP_SOUTH || side == CLIPMAP_NORTH;
    int step = along_x ? 1 : CLIPMAP_ROW;
    begin_list(mesh, clipmap_zero_area_kind(side, length));
    for (int i = 0; i < length; i += 2) {
        int a = i * step, middle = a + step, b = middle + step;
        if (side == CLIPMAP_SOUTH || side == CLIPMAP_EAST) // the coarse level is to the right of a -> b
            add_triangle(mesh, a, b, middle);
        else
            add_triangle(mesh, b, a, middle);
    }
    end_list(mesh, clipmap_zero_area_kind(side, length));
}

// A cell beyond `side` of the hole: the triangle that has its edge on the hole becomes two.
static void add_split_cell(struct clipmap_mesh *mesh, enum clipmap_side side, int south_west)
{
    int east = 2, north = 2 * CLIPMAP_HALF_ROW;
    int south_east = south_west + east, north_west = south_west + north, north_east = south_east + north;
    switch (side) {
    case CLIPMAP_WEST: // the hole is east of the cell
        add_triangle(mesh, south_west, south_east, south_east + north / 2);
        add_triangle(mesh, south_west, south_east + north / 2, north_east);
        add_triangle(mesh, south_west, north_east, north_west);
        break;
    case CLIPMAP_SOUTH:
        add_triangle(mesh, south_west, south_east, north_east);
        add_triangle(mesh, south_west, north_east, north_west + east / 2);
        add_triangle(mesh, south_west, north_west + east / 2, north_west);
        break;
    case CLIPMAP_EAST:
        add_triangle(mesh, south_west, south_east, north_east);
        add_triangle(mesh, south_west, north_east, south_west + north / 2);
        add_triangle(mesh, south_west + north / 2, north_east, north_west);
        break;
    default:
        add_triangle(mesh, south_west, south_west + east / 2, north_east);
        add_triangle(mesh, south_west + east / 2, south_east, north_east);
        add_triangle(mesh, south_west, north_east, north_west);
    }
}

static void add_split(struct clipmap_mesh *mesh, enum clipmap_side side, int length)
{
    bool along_x = side == CLIPMAP_SOUTH || side == CLIPMAP_NORTH;
    begin_list(mesh, clipmap_split_kind(side, length));
    for (int i = 0; i < length; i++) add_split_cell(mesh, side, 2 * i * (along_x ? 1 : CLIPMAP_HALF_ROW));
    end_list(mesh, clipmap_split_kind(side, length));
}

// Indices of a column, 2 a row for its joint to the row before.
static uint32_t column_indices(int width, int rows)
{
    return rows > 0 ? (uint32_t)(rows * (2 * (width + 1) + 2) - 2) : 0;
}

static void add_column(struct clipmap_mesh *mesh, int width, int rows)
{
    struct clipmap_list *list = &mesh->lists[clipmap_column_kind(width)];
    list->first = (uint32_t)mesh->count;
    for (int y = 0; y < rows; y++) {
        int south_west = y * CLIPMAP_ROW;
        if (y > 0) { // an even number of repetitions keeps the strip's sense of turning
            mesh->indices[mesh->count] = mesh->indices[mesh->count - 1];
            mesh->indices[mesh->count + 1] = (uint16_t)(south_west + CLIPMAP_ROW);
            mesh->count += 2;
        }
        for (int x = 0; x <= width; x++) {
            mesh->indices[mesh->count++] = (uint16_t)(south_west + CLIPMAP_ROW + x);
            mesh->indices[mesh->count++] = (uint16_t)(south_west + x);
        }
    }
    list->count = (uint32_t)mesh->count - list->first;
    list->triangles = rows > 0 ? list->count - 2 : 0;
}

struct clipmap_list clipmap_mesh_list(const struct clipmap_mesh *mesh, int kind, int rows)
{
    struct clipmap_list list = mesh->lists[kind];
    if (kind < CLIPMAP_FIRST_STRIP) return list;
    list.count = column_indices(kind - CLIPMAP_FIRST_STRIP + 1, rows);
    list.triangles = list.count - 2;
    return list;
}

bool clipmap_mesh_init(struct clipmap_mesh *mesh, int rows)
{
    const size_t cells = CLIPMAP_BLOCK * (CLIPMAP_BLOCK + 1) / 2;         // 1 + 2 + ... + CLIPMAP_BLOCK
    const size_t pairs = CLIPMAP_BLOCK / 2 * (CLIPMAP_BLOCK / 2 + 1) / 2; // 1 + 2 + ... + CLIPMAP_BLOCK / 2
    const size_t triangles = 2 * cells * cells + CLIPMAP_SIDES * (pairs + 3 * cells);
    size_t indices = 3 * triangles;
    for (int width = 1; width <= CLIPMAP_COLUMN; width++) indices += column_indices(width, rows);
    *mesh = (struct clipmap_mesh){.indices = malloc(indices * sizeof *mesh->indices)};
    if (!mesh->indices) return fail("clipmap: no memory for index lists");
    for (int height = 1; height <= CLIPMAP_BLOCK; height++)
        for (int width = 1; width <= CLIPMAP_BLOCK; width++) add_block(mesh, width, height);
    for (int side = 0; side < CLIPMAP_SIDES; side++) {
        for (int length = 2; length <= CLIPMAP_BLOCK; length += 2)
            add_zero_area(mesh, (enum clipmap_side)side, length);
        for (int length = 1; length <= CLIPMAP_BLOCK; length++)
            add_split(mesh, (enum clipmap_side)side, length);
    }
    for (int width = 1; width <= CLIPMAP_COLUMN; width++) add_column(mesh, width, rows);
    return true;
}

void clipmap_mesh_finish(struct clipmap_mesh *mesh)
{
    free(mesh->indices);
    mesh->indices = NULL;
}

// ---- cutting regions -------------------------------------------------------

// Part `index` of `parts` nearly equal parts of `length`.
static int64_t part_start(int64_t length, int64_t parts, int64_t index)
{
    return length / parts * index + (index < length % parts ? index : length % parts);
}

static int64_t parts_of(int64_t length, int most)
{
    return (length + most - 1) / most;
}

struct cut { // of a box into a grid of nearly equal parts
    const struct clipmap_box *box;
    int64_t length[2], parts[2];
    const struct clipmap_taker *taker;
    enum clipmap_layout layout;
};

static int64_t line(const struct cut *cut, int axis, int64_t part)
{
    return cut->box->lo[axis] + part_start(cut->length[axis], cut->parts[axis], part);
}

static void take_block(const struct cut *cut, const struct clipmap_box *block, unsigned planes)
{
    struct clipmap_piece piece = {.corner = {block->lo[0], block->lo[1]}};
    for (int axis = 0; axis < 2; axis++) piece.extent[axis] = (int)(block->hi[axis] - block->lo[axis]);
    piece.kind = cut->layout == CLIPMAP_LAYOUT_STRIPS ? clipmap_column_kind(piece.extent[0])
                                                      : clipmap_block_kind(piece.extent[0], piece.extent[1]);
    cut->taker->take(cut->taker->user, &piece, planes);
}

// Blocks first .. end - 1 on each axis, halved along the longer side until one is left.
static void take_blocks(const struct cut *cut, const int64_t first[2], const int64_t end[2], unsigned planes)
{
    struct clipmap_box group;
    for (int axis = 0; axis < 2; axis++) {
        group.lo[axis] = line(cut, axis, first[axis]);
        group.hi[axis] = line(cut, axis, end[axis]);
    }
    if (planes && cut->taker->enter) planes = cut->taker->enter(cut->taker->user, &group, planes);
    if (planes == CLIPMAP_LEAVE) return;
    int64_t columns = end[0] - first[0], rows = end[1] - first[1];
    if (columns == 1 && rows == 1) {
        take_block(cut, &group, planes);
        return;
    }
    int axis = rows > columns;
    int64_t middle[2] = {first[0], first[1]}, near_end[2] = {end[0], end[1]};
    middle[axis] = near_end[axis] = (first[axis] + end[axis]) / 2;
    take_blocks(cut, first, near_end, planes);
    take_blocks(cut, middle, end, planes);
}

static int cut_box(const struct clipmap_box *box, const struct clipmap_taker *taker)
{
    struct cut cut = {.box = box, .taker = taker, .layout = CLIPMAP_LAYOUT_BLOCKS};
    const int64_t first[2] = {0, 0};
    for (int axis = 0; axis < 2; axis++) {
        cut.length[axis] = box->hi[axis] - box->lo[axis];
        cut.parts[axis] = parts_of(cut.length[axis], CLIPMAP_BLOCK);
    }
    take_blocks(&cut, first, cut.parts, taker->planes);
    return (int)(cut.parts[0] * cut.parts[1]);
}

int clipmap_columns(const struct clipmap_box *rectangle)
{
    return (int)parts_of(rectangle->hi[0] - rectangle->lo[0], CLIPMAP_COLUMN);
}

int clipmap_cut_columns(const struct clipmap_box *rectangle, const struct clipmap_taker *taker)
{
    struct cut cut = {.box = rectangle, .taker = taker, .layout = CLIPMAP_LAYOUT_STRIPS};
    const int64_t first[2] = {0, 0};
    for (int axis = 0; axis < 2; axis++) cut.length[axis] = rectangle->hi[axis] - rectangle->lo[axis];
    cut.parts[0] = clipmap_columns(rectangle), cut.parts[1] = 1;
    take_blocks(&cut, first, cut.parts, taker->planes);
    return (int)cut.parts[0];
}

// What the blocks leave out: the hole and, when edges are split, the cells round its open sides.
static struct clipmap_box left_out(const struct clipmap_region *region, const struct clipmap_region *finer,
                                   enum clipmap_stitch stitch)
{
    struct clipmap_box out = region->hole;
    for (int axis = 0; stitch == CLIPMAP_STITCH_SPLIT && axis < 2; axis++) {
        out.lo[axis] -= finer->open[axis];
        out.hi[axis] += finer->open[axis + 2];
    }
    return out;
}

static void keep(struct clipmap_box rectangles[CLIPMAP_RECTANGLES], int *count, const struct clipmap_box *box)
{
    if (box->lo[0] < box->hi[0] && box->lo[1] < box->hi[1]) rectangles[(*count)++] = *box;
}

// Cells that touch the hole in a corner alone are not split.
static void keep_corners(const struct clipmap_box *hole, const struct clipmap_box *out,
                         struct clipmap_box rectangles[CLIPMAP_RECTANGLES], int *count)
{
    for (int corner = 0; corner < 4; corner++) {
        struct clipmap_box box;
        for (int axis = 0; axis < 2; axis++) {
            bool high = corner >> axis & 1;
            box.lo[axis] = high ? hole->hi[axis] : out->lo[axis];
            box.hi[axis] = high ? out->hi[axis] : hole->lo[axis];
        }
        keep(rectangles, count, &box);
    }
}

int clipmap_rectangles(const struct clipmap_region *region, const struct clipmap_region *finer,
                       enum clipmap_stitch stitch, struct clipmap_box rectangles[CLIPMAP_RECTANGLES])
{
    struct clipmap_box active = region->active, box;
    int count = 0;
    if (clipmap_box_is_empty(&active)) return 0;
    if (clipmap_box_is_empty(&region->hole)) {
        keep(rectangles, &count, &active);
        return count;
    }
    struct clipmap_box out = left_out(region, finer, stitch);
    for (int axis = 0; axis < 2; axis++) { // beyond a closed side of the hole there is no map
        if (!finer->open[axis]) active.lo[axis] = out.lo[axis];
        if (!finer->open[axis + 2]) active.hi[axis] = out.hi[axis];
    }
    box = active, box.hi[1] = out.lo[1]; // south of the hole, over the whole width
    keep(rectangles, &count, &box);
    box = active, box.lo[1] = out.hi[1]; // north
    keep(rectangles, &count, &box);
    active.lo[1] = out.lo[1], active.hi[1] = out.hi[1];
    box = active, box.hi[0] = out.lo[0]; // west
    keep(rectangles, &count, &box);
    box = active, box.lo[0] = out.hi[0]; // east
    keep(rectangles, &count, &box);
    keep_corners(&region->hole, &out, rectangles, &count);
    return count;
}

int clipmap_cut_blocks(const struct clipmap_region *region, const struct clipmap_region *finer,
                       enum clipmap_stitch stitch, const struct clipmap_taker *taker)
{
    struct clipmap_box rectangles[CLIPMAP_RECTANGLES];
    int count = 0, rectangle_count = clipmap_rectangles(region, finer, stitch, rectangles);
    for (int i = 0; i < rectangle_count; i++) count += cut_box(&rectangles[i], taker);
    return count;
}

// Stretches of `length` cells along `side` of a box from `corner` on, none longer than a list.
static int cut_side(enum clipmap_side side, const int64_t corner[2], int64_t length,
                    enum clipmap_stitch stitch, const struct clipmap_taker *taker)
{
    int across = side & 1, along = 1 - across; // west and east run along y
    bool split = stitch == CLIPMAP_STITCH_SPLIT;
    int unit = split ? 1 : 2; // zero-area stitches take edges in pairs
    int64_t units = length / unit, parts = parts_of(units, CLIPMAP_BLOCK / unit);
    for (int64_t part = 0; part < parts; part++) {
        int64_t from = unit * part_start(units, parts, part), to = unit * part_start(units, parts, part + 1);
        struct clipmap_piece piece = {.corner = {corner[0], corner[1]}};
        piece.corner[along] += from;
        piece.extent[along] = (int)(to - from);
        piece.extent[across] = split;
        piece.kind = split ? clipmap_split_kind(side, piece.extent[along])
                           : clipmap_zero_area_kind(side, piece.extent[along]);
        taker->take(taker->user, &piece, taker->planes);
    }
    return (int)parts;
}

int clipmap_cut_stitches(const struct clipmap_region *region, const struct clipmap_region *finer,
                         enum clipmap_stitch stitch, const struct clipmap_taker *taker)
{
    bool split = stitch == CLIPMAP_STITCH_SPLIT;
    const struct clipmap_box *box = split ? &region->hole : &region->active;
    const struct clipmap_region *inner = split ? finer : region;
    if (stitch == CLIPMAP_STITCH_NONE || clipmap_box_is_empty(box)) return 0;
    int count = 0;
    for (int side = 0; side < CLIPMAP_SIDES; side++) {
        if (!inner->open[side]) continue;
        int across = side & 1, along = 1 - across;
        int64_t corner[2];
        corner[along] = box->lo[along];
        corner[across] = side < CLIPMAP_EAST ? box->lo[across] - split : box->hi[across];
        count += cut_side((enum clipmap_side)side, corner, box->hi[along] - box->lo[along], stitch, taker);
    }
    return count;
}
