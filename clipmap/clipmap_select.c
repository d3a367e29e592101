// SPDX-License-Identifier: MIT
#include "clipmap/clipmap_select.h"

#include "common/report.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>

struct culler {
    struct clipmap_selection *selection;
    const struct clipmap_choice *choice;
    const struct clipmap_mesh *mesh;
    const struct clipmap_store *store;
    const struct view_origin *eye;
    const struct view *view;
    struct frustum frustum;
    double spacing_m[2], quantum_m, eye_q;
    int level; // in work
};

bool clipmap_selection_init(struct clipmap_selection *selection, const struct clipmap_shape *shape)
{
    int side = shape->size / CLIPMAP_BLOCK + 3; // each of four rectangles rounds its blocks up
    int of_level = side * side + CLIPMAP_SIDES * side;
    *selection = (struct clipmap_selection){.capacity = shape->levels * of_level};
    size_t count = (size_t)selection->capacity;
    selection->corners = malloc(count * sizeof *selection->corners);
    selection->draws = malloc(count * sizeof *selection->draws);
    selection->pieces = malloc((size_t)of_level * sizeof *selection->pieces);
    if (selection->corners && selection->draws && selection->pieces) return true;
    return fail("clipmap: no memory for a list of %zu blocks", count);
}

void clipmap_selection_finish(struct clipmap_selection *selection)
{
    free(selection->corners);
    free(selection->draws);
    free(selection->pieces);
    *selection = (struct clipmap_selection){.corners = NULL};
}

// A box of samples with the bounds of its heights, about the eye.
static void box_m(const struct culler *culler, const struct clipmap_box *box, double low[3], double high[3])
{
    struct clipmap_range range = clipmap_store_range(culler->store, box);
    for (int axis = 0; axis < 2; axis++) {
        double fraction = (double)culler->eye->fraction[axis];
        low[axis] = ((double)(box->lo[axis] - culler->eye->base[axis]) - fraction) * culler->spacing_m[axis];
        high[axis] = ((double)(box->hi[axis] - culler->eye->base[axis]) - fraction) * culler->spacing_m[axis];
    }
    low[2] = (range.low - culler->eye_q) * culler->quantum_m;
    high[2] = (range.high - culler->eye_q) * culler->quantum_m;
}

static unsigned enter_box(void *user, const struct clipmap_box *box, unsigned planes)
{
    const struct culler *culler = user;
    double low[3], high[3];
    box_m(culler, box, low, high);
    bool outside = frustum_test_box(&culler->frustum, low, high, &planes) == FRUSTUM_OUTSIDE;
    return outside && culler->choice->cull ? CLIPMAP_LEAVE : planes;
}

static void take_block(void *user, const struct clipmap_piece *piece, unsigned planes)
{
    const struct culler *culler = user;
    struct clipmap_selection *selection = culler->selection;
    double low[2], high[2];
    for (int axis = 0; axis < 2; axis++) {
        double from =
            (double)(piece->corner[axis] - culler->eye->base[axis]) - (double)culler->eye->fraction[axis];
        low[axis] = from * culler->spacing_m[axis];
        high[axis] = (from + piece->extent[axis]) * culler->spacing_m[axis];
    }
    int way = view_inside_outline(culler->view, culler->store->terrain, low, high) ? CLIPMAP_WITHIN_MAP : 0;
    if (!planes) way |= CLIPMAP_WITHIN_VIEW;
    selection->pieces[selection->piece_count++] = (struct clipmap_chosen){*piece, way};
}

static void take_stitch(void *user, const struct clipmap_piece *piece, unsigned planes)
{
    struct clipmap_box box = {{piece->corner[0], piece->corner[1]},
                              {piece->corner[0] + piece->extent[0], piece->corner[1] + piece->extent[1]}};
    planes = enter_box(user, &box, planes);
    if (planes != CLIPMAP_LEAVE) take_block(user, piece, planes);
}

