// SPDX-License-Identifier: MIT
#include "clipmap/clipmap_mesh.h"

#include "common/report.h"

#include <stdlib.h>

int clipmap_block_kind(int width, int height)
{
    return (height - 1) * CLIPMAP_BLOCK + width - 1;
}

int clipmap_stitch_kind(enum clipmap_side side, int length)
{
    return CLIPMAP_BLOCK_KINDS + (int)side * (CLIPMAP_BLOCK / 2) + length / 2 - 1;
}

// ---- index lists
// ------------------------------------------------------------------------------------------------

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
    mesh->lists[kind].count = (uint32_t)mesh->count - mesh->lists[kind].first;
}

static void add_block(struct clipmap_mesh *mesh, int width, int height)
{
    begin_list(mesh, clipmap_block_kind(width, height));
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            int south_west = y * CLIPMAP_ROW + x, north_east = south_west + CLIPMAP_ROW + 1;
            add_triangle(mesh, south_west, south_west + 1, north_east);
            add_triangle(mesh, south_west, north_east, south_west + CLIPMAP_ROW);
        }
    end_list(mesh, clipmap_block_kind(width, height));
}

static void add_stitch(struct clipmap_mesh *mesh, enum clipmap_side side, int length)
{
    bool along_x = side == CLIPMAP_SOUTH || side == CLIPMAP_NORTH;
    int step = along_x ? 1 : CLIPMAP_ROW;
    begin_list(mesh, clipmap_stitch_kind(side, length));
    for (int i = 0; i < length; i += 2) {
        int a = i * step, middle = a + step, b = middle + step;
        if (side == CLIPMAP_SOUTH || side == CLIPMAP_EAST) // the coarse level is to the right of a -> b
            add_triangle(mesh, a, b, middle);
        else
            add_triangle(mesh, b, a, middle);
    }
    end_list(mesh, clipmap_stitch_kind(side, length));
}

bool clipmap_mesh_init(struct clipmap_mesh *mesh)
{
    const size_t sums = CLIPMAP_BLOCK * (CLIPMAP_BLOCK + 1) / 2;            // 1 + 2 + ... + CLIPMAP_BLOCK
    const size_t pairs = (CLIPMAP_BLOCK / 2) * (CLIPMAP_BLOCK / 2 + 1) / 2; // 1 + 2 + ... + CLIPMAP_BLOCK / 2
    *mesh = (struct clipmap_mesh){
        .indices = malloc((6 * sums * sums + 3 * CLIPMAP_SIDES * pairs) * sizeof(uint16_t))};
    if (!mesh->indices) return fail("clipmap: no memory for index lists");
    for (int height = 1; height <= CLIPMAP_BLOCK; height++)
        for (int width = 1; width <= CLIPMAP_BLOCK; width++) add_block(mesh, width, height);
    for (int side = 0; side < CLIPMAP_SIDES; side++)
        for (int length = 2; length <= CLIPMAP_BLOCK; length += 2)
            add_stitch(mesh, (enum clipmap_side)side, length);
    return true;
}

void clipmap_mesh_finish(struct clipmap_mesh *mesh)
{
    free(mesh->indices);
    mesh->indices = NULL;
}

// ---- cutting regions
// --------------------------------------------------------------------------------------------

// Part `index` of `parts` nearly equal parts of `length`.
static int64_t part_start(int64_t length, int64_t parts, int64_t index)
{
    return length / parts * index + (index < length % parts ? index : length % parts);
}

static int64_t parts_of(int64_t length, int most)
{
    return (length + most - 1) / most;
}

static void cut_box(const struct clipmap_box *box, clipmap_piece_fn *take, void *user)
{
    int64_t width = box->hi[0] - box->lo[0], height = box->hi[1] - box->lo[1];
    if (width <= 0 || height <= 0) return;
    int64_t columns = parts_of(width, CLIPMAP_BLOCK), rows = parts_of(height, CLIPMAP_BLOCK);
    for (int64_t row = 0; row < rows; row++)
        for (int64_t column = 0; column < columns; column++) {
            int64_t x = part_start(width, columns, column), y = part_start(height, rows, row);
            struct clipmap_piece piece = {.corner = {box->lo[0] + x, box->lo[1] + y}};
            piece.extent[0] = (int)(part_start(width, columns, column + 1) - x);
            piece.extent[1] = (int)(part_start(height, rows, row + 1) - y);
            piece.kind = clipmap_block_kind(piece.extent[0], piece.extent[1]);
            take(user, &piece);
        }
}

void clipmap_cut_blocks(const struct clipmap_region *region, const struct clipmap_region *finer,
                        clipmap_piece_fn *take, void *user)
{
    struct clipmap_box active = region->active, box = active;
    const struct clipmap_box *hole = &region->hole;
    if (clipmap_box_is_empty(&active)) return;
    if (clipmap_box_is_empty(hole)) {
        cut_box(&active, take, user);
        return;
    }
    for (int axis = 0; axis < 2; axis++) { // beyond a closed side of the hole there is no map
        if (!finer->open[axis]) active.lo[axis] = hole->lo[axis];
        if (!finer->open[axis + 2]) active.hi[axis] = hole->hi[axis];
    }
    box = active, box.hi[1] = hole->lo[1]; // south of the hole, over the whole width
    cut_box(&box, take, user);
    box = active, box.lo[1] = hole->hi[1]; // north
    cut_box(&box, take, user);
    active.lo[1] = hole->lo[1], active.hi[1] = hole->hi[1];
    box = active, box.hi[0] = hole->lo[0]; // west
    cut_box(&box, take, user);
    box = active, box.lo[0] = hole->hi[0]; // east
    cut_box(&box, take, user);
}

void clipmap_cut_stitches(const struct clipmap_region *region, clipmap_piece_fn *take, void *user)
{
    const struct clipmap_box *active = &region->active;
    for (int side = 0; side < CLIPMAP_SIDES && !clipmap_box_is_empty(active); side++) {
        if (!region->open[side]) continue;
        int across = side & 1, along = 1 - across; // west and east run along y
        int64_t pairs = (active->hi[along] - active->lo[along]) / 2,
                parts = parts_of(pairs, CLIPMAP_BLOCK / 2);
        for (int64_t part = 0; part < parts; part++) {
            int64_t from = 2 * part_start(pairs, parts, part), to = 2 * part_start(pairs, parts, part + 1);
            struct clipmap_piece piece = {.extent = {0, 0}};
            piece.corner[along] = active->lo[along] + from;
            piece.corner[across] = side < CLIPMAP_EAST ? active->lo[across] : active->hi[across];
            piece.extent[along] = (int)(to - from);
            piece.kind = clipmap_stitch_kind((enum clipmap_side)side, piece.extent[along]);
            take(user, &piece);
        }
    }
}
