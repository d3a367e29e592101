// SPDX-License-Identifier: MIT
#include "clipmap/clipmap_levels.h"

#include "common/integer.h"

#include <math.h>
#include <string.h>

static const float far_side = 1e9f; // a closed side: no vertex is near it

const struct clipmap_box clipmap_empty = {{0, 0}, {-1, -1}};

bool clipmap_box_is_empty(const struct clipmap_box *box)
{
    return box->hi[0] < box->lo[0] || box->hi[1] < box->lo[1];
}

bool clipmap_box_holds(const struct clipmap_box *outer, const struct clipmap_box *inner)
{
    if (clipmap_box_is_empty(inner)) return true;
    for (int axis = 0; axis < 2; axis++)
        if (inner->lo[axis] < outer->lo[axis] || inner->hi[axis] > outer->hi[axis]) return false;
    return true;
}

bool clipmap_box_equal(const struct clipmap_box *a, const struct clipmap_box *b)
{
    return memcmp(a, b, sizeof *a) == 0;
}

uint64_t clipmap_box_samples(const struct clipmap_box *box)
{
    if (clipmap_box_is_empty(box)) return 0;
    return (uint64_t)(box->hi[0] - box->lo[0] + 1) * (uint64_t)(box->hi[1] - box->lo[1] + 1);
}

int64_t clipmap_floor_div(int64_t a, int64_t b)
{
    return a / b - (a % b < 0);
}

int clipmap_slot(int64_t index, int size)
{
    return (int)(index - clipmap_floor_div(index, size) * size);
}

static int64_t even_down(int64_t i)
{
    return 2 * clipmap_floor_div(i, 2);
}

static int64_t even_up(int64_t i)
{
    return 2 * clipmap_floor_div(i + 1, 2);
}

struct clipmap_box clipmap_box_common(const struct clipmap_box *a, const struct clipmap_box *b)
{
    struct clipmap_box both;
    for (int axis = 0; axis < 2; axis++) {
        both.lo[axis] = larger(a->lo[axis], b->lo[axis]);
        both.hi[axis] = smaller(a->hi[axis], b->hi[axis]);
    }
    return clipmap_box_is_empty(&both) ? clipmap_empty : both;
}

// The largest odd number that is at most `side`, but no smaller than regions can be (numerics.md, CM3).
static int odd_side(double side)
{
    return (int)fmax(2 * floor((side - 1) / 2) + 1, 11);
}

static void set_sides(struct clipmap_shape *shape, int k, int n)
{
    shape->kept[k] = n;
    shape->drawn[k] = odd_side(n * sqrt(shape->rules.throttle));
}

// Where levels cannot get as small as the throttle asks, the finest ones are left out.
static void leave_out(struct clipmap_shape *shape)
{
    double most = 0, drawn = 0;
    for (int k = 0; k < shape->levels; k++) most += shape->rules.throttle * shape->kept[k] * shape->kept[k];
    for (int k = shape->levels - 1; k >= 0; k--) {
        drawn += shape->drawn[k] * shape->drawn[k];
        if (drawn <= most || k == shape->levels - 1) shape->finest = k;
    }
}

// As many levels as it takes for one to hold the whole map.
static void settle(struct clipmap_shape *shape)
{
    int64_t longest;
    shape->levels = 0;
    do {
        const struct clipmap_box *map = &shape->map[shape->levels];
        longest = larger(map->hi[0] - map->lo[0], map->hi[1] - map->lo[1]) + 1;
        shape->levels++;
    } while (longest > shape->drawn[shape->levels - 1] && shape->levels < shape->available);
    shape->size = (int)larger(shape->rules.n, longest) + CLIPMAP_MARGIN + shape->rules.ahead;
    leave_out(shape);
}

void clipmap_shape_init(struct clipmap_shape *shape, const struct clipmap_rules *rules, int available,
                        const struct terrain_extent *finest, double finest_spacing_m)
{
    *shape = (struct clipmap_shape){.rules = *rules};
    shape->available = (int)smaller(available, CLIPMAP_MAX_LEVELS);
    int64_t lo[2] = {finest->x0, finest->y0}, hi[2] = {finest->x1 - 1, finest->y1 - 1};
    for (int k = 0; k < shape->available; k++) {
        for (int axis = 0; axis < 2; axis++) {
            shape->map[k].lo[axis] = even_down(lo[axis]);
            shape->map[k].hi[axis] = even_up(hi[axis]);
            lo[axis] = clipmap_floor_div(lo[axis], 2);
            hi[axis] = -clipmap_floor_div(-hi[axis], 2);
        }
        shape->spacing_m[k] = ldexp(finest_spacing_m, k);
        set_sides(shape, k, rules->n);
    }
    settle(shape);
}

