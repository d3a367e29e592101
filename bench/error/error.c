// SPDX-License-Identifier: MIT
#include "bench/error/error.h"

#include "bench/error/flat.h"

#include "common/parallel.h"
#include "common/report.h"

#include <limits.h>
#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

enum { ROWS_A_BLOCK = 8, HOLE_UNDER_SKYLINE = 8 };

bool frame_error_init(struct frame_error *error, int width, int height)
{
    size_t pixels = (size_t)width * (size_t)height;
    *error = (struct frame_error){.width = width, .height = height};
    error->error_px = malloc(pixels * sizeof *error->error_px);
    error->plane_px = malloc(pixels * sizeof *error->plane_px);
    error->kind = malloc(pixels);
    error->scratch = malloc((pixels + 3 * (size_t)height) * sizeof *error->scratch);
    if (error->error_px && error->plane_px && error->kind && error->scratch) return true;
    frame_error_finish(error);
    return fail("--size %dx%d: no memory for a picture of this size", width, height);
}

void frame_error_finish(struct frame_error *error)
{
    free(error->error_px);
    free(error->plane_px);
    free(error->kind);
    free(error->scratch);
    *error = (struct frame_error){0};
}

struct places *truth_places(const struct truth *truth, int threads)
{
    double(*xy)[2] = malloc((truth->ground + 1) * sizeof *xy);
    if (!xy) {
        fail("no memory for %llu places", (unsigned long long)truth->ground);
        return NULL;
    }
    size_t count = 0, pixels = (size_t)truth->width * (size_t)truth->height;
    for (size_t k = 0; k < pixels; k++)
        if (truth->pixels[k].depth > 0) {
            double flat[3];
            flat_from_relative(truth->radius_m, truth->pixels[k].relative, flat);
            memcpy(xy[count++], flat, sizeof *xy);
        }
    struct places *places = places_create((const double(*)[2])xy, count, threads);
    free(xy);
    return places;
}

// ---- pixel by pixel -----------------------------------------------------------------------------

struct measuring {
    struct frame_error *error;
    const struct terrain *terrain;
    const struct terrain_info *info;
    const struct view *view;
    const struct truth *truth;
    const float *positions;
    const struct places *hits;
    double eye_q;       // the eye's height in quanta, exact
    double diagonal_px; // of the window
    atomic_ullong unmeasured, order_mismatches, uncovered, beyond_window;
};

static bool is_drawn(const float position[4])
{
    return position[3] > 0 && isfinite(position[0]) && isfinite(position[1]) && isfinite(position[2]);
}

// Moves a place that rounding put beyond the outline back onto it; false when it is farther out than that.
static bool onto_map(const struct terrain_info *info, double place[3], double tolerance)
{
    for (int k = 0; k < 2; k++) {
        double inside = fmin(fmax(place[k], info->outline_m[k]), info->outline_m[k + 2]);
        if (fabs(inside - place[k]) > tolerance) return false;
        place[k] = inside;
    }
    return true;
}

// Two heights over the eye's at one place of a sphere, projected.
static bool project_rises(const struct measuring *m, const double flat[3], double from_m, double to_m,
                          double *error_px)
{
    double from[3], step[3];
    flat_point(m->view->radius_m, flat, from_m, from);
    flat_up(m->view->radius_m, flat, step);
    for (int axis = 0; axis < 3; axis++) step[axis] *= to_m - from_m;
    return view_project_segment(m->view, from, step, error_px);
}

// The same two on a sphere, where "vertical" is the plumb line at the place.
static bool drawn_against_truth_sphere(const struct measuring *m, const double drawn[3], double *error_px)
{
    double world[3], place[3], flat[3], height_q;
    view_world(m->view, drawn, world);
    terrain_place_from_world(m->terrain, world, place);
    if (!terrain_truth_at(m->terrain, place[0], place[1], &height_q, NULL)) return false;
    flat_from_relative(m->view->radius_m, drawn, flat);
    double truth_m = (height_q - m->eye_q) * m->info->quantum_m;
    return project_rises(m, flat, truth_m, flat_rise(m->view->radius_m, flat), error_px);
}