// Groups pieces by way and list, in the order in which they were cut: one draw each.  Columns among them are
// of the same height.
static void add_draws(const struct culler *culler)
{
    struct clipmap_selection *selection = culler->selection;
    int next[CLIPMAP_WAYS][CLIPMAP_KINDS] = {{0}};
    for (int i = 0; i < selection->piece_count; i++)
        next[selection->pieces[i].way][selection->pieces[i].piece.kind]++;
    for (int group = 0; group < CLIPMAP_WAYS * CLIPMAP_KINDS; group++) {
        int way = group / CLIPMAP_KINDS, kind = group % CLIPMAP_KINDS;
        if (!next[way][kind]) continue;
        assert(selection->corner_count + next[way][kind] <= selection->capacity);
        struct clipmap_draw draw = {
            culler->level,
            selection->corner_count,
            next[way][kind],
            way,
            kind >= CLIPMAP_FIRST_STRIP,
            clipmap_mesh_list(culler->mesh, kind, selection->pieces[0].piece.extent[1])};
        selection->draws[selection->draw_count++] = draw;
        selection->triangles += (uint64_t)draw.count * draw.list.triangles;
        selection->corner_count += draw.count;
        next[way][kind] = draw.first;
    }
    for (int i = 0; i < selection->piece_count; i++) {
        const struct clipmap_chosen *chosen = &selection->pieces[i];
        int32_t *corner = selection->corners[next[chosen->way][chosen->piece.kind]++];
        for (int axis = 0; axis < 2; axis++)
            corner[axis] = (int32_t)(chosen->piece.corner[axis] - culler->eye->base[axis]);
    }
    selection->piece_count = 0;
}

// False when the level draws nothing.
static bool begin_level(struct culler *culler, int level, const struct clipmap_region *region,
                        const struct clipmap_store *store, const struct view_origin *eye)
{
    if (clipmap_box_is_empty(&region->active)) return false;
    // An eye so far away sees nothing of the map, and corners are 32-bit.
    for (int axis = 0; axis < 2; axis++)
        if (llabs(region->active.lo[axis] - eye->base[axis]) > INT64_C(1) << 30) return false;
    culler->level = level;
    culler->store = store;
    culler->eye = eye;
    for (int axis = 0; axis < 2; axis++)
        culler->spacing_m[axis] = terrain_level(store->terrain, store->level).spacing_m[axis];
    culler->quantum_m = terrain_info(store->terrain)->quantum_m;
    return true;
}

static void add_blocks(struct culler *culler, const struct clipmap_region *region,
                       const struct clipmap_region *finer)
{
    struct clipmap_selection *selection = culler->selection;
    const struct clipmap_taker taker = {enter_box, take_block, culler, FRUSTUM_ALL};
    int all = clipmap_cut_blocks(region, finer, culler->choice->stitch, &taker);
    selection->blocks += selection->piece_count;
    selection->culled += all - selection->piece_count;
    add_draws(culler);
}

// Section 6.4: to the rectangle round what the frustum holds of the box.  False when nothing is left.
static bool crop(const struct culler *culler, struct clipmap_box *box)
{
    double low[3], high[3], seen_m[4];
    box_m(culler, box, low, high);
    if (!frustum_clip_box(culler->view, low, high, seen_m, NULL)) return false;
    for (int axis = 0; axis < 2; axis++) {
        double fraction = (double)culler->eye->fraction[axis], spacing_m = culler->spacing_m[axis];
        int64_t base = culler->eye->base[axis];
        int64_t lo = base + (int64_t)floor(seen_m[axis] / spacing_m + fraction);
        int64_t hi = base + (int64_t)ceil(seen_m[axis + 2] / spacing_m + fraction);
        if (lo > box->lo[axis]) box->lo[axis] = lo;
        if (hi < box->hi[axis]) box->hi[axis] = hi;
    }
    return box->lo[0] < box->hi[0] && box->lo[1] < box->hi[1];
}

