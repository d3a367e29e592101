// SPDX-License-Identifier: MIT
#include "geomipmap/geomipmap_select.h"

#include "common/report.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

bool geomipmap_selection_init(struct geomipmap_selection *selection, const struct geomipmap_tiles *tiles)
{
    int count = tiles->tiles.columns * tiles->tiles.rows;
    *selection = (struct geomipmap_selection){.tile_count = count};
    selection->picks = malloc((size_t)count * sizeof *selection->picks);
    selection->level = malloc((size_t)count);
    if (!selection->picks || !selection->level) {
        geomipmap_selection_finish(selection);
        return fail("geomipmap: no memory to select from %d tiles", count);
    }
    memset(selection->level, GEOMIPMAP_NOT_DRAWN, (size_t)count);
    return true;
}

void geomipmap_selection_finish(struct geomipmap_selection *selection)
{
    free(selection->picks);
    free(selection->level);
    *selection = (struct geomipmap_selection){0};
}

struct scan { // of one view
    struct geomipmap_selection *selection;
    const struct geomipmap_tiles *tiles;
    const struct view *view;
    bool cull;
    struct frustum frustum;
    struct geomipmap_judge judge;
    double corner_m[2]; // south-west corner of tile (0, 0), relative to the eye
    double tile_m[2];   // size of a tile
    double eye_tile[2]; // the eye, in tiles
};

struct box { // relative to the eye, metres
    double low[3], high[3];
};

// `columns` x `rows` tiles from (column, row).
static struct box scan_box(const struct scan *scan, int column, int row, int columns, int rows,
                           struct geomipmap_range range)
{
    const struct geomipmap_tiles *tiles = scan->tiles;
    double ground = tiles->offset_m - scan->view->eye_m[2];
    return (struct box){
        .low = {scan->corner_m[0] + column * scan->tile_m[0], scan->corner_m[1] + row * scan->tile_m[1],
                ground + range.low * tiles->quantum_m},
        .high = {scan->corner_m[0] + (column + columns) * scan->tile_m[0],
                 scan->corner_m[1] + (row + rows) * scan->tile_m[1], ground + range.high * tiles->quantum_m},
    };
}

static double box_depth(const struct box *box, const double forward[3])
{
    double depth = 0;
    for (int axis = 0; axis < 3; axis++)
        depth += forward[axis] * (forward[axis] > 0 ? box->low[axis] : box->high[axis]);
    return depth;
}

static double box_distance(const struct box *box)
{
    double squares = 0;
    for (int axis = 0; axis < 3; axis++) {
        double away = fmax(fmax(box->low[axis], -box->high[axis]), 0);
        squares += away * away;
    }
    return sqrt(squares);
}

static int choose_level(const struct scan *scan, const struct box *box, bool whole, const float *error)
{
    const struct geomipmap_judge *judge = &scan->judge;
    int levels = scan->tiles->levels;
    double unit = 1 / scan->tiles->quantum_m;
    double depth = fmax(box_depth(box, scan->view->forward), scan->view->near_m);
    double distance = judge->metric == GEOMIPMAP_PAPER ? box_distance(box) : 0;
    int level = geomipmap_choose(error, levels, geomipmap_allowed(judge, depth, distance) * unit);
    if (whole || level == levels - 1 || judge->metric == GEOMIPMAP_PAPER) return level;
    // Only part of the box is seen, and that part may begin farther away (numerics.md, C2).
    double rect[4], seen_depth;
    if (!frustum_clip_box(scan->view, box->low, box->high, rect, &seen_depth)) return levels - 1;
    return geomipmap_choose(error, levels,
                            geomipmap_allowed(judge, fmax(depth, seen_depth), distance) * unit);
}

static void add_pick(struct scan *scan, int tile, int level)
{
    struct geomipmap_selection *selection = scan->selection;
    selection->picks[selection->count++] = (struct geomipmap_pick){.tile = tile, .level = level};
    selection->level[tile] = (uint8_t)level;
}

static void scan_tile(struct scan *scan, int column, int row, unsigned mask)
{
    const struct geomipmap_tiles *tiles = scan->tiles;
    int tile = row * tiles->tiles.columns + column;
    struct box box = scan_box(scan, column, row, 1, 1, tiles->tiles.range[tile]);
    enum frustum_side side =
        mask ? frustum_test_box(&scan->frustum, box.low, box.high, &mask) : FRUSTUM_INSIDE;
    if (side != FRUSTUM_OUTSIDE)
        add_pick(
            scan, tile,
            choose_level(scan, &box, side == FRUSTUM_INSIDE, tiles->error + (size_t)tile * tiles->levels));
    else if (!scan->cull)
        add_pick(scan, tile, tiles->levels - 1);
}

// The n-th of the cells first..end-1 in an order that is front to back as seen from cell `eye`: from there
// upwards, then from there downwards.  Cells on either side of the eye never hide each other.
static int outward(int eye, int first, int end, int n)
{
    int start = eye < first ? first : eye > end ? end : eye;
    return n < end - start ? start + n : start - 1 - (n - (end - start));
}