static bool truth_against_mesh_sphere(const struct measuring *m, const struct truth_pixel *truth, size_t hit,
                                      double *error_px, bool *covered)
{
    double low, high, flat[3], other_px;
    flat_from_relative(m->view->radius_m, truth->relative, flat);
    double truth_m = flat_rise(m->view->radius_m, flat);
    *covered = places_height(m->hits, hit, &low, &high);
    if (!*covered) return false;
    flat[2] = low;
    if (!project_rises(m, flat, truth_m, flat_rise(m->view->radius_m, flat), error_px)) return false;
    flat[2] = high;
    if (high > low && project_rises(m, flat, truth_m, flat_rise(m->view->radius_m, flat), &other_px))
        *error_px = fmax(*error_px, other_px);
    return true;
}

// (a): the drawn point against the truth at the same place.
static bool drawn_against_truth(const struct measuring *m, const double drawn[3], double *error_px)
{
    if (m->view->radius_m > 0) return drawn_against_truth_sphere(m, drawn, error_px);
    const double *eye = m->view->eye_m;
    double world[3] = {eye[0] + drawn[0], eye[1] + drawn[1], eye[2] + drawn[2]}, place[3], height_q;
    double tolerance = 1e-6 * (fabs(drawn[0]) + fabs(drawn[1]) + fabs(drawn[2]));
    terrain_place_from_world(m->terrain, world, place);
    if (!terrain_truth_at(m->terrain, place[0], place[1], &height_q, NULL) &&
        !(onto_map(m->info, place, tolerance) &&
          terrain_truth_at(m->terrain, place[0], place[1], &height_q, NULL)))
        return false;
    double truth_z = (double)(float)((height_q - m->eye_q) * m->info->quantum_m);
    return view_project_vertical(m->view, drawn[0], drawn[1], truth_z, drawn[2], error_px);
}

// (b): the truth's hit against the drawn mesh at the same place.  *covered: there is a mesh.
static bool truth_against_mesh(const struct measuring *m, const struct truth_pixel *truth, size_t hit,
                               double *error_px, bool *covered)
{
    if (m->view->radius_m > 0) return truth_against_mesh_sphere(m, truth, hit, error_px, covered);
    double low, high, other_px;
    const double *at = truth->relative;
    double truth_z = (double)(float)at[2];
    *covered = places_height(m->hits, hit, &low, &high);
    if (!*covered || !view_project_vertical(m->view, at[0], at[1], truth_z, low, error_px)) return false;
    if (high > low && view_project_vertical(m->view, at[0], at[1], truth_z, high, &other_px))
        *error_px = fmax(*error_px, other_px);
    return true;
}

// K |n . (p - q)| / w
static double plane_distance_px(const struct view *view, const struct truth_pixel *truth,
                                const double drawn[3])
{
    double east = (double)truth->slope[0], north = (double)truth->slope[1];
    double above = drawn[2] - (double)(float)truth->relative[2];
    double height = above - east * (drawn[0] - truth->relative[0]) - north * (drawn[1] - truth->relative[1]);
    return view->pixels_per_tangent * fabs(height) / (sqrt(1 + east * east + north * north) * truth->depth);
}

bool frame_error_other_surface(double plane_px, double drawn_depth, double truth_depth)
{
    return plane_px > 0.5 && fabs(drawn_depth - truth_depth) > 1e-3 * truth_depth;
}

static void measure_ground(struct measuring *m, size_t pixel, size_t hit)
{
    const struct truth_pixel *truth = &m->truth->pixels[pixel];
    const float *position = m->positions + 4 * pixel;
    const double drawn[3] = {(double)position[0], (double)position[1], (double)position[2]};
    const double *forward = m->view->forward;
    double a_px = 0, b_px = 0, plane_px = plane_distance_px(m->view, truth, drawn);
    bool covered, a = drawn_against_truth(m, drawn, &a_px),
                  b = truth_against_mesh(m, truth, hit, &b_px, &covered);
    if (!covered) {
        m->uncovered++;
        b_px = plane_px;
        b = true;
    }
    double error_px = fmax(a_px, b_px),
           depth = forward[0] * drawn[0] + forward[1] * drawn[1] + forward[2] * drawn[2];
    if (!a && !b) m->unmeasured++;
    if (error_px > m->diagonal_px) m->beyond_window++;
    if (frame_error_other_surface(plane_px, depth, truth->depth)) m->order_mismatches++;
    m->error->error_px[pixel] = a || b ? (float)error_px : NAN;
    m->error->plane_px[pixel] = (float)plane_px;
    m->error->kind[pixel] = PIXEL_GROUND;
}

