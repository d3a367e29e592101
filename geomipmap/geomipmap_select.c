// SPDX-License-Identifier: MIT
#include "geomipmap/geomipmap_select.h"

#include "common/report.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { FIRST_ROOM = 64, FIRST_CORNER_BITS = 8, PARTS = 4, ROOT = 0, REMEMBERED = 1 << 16 };

// ---- memory -------------------------------------------------------------------------------------

static int grown(int room, int needed)
{
    return needed > room + room / 16 ? needed : room + room / 16;
}

static bool reserve_picks(struct geomipmap_selection *selection, int count)
{
    if (count <= selection->room) return true;
    int room = grown(selection->room, count);
    struct geomipmap_pick *picks = realloc(selection->picks, (size_t)room * sizeof *picks);
    if (!picks) return fail("geomipmap: no memory to select %d tiles", room);
    selection->picks = picks;
    selection->room = room;
    return true;
}

static bool reserve_nodes(struct geomipmap_selection *selection, int count)
{
    if (count <= selection->node_room) return true;
    int room = grown(selection->node_room, count);
    struct geomipmap_node *nodes = realloc(selection->nodes, (size_t)room * sizeof *nodes);
    if (!nodes) return fail("geomipmap: no memory to look at %d tiles", room);
    selection->nodes = nodes;
    selection->node_room = room;
    return true;
}

static size_t corner_room(const struct geomipmap_selection *selection)
{
    return selection->corner_bits ? (size_t)1 << selection->corner_bits : 0;
}

// The corner's entry, or the gap where it would stand: its step is GEOMIPMAP_NOTHING.
static struct geomipmap_corner *find_corner(const struct geomipmap_selection *selection,
                                            struct geomipmap_corner wanted)
{
    struct geomipmap_corner *corners = selection->corners;
    uint64_t name = (uint64_t)wanted.row << 28 | wanted.column;
    size_t mask = corner_room(selection) - 1,
           at = (size_t)(name * 0x9e3779b97f4a7c15u >> (64 - selection->corner_bits));
    while (corners[at].step != GEOMIPMAP_NOTHING &&
           (corners[at].column != wanted.column || corners[at].row != wanted.row))
        at = (at + 1) & mask;
    return &corners[at];
}

static void clear_corners(struct geomipmap_selection *selection)
{
    for (size_t i = 0; i < corner_room(selection); i++) selection->corners[i].step = GEOMIPMAP_NOTHING;
    selection->corner_count = 0;
}

// Makes the hash at most three quarters full with those of one more tile.
static bool reserve_corners(struct geomipmap_selection *selection)
{
    size_t old_room = corner_room(selection);
    if (4 * ((size_t)selection->corner_count + GEOMIPMAP_SIDES) <= 3 * old_room) return true;
    struct geomipmap_corner *old = selection->corners;
    int bits = old ? selection->corner_bits + 1 : FIRST_CORNER_BITS, count = selection->corner_count;
    struct geomipmap_corner *corners = malloc(((size_t)1 << bits) * sizeof *corners);
    if (!corners) return fail("geomipmap: no memory for the corners of %d tiles", count);
    selection->corners = corners;
    selection->corner_bits = bits;
    clear_corners(selection);
    for (size_t i = 0; i < old_room; i++)
        if (old[i].step != GEOMIPMAP_NOTHING) *find_corner(selection, old[i]) = old[i];
    selection->corner_count = count;
    free(old);
    return true;
}

bool geomipmap_selection_init(struct geomipmap_selection *selection)
{
    *selection = (struct geomipmap_selection){.now = 0, .since = 1};
    if (reserve_picks(selection, FIRST_ROOM) && reserve_nodes(selection, FIRST_ROOM) &&
        geomipmap_cache_init(&selection->remembered, 0, REMEMBERED))
        return true;
    geomipmap_selection_finish(selection);
    return false;
}

void geomipmap_selection_finish(struct geomipmap_selection *selection)
{
    free(selection->picks);
    free(selection->nodes);
    free(selection->corners);
    free(selection->memory);
    geomipmap_cache_finish(&selection->remembered);
    *selection = (struct geomipmap_selection){0};
}

void geomipmap_selection_restart(struct geomipmap_selection *selection)
{
    selection->since = selection->now + 1;
}