static int clamp_cell(double cell, int count)
{
    return cell < 0 ? -1 : cell >= count ? count : (int)cell;
}

static void scan_block(struct scan *scan, int column, int row, unsigned mask)
{
    const struct geomipmap_tiles *tiles = scan->tiles;
    int first_column = column * GEOMIPMAP_BLOCK, first_row = row * GEOMIPMAP_BLOCK;
    int end_column = first_column + GEOMIPMAP_BLOCK, end_row = first_row + GEOMIPMAP_BLOCK;
    if (end_column > tiles->tiles.columns) end_column = tiles->tiles.columns;
    if (end_row > tiles->tiles.rows) end_row = tiles->tiles.rows;
    struct box box = scan_box(scan, first_column, first_row, end_column - first_column, end_row - first_row,
                              tiles->blocks.range[(size_t)row * tiles->blocks.columns + column]);
    if (mask && frustum_test_box(&scan->frustum, box.low, box.high, &mask) == FRUSTUM_OUTSIDE) {
        if (scan->cull) return;
        mask = FRUSTUM_ALL;
    }
    int eye_column = clamp_cell(scan->eye_tile[0], tiles->tiles.columns);
    int eye_row = clamp_cell(scan->eye_tile[1], tiles->tiles.rows);
    for (int j = 0; j < end_row - first_row; j++)
        for (int i = 0; i < end_column - first_column; i++)
            scan_tile(scan, outward(eye_column, first_column, end_column, i),
                      outward(eye_row, first_row, end_row, j), mask);
}

static void scan_blocks(struct scan *scan)
{
    const struct geomipmap_tiles *tiles = scan->tiles;
    unsigned mask = FRUSTUM_ALL;
    struct box box = scan_box(scan, 0, 0, tiles->tiles.columns, tiles->tiles.rows, tiles->range);
    if (frustum_test_box(&scan->frustum, box.low, box.high, &mask) == FRUSTUM_OUTSIDE) {
        if (scan->cull) return;
        mask = FRUSTUM_ALL;
    }
    int eye_column = clamp_cell(scan->eye_tile[0] / GEOMIPMAP_BLOCK, tiles->blocks.columns);
    int eye_row = clamp_cell(scan->eye_tile[1] / GEOMIPMAP_BLOCK, tiles->blocks.rows);
    for (int j = 0; j < tiles->blocks.rows; j++)
        for (int i = 0; i < tiles->blocks.columns; i++)
            scan_block(scan, outward(eye_column, 0, tiles->blocks.columns, i),
                       outward(eye_row, 0, tiles->blocks.rows, j), mask);
}

// The level that a neighbour asks of this tile's edge: its own, or none when it is not drawn or not there.
static int level_at(const struct scan *scan, int column, int row, int otherwise)
{
    const struct geomipmap_grid *grid = &scan->tiles->tiles;
    if (column < 0 || row < 0 || column >= grid->columns || row >= grid->rows) return otherwise;
    int level = scan->selection->level[row * grid->columns + column];
    return level == GEOMIPMAP_NOT_DRAWN ? otherwise : level;
}

static void choose_sets(struct scan *scan)
{
    int columns = scan->tiles->tiles.columns;
    for (int i = 0; i < scan->selection->count; i++) {
        struct geomipmap_pick *pick = &scan->selection->picks[i];
        int column = pick->tile % columns, row = pick->tile / columns, neighbours[GEOMIPMAP_SIDES];
        neighbours[GEOMIPMAP_SOUTH] = level_at(scan, column, row - 1, pick->level);
        neighbours[GEOMIPMAP_EAST] = level_at(scan, column + 1, row, pick->level);
        neighbours[GEOMIPMAP_NORTH] = level_at(scan, column, row + 1, pick->level);
        neighbours[GEOMIPMAP_WEST] = level_at(scan, column - 1, row, pick->level);
        pick->set = geomipmap_mesh_set(pick->level, neighbours);
    }
}

void geomipmap_select(struct geomipmap_selection *selection, const struct geomipmap_tiles *tiles,
                      const struct geomipmap_choice *choice, const struct view *view)
{
    for (int i = 0; i < selection->count; i++)
        selection->level[selection->picks[i].tile] = GEOMIPMAP_NOT_DRAWN;
    selection->count = 0;
    struct scan scan = {.selection = selection, .tiles = tiles, .view = view, .cull = choice->cull};
    struct view_origin eye = view_level_origin(view, tiles->finest);
    const int64_t first[2] = {tiles->x0, tiles->y0};
    frustum_init(&scan.frustum, view);
    geomipmap_judge_init(&scan.judge, choice->metric, choice->tau_px, view);
    for (int axis = 0; axis < 2; axis++) {
        scan.tile_m[axis] = tiles->spacing_m[axis] * (1 << tiles->bits);
        // Cells first: the difference of two large integers is exact.
        double cells = (double)(first[axis] - eye.base[axis]) - (double)eye.fraction[axis];
        scan.corner_m[axis] = cells * tiles->spacing_m[axis];
        scan.eye_tile[axis] = -scan.corner_m[axis] / scan.tile_m[axis];
    }
    scan_blocks(&scan);
    choose_sets(&scan);
}