static void measure_rows(int block, void *user)
{
    struct measuring *m = user;
    struct frame_error *error = m->error;
    int end = (block + 1) * ROWS_A_BLOCK < error->height ? (block + 1) * ROWS_A_BLOCK : error->height;
    for (int y = block * ROWS_A_BLOCK; y < end; y++) {
        size_t pixel = (size_t)y * (size_t)error->width, hit = m->truth->row_first[y];
        for (int x = 0; x < error->width; x++, pixel++) {
            bool ground = m->truth->pixels[pixel].depth > 0;
            bool drawn = is_drawn(m->positions + 4 * pixel);
            error->error_px[pixel] = error->plane_px[pixel] = NAN;
            error->kind[pixel] = ground ? PIXEL_HOLE : drawn ? PIXEL_SPILL : PIXEL_SKY;
            if (ground != drawn && m->truth->pixels[pixel].skyline) error->kind[pixel] = PIXEL_SKY; // error.h
            if (ground && drawn) measure_ground(m, pixel, hit);
            hit += ground;
        }
    }
}

// ---- regions and skylines -----------------------------------------------------------------------

static bool is_truth_sky(uint8_t kind)
{
    return kind == PIXEL_SKY || kind == PIXEL_SPILL;
}

static bool touches_sky(const struct frame_error *error, int x, int y)
{
    for (int j = y - 1; j <= y + 1; j++)
        for (int i = x - 1; i <= x + 1; i++)
            if (i >= 0 && j >= 0 && i < error->width && j < error->height &&
                is_truth_sky(error->kind[(size_t)j * (size_t)error->width + (size_t)i]))
                return true;
    return false;
}

// Turns the undrawn pixels around a pixel from holes into misses and pushes them.
static size_t open_around(struct frame_error *error, int32_t pixel, int32_t *stack, size_t count)
{
    int x = pixel % error->width, y = pixel / error->width;
    for (int j = y - 1; j <= y + 1; j++)
        for (int i = x - 1; i <= x + 1; i++) {
            if (i < 0 || j < 0 || i >= error->width || j >= error->height) continue;
            int32_t at = j * error->width + i;
            if (error->kind[at] != PIXEL_HOLE) continue;
            error->kind[at] = PIXEL_MISS;
            stack[count++] = at;
        }
    return count;
}

// Undrawn regions that touch the truth's sky are misses; all undrawn pixels come in as holes.
static void open_regions(struct frame_error *error)
{
    int32_t *stack = error->scratch, pixels = error->width * error->height;
    for (int32_t pixel = 0; pixel < pixels; pixel++) {
        if (error->kind[pixel] != PIXEL_HOLE ||
            !touches_sky(error, pixel % error->width, pixel / error->width))
            continue;
        for (size_t count = open_around(error, pixel, stack, 0); count > 0;) {
            int32_t at = stack[--count];
            count = open_around(error, at, stack, count);
        }
    }
}

// rows[y]: how many rows pixel y of a column is from the nearest one whose kind is in `kinds` (a set of
// bits).  Rows `below` and `above` the picture count as such pixels.
static void nearest_rows(const uint8_t *column, int width, int height, unsigned kinds, int below, int above,
                         int32_t *rows)
{
    int nearest = below;
    for (int y = 0; y < height; y++) {
        if (kinds >> column[(size_t)y * (size_t)width] & 1) nearest = y;
        rows[y] = y - nearest;
    }
    nearest = above;
    for (int y = height - 1; y >= 0; y--) {
        if (kinds >> column[(size_t)y * (size_t)width] & 1) nearest = y;
        if (nearest - y < rows[y]) rows[y] = nearest - y;
    }
}

static bool column_is_covered(const struct frame_error *error, const uint8_t *column)
{
    for (int y = 0; y < error->height; y++) {
        uint8_t kind = column[(size_t)y * (size_t)error->width];
        if (kind != PIXEL_SKY && kind != PIXEL_GROUND) return false;
    }
    return true;
}