size_t geomipmap_selection_bytes(const struct geomipmap_selection *selection)
{
    return (size_t)selection->room * sizeof *selection->picks +
           (size_t)selection->node_room * sizeof *selection->nodes +
           corner_room(selection) * sizeof *selection->corners +
           geomipmap_cache_bytes(&selection->remembered) +
           (size_t)selection->memory_room * sizeof *selection->memory;
}

// What is remembered of a tile; NULL when memory runs out.
static struct geomipmap_memory *recall(struct geomipmap_selection *selection, struct geomipmap_place place)
{
    int slot;
    struct geomipmap_cache *cache = &selection->remembered;
    enum geomipmap_found found = geomipmap_cache_find(cache, geomipmap_tiles_name(place), &slot);
    if (found == GEOMIPMAP_FULL) return NULL;
    if (cache->slot_room > selection->memory_room) {
        struct geomipmap_memory *memory =
            realloc(selection->memory, (size_t)cache->slot_room * sizeof *memory);
        if (!memory) return NULL;
        selection->memory = memory;
        selection->memory_room = cache->slot_room;
    }
    struct geomipmap_memory *memory = &selection->memory[slot];
    if (found == GEOMIPMAP_MISS) *memory = (struct geomipmap_memory){0};
    return memory;
}

struct scan { // of one view
    struct geomipmap_selection *selection;
    struct geomipmap_tiles *tiles;
    const struct geomipmap_choice *choice;
    const struct view *view;
    struct frustum frustum;
    struct geomipmap_judge judge;
    double corner_m[2]; // south-west corner of the map, relative to the eye
    double tile_m[2];   // size of a tile of height 0
    double eye_tile[2]; // the eye, in tiles of height 0
    bool waiting;       // for a tile to be measured
    bool failed;
};

static struct geomipmap_node *node_at(const struct scan *scan, int n)
{
    return &scan->selection->nodes[n];
}

// ---- levels -------------------------------------------------------------------------------------

struct box { // relative to the eye, metres
    double low[3], high[3];
};