// What the side of level k is in proportion to.
static double weight(const struct clipmap_shape *shape, enum clipmap_sizes sizes, int k,
                     const double *error_m)
{
    const double g = shape->spacing_m[k];
    if (sizes == CLIPMAP_SIZES_ERROR) return error_m[k + 1] / (2 * g);
    return sqrt(sqrt(fmax(error_m[k + 1] - error_m[k], 0) / (g * g)));
}

void clipmap_shape_by_error(struct clipmap_shape *shape, enum clipmap_sizes sizes, const double *error_m)
{
    double largest = 0;
    for (int k = 0; k + 1 < shape->levels; k++) largest = fmax(largest, weight(shape, sizes, k, error_m));
    if (largest == 0) return; // flat: nothing to tell the levels apart
    for (int k = 0; k < shape->available; k++) {
        int coarser = k + 1 < shape->available ? k : k - 1; // what is coarser than the coarsest is not known
        double share = fmin(fmax(weight(shape, sizes, coarser, error_m) / largest, 0.5), 1);
        int n = odd_side(shape->rules.n * share);
        if (k > 0) n = (int)larger(n, odd_side(0.7 * shape->kept[k - 1]));
        set_sides(shape, k, n);
    }
    settle(shape);
}

static bool is_coarsest(const struct clipmap_shape *shape, int k)
{
    return k == shape->levels - 1;
}

struct clipmap_box clipmap_square(int n, const struct view_origin *eye)
{
    struct clipmap_box box;
    for (int axis = 0; axis < 2; axis++) {
        box.lo[axis] = even_down(eye->base[axis] - (n - 1) / 2 + 1);
        box.hi[axis] = box.lo[axis] + n - 1;
    }
    return box;
}

// square: n x n samples about the viewer.
static struct clipmap_box wanted(const struct clipmap_shape *shape, int k, int n,
                                 const struct clipmap_box *square, double height_m,
                                 const struct clipmap_fit *fits)
{
    if (is_coarsest(shape, k)) return shape->map[k];
    if (height_m > 0.4 * n * shape->spacing_m[k]) return clipmap_empty;
    struct clipmap_box box = clipmap_box_common(square, &shape->map[k]);
    if (fits) box = clipmap_box_common(&box, &fits[k].seen);
    for (int axis = 0; axis < 2; axis++)
        if (box.hi[axis] - box.lo[axis] < 2) return clipmap_empty;
    return box;
}

struct clipmap_box clipmap_desired(const struct clipmap_shape *shape, int k, const struct view_origin *eye,
                                   double height_m, const struct clipmap_fit *fits)
{
    int n = fits ? fits[k].n : shape->kept[k];
    struct clipmap_box square = clipmap_square(n, eye);
    return wanted(shape, k, n, &square, height_m, fits);
}

// The part of level k that the coarser clip region less one cell covers.
static struct clipmap_box room_within(const struct clipmap_shape *shape, int k,
                                      const struct clipmap_box *coarser_clip)
{
    const struct clipmap_box *map = &shape->map[k], *coarser_map = &shape->map[k + 1];
    struct clipmap_box room = *map;
    if (clipmap_box_is_empty(coarser_clip)) return clipmap_empty;
    for (int axis = 0; axis < 2; axis++) {
        int64_t lo = coarser_clip->lo[axis], hi = coarser_clip->hi[axis];
        if (lo > coarser_map->lo[axis]) room.lo[axis] = larger(room.lo[axis], 2 * (lo + 1));
        if (hi < coarser_map->hi[axis]) room.hi[axis] = smaller(room.hi[axis], 2 * (hi - 1));
    }
    return clipmap_box_is_empty(&room) ? clipmap_empty : room;
}

// Lines that the viewer has left stay while there is room for them; a side that has to move in the direction
// of the motion goes `ahead` lines farther.
static struct clipmap_box follow(const struct clipmap_box *clip, const struct clipmap_box *desired, int size,
                                 int ahead, const int heading[2])
{
    struct clipmap_box next = *desired, common = clipmap_box_common(clip, desired);
    if (clipmap_box_is_empty(&common)) return next;
    for (int axis = 0; axis < 2; axis++) {
        int64_t lo = smaller(clip->lo[axis], desired->lo[axis]),
                hi = larger(clip->hi[axis], desired->hi[axis]);
        bool upwards = desired->hi[axis] > clip->hi[axis], downwards = desired->lo[axis] < clip->lo[axis];
        if (upwards && heading[axis] > 0) hi += ahead;
        if (downwards && heading[axis] < 0) lo -= ahead;
        next.lo[axis] = upwards ? larger(lo, hi - size + 1) : lo;
        next.hi[axis] = upwards ? hi : smaller(hi, lo + size - 1);
    }
    return next;
}

