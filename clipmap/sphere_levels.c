// SPDX-License-Identifier: MIT
#include "clipmap/sphere_levels.h"

#include <math.h>

enum { MARGIN = 4, SNAP = 4 }; // texels beyond what rings reach; windows begin on multiples of SNAP

void sphere_shape_init(struct sphere_shape *shape, const struct terrain *terrain, int azimuths)
{
    const struct terrain_info *info = terrain_info(terrain);
    struct terrain_extent e = terrain_level(terrain, 0).extent;
    *shape = (struct sphere_shape){.azimuths = azimuths,
                                   .finest = info->finest,
                                   .coarsest = info->coarsest,
                                   .radius_m = info->radius_m,
                                   .spacing_m = {info->spacing_m[0], info->spacing_m[1]},
                                   .columns = e.x1 - e.x0,
                                   .first = e.x0,
                                   .pole = e.y1 - 1};
    if (shape->finest < shape->coarsest - SPHERE_MAX_LEVELS + 1)
        shape->finest = shape->coarsest - SPHERE_MAX_LEVELS + 1;
    // A turn must fit when no more columns can be taken together, and the coarsest level whole.
    int64_t turn = shape->columns >> shape->coarsest, rows = 2 * (shape->pole >> shape->coarsest) + 1;
    while (turn % 2 == 0 && turn > azimuths) turn /= 2;
    int64_t least = turn > rows ? turn : rows;
    shape->size = (int)(least + 2 * MARGIN > azimuths ? least + 2 * MARGIN : azimuths);
}

double sphere_level_at(const struct sphere_shape *shape, double angle)
{
    return log2(SPHERE_TEXEL_SHARE * angle * shape->radius_m / (shape->azimuths * shape->spacing_m[1]));
}

static int64_t turn_of(const struct sphere_shape *shape, int level)
{
    return level > 0 ? shape->columns >> level : shape->columns << -level;
}

// Half the longitudes that a cap of an angle spans; NAN when it holds a pole (section 4.1, corrected: SC7).
static double half_longitude(double angle, double latitude)
{
    double share = sin(angle) / cos(latitude);
    return angle < M_PI / 2 - fabs(latitude) && share < 1 ? asin(share) : (double)NAN;
}

static int64_t snap_down(double value)
{
    return (int64_t)floor(value / SNAP) * SNAP;
}

struct sphere_window sphere_window_wanted(const struct sphere_shape *shape, int level,
                                          const double place_m[2])
{
    double spacing_m = ldexp(shape->spacing_m[1], level), column_m = ldexp(shape->spacing_m[0], level);
    // Rings sample this level up to where they sample the next alone: one octave, twice the angle.
    double angle = level == shape->coarsest
                       ? M_PI
                       : 2 * shape->azimuths * spacing_m / (SPHERE_TEXEL_SHARE * shape->radius_m);
    double half = half_longitude(angle, place_m[1] / shape->radius_m) * shape->radius_m / column_m;
    int64_t turn = turn_of(shape, level);
    struct sphere_window window = {.period = shape->size};
    bool fits = !isnan(half);
    while (fits && half / (1 << window.decimation) + MARGIN + SNAP > shape->size / 2.0) {
        window.decimation++;
        fits = turn % ((int64_t)1 << window.decimation) == 0 && window.decimation < 30;
    }
    if (!fits || turn >> window.decimation <= shape->size) { // then the turn is no larger than a window
        for (window.decimation = 0; turn >> window.decimation > shape->size; window.decimation++) continue;
        window.around = true;
        window.period = (int)(turn >> window.decimation);
    }
    double x = place_m[0] / ldexp(column_m, window.decimation), y = place_m[1] / spacing_m;
    double rows = fmin(angle * shape->radius_m / spacing_m, shape->size / 2.0 - SNAP - MARGIN) + MARGIN;
    window.box.lo[1] = snap_down(y - rows);
    window.box.hi[1] = snap_down(y + rows) + SNAP;
    if (level == shape->coarsest) { // all rows there are, wherever the viewer is
        window.box.lo[1] = -(shape->pole >> level) - 1;
        window.box.hi[1] = (shape->pole >> level) + 1;
    }
    if (window.around) {
        window.box.hi[0] = window.period - 1;
        return window;
    }
    double reach = half / (1 << window.decimation) + MARGIN;
    window.box.lo[0] = snap_down(x - reach);
    window.box.hi[0] = snap_down(x + reach) + SNAP;
    return window;
}

void sphere_window_origin(const struct sphere_shape *shape, int level, const struct sphere_window *window,
                          const double place_m[2], int64_t texel[2], float fraction[2])
{
    for (int axis = 0; axis < 2; axis++) {
        double spacing_m = ldexp(shape->spacing_m[axis], level + (axis ? 0 : window->decimation));
        double at = place_m[axis] / spacing_m, whole = floor(at);
        texel[axis] = (int64_t)whole;
        fraction[axis] = (float)(at - whole);
    }
}