// Misses far under the skyline become holes; the others and spills get their distance to the other skyline.
static void measure_skyline(struct frame_error *error, int x, bool upright)
{
    enum { SKY = 1 << PIXEL_SKY, GROUND = 1 << PIXEL_GROUND, HOLE = 1 << PIXEL_HOLE, MISS = 1 << PIXEL_MISS };
    enum { SPILL = 1 << PIXEL_SPILL, NOWHERE = 1 << 24 };
    int width = error->width, height = error->height;
    const uint8_t *column = error->kind + x;
    if (column_is_covered(error, column)) return;
    int32_t *to_sky = error->scratch, *to_drawn = to_sky + height, *to_truth = to_drawn + height;
    nearest_rows(column, width, height, SKY | SPILL, upright ? -NOWHERE : -1, upright ? height : NOWHERE,
                 to_sky);
    nearest_rows(column, width, height, GROUND | SPILL, -NOWHERE, NOWHERE, to_drawn);
    nearest_rows(column, width, height, GROUND | HOLE | MISS, -NOWHERE, NOWHERE, to_truth);
    for (int y = 0; y < height; y++) {
        size_t pixel = (size_t)y * (size_t)width + (size_t)x;
        uint8_t *kind = &error->kind[pixel];
        if (*kind == PIXEL_MISS && to_sky[y] - 1 > HOLE_UNDER_SKYLINE) *kind = PIXEL_HOLE;
        if (*kind != PIXEL_MISS && *kind != PIXEL_SPILL) continue;
        int rows = *kind == PIXEL_MISS ? to_drawn[y] : to_truth[y];
        if (rows > height) rows = upright ? y + 1 : height - y; // that picture has no ground in this column
        error->error_px[pixel] = (float)rows;
    }
}

static void count_kinds(struct frame_error *error)
{
    uint64_t counts[PIXEL_SPILL + 1] = {0};
    for (size_t k = 0; k < (size_t)error->width * (size_t)error->height; k++) counts[error->kind[k]]++;
    error->ground = counts[PIXEL_GROUND];
    error->holes = counts[PIXEL_HOLE];
    error->misses = counts[PIXEL_MISS];
    error->spills = counts[PIXEL_SPILL];
}

void frame_error_measure(struct frame_error *error, const struct terrain *terrain, const struct view *view,
                         const struct truth *truth, const float *positions, const struct places *hits,
                         int threads)
{
    struct measuring m = {.error = error, .terrain = terrain, .info = terrain_info(terrain), .view = view};
    m.truth = truth, m.positions = positions, m.hits = hits;
    m.eye_q = ldexp((double)view->eye_height, -VIEW_HEIGHT_BITS);
    m.diagonal_px = hypot(error->width, error->height);
    parallel_blocks((error->height + ROWS_A_BLOCK - 1) / ROWS_A_BLOCK, threads, measure_rows, &m);
    open_regions(error);
    for (int x = 0; x < error->width; x++) measure_skyline(error, x, view->up[2] >= 0);
    count_kinds(error);
    error->unmeasured = m.unmeasured;
    error->order_mismatches = m.order_mismatches;
    error->uncovered = m.uncovered;
    error->beyond_window = m.beyond_window;
}

// ---- holes alone --------------------------------------------------------------------------------

// Marks the pixels, other than undrawn ones, that tell whether undrawn ground at (x, y) is a hole: those
// about it, and those of its column in which the skyline may be near enough.
static void want_around(uint8_t *wanted, const struct frame_error *error, int x, int y)
{
    enum { FAR = HOLE_UNDER_SKYLINE + 1 };
    for (int j = y - FAR; j <= y + FAR; j++)
        for (int i = x - 1; i <= x + 1; i++) {
            if (i < 0 || j < 0 || i >= error->width || j >= error->height) continue;
            size_t pixel = (size_t)j * (size_t)error->width + (size_t)i;
            if ((i == x || abs(j - y) <= 1) && error->kind[pixel] == PIXEL_GROUND) wanted[pixel] = 1;
        }
}