struct clipmap_box clipmap_target(const struct clipmap_shape *shape, int k, const struct clipmap_box *clip,
                                  const struct clipmap_box *coarser_clip, const struct clipmap_box *desired,
                                  const int heading[2])
{
    if (is_coarsest(shape, k)) return shape->map[k];
    struct clipmap_box room = room_within(shape, k, coarser_clip), kept = clipmap_box_common(clip, &room),
                       wanted_here = clipmap_box_common(desired, &room);
    if (clipmap_box_is_empty(&wanted_here)) return kept;
    struct clipmap_box next = follow(&kept, &wanted_here, shape->size, shape->rules.ahead, heading);
    return clipmap_box_common(&next, &room);
}

// `step` of `steps` from one box to one around it.
static struct clipmap_box between(const struct clipmap_box *from, const struct clipmap_box *to, int64_t step,
                                  int64_t steps)
{
    struct clipmap_box box;
    for (int axis = 0; axis < 2; axis++) {
        box.lo[axis] = from->lo[axis] - (from->lo[axis] - to->lo[axis]) * step / steps;
        box.hi[axis] = from->hi[axis] + (to->hi[axis] - from->hi[axis]) * step / steps;
    }
    return box;
}

struct clipmap_box clipmap_grown(const struct clipmap_box *kept, const struct clipmap_box *target,
                                 uint64_t budget)
{
    if (clipmap_box_is_empty(target)) return clipmap_empty;
    struct clipmap_box from = *kept;
    int64_t steps = 1;
    for (int axis = 0; axis < 2; axis++) {
        if (clipmap_box_is_empty(kept)) {
            from.lo[axis] = clipmap_floor_div(target->lo[axis] + target->hi[axis] + 1, 2);
            from.hi[axis] = from.lo[axis] - 1;
        }
        steps = larger(steps, from.lo[axis] - target->lo[axis]);
        steps = larger(steps, target->hi[axis] - from.hi[axis]);
    }
    int64_t done = 0; // how many steps the budget pays for
    for (int64_t most = steps; done < most;) {
        int64_t middle = (done + most + 1) / 2;
        struct clipmap_box box = between(&from, target, middle, steps);
        if (clipmap_box_samples(&box) - clipmap_box_samples(kept) <= budget)
            done = middle;
        else
            most = middle - 1;
    }
    struct clipmap_box grown = between(&from, target, done, steps);
    return clipmap_box_is_empty(&grown) ? clipmap_empty : grown;
}

int clipmap_exposed(const struct clipmap_box *before, const struct clipmap_box *now,
                    struct clipmap_box exposed[4])
{
    struct clipmap_box kept = clipmap_box_common(before, now), rest = *now;
    if (clipmap_box_is_empty(before) || clipmap_box_is_empty(&kept)) {
        exposed[0] = *now;
        return clipmap_box_is_empty(now) ? 0 : 1;
    }
    int count = 0;
    for (int axis = 1; axis >= 0; axis--) { // whole rows first, then what is left of the columns
        if (rest.lo[axis] < kept.lo[axis]) {
            exposed[count] = rest;
            exposed[count++].hi[axis] = kept.lo[axis] - 1;
        }
        if (rest.hi[axis] > kept.hi[axis]) {
            exposed[count] = rest;
            exposed[count++].lo[axis] = kept.hi[axis] + 1;
        }
        rest.lo[axis] = kept.lo[axis];
        rest.hi[axis] = kept.hi[axis];
    }
    return count;
}

static bool reach_there(const struct clipmap_box *kept, const struct clipmap_box *now,
                        clipmap_there_fn *there, void *user)
{
    struct clipmap_box exposed[4];
    int count = clipmap_exposed(kept, now, exposed);
    bool all = true;
    for (int i = 0; i < count; i++) all = there(user, &exposed[i]) && all;
    return all;
}

uint64_t clipmap_budget_there(const struct clipmap_box *kept, const struct clipmap_box *target,
                              uint64_t budget, clipmap_there_fn *there, void *user)
{
    enum { STEPS = 8 };
    uint64_t whole = clipmap_box_samples(target) - clipmap_box_samples(kept), reached = 0;
    struct clipmap_box before = *kept;
    bool all = true;
    for (int step = 1; step <= STEPS; step++) {
        uint64_t part = whole * (uint64_t)(step * step) / (STEPS * STEPS);
        if (part > budget) part = budget;
        struct clipmap_box now = clipmap_grown(kept, target, part);
        if (clipmap_box_equal(&now, &before)) continue;
        all = reach_there(kept, &now, there, user) && all;
        if (all) reached = part;
        before = now;
    }
    return reached;
}