static struct box tile_box(const struct scan *scan, struct geomipmap_place place,
                           struct geomipmap_range range)
{
    const struct geomipmap_tiles *tiles = scan->tiles;
    double ground = tiles->offset_m - scan->view->eye_m[2];
    const int cell[2] = {place.column, place.row};
    struct box box = {.low = {0, 0, ground + range.low * tiles->quantum_m},
                      .high = {0, 0, ground + range.high * tiles->quantum_m}};
    for (int axis = 0; axis < 2; axis++) {
        double size = scan->tile_m[axis] * (double)((int64_t)1 << place.height);
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

// The finest step that was drawn of a tile when it was last seen: as a tile itself, in tiles within it or as
// a part of a larger one.
static int last_step(struct scan *scan, struct geomipmap_place place)
{
    struct geomipmap_selection *selection = scan->selection;
    uint64_t newest = selection->since - 1;
    int step = GEOMIPMAP_NOTHING;
    for (struct geomipmap_place at = place; at.height <= scan->tiles->drawn;
         at = (struct geomipmap_place){at.height + 1, at.column / 2, at.row / 2}) {
        const struct geomipmap_memory *memory = recall(selection, at);
        if (!memory) {
            scan->failed = true;
            break;
        }
        if (memory->when > newest) step = memory->step, newest = memory->when;
        if (at.height == place.height && memory->inner_when > newest)
            step = memory->inner, newest = memory->inner_when;
    }
    return step;
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
                                 allowed * (1 - scan->choice->hysteresis));
    bool last = level == scan->tiles->levels - 1;
    return (struct grade){level, scan->choice->morph && !last ? morph_of(asked->error, level, allowed) : 0,
                          fmax(depth, scan->view->near_m)};
}

static struct grade choose_grade(struct scan *scan, struct geomipmap_place place, const struct box *box,
                                 const float *error, bool whole)
{
    const struct asked asked = {error, scan->choice->hysteresis > 0 ? last_step(scan, place) - place.height
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

// ---- the tree -----------------------------------------------------------------------------------

enum {      // kinds of leaves
    ABSENT, // beyond the map
    IDLE,   // not seen, and nothing to its neighbours
    BLOCK,  // not seen: the largest tiles that may be drawn, at their coarsest
    PICK,
};

static bool within_map(const struct scan *scan, struct geomipmap_place place)
{
    const int cell[2] = {place.column, place.row};
    double low[2], high[2];
    for (int axis = 0; axis < 2; axis++) {
        double size = scan->tile_m[axis] * (double)((int64_t)1 << place.height);
        low[axis] = scan->corner_m[axis] + cell[axis] * size;
        high[axis] = low[axis] + size;
    }
    return view_inside_outline(scan->view, scan->tiles->terrain, low, high);
}

static void set_pick(struct scan *scan, int n, struct grade grade, enum frustum_side side)
{
    struct geomipmap_node *node = node_at(scan, n);
    node->kind = PICK;
    node->seen = side != FRUSTUM_OUTSIDE;
    node->level = (uint8_t)grade.level;
    node->morph = grade.morph;
    node->depth_m = (float)grade.depth_m;
    node->way = (uint8_t)((within_map(scan, node->place) ? GEOMIPMAP_WITHIN_MAP : 0) |
                          (side == FRUSTUM_INSIDE ? GEOMIPMAP_WITHIN_VIEW : 0));
}

static struct geomipmap_place part_place(struct geomipmap_place place, int part)
{
    return (struct geomipmap_place){place.height - 1, place.column * 2 + part % 2, place.row * 2 + part / 2};
}

// The k-th of a tile's four parts, front to back as seen from the eye.  Parts on either side of the eye never
// hide each other.
static int part_in_order(const struct scan *scan, struct geomipmap_place place, int k)
{
    double scale = 1 / (double)((int64_t)1 << (place.height - 1));
    int east = scan->eye_tile[0] * scale >= 2.0 * place.column + 1;
    int north = scan->eye_tile[1] * scale >= 2.0 * place.row + 1;
    return ((k / 2) ^ north) * 2 + ((k % 2) ^ east);
}

// Gives a node its four parts, and has those within the map visited.
static void divide(struct scan *scan, int n, void (*visit)(struct scan *scan, int n, unsigned mask),
                   unsigned mask)
{
    struct geomipmap_selection *selection = scan->selection;
    int first = selection->node_count;
    scan->failed = scan->failed || !reserve_nodes(selection, first + PARTS);
    if (scan->failed) return;
    struct geomipmap_place place = selection->nodes[n].place;
    const struct geomipmap_grid *grid = &scan->tiles->grid[place.height - 1];
    for (int part = 0; part < PARTS; part++) {
        struct geomipmap_place at = part_place(place, part);
        bool there = at.column < grid->columns && at.row < grid->rows;
        selection->nodes[first + part] = (struct geomipmap_node){.place = at, .kind = there ? IDLE : ABSENT};
    }
    selection->node_count += PARTS;
    selection->nodes[n].first = first;
    for (int k = 0; k < PARTS; k++) {
        int part = first + part_in_order(scan, place, k);
        if (node_at(scan, part)->kind != ABSENT) visit(scan, part, mask);
    }
}

static void scan_unseen(struct scan *scan, int n, unsigned mask)
{
    const struct geomipmap_tiles *tiles = scan->tiles;
    // All alike at their coarsest, tiles of one size ask nothing of their neighbours.
    if (tiles->drawn == 0 && scan->choice->cull) return;
    if (node_at(scan, n)->place.height <= tiles->drawn)
        set_pick(scan, n, (struct grade){tiles->levels - 1, 0, 0}, FRUSTUM_OUTSIDE);
    else if (scan->choice->cull)
        node_at(scan, n)->kind = BLOCK;
    else
        divide(scan, n, scan_unseen, mask);
}

// The finest level from `wanted` on that is there; else the coarsest, which is waited for.
static int level_there(const struct scan *scan, struct geomipmap_place place, int wanted)
{
    int level = wanted, last = scan->tiles->levels - 1;
    while (level < last && !geomipmap_tiles_ready(scan->tiles, scan->choice->reader, place, level)) level++;
    scan->selection->late += level > wanted;
    return level;
}

// Whether the four smaller tiles in a tile's place can be drawn.
static bool parts_there(const struct scan *scan, struct geomipmap_place place)
{
    const struct geomipmap_grid *grid = &scan->tiles->grid[place.height - 1];
    bool there = true; // all are asked for
    for (int n = 0; n < PARTS && scan->choice->reader; n++) {
        struct geomipmap_place part = part_place(place, n);
        if (part.column < grid->columns && part.row < grid->rows)
            there = geomipmap_tiles_ready(scan->tiles, scan->choice->reader, part, scan->tiles->levels - 1) &&
                    there;
    }
    return there;
}

// Draws a tile that is seen, unless smaller ones are better.
static bool draw_node(struct scan *scan, int n, const struct box *box, const float *error,
                      enum frustum_side side)
{
    struct geomipmap_place place = node_at(scan, n)->place;
    int levels = scan->tiles->levels;
    struct grade grade = choose_grade(scan, place, box, error, side == FRUSTUM_INSIDE);
    // Smaller tiles would not save triangles: 2 x 2 of them, at their coarsest, are this tile's second
    // coarsest level.
    bool fine = place.height == 0 || grade.level >= levels - 2;
    if (!fine && parts_there(scan, place)) return false;
    scan->selection->late += !fine;
    if (scan->choice->reader) grade.level = level_there(scan, place, fine ? grade.level : levels - 2);
    set_pick(scan, n, grade, side);
    return true;
}

static bool look_at(struct scan *scan, int n, struct box *box, const float **error, unsigned *mask,
                    enum frustum_side *side)
{
    struct geomipmap_range range;
    struct geomipmap_place place = node_at(scan, n)->place;
    if (!geomipmap_tiles_know(scan->tiles, place, &range, error)) {
        scan->waiting = true;
        return false;
    }
    *box = tile_box(scan, place, range);
    *side = *mask ? frustum_test_box(&scan->frustum, box->low, box->high, mask) : FRUSTUM_INSIDE;
    return true;
}

static void scan_node(struct scan *scan, int n, unsigned mask)
{
    struct box box;
    const float *error;
    enum frustum_side side;
    if (!look_at(scan, n, &box, &error, &mask, &side)) return;
    if (side == FRUSTUM_OUTSIDE)
        scan_unseen(scan, n, mask);
    else if (node_at(scan, n)->place.height > scan->tiles->drawn || !draw_node(scan, n, &box, error, side))
        divide(scan, n, scan_node, mask);
}

// Of a tile that has to be divided whatever its error: each part is drawn.
static void scan_part(struct scan *scan, int n, unsigned mask)
{
    struct box box;
    const float *error;
    enum frustum_side side;
    if (!look_at(scan, n, &box, &error, &mask, &side)) return;
    struct geomipmap_place place = node_at(scan, n)->place;
    struct grade grade = {scan->tiles->levels - 1, 0, 0};
    if (side != FRUSTUM_OUTSIDE) {
        grade = choose_grade(scan, place, &box, error, side == FRUSTUM_INSIDE);
        if (scan->choice->reader) grade.level = level_there(scan, place, grade.level);
    }
    set_pick(scan, n, grade, side);
}

// ---- borders ------------------------------------------------------------------------------------

struct cover { // what is drawn of a tile, or the finest along one of its sides
    int step;  // every 2^step-th sample; GEOMIPMAP_NOTHING: no pick covers it
    int morph;
    bool seen;
};

static struct cover cover_of(const struct scan *scan, const struct geomipmap_node *node)
{
    const struct geomipmap_tiles *tiles = scan->tiles;
    if (node->kind == BLOCK) return (struct cover){tiles->drawn + tiles->levels - 1, 0, false};
    // Of tiles of one size, those that are not seen ask nothing of their neighbours.
    if (node->kind != PICK || (!node->seen && tiles->drawn == 0))
        return (struct cover){GEOMIPMAP_NOTHING, 0, false};
    return (struct cover){node->place.height + node->level, node->morph, node->seen};
}

static enum geomipmap_side opposite(enum geomipmap_side side)
{
    return (enum geomipmap_side)((side + 2) % GEOMIPMAP_SIDES);
}

// The node beyond a side: as large, with parts or without, or larger.  -1: the edge of the map.
static int find_beyond(const struct scan *scan, struct geomipmap_place place, enum geomipmap_side side)
{
    const struct geomipmap_grid *grid = &scan->tiles->grid[place.height];
    int column = place.column + (side == GEOMIPMAP_EAST) - (side == GEOMIPMAP_WEST);
    int row = place.row + (side == GEOMIPMAP_NORTH) - (side == GEOMIPMAP_SOUTH);
    if (column < 0 || row < 0 || column >= grid->columns || row >= grid->rows) return -1;
    const struct geomipmap_node *nodes = scan->selection->nodes;
    int n = ROOT;
    for (int shift = scan->tiles->top - place.height - 1; shift >= 0 && nodes[n].first; shift--)
        n = nodes[n].first + (row >> shift & 1) * 2 + (column >> shift & 1);
    return n;
}

// Takes the leaves along one side of a node into the finest.  GEOMIPMAP_NOTHING is larger than any step.
static void meet(const struct scan *scan, int n, enum geomipmap_side side, struct cover *finest)
{
    static const uint8_t along[GEOMIPMAP_SIDES][2] = {{0, 1}, {1, 3}, {2, 3}, {0, 2}};
    const struct geomipmap_node *node = node_at(scan, n);
    if (node->first) {
        for (int i = 0; i < 2; i++) meet(scan, node->first + along[side][i], side, finest);
        return;
    }
    struct cover cover = cover_of(scan, node);
    bool seen = finest->seen || cover.seen;
    if (cover.step < finest->step || (cover.step == finest->step && cover.morph < finest->morph))
        *finest = cover;
    finest->seen = seen;
}

// The smallest step along one side of a tile, its own and its neighbours'; those not drawn ask for nothing.
// The edge of the map stands against the sky wherever it is seen, so it gets every sample that the tile
// has.
static struct cover side_cover(const struct scan *scan, int n, enum geomipmap_side side)
{
    const struct geomipmap_node *node = node_at(scan, n);
    struct cover cover = cover_of(scan, node);
    int beyond = find_beyond(scan, node->place, side);
    if (beyond < 0) return (struct cover){node->place.height, 0, cover.seen};
    meet(scan, beyond, opposite(side), &cover);
    return cover;
}

// The same, as it is drawn: beside a larger tile it is decided along the whole side of that one.
static struct cover border_cover(const struct scan *scan, int n, enum geomipmap_side side, uint8_t *larger)
{
    const struct geomipmap_node *node = node_at(scan, n);
    int beyond = find_beyond(scan, node->place, side);
    *larger = 0;
    if (beyond < 0) return (struct cover){node->place.height, 0, node->seen};
    const struct geomipmap_node *other = node_at(scan, beyond);
    if (other->kind == PICK && !other->first && other->place.height > node->place.height) {
        *larger = (uint8_t)other->place.height;
        return side_cover(scan, beyond, opposite(side));
    }
    struct cover cover = cover_of(scan, node);
    if (!node->seen && scan->tiles->drawn == 0) cover.step = node->level;
    meet(scan, beyond, opposite(side), &cover);
    return cover;
}

// The step along a side that has only the vertices of both tiles.  Both are of one size.
static int removed_step(const struct scan *scan, int n, enum geomipmap_side side)
{
    int level = node_at(scan, n)->level, beyond = find_beyond(scan, node_at(scan, n)->place, side);
    if (beyond < 0) return level;
    int step = cover_of(scan, node_at(scan, beyond)).step;
    return step != GEOMIPMAP_NOTHING && step > level ? step : level;
}

// Whether a leaf has to be divided: a tile that has fewer samples than are drawn along one of its sides, a
// block that would have something to do with what is seen or finer.
static bool must_divide(const struct scan *scan, int n)
{
    const struct geomipmap_node *node = node_at(scan, n);
    bool block = node->kind == BLOCK;
    if (node->first || (!block && (node->kind != PICK || node->place.height == 0))) return false;
    for (int side = 0; side < GEOMIPMAP_SIDES; side++) {
        struct cover cover = side_cover(scan, n, (enum geomipmap_side)side);
        int least = block && find_beyond(scan, node->place, (enum geomipmap_side)side) >= 0
                        ? scan->tiles->drawn + scan->tiles->levels - 1
                        : node->place.height;
        if (cover.step < least || (block && cover.seen)) return true;
    }
    return false;
}

// Divides leaves until none has to be.  Every division makes tiles smaller, so this ends.
static void divide_coarse_neighbours(struct scan *scan)
{
    struct geomipmap_selection *selection = scan->selection;
    for (bool again = scan->tiles->drawn > 0; again && !scan->failed && !scan->waiting;) {
        again = false;
        for (int n = 0; n < selection->node_count && !scan->failed; n++) {
            if (!must_divide(scan, n)) continue;
            bool seen = node_at(scan, n)->seen;
            divide(scan, n, seen ? scan_part : scan_unseen, FRUSTUM_ALL);
            again = true;
        }
    }
}

// ---- picks --------------------------------------------------------------------------------------

static struct geomipmap_pick make_pick(const struct scan *scan, int n)
{
    const struct geomipmap_node *node = node_at(scan, n);
    struct geomipmap_pick pick = {.place = node->place,
                                  .depth_m = node->depth_m,
                                  .level = node->level,
                                  .seen = node->seen,
                                  .way = node->way,
                                  .morph = node->morph};
    int neighbours[GEOMIPMAP_SIDES];
    for (int side = 0; side < GEOMIPMAP_SIDES; side++) {
        if (scan->choice->borders == GEOMIPMAP_REMOVE) {
            neighbours[side] = removed_step(scan, n, (enum geomipmap_side)side);
            pick.hem[side] = (struct geomipmap_hem){(uint8_t)neighbours[side], 0};
        } else {
            struct cover cover = border_cover(scan, n, (enum geomipmap_side)side, &pick.larger[side]);
            neighbours[side] = cover.step - node->place.height;
            pick.hem[side] = (struct geomipmap_hem){(uint8_t)neighbours[side], (uint8_t)cover.morph};
        }
    }
    pick.set = (uint16_t)geomipmap_mesh_set(scan->tiles->bits, scan->choice->borders, pick.level, neighbours);
    return pick;
}

static bool is_pick(const struct geomipmap_node *node)
{
    return node->kind == PICK && !node->first;
}

// Lists the leaves that are picks front to back: those seen from next[1] on, the others from next[0].
static void list_picks(struct scan *scan, int n, struct geomipmap_pick *next[2])
{
    const struct geomipmap_node *node = node_at(scan, n);
    for (int k = 0; k < PARTS && node->first; k++)
        list_picks(scan, node->first + part_in_order(scan, node->place, k), next);
    if (is_pick(node)) *next[node->seen]++ = make_pick(scan, n);
}

static void choose_sets(struct scan *scan)
{
    struct geomipmap_selection *selection = scan->selection;
    selection->count = selection->seen = 0;
    for (int n = 0; n < selection->node_count; n++) {
        selection->count += is_pick(node_at(scan, n));
        selection->seen += is_pick(node_at(scan, n)) && node_at(scan, n)->seen;
    }
    scan->failed = !reserve_picks(selection, selection->count);
    if (scan->failed) return;
    struct geomipmap_pick *next[2] = {selection->picks + selection->seen, selection->picks};
    list_picks(scan, ROOT, next);
}

// ---- corners ------------------------------------------------------------------------------------

static struct geomipmap_corner corner_at(struct geomipmap_place place, int corner)
{
    bool east = corner < 2, north = corner == 1 || corner == 2;
    return (struct geomipmap_corner){.column = (uint32_t)(place.column + east) << place.height,
                                     .row = (uint32_t)(place.row + north) << place.height};
}

static int side_step(const struct geomipmap_pick *pick, int side)
{
    return pick->place.height + pick->hem[side].level;
}

// Corner n lies between sides n and n + 1, and takes the finest step of those that end there.
static void end_sides(struct scan *scan, const struct geomipmap_pick *pick)
{
    struct geomipmap_selection *selection = scan->selection;
    scan->failed = scan->failed || !reserve_corners(selection);
    for (int corner = 0; corner < GEOMIPMAP_SIDES && !scan->failed; corner++) {
        int one = side_step(pick, corner), other = side_step(pick, (corner + 1) % GEOMIPMAP_SIDES);
        int step = one < other ? one : other;
        struct geomipmap_corner there = corner_at(pick->place, corner), *at = find_corner(selection, there);
        there.step = (uint8_t)step;
        selection->corner_count += at->step == GEOMIPMAP_NOTHING;
        if (there.step < at->step) *at = there;
    }
}

// Corners within the side of a larger tile.
static void cross_sides(const struct scan *scan, const struct geomipmap_pick *pick)
{
    for (int side = 0; side < GEOMIPMAP_SIDES; side++)
        for (int end = 0; end < 2 && pick->larger[side]; end++) {
            int corner = (side + 3 * end) % GEOMIPMAP_SIDES;
            bool east = corner < 2, north = corner == 1 || corner == 2;
            bool across = side == GEOMIPMAP_SOUTH || side == GEOMIPMAP_NORTH;
            int along = across ? pick->place.column + east : pick->place.row + north;
            if (along & ((1 << (pick->larger[side] - pick->place.height)) - 1))
                find_corner(scan->selection, corner_at(pick->place, corner))->step =
                    (uint8_t)side_step(pick, side);
        }
}

// A vertex where sides end takes the finest step of them all; but within the side of a larger tile, which
// does not end there, it takes that side's.
static void choose_forms(struct scan *scan)
{
    struct geomipmap_selection *selection = scan->selection;
    clear_corners(selection);
    for (int k = 0; k < selection->count; k++) end_sides(scan, &selection->picks[k]);
    if (scan->failed) return;
    for (int k = 0; k < selection->count; k++) cross_sides(scan, &selection->picks[k]);
    for (int k = 0; k < selection->count; k++)
        for (int n = 0; n < GEOMIPMAP_SIDES; n++)
            selection->picks[k].corner[n] =
                find_corner(selection, corner_at(selection->picks[k].place, n))->step;
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

// ---- the whole ----------------------------------------------------------------------------------

// Remembers the steps of all tiles that were seen, which only hysteresis asks for.
static void remember(struct scan *scan)
{
    struct geomipmap_selection *selection = scan->selection;
    for (int k = 0; k < selection->seen; k++) {
        struct geomipmap_place at = selection->picks[k].place;
        int step = at.height + selection->picks[k].level;
        for (bool own = true; at.height <= scan->tiles->drawn; own = false) {
            struct geomipmap_memory *memory = recall(selection, at);
            scan->failed = scan->failed || !memory;
            if (scan->failed) return;
            if (own) memory->step = step, memory->when = selection->now;
            if (!own && (memory->inner_when < selection->now || step < memory->inner)) memory->inner = step;
            if (!own) memory->inner_when = selection->now;
            at = (struct geomipmap_place){at.height + 1, at.column / 2, at.row / 2};
        }
    }
}

static void begin(struct scan *scan)
{
    struct geomipmap_selection *selection = scan->selection;
    int from, to;
    selection->now++;
    if (geomipmap_cache_begin_frame(&selection->remembered, &from, &to))
        selection->memory[to] = selection->memory[from];
    geomipmap_tiles_begin(scan->tiles);
}

// Makes the tree.  Tiles that it meets for the first time are measured, and it is made again.
static bool make_tree(struct scan *scan)
{
    struct geomipmap_selection *selection = scan->selection;
    do {
        selection->nodes[ROOT] = (struct geomipmap_node){.place = {scan->tiles->top, 0, 0}, .kind = IDLE};
        selection->node_count = 1;
        selection->late = 0;
        scan->waiting = false;
        scan_node(scan, ROOT, FRUSTUM_ALL);
        divide_coarse_neighbours(scan);
        if (scan->waiting && !geomipmap_tiles_measure(scan->tiles)) return false;
    } while (scan->waiting && !scan->failed);
    return !scan->failed;
}

bool geomipmap_select(struct geomipmap_selection *selection, struct geomipmap_tiles *tiles,
                      const struct geomipmap_choice *choice, const struct view *view)
{
    struct scan scan = {.selection = selection, .tiles = tiles, .choice = choice, .view = view};
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
    begin(&scan);
    if (!make_tree(&scan)) return false;
    choose_sets(&scan);
    if (!scan.failed && tiles->filtered) choose_forms(&scan);
    if (!scan.failed && choice->hysteresis > 0) remember(&scan);
    return !scan.failed;
}