void frame_error_holes(struct frame_error *error, struct truth *truth, const struct truth_surface *surface,
                       const struct view *view, const float *positions, int threads)
{
    size_t pixels = (size_t)error->width * (size_t)error->height;
    uint8_t *wanted = (uint8_t *)error->scratch, *kind = error->kind;
    for (size_t k = 0; k < pixels; k++) {
        wanted[k] = !is_drawn(positions + 4 * k);
        kind[k] = wanted[k] ? PIXEL_SKY : PIXEL_GROUND;
    }
    truth_cast_some(truth, surface, view, wanted, threads);
    for (size_t k = 0; k < pixels; k++)
        if (wanted[k] && truth->pixels[k].depth > 0) kind[k] = PIXEL_HOLE;
    memset(wanted, 0, pixels);
    for (size_t k = 0; k < pixels; k++)
        if (kind[k] == PIXEL_HOLE)
            want_around(wanted, error, (int)(k % (size_t)error->width), (int)(k / (size_t)error->width));
    truth_cast_some(truth, surface, view, wanted, threads);
    for (size_t k = 0; k < pixels; k++) {
        if (wanted[k] && !(truth->pixels[k].depth > 0)) kind[k] = PIXEL_SPILL;
        wanted[k] = kind[k] == PIXEL_HOLE;
    }
    truth_mark_some(truth, surface, view, wanted, threads);
    for (size_t k = 0; k < pixels; k++)
        if (wanted[k] && truth->pixels[k].skyline) kind[k] = PIXEL_SKY;
    open_regions(error);
    for (int x = 0; x < error->width; x++) measure_skyline(error, x, view->up[2] >= 0);
    count_kinds(error);
}

// ---- the picture --------------------------------------------------------------------------------

void frame_error_colour(double error_px, uint8_t rgb[3])
{
    static const uint8_t ramp[][3] = {{255, 255, 204}, {255, 237, 160}, {254, 217, 118},
                                      {254, 178, 76},  {253, 141, 60},  {252, 78, 42},
                                      {227, 26, 28},   {189, 0, 38},    {128, 0, 38}};
    enum { STEPS = sizeof ramp / sizeof *ramp - 1 };
    double at = error_px > 0.01 ? fmin((log10(error_px) + 2) / 3, 1) * STEPS : 0; // 0.01 .. 10 px
    int step = at < STEPS ? (int)at : STEPS - 1;
    for (int k = 0; k < 3; k++)
        rgb[k] = (uint8_t)lround(ramp[step][k] + (at - step) * (ramp[step + 1][k] - ramp[step][k]));
}

void frame_error_picture(const struct frame_error *error, uint8_t *rgb)
{
    static const uint8_t colours[][3] = {[PIXEL_SKY] = {176, 176, 176},
                                         [PIXEL_GROUND] = {64, 64, 64}, // unmeasured
                                         [PIXEL_HOLE] = {255, 0, 255},
                                         [PIXEL_MISS] = {0, 220, 255},
                                         [PIXEL_SPILL] = {0, 64, 255}};
    for (size_t k = 0; k < (size_t)error->width * (size_t)error->height; k++) {
        if (error->kind[k] == PIXEL_GROUND && !isnan(error->error_px[k]))
            frame_error_colour((double)error->error_px[k], rgb + 3 * k);
        else
            memcpy(rgb + 3 * k, colours[error->kind[k]], 3);
    }
}

uint64_t frame_error_order_beyond_grid(const struct frame_error *error, const struct truth *truth,
                                       const struct truth_surface *surface, const struct view *view,
                                       const float *positions)
{
    uint64_t count = 0;
    const double *f = view->forward;
    for (size_t p = 0; p < (size_t)error->width * (size_t)error->height; p++) {
        const float *drawn = positions + 4 * p;
        double depth = f[0] * (double)drawn[0] + f[1] * (double)drawn[1] + f[2] * (double)drawn[2];
        if (error->kind[p] != PIXEL_GROUND ||
            !frame_error_other_surface((double)error->plane_px[p], depth, truth->pixels[p].depth))
            continue;
        bool explained = false;
        for (int k = 0; k < TRUTH_SNAP_RAYS && !explained; k++) {
            double ray[3], direction[3], t;
            float slope[2];
            truth_snap_ray(view, (int)(p % (size_t)error->width), (int)(p / (size_t)error->width), k, ray);
            view_world_direction(view, ray, direction);
            explained =
                truth_cast_ray(surface, view->eye_m, direction, &t, slope) && fabs(t - depth) <= 1e-3 * depth;
        }
        count += !explained;
    }
    return count;
}