int clipmap_unwrap(const struct clipmap_box *box, int size, struct clipmap_box pieces[4])
{
    int count = 0;
    for (int64_t y = box->lo[1], y_next; y <= box->hi[1]; y = y_next) {
        y_next = smaller(y + size - clipmap_slot(y, size), box->hi[1] + 1);
        for (int64_t x = box->lo[0], x_next; x <= box->hi[0]; x = x_next) {
            x_next = smaller(x + size - clipmap_slot(x, size), box->hi[0] + 1);
            pieces[count++] = (struct clipmap_box){{x, y}, {x_next - 1, y_next - 1}};
        }
    }
    return count;
}

// ---- active regions --------------------------------------------------------

// Crops to the samples in memory and, where the coarser level has an open side, to two of its cells within it
// (section 5, constraints 2 to 4).  Beside a closed side the coarser level goes on to the map's edge and
// needs no room.
static void crop(struct clipmap_box *box, const struct clipmap_box *clip,
                 const struct clipmap_region *coarser)
{
    for (int axis = 0; axis < 2; axis++) {
        if (clip) {
            box->lo[axis] = larger(box->lo[axis], even_up(clip->lo[axis]));
            box->hi[axis] = smaller(box->hi[axis], even_down(clip->hi[axis]));
        }
        if (!coarser) continue;
        int64_t low_room = coarser->open[axis] ? 2 : 0, high_room = coarser->open[axis + 2] ? 2 : 0;
        box->lo[axis] = larger(box->lo[axis], 2 * (coarser->active.lo[axis] + low_room));
        box->hi[axis] = smaller(box->hi[axis], 2 * (coarser->active.hi[axis] - high_room));
    }
    for (int axis = 0; axis < 2; axis++)
        if (box->hi[axis] - box->lo[axis] < 2) *box = clipmap_empty;
}

// The square about the viewer that a level's active region is a part of.
static int side_drawn(const struct clipmap_shape *shape, int k, const struct clipmap_fit *fits)
{
    return fits ? fits[k].n : shape->drawn[k];
}

static void set_active(const struct clipmap_shape *shape, int k, const struct clipmap_box *square,
                       double height_m, const struct clipmap_fit *fits, const struct clipmap_box *clip,
                       const struct clipmap_region *coarser, struct clipmap_region *region)
{
    *region = (struct clipmap_region){.active = clipmap_empty, .hole = clipmap_empty, .width = 1};
    if (k < shape->finest) return;
    if (coarser && clipmap_box_is_empty(&coarser->active)) return; // then all finer levels are empty too
    region->active = wanted(shape, k, side_drawn(shape, k, fits), square, height_m, fits);
    if (clipmap_box_is_empty(&region->active)) return;
    crop(&region->active, clip, coarser);
    if (!coarser) return;
    for (int axis = 0; axis < 2; axis++) {
        region->open[axis] = region->active.lo[axis] != shape->map[k].lo[axis];
        region->open[axis + 2] = region->active.hi[axis] != shape->map[k].hi[axis];
    }
}

static struct clipmap_box hole_of(const struct clipmap_region *finer)
{
    if (clipmap_box_is_empty(&finer->active)) return clipmap_empty;
    struct clipmap_box hole;
    for (int axis = 0; axis < 2; axis++) {
        hole.lo[axis] = finer->active.lo[axis] / 2; // even: exact
        hole.hi[axis] = finer->active.hi[axis] / 2;
    }
    return hole;
}

// ---- morph -----------------------------------------------------------------

// Cells between the hole and the nearest open side.
static double least_width(const struct clipmap_region *region)
{
    double least = INFINITY;
    if (clipmap_box_is_empty(&region->hole)) return least;
    for (int axis = 0; axis < 2; axis++) {
        if (region->open[axis])
            least = fmin(least, (double)(region->hole.lo[axis] - region->active.lo[axis]));
        if (region->open[axis + 2])
            least = fmin(least, (double)(region->active.hi[axis] - region->hole.hi[axis]));
    }
    return least;
}

// Section 6.2 as printed: alpha from the distance to the viewer and half the extent, wherever the viewer
// stands in the region.
static void set_published(struct clipmap_region *region, const struct view_origin *eye, double width)
{
    for (int axis = 0; axis < 2; axis++) {
        double half = (double)(region->active.hi[axis] - region->active.lo[axis]) / 2;
        if (region->open[axis]) region->low[axis] = (float)((double)eye->fraction[axis] - half + 1);
        if (region->open[axis + 2]) region->high[axis] = (float)((double)eye->fraction[axis] + half - 1);
    }
    region->width = (float)width;
}

