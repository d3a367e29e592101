// SPDX-License-Identifier: MIT
#include "geomipmap/geomipmap_select.h"

#include "common/report.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { NONE = -1, FIRST_ROOM = 1024 };

static bool reserve(struct geomipmap_selection *selection, int room)
{
    struct geomipmap_pick *picks = realloc(selection->picks, (size_t)room * sizeof *picks);
    if (picks) selection->picks = picks;
    struct geomipmap_pick *list = realloc(selection->list, (size_t)room * sizeof *list);
    if (list) selection->list = list;
    if (!picks || !list) return fail("geomipmap: no memory to select %d tiles", room);
    selection->room = room;
    return true;
}

// Tiles may stick out of the map.
static size_t corners_across(const struct geomipmap_tiles *tiles, int tiles_across)
{
    return ((size_t)tiles_across << tiles->top) + 1;
}

static size_t corner_count(const struct geomipmap_tiles *tiles)
{
    const struct geomipmap_grid *top = &tiles->grid[tiles->top];
    return tiles->filtered ? corners_across(tiles, top->columns) * corners_across(tiles, top->rows) : 0;
}

bool geomipmap_selection_init(struct geomipmap_selection *selection, const struct geomipmap_tiles *tiles)
{
    size_t count = (size_t)tiles->grid[0].columns * (size_t)tiles->grid[0].rows;
    *selection = (struct geomipmap_selection){.cover = malloc(count * sizeof *selection->cover),
                                              .corners = malloc(corner_count(tiles) + 1),
                                              .last_step = malloc(count)};
    if (!selection->cover || !selection->last_step || !selection->corners ||
        !reserve(selection, FIRST_ROOM)) {
        geomipmap_selection_finish(selection);
        return fail("geomipmap: no memory to select from %zu tiles", count);
    }
    memset(selection->cover, GEOMIPMAP_NOTHING, count * sizeof *selection->cover);
    geomipmap_selection_restart(selection, tiles);
    return true;
}

void geomipmap_selection_finish(struct geomipmap_selection *selection)
{
    free(selection->picks);
    free(selection->list);
    free(selection->cover);
    free(selection->corners);
    free(selection->last_step);
    *selection = (struct geomipmap_selection){0};
}

void geomipmap_selection_restart(struct geomipmap_selection *selection, const struct geomipmap_tiles *tiles)
{
    memset(selection->last_step, GEOMIPMAP_NOTHING,
           (size_t)tiles->grid[0].columns * (size_t)tiles->grid[0].rows);
}

size_t geomipmap_selection_bytes(const struct geomipmap_selection *selection,
                                 const struct geomipmap_tiles *tiles)
{
    size_t count = (size_t)tiles->grid[0].columns * (size_t)tiles->grid[0].rows;
    return corner_count(tiles) + count * (sizeof *selection->cover + sizeof *selection->last_step) +
           (size_t)selection->room * (sizeof *selection->picks + sizeof *selection->list);
}

struct scan { // of one view
    struct geomipmap_selection *selection;
    const struct geomipmap_tiles *tiles;
    const struct view *view;
    struct frustum frustum;
    struct geomipmap_judge judge;
    bool cull;
    enum geomipmap_borders borders;
    double hysteresis;
    bool morph;
    struct terrain_reader *reader;
    double corner_m[2]; // south-west corner of the map, relative to the eye
    double tile_m[2];   // size of a tile of height 0
    double eye_tile[2]; // the eye, in tiles of height 0
    int last;           // pick after which the next one goes
    bool failed;
};

// ---- levels -------------------------------------------------------------------------------------

struct box { // relative to the eye, metres
    double low[3], high[3];
};

static struct box tile_box(const struct scan *scan, struct geomipmap_place place)
{
    const struct geomipmap_tiles *tiles = scan->tiles;
    struct geomipmap_range range = geomipmap_tiles_range(tiles, place);
    double ground = tiles->offset_m - scan->view->eye_m[2];
    const int cell[2] = {place.column, place.row};
    struct box box = {.low = {0, 0, ground + range.low * tiles->quantum_m},
                      .high = {0, 0, ground + range.high * tiles->quantum_m}};
    for (int axis = 0; axis < 2; axis++) {
        double size = scan->tile_m[axis] * (1 << place.height);
        box.low[axis] = scan->corner_m[axis] + cell[axis] * size;
        box.high[axis] = scan->corner_m[axis] + (cell[axis] + 1) * size;
    }
    return box;
}

