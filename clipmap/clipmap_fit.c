// SPDX-License-Identifier: MIT
#include "clipmap/clipmap_fit.h"

#include "common/view/frustum.h"

#include <math.h>

struct ground { // of one level, relative to the eye
    const struct view *view;
    const struct view_origin *eye;
    double spacing_m[2], low_m, high_m;
    struct clipmap_box map;
    int pad; // samples round what is seen: there the level morphs to the coarser one
};

static struct ground ground_of(const struct clipmap_shape *shape, int k, const struct terrain *terrain,
                               const struct view *view, const struct view_origin *eye)
{
    const struct terrain_info *info = terrain_info(terrain);
    struct terrain_level level = terrain_level(terrain, info->finest + k);
    double eye_m = view->eye_m[2] - info->offset_m;
    return (struct ground){.view = view,
                           .eye = eye,
                           .spacing_m = {level.spacing_m[0], level.spacing_m[1]},
                           .low_m = level.min_q * info->quantum_m - eye_m,
                           .high_m = level.max_q * info->quantum_m - eye_m,
                           .map = shape->map[k],
                           .pad = (int)ceil(shape->rules.transition * shape->drawn[k]) + 2};
}

// What the frustum sees of a square of n x n samples and the pad, sides on even samples; empty when nothing.
static struct clipmap_box seen_of(const struct ground *ground, int n)
{
    struct clipmap_box square = clipmap_square(n, ground->eye),
                       box = clipmap_box_common(&square, &ground->map);
    double low[3] = {0, 0, ground->low_m}, high[3] = {0, 0, ground->high_m}, rect[4];
    if (clipmap_box_is_empty(&box)) return clipmap_empty;
    for (int axis = 0; axis < 2; axis++) {
        double eye = (double)ground->eye->fraction[axis], g = ground->spacing_m[axis];
        low[axis] = ((double)(box.lo[axis] - ground->eye->base[axis]) - eye) * g;
        high[axis] = ((double)(box.hi[axis] - ground->eye->base[axis]) - eye) * g;
    }
    if (!frustum_clip_box(ground->view, low, high, rect, NULL)) return clipmap_empty;
    for (int axis = 0; axis < 2; axis++) {
        double eye = (double)ground->eye->fraction[axis], g = ground->spacing_m[axis];
        int64_t lo = ground->eye->base[axis] + (int64_t)floor(rect[axis] / g + eye) - ground->pad;
        int64_t hi = ground->eye->base[axis] + (int64_t)ceil(rect[axis + 2] / g + eye) + ground->pad;
        box.lo[axis] = 2 * clipmap_floor_div(lo, 2);
        box.hi[axis] = 2 * clipmap_floor_div(hi + 1, 2);
    }
    return clipmap_box_common(&box, &square);
}

static bool is_within(const struct clipmap_box *box, int side)
{
    return box->hi[0] - box->lo[0] < side && box->hi[1] - box->lo[1] < side;
}

// n = side fits: it is no larger than its square.
static struct clipmap_fit fit_level(const struct ground *ground, int side, int most)
{
    int steps = 0; // of 2 samples
    for (int too_many = (most - side) / 2 + 1; too_many - steps > 1;) {
        int middle = (steps + too_many) / 2;
        struct clipmap_box seen = seen_of(ground, side + 2 * middle);
        *(is_within(&seen, side) ? &steps : &too_many) = middle;
    }
    struct clipmap_fit fit = {side + 2 * steps, seen_of(ground, side + 2 * steps)};
    if (clipmap_box_is_empty(&fit.seen)) fit = (struct clipmap_fit){side, ground->map};
    return fit;
}

void clipmap_fit(const struct clipmap_shape *shape, const struct terrain *terrain, const struct view *view,
                 const struct view_origin *eyes, struct clipmap_fit *fits)
{
    double narrow = fmin(1 / view->tan_half[0], 2); // a region that holds the viewer reaches no farther
    for (int k = 0; k < shape->levels; k++) {
        int side = shape->drawn[k];
        fits[k] = (struct clipmap_fit){side, shape->map[k]};
        if (narrow <= 1 || k == shape->levels - 1) continue;
        struct ground ground = ground_of(shape, k, terrain, view, &eyes[k]);
        fits[k] = fit_level(&ground, side, (int)(side * narrow));
    }
}