// CM1 to CM3.  A side where the viewer puts it morphs by the viewer's continuous place, so that nothing jumps
// when the region snaps: that band ends up to two cells farther in than the perimeter form's, and needs their
// room.
static void set_stable(struct clipmap_region *region, const struct view_origin *eye,
                       const struct clipmap_box *square, int n, double width, double least)
{
    bool room = width + 2 <= least;
    for (int axis = 0; axis < 2; axis++) {
        double middle = (double)eye->fraction[axis], half = (n - 1) / 2;
        bool low_placed = region->active.lo[axis] == square->lo[axis];
        bool high_placed = region->active.hi[axis] == square->hi[axis];
        if (region->open[axis])
            region->low[axis] =
                (float)(room && low_placed ? middle - half + 1
                                           : (double)(region->active.lo[axis] - eye->base[axis]));
        if (region->open[axis + 2])
            region->high[axis] =
                (float)(room && high_placed ? middle + half - 1
                                            : (double)(region->active.hi[axis] - eye->base[axis]));
    }
    region->width = (float)fmin(width, least);
}

static float fade_of(const struct clipmap_shape *shape, int k, int n, double height_m)
{
    if (!shape->rules.fade || is_coarsest(shape, k)) return 0;
    double share = height_m / (n * shape->spacing_m[k]);
    return (float)fmin(fmax((share - 0.3) / 0.1, 0), 1);
}

// n: of the square about the viewer.
static void set_morph(const struct clipmap_shape *shape, int k, const struct view_origin *eye,
                      double height_m, int n, const struct clipmap_box *square, struct clipmap_region *region)
{
    const struct clipmap_rules *rules = &shape->rules;
    int side = shape->drawn[k], finer_side = shape->drawn[k > 0 ? k - 1 : 0];
    double width = fmax(rules->transition * side, 1), least = least_width(region);
    for (int axis = 0; axis < 2; axis++) {
        region->low[axis] = -far_side;
        region->high[axis] = far_side;
    }
    if (rules->alpha == CLIPMAP_ALPHA_PUBLISHED) {
        set_published(region, eye, fmin(width, least));
    } else {
        double uncropped =
            floor((2 * side - finer_side - 3) / 4.0); // least_width() of squares that nothing cropped
        set_stable(region, eye, square, n, fmin(width, fmax(uncropped - 2, 1)), least);
    }
    region->fade = fade_of(shape, k, n, height_m);
}

void clipmap_regions(const struct clipmap_shape *shape, const struct view_origin *eyes, double height_m,
                     const struct clipmap_fit *fits, const struct clipmap_box *clips,
                     struct clipmap_region *regions)
{
    struct clipmap_box squares[CLIPMAP_MAX_LEVELS];
    for (int k = shape->levels - 1; k >= 0; k--) {
        squares[k] = clipmap_square(side_drawn(shape, k, fits), &eyes[k]);
        set_active(shape, k, &squares[k], height_m, fits, clips ? &clips[k] : NULL,
                   is_coarsest(shape, k) ? NULL : &regions[k + 1], &regions[k]);
    }
    for (int k = 0; k < shape->levels; k++) {
        if (clipmap_box_is_empty(&regions[k].active)) continue;
        if (k > 0) regions[k].hole = hole_of(&regions[k - 1]);
        set_morph(shape, k, &eyes[k], height_m, side_drawn(shape, k, fits), &squares[k], &regions[k]);
    }
}

double clipmap_spacing_px(int n, int width_px, double tan_half_horizontal)
{
    const double depth = 0.4; // in n g
    return width_px / (2 * depth * n * tan_half_horizontal);
}

float clipmap_alpha_at(const struct clipmap_region *region, enum clipmap_alpha form, int cell_x, int cell_y)
{
    float x = (float)cell_x, y = (float)cell_y;
    float d =
        fminf(fminf(x - region->low[0], region->high[0] - x), fminf(y - region->low[1], region->high[1] - y));
    float alpha = fminf(fmaxf((region->width - d) * (1.0f / region->width), region->fade), 1.0f);
    return form == CLIPMAP_ALPHA_STABLE && d <= 0.0f ? 1.0f : alpha;
}

float clipmap_morphed(float z, float z_c, float alpha)
{
    return alpha >= 1.0f ? z_c : z + (z_c - z) * alpha;
}