// Least (sign 1) or greatest (sign -1) depth of a box.
static double box_depth(const struct box *box, const double forward[3], double sign)
{
    double depth = 0;
    for (int axis = 0; axis < 3; axis++)
        depth += forward[axis] * (forward[axis] * sign > 0 ? box->low[axis] : box->high[axis]);
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

// The finest step that was drawn of a tile when it was last seen.
static int last_step(const struct scan *scan, struct geomipmap_place place)
{
    const struct geomipmap_grid *grid = &scan->tiles->grid[0];
    int size = 1 << place.height, column = place.column * size, row = place.row * size,
        least = GEOMIPMAP_NOTHING;
    for (int j = row; j < row + size && j < grid->rows; j++)
        for (int i = column; i < column + size && i < grid->columns; i++) {
            int step = scan->selection->last_step[(size_t)j * (size_t)grid->columns + (size_t)i];
            least = step < least ? step : least;
        }
    return least;
}

struct asked { // a tile whose level is sought
    const float *error;
    int kept; // level that it had
};

struct grade { // of detail
    int level;
    uint8_t morph;
    double depth_m;
};

// How far the level's error is from what is allowed, towards the next coarser level's: the mean of both
// surfaces so weighted is as wrong as is allowed.
static uint8_t morph_of(const float *error, int level, double allowed)
{
    double from = (double)error[level], to = (double)error[level + 1];
    return to > from ? (uint8_t)(fmin(fmax((allowed - from) / (to - from), 0), 1) * GEOMIPMAP_MORPHED) : 0;
}

static struct grade grade_at_depth(const struct scan *scan, const struct asked *asked, double depth,
                                   double distance)
{
    double allowed =
        geomipmap_allowed(&scan->judge, fmax(depth, scan->view->near_m), distance) / scan->tiles->quantum_m;
    int level = geomipmap_choose(asked->error, scan->tiles->levels, allowed, asked->kept,
                                 allowed * (1 - scan->hysteresis));
    bool last = level == scan->tiles->levels - 1;
    return (struct grade){level, scan->morph && !last ? morph_of(asked->error, level, allowed) : 0,
                          fmax(depth, scan->view->near_m)};
}

static struct grade choose_grade(const struct scan *scan, struct geomipmap_place place, const struct box *box,
                                 bool whole)
{
    const struct asked asked = {geomipmap_tiles_error(scan->tiles, place),
                                scan->hysteresis > 0 ? last_step(scan, place) - place.height
                                                     : scan->tiles->levels};
    const double *forward = scan->view->forward;
    double depth = box_depth(box, forward, 1), rect[4], seen_depth;
    if (scan->judge.metric == GEOMIPMAP_PAPER) return grade_at_depth(scan, &asked, depth, box_distance(box));
    double farthest = box_depth(box, forward, -1);
    if (scan->judge.metric == GEOMIPMAP_MEAN)
        return grade_at_depth(scan, &asked, sqrt(fmax(depth, scan->view->near_m) * fmax(farthest, 0)), 0);
    struct grade grade = grade_at_depth(scan, &asked, depth, 0);
    // Only part of the box is seen, and that part may begin farther away (numerics.md, C2).  Clipping is
    // worth its time only where a greater depth could help.
    struct grade far = grade_at_depth(scan, &asked, farthest, 0);
    if (whole || (grade.level == far.level && grade.morph == far.morph)) return grade;
    if (!frustum_clip_box(scan->view, box->low, box->high, rect, &seen_depth))
        return (struct grade){scan->tiles->levels - 1, 0, 0};
    return grade_at_depth(scan, &asked, fmax(depth, seen_depth), 0);
}

// ---- picks --------------------------------------------------------------------------------------

static void set_cover(struct scan *scan, struct geomipmap_place place, struct geomipmap_cover cover)
{
    const struct geomipmap_grid *grid = &scan->tiles->grid[0];
    int size = 1 << place.height, column = place.column * size, row = place.row * size;
    for (int j = row; j < row + size && j < grid->rows; j++)
        for (int i = column; i < column + size && i < grid->columns; i++)
            scan->selection->cover[(size_t)j * (size_t)grid->columns + (size_t)i] = cover;
}

static bool within_map(const struct scan *scan, struct geomipmap_place place)
{
    const int cell[2] = {place.column, place.row};
    double low[2], high[2];
    for (int axis = 0; axis < 2; axis++) {
        double size = scan->tile_m[axis] * (1 << place.height);
        low[axis] = scan->corner_m[axis] + cell[axis] * size;
        high[axis] = low[axis] + size;
    }
    return view_inside_outline(scan->view, scan->tiles->terrain, low, high);
}

static void add_pick(struct scan *scan, struct geomipmap_place place, struct grade grade,
                     enum frustum_side side)
{
    struct geomipmap_selection *selection = scan->selection;
    if (selection->listed == selection->room && !reserve(selection, selection->room + selection->room / 4)) {
        scan->failed = true;
        return;
    }
    int index = selection->listed++;
    bool seen = side != FRUSTUM_OUTSIDE;
    int way = (within_map(scan, place) ? GEOMIPMAP_WITHIN_MAP : 0) |
              (side == FRUSTUM_INSIDE ? GEOMIPMAP_WITHIN_VIEW : 0);
    struct geomipmap_pick *pick = &selection->list[index];
    *pick = (struct geomipmap_pick){.place = place,
                                    .level = (uint8_t)grade.level,
                                    .morph = grade.morph,
                                    .depth_m = (float)grade.depth_m,
                                    .seen = seen,
                                    .way = (uint8_t)way,
                                    .next = NONE};
    if (scan->last != NONE) {
        pick->next = selection->list[scan->last].next;
        selection->list[scan->last].next = index;
    }
    scan->last = index;
    // Of tiles of one size, those that are not seen ask nothing of their neighbours.
    if (!seen && scan->tiles->merge == 0) return;
    set_cover(
        scan, place,
        (struct geomipmap_cover){(uint8_t)place.height, (uint8_t)(place.height + grade.level), grade.morph});
}

// The n-th of the cells first..end-1 in an order that is front to back as seen from cell `eye`: from there
// upwards, then from there downwards.  Cells on either side of the eye never hide each other.
static int outward(double eye, int first, int end, int n)
{
    int start = eye < first ? first : eye >= end ? end : (int)eye;
    return n < end - start ? start + n : start - 1 - (n - (end - start));
}

// Calls visit for the tiles first .. first + size - 1 (column and row) of one height, front to back.
static void visit_tiles(struct scan *scan, struct geomipmap_place first, int size,
                        void (*visit)(struct scan *scan, struct geomipmap_place place, unsigned mask),
                        unsigned mask)
{
    const struct geomipmap_grid *grid = &scan->tiles->grid[first.height];
    double scale = 1.0 / (1 << first.height);
    int end_column = first.column + size < grid->columns ? first.column + size : grid->columns;
    int end_row = first.row + size < grid->rows ? first.row + size : grid->rows;
    for (int j = 0; j < end_row - first.row; j++)
        for (int i = 0; i < end_column - first.column; i++) {
            struct geomipmap_place place = {first.height,
                                            outward(scan->eye_tile[0] * scale, first.column, end_column, i),
                                            outward(scan->eye_tile[1] * scale, first.row, end_row, j)};
            visit(scan, place, mask);
        }
}

static struct geomipmap_place first_child(struct geomipmap_place place)
{
    return (struct geomipmap_place){place.height - 1, place.column * 2, place.row * 2};
}

// The finest level from `wanted` on that is there; else the coarsest, which is waited for.
static int level_there(const struct scan *scan, struct geomipmap_place place, int wanted)
{
    int level = wanted, last = scan->tiles->levels - 1;
    while (level < last && !geomipmap_tiles_ready(scan->tiles, scan->reader, place, level)) level++;
    scan->selection->late += level > wanted;
    return level;
}

// Whether the four smaller tiles in a tile's place can be drawn.
static bool parts_there(const struct scan *scan, struct geomipmap_place place)
{
    const struct geomipmap_grid *grid = &scan->tiles->grid[place.height - 1];
    struct geomipmap_place first = first_child(place);
    bool there = true; // all are asked for
    for (int n = 0; n < 4 && scan->reader; n++) {
        struct geomipmap_place part = {first.height, first.column + n % 2, first.row + n / 2};
        if (part.column < grid->columns && part.row < grid->rows)
            there = geomipmap_tiles_ready(scan->tiles, scan->reader, part, scan->tiles->levels - 1) && there;
    }
    return there;
}

enum { MASK_OUTSIDE = 1 << FRUSTUM_PLANES }; // a plane's bit that is never tested: an ancestor was outside

static void scan_tile(struct scan *scan, struct geomipmap_place place, unsigned mask)
{
    const struct geomipmap_tiles *tiles = scan->tiles;
    struct box box;
    enum frustum_side side = FRUSTUM_OUTSIDE;
    if (mask != MASK_OUTSIDE) {
        box = tile_box(scan, place);
        side = mask ? frustum_test_box(&scan->frustum, box.low, box.high, &mask) : FRUSTUM_INSIDE;
    }
    // All alike at their coarsest, tiles outside ask nothing of their neighbours; merged ones may have to
    // split.
    if (side == FRUSTUM_OUTSIDE && scan->cull && tiles->merge == 0) return;
    if (place.height <= tiles->merge) {
        if (side == FRUSTUM_OUTSIDE) {
            add_pick(scan, place, (struct grade){tiles->levels - 1, 0, 0}, side);
            return;
        }
        struct grade grade = choose_grade(scan, place, &box, side == FRUSTUM_INSIDE);
        // Smaller tiles would not save triangles: 2 x 2 of them, at their coarsest, are this tile's second
        // coarsest level.
        bool fine = place.height == 0 || grade.level >= tiles->levels - 2;
        if (fine || !parts_there(scan, place)) {
            scan->selection->late += !fine;
            if (scan->reader) grade.level = level_there(scan, place, fine ? grade.level : tiles->levels - 2);
            add_pick(scan, place, grade, side);
            return;
        }
    }
    visit_tiles(scan, first_child(place), 2, scan_tile, side == FRUSTUM_OUTSIDE ? MASK_OUTSIDE : mask);
}

// ---- borders ------------------------------------------------------------------------------------

// The tiles of height 0 along the outside of one side of a tile.
struct fringe {
    int column, row, step_column, step_row, count;
};

static struct fringe tile_fringe(const struct scan *scan, struct geomipmap_place place,
                                 enum geomipmap_side side)
{
    const struct geomipmap_grid *grid = &scan->tiles->grid[0];
    int size = 1 << place.height, column = place.column * size, row = place.row * size;
    bool across = side == GEOMIPMAP_SOUTH || side == GEOMIPMAP_NORTH;
    struct fringe fringe = {.column = column, .row = row, .step_column = across, .step_row = !across};
    if (side == GEOMIPMAP_SOUTH) fringe.row = row - 1;
    if (side == GEOMIPMAP_NORTH) fringe.row = row + size;
    if (side == GEOMIPMAP_WEST) fringe.column = column - 1;
    if (side == GEOMIPMAP_EAST) fringe.column = column + size;
    if (fringe.column < 0 || fringe.row < 0 || fringe.column >= grid->columns || fringe.row >= grid->rows)
        return fringe; // the edge of the map
    int along = across ? grid->columns - column : grid->rows - row;
    fringe.count = size < along ? size : along;
    return fringe;
}

static struct geomipmap_cover cover_at(const struct scan *scan, const struct fringe *fringe, int n)
{
    int column = fringe->column + n * fringe->step_column, row = fringe->row + n * fringe->step_row;
    return scan->selection->cover[(size_t)row * (size_t)scan->tiles->grid[0].columns + (size_t)column];
}

// The smallest step along one side of a tile, its own and its neighbours'; those not drawn ask for nothing.
// The edge of the map stands against the sky wherever it is seen, so it gets every sample that the tile
// has.
static struct geomipmap_cover side_cover(const struct scan *scan, struct geomipmap_place place,
                                         struct geomipmap_cover own, enum geomipmap_side side)
{
    struct fringe fringe = tile_fringe(scan, place, side);
    if (fringe.count == 0) return (struct geomipmap_cover){own.height, (uint8_t)place.height, 0};
    for (int n = 0; n < fringe.count; n++) {
        struct geomipmap_cover other = cover_at(scan, &fringe, n);
        // GEOMIPMAP_NOTHING is larger than any step.
        if (other.step < own.step || (other.step == own.step && other.morph < own.morph)) own = other;
    }
    return own;
}

static struct geomipmap_cover pick_cover(const struct geomipmap_pick *pick)
{
    return (struct geomipmap_cover){(uint8_t)pick->place.height, (uint8_t)(pick->place.height + pick->level),
                                    pick->morph};
}

// The step that a tile must draw along one side.  Beside a larger tile it is decided along the whole side
// of that one.
static struct geomipmap_cover border_cover(const struct scan *scan, const struct geomipmap_pick *pick,
                                           enum geomipmap_side side)
{
    struct geomipmap_place place = pick->place;
    struct fringe fringe = tile_fringe(scan, place, side);
    if (fringe.count > 0) {
        struct geomipmap_cover cover = cover_at(scan, &fringe, 0);
        if (cover.step != GEOMIPMAP_NOTHING && cover.height > place.height) {
            struct geomipmap_place larger = {cover.height, fringe.column >> cover.height,
                                             fringe.row >> cover.height};
            return side_cover(scan, larger, cover, (enum geomipmap_side)((side + 2) % GEOMIPMAP_SIDES));
        }
    }
    return side_cover(scan, place, pick_cover(pick), side);
}

// The step along a side that has only the vertices of both tiles.  Both are of one size.
static int removed_step(const struct scan *scan, const struct geomipmap_pick *pick, enum geomipmap_side side)
{
    struct fringe fringe = tile_fringe(scan, pick->place, side);
    if (fringe.count == 0) return pick->level;
    int step = cover_at(scan, &fringe, 0).step;
    return step != GEOMIPMAP_NOTHING && step > pick->level ? step : pick->level;
}

static bool lacks_samples(const struct scan *scan, const struct geomipmap_pick *pick)
{
    for (int side = 0; side < GEOMIPMAP_SIDES && pick->place.height > 0; side++)
        if (side_cover(scan, pick->place, pick_cover(pick), (enum geomipmap_side)side).step <
            pick->place.height)
            return true;
    return false;
}

static void split_child(struct scan *scan, struct geomipmap_place place, unsigned mask)
{
    struct box box = tile_box(scan, place);
    enum frustum_side side =
        mask == MASK_OUTSIDE ? FRUSTUM_OUTSIDE : frustum_test_box(&scan->frustum, box.low, box.high, &mask);
    struct grade grade = {scan->tiles->levels - 1, 0, 0};
    if (side != FRUSTUM_OUTSIDE) {
        grade = choose_grade(scan, place, &box, side == FRUSTUM_INSIDE);
        if (scan->reader) grade.level = level_there(scan, place, grade.level);
    }
    add_pick(scan, place, grade, side);
}

// Puts the four smaller tiles in the place of a pick: the first takes over its entry, so that the order
// stays.
static void split_pick(struct scan *scan, int index)
{
    struct geomipmap_selection *selection = scan->selection;
    struct geomipmap_pick whole = selection->list[index];
    scan->last = index;
    visit_tiles(scan, first_child(whole.place), 2, split_child, whole.seen ? FRUSTUM_ALL : MASK_OUTSIDE);
    if (scan->failed) return;
    int first = selection->list[index].next;
    selection->list[index] = selection->list[first];
}

// Splits merged tiles until each has the samples that its neighbours draw.  Every split makes tiles
// smaller, so this ends.
static void split_coarse_neighbours(struct scan *scan)
{
    struct geomipmap_selection *selection = scan->selection;
    for (bool again = scan->tiles->merge > 0; again && !scan->failed;) {
        again = false;
        for (int i = selection->listed ? 0 : NONE; i != NONE && !scan->failed; i = selection->list[i].next)
            while (lacks_samples(scan, &selection->list[i]) && !scan->failed) {
                split_pick(scan, i);
                again = true;
            }
    }
}

static void choose_set(const struct scan *scan, struct geomipmap_pick *pick)
{
    int neighbours[GEOMIPMAP_SIDES];
    for (int side = 0; side < GEOMIPMAP_SIDES; side++) {
        if (scan->borders == GEOMIPMAP_REMOVE) {
            neighbours[side] = removed_step(scan, pick, (enum geomipmap_side)side);
            pick->hem[side] = (struct geomipmap_hem){(uint8_t)neighbours[side], 0};
        } else {
            struct geomipmap_cover cover = border_cover(scan, pick, (enum geomipmap_side)side);
            neighbours[side] = cover.step - pick->place.height;
            pick->hem[side] = (struct geomipmap_hem){(uint8_t)neighbours[side], cover.morph};
        }
    }
    pick->set = (uint16_t)geomipmap_mesh_set(scan->tiles->bits, scan->borders, pick->level, neighbours);
}

// Entry of a place between tiles of height 0.
static uint8_t *corner_at(const struct scan *scan, int column, int row)
{
    size_t across = corners_across(scan->tiles, scan->tiles->grid[scan->tiles->top].columns);
    return scan->selection->corners + (size_t)row * across + (size_t)column;
}

static uint8_t *corner_step(const struct scan *scan, struct geomipmap_place place, int corner)
{
    bool east = corner < 2, north = corner == 1 || corner == 2;
    return corner_at(scan, (place.column + east) << place.height, (place.row + north) << place.height);
}

static int side_step(const struct geomipmap_pick *pick, int side)
{
    return pick->place.height + pick->hem[side].level;
}

static void end_sides(const struct scan *scan, const struct geomipmap_pick *pick)
{
    for (int side = 0; side < GEOMIPMAP_SIDES; side++)
        for (int end = 0; end < 2; end++) {
            uint8_t *least = corner_step(scan, pick->place, (side + 3 * end) % GEOMIPMAP_SIDES);
            int step = side_step(pick, side);
            if (step < *least) *least = (uint8_t)step;
        }
}

// Places along the sides where only smaller tiles have corners.
static void cross_sides(const struct scan *scan, const struct geomipmap_pick *pick)
{
    int size = 1 << pick->place.height, column = pick->place.column * size, row = pick->place.row * size;
    for (int n = 1; n < size; n++) {
        *corner_at(scan, column + n, row) = (uint8_t)side_step(pick, GEOMIPMAP_SOUTH);
        *corner_at(scan, column + n, row + size) = (uint8_t)side_step(pick, GEOMIPMAP_NORTH);
        *corner_at(scan, column, row + n) = (uint8_t)side_step(pick, GEOMIPMAP_WEST);
        *corner_at(scan, column + size, row + n) = (uint8_t)side_step(pick, GEOMIPMAP_EAST);
    }
}

// A vertex where sides end takes the finest step of them all; but within the side of a larger tile, which
// does not end there, it takes that side's.
static void choose_forms(const struct scan *scan)
{
    struct geomipmap_selection *selection = scan->selection;
    for (int k = 0; k < selection->count; k++)
        for (int corner = 0; corner < GEOMIPMAP_SIDES; corner++)
            *corner_step(scan, selection->picks[k].place, corner) = GEOMIPMAP_NOTHING;
    for (int k = 0; k < selection->count; k++) end_sides(scan, &selection->picks[k]);
    for (int k = 0; k < selection->count; k++) cross_sides(scan, &selection->picks[k]);
    for (int k = 0; k < selection->count; k++)
        for (int n = 0; n < GEOMIPMAP_SIDES; n++)
            selection->picks[k].corner[n] = *corner_step(scan, selection->picks[k].place, n);
}

struct geomipmap_form geomipmap_pick_form(const struct geomipmap_pick *pick)
{
    struct geomipmap_form form = {.inside = (uint8_t)(pick->place.height + pick->level)};
    for (int n = 0; n < GEOMIPMAP_SIDES; n++) {
        form.side[n] = (uint8_t)side_step(pick, n);
        form.corner[n] = pick->corner[n];
    }
    return form;
}

static void choose_sets(struct scan *scan)
{
    struct geomipmap_selection *selection = scan->selection;
    int seen = 0, unseen = 0; // where the next pick of either kind goes
    for (int i = selection->listed ? 0 : NONE; i != NONE; i = selection->list[i].next)
        unseen += selection->list[i].seen;
    selection->seen = unseen;
    for (int i = selection->listed ? 0 : NONE; i != NONE; i = selection->list[i].next) {
        struct geomipmap_pick *pick = &selection->list[i];
        choose_set(scan, pick);
        selection->picks[pick->seen ? seen++ : unseen++] = *pick;
    }
    selection->count = unseen;
}

// Remembers the steps of all tiles that were seen, which only hysteresis asks for.
static void remember(struct scan *scan)
{
    struct geomipmap_selection *selection = scan->selection;
    const struct geomipmap_grid *grid = &scan->tiles->grid[0];
    for (int k = 0; k < selection->seen; k++) {
        const struct geomipmap_pick *pick = &selection->picks[k];
        int size = 1 << pick->place.height, column = pick->place.column * size, row = pick->place.row * size;
        for (int j = row; j < row + size && j < grid->rows; j++)
            for (int i = column; i < column + size && i < grid->columns; i++)
                selection->last_step[(size_t)j * (size_t)grid->columns + (size_t)i] =
                    (uint8_t)(pick->place.height + pick->level);
    }
}

static void forget(struct scan *scan)
{
    struct geomipmap_selection *selection = scan->selection;
    const struct geomipmap_cover nothing = {GEOMIPMAP_NOTHING, GEOMIPMAP_NOTHING, 0};
    for (int i = 0; i < selection->count; i++) set_cover(scan, selection->picks[i].place, nothing);
    selection->count = selection->seen = selection->listed = selection->late = 0;
}

bool geomipmap_select(struct geomipmap_selection *selection, const struct geomipmap_tiles *tiles,
                      const struct geomipmap_choice *choice, const struct view *view)
{
    struct scan scan = {.selection = selection,
                        .tiles = tiles,
                        .view = view,
                        .cull = choice->cull,
                        .borders = choice->borders,
                        .hysteresis = choice->hysteresis,
                        .morph = choice->morph,
                        .reader = choice->reader,
                        .last = NONE};
    struct view_origin eye = view_level_origin(view, tiles->finest);
    const int64_t first[2] = {tiles->x0, tiles->y0};
    frustum_init(&scan.frustum, view);
    geomipmap_judge_init(&scan.judge, choice->metric, choice->tau_px, view,
                         sqrt(tiles->spacing_m[0] * tiles->spacing_m[1]));
    for (int axis = 0; axis < 2; axis++) {
        scan.tile_m[axis] = tiles->spacing_m[axis] * (1 << tiles->bits);
        // Cells first: the difference of two large integers is exact.
        double cells = (double)(first[axis] - eye.base[axis]) - (double)eye.fraction[axis];
        scan.corner_m[axis] = cells * tiles->spacing_m[axis];
        scan.eye_tile[axis] = -scan.corner_m[axis] / scan.tile_m[axis];
    }
    forget(&scan);
    const struct geomipmap_grid *top = &tiles->grid[tiles->top];
    int size = top->columns > top->rows ? top->columns : top->rows;
    visit_tiles(&scan, (struct geomipmap_place){tiles->top, 0, 0}, size, scan_tile, FRUSTUM_ALL);
    split_coarse_neighbours(&scan);
    if (!scan.failed) choose_sets(&scan);
    if (!scan.failed && tiles->filtered) choose_forms(&scan);
    if (!scan.failed && scan.hysteresis > 0) remember(&scan);
    return !scan.failed;
}