static void add_strips(struct culler *culler, const struct clipmap_region *region,
                       const struct clipmap_region *finer)
{
    struct clipmap_selection *selection = culler->selection;
    const struct clipmap_taker taker = {NULL, take_block, culler,
                                        FRUSTUM_ALL}; // a column is long: seldom inside
    struct clipmap_box rectangles[CLIPMAP_RECTANGLES];
    int count = clipmap_rectangles(region, finer, culler->choice->stitch, rectangles);
    for (int i = 0; i < count; i++) {
        int all = clipmap_columns(&rectangles[i]), drawn = 0;
        if (!culler->choice->cull || crop(culler, &rectangles[i]))
            drawn = clipmap_cut_columns(&rectangles[i], &taker);
        selection->blocks += drawn;
        selection->culled += all - drawn;
        add_draws(culler);
    }
}

bool clipmap_eye_above(const struct clipmap_shape *shape, const struct clipmap_region *regions,
                       const struct clipmap_store *stores, const struct clipmap_scratch *scratch,
                       const struct view_origin *eyes, const struct view *view)
{
    int32_t eye_base;
    float eye_fraction, z[4];
    view_eye_quanta(view, &eye_base, &eye_fraction);
    for (int k = 0; k < shape->levels; k++) {
        const int64_t *base = eyes[k].base;
        const struct clipmap_box cell = {{base[0], base[1]}, {base[0] + 1, base[1] + 1}};
        if (clipmap_box_is_empty(&regions[k].active) || !clipmap_box_holds(&regions[k].active, &cell))
            continue;
        clipmap_store_read(&stores[k], &cell, scratch);
        for (int i = 0; i < 4; i++)
            z[i] = clipmap_morphed(scratch->pairs[i][0], scratch->pairs[i][1],
                                   clipmap_alpha_at(&regions[k], shape->rules.alpha, i & 1, i >> 1));
        float x = eyes[k].fraction[0], y = eyes[k].fraction[1];
        float drawn = x >= y ? z[0] + x * (z[1] - z[0]) + y * (z[3] - z[1])
                             : z[0] + y * (z[2] - z[0]) + x * (z[3] - z[2]);
        return (double)eye_base + (double)eye_fraction > (double)drawn;
    }
    return true;
}

static void clear(struct clipmap_selection *selection)
{
    selection->corner_count = selection->draw_count = selection->stitch_draws = selection->piece_count = 0;
    selection->levels = selection->blocks = selection->culled = 0;
    selection->triangles = 0;
}

void clipmap_select(struct clipmap_selection *selection, const struct clipmap_shape *shape,
                    const struct clipmap_choice *choice, const struct clipmap_mesh *mesh,
                    const struct clipmap_region *regions, const struct clipmap_store *stores,
                    const struct view_origin *eyes, const struct view *view)
{
    struct culler culler = {.selection = selection, .choice = choice, .mesh = mesh, .view = view};
    int32_t eye_base;
    float eye_fraction;
    view_eye_quanta(view, &eye_base, &eye_fraction);
    culler.eye_q = (double)eye_base + (double)eye_fraction;
    frustum_init(&culler.frustum, view);
    clear(selection);
    for (int k = 0; k < shape->levels; k++) {
        if (!begin_level(&culler, k, &regions[k], &stores[k], &eyes[k])) continue;
        bool strips = choice->layout == CLIPMAP_LAYOUT_STRIPS;
        (strips ? add_strips : add_blocks)(&culler, &regions[k], k > 0 ? &regions[k - 1] : NULL);
        selection->levels++;
    }
    int block_draws = selection->draw_count;
    for (int k = 0; k < shape->levels; k++) {
        const struct clipmap_taker taker = {NULL, take_stitch, &culler, FRUSTUM_ALL};
        if (!begin_level(&culler, k, &regions[k], &stores[k], &eyes[k])) continue;
        clipmap_cut_stitches(&regions[k], k > 0 ? &regions[k - 1] : NULL, choice->stitch, &taker);
        add_draws(&culler);
    }
    selection->stitch_draws = selection->draw_count - block_draws;
}