void sphere_cap_bounds(const struct sphere_shape *shape, const struct terrain *terrain, int level,
                       const struct sphere_window *window, const double place_m[2], double angle,
                       int32_t *low_q, int32_t *high_q)
{
    double spacing_m = ldexp(shape->spacing_m[1], level), column_m = ldexp(shape->spacing_m[0], level);
    double half = half_longitude(angle, place_m[1] / shape->radius_m) * shape->radius_m / column_m;
    int64_t beyond = ((int64_t)2 << window->decimation) + 1; // columns that the outer texels stand for
    int64_t x = (int64_t)floor(place_m[0] / column_m), y = (int64_t)floor(place_m[1] / spacing_m);
    int64_t reach = isnan(half) ? turn_of(shape, level) : (int64_t)ceil(half) + beyond;
    int64_t rows = (int64_t)ceil(angle * shape->radius_m / spacing_m) + 2;
    terrain_bounds(terrain, level, x - reach, y - rows, x + reach + 1, y + rows + 1, low_q, high_q);
}

// ---- reading ---------------------------------------------------------------

// The mean of 2^p columns and half of the one beyond them on either side.
static float mean_of(const int32_t *columns, int count)
{
    double sum = 0.5 * columns[0] + 0.5 * columns[count];
    for (int k = 1; k < count; k++) sum += columns[k];
    return (float)(sum / count);
}

// Stored levels are filtered; synthesised ones, whose noise tapers where columns are taken together, are not.
void sphere_read_texels(const struct sphere_shape *shape, const struct terrain *terrain, int level,
                        int decimation, const struct clipmap_box *box, float *heights, int32_t *columns)
{
    int width = (int)(box->hi[0] - box->lo[0] + 1), height = (int)(box->hi[1] - box->lo[1] + 1);
    int count = 1 << decimation;
    if (decimation == 0) {
        terrain_window(terrain, level, box->lo[0], box->lo[1], width, height, columns, TERRAIN_WAIT);
        for (int64_t k = 0; k < (int64_t)width * height; k++) heights[k] = (float)columns[k];
        return;
    }
    bool filter = level >= 0 && count + 1 <= shape->size * shape->size;
    for (int i = 0; i < width; i++) {
        int64_t x = (box->lo[0] + i) << decimation;
        if (!filter) {
            terrain_window(terrain, level, x, box->lo[1], 1, height, columns, TERRAIN_WAIT);
            for (int j = 0; j < height; j++) heights[(int64_t)j * width + i] = (float)columns[j];
            continue;
        }
        for (int j = 0; j < height; j++) {
            terrain_window(terrain, level, x - count / 2, box->lo[1] + j, count + 1, 1, columns,
                           TERRAIN_WAIT);
            heights[(int64_t)j * width + i] = mean_of(columns, count);
        }
    }
}

static uint64_t read_box(const struct sphere_shape *shape, const struct terrain *terrain, int level,
                         const struct sphere_window *window, const struct clipmap_box *box, float *heights,
                         int32_t *columns, sphere_write_fn *write, void *user)
{
    struct clipmap_box pieces[4];
    int count = clipmap_unwrap(box, shape->size, pieces);
    for (int k = 0; k < count; k++) {
        const struct clipmap_box *piece = &pieces[k];
        sphere_read_texels(shape, terrain, level, window->decimation, piece, heights, columns);
        write(user, clipmap_slot(piece->lo[0], shape->size), clipmap_slot(piece->lo[1], shape->size),
              (int)(piece->hi[0] - piece->lo[0] + 1), (int)(piece->hi[1] - piece->lo[1] + 1), heights);
    }
    return clipmap_box_samples(box);
}

uint64_t sphere_store_move(struct sphere_store *store, const struct sphere_shape *shape,
                           const struct terrain *terrain, int level, const struct sphere_window *wanted,
                           uint64_t budget, float *heights, int32_t *columns, sphere_write_fn *write,
                           void *user, bool *whole)
{
    struct clipmap_box kept = store->held.box, exposed[4];
    bool same = store->held.decimation == wanted->decimation && store->held.around == wanted->around;
    kept = same ? clipmap_box_common(&kept, &wanted->box) : clipmap_empty;
    store->held = *wanted;
    store->held.box = clipmap_grown(&kept, &wanted->box, budget);
    uint64_t read = 0;
    int count = clipmap_exposed(&kept, &store->held.box, exposed);
    for (int k = 0; k < count; k++)
        read += read_box(shape, terrain, level, wanted, &exposed[k], heights, columns, write, user);
    *whole = clipmap_box_equal(&store->held.box, &wanted->box);
    return read;
}
