// SPDX-License-Identifier: MIT
#include "clipmap/clipmap_normals.h"

#include "common/report.h"
#include "common/terrain/upsample.h"

#include <stdlib.h>
#include <string.h>

enum { CHUNK = 32 }; // texels of a row at a time: a fixed number, so that -O2 vectorises

// ---- heights around the texels ---------------------------------------------

struct window { // samples of one grid, row by row northwards
    int64_t x0, y0;
    int width, height;
    int32_t *samples;
};

static int64_t clamped(int64_t value, int64_t low, int64_t high)
{
    return value < low ? low : value > high ? high : value;
}

static int32_t straight_on(int32_t edge, int32_t inner, int64_t steps)
{
    return (int32_t)clamped(edge + steps * ((int64_t)edge - inner), -QUANTA_LIMIT, QUANTA_LIMIT);
}

// Samples beyond the extent, at most two in each direction, continue the line through the last two within.
static void continue_straight(const struct window *window, const struct terrain_extent *extent)
{
    int width = window->width;
    int64_t first[2] = {extent->x0 - window->x0, extent->y0 - window->y0};
    int64_t last[2] = {extent->x1 - 1 - window->x0, extent->y1 - 1 - window->y0};
    int64_t inner[2][2];
    for (int axis = 0; axis < 2; axis++) {
        inner[0][axis] = first[axis] < last[axis] ? first[axis] + 1 : first[axis];
        inner[1][axis] = first[axis] < last[axis] ? last[axis] - 1 : last[axis];
    }
    for (int y = 0; y < window->height; y++) {
        int32_t *row = window->samples + (size_t)y * (size_t)width;
        for (int64_t x = 0; x < first[0]; x++)
            row[x] = straight_on(row[first[0]], row[inner[0][0]], first[0] - x);
        for (int64_t x = last[0] + 1; x < width; x++)
            row[x] = straight_on(row[last[0]], row[inner[1][0]], x - last[0]);
    }
    for (int side = 0; side < 2; side++) {
        int64_t edge = side ? last[1] : first[1];
        for (int64_t y = side ? edge + 1 : 0; y < (side ? window->height : edge); y++)
            for (int x = 0; x < width; x++)
                window->samples[y * width + x] =
                    straight_on(window->samples[edge * width + x],
                                window->samples[inner[side][1] * width + x], side ? y - edge : edge - y);
    }
}

static void read_straight(const struct terrain *terrain, int level, const struct window *window)
{
    struct terrain_extent extent = terrain_level(terrain, level).extent;
    terrain_window(terrain, level, window->x0, window->y0, window->width, window->height, window->samples,
                   TERRAIN_WAIT);
    if (window->x0 < extent.x0 || window->y0 < extent.y0 || window->x0 + window->width > extent.x1 ||
        window->y0 + window->height > extent.y1)
        continue_straight(window, &extent);
}

// Bits by which heights can be refined so that U, which rounds to whole quanta, loses less.
static int spare_bits(const struct terrain_level *level)
{
    int bits = 0;
    int64_t most = level->max_q > -(int64_t)level->min_q ? level->max_q : -(int64_t)level->min_q;
    while (bits < 8 && (3 * most) << (bits + 1) <= QUANTA_LIMIT) bits++; // 3: continued straight
    return bits;
}

// Reads the half samples of a level into `window`.  Returns the bits by which they are refined.
static int read_half_samples(const struct terrain *terrain, int level, const struct window *window,
                             int32_t *coarse)
{
    if (level > terrain_info(terrain)->finest) {
        read_straight(terrain, level - 1, window);
        return 0;
    }
    struct window own = {clipmap_floor_div(window->x0, 2) - 1, clipmap_floor_div(window->y0, 2) - 1,
                         upsample_coarse_size(window->x0, window->width),
                         upsample_coarse_size(window->y0, window->height), coarse};
    read_straight(terrain, level, &own);
    struct terrain_level l = terrain_level(terrain, level);
    int bits = spare_bits(&l);
    for (size_t i = 0; i < (size_t)own.width * (size_t)own.height; i++) coarse[i] *= 1 << bits;
    upsample(coarse, window->x0, window->y0, window->width, window->height, window->samples);
    return bits;
}

// ---- normals ---------------------------------------------------------------

// 1 / sqrt(a) to 4.7e-6: a first guess from the bits and two of Newton's steps.  sqrtf() would keep the loop
// below from being vectorised, since it may set errno.
static inline float inverse_root(float a)
{
    int32_t bits;
    float y;
    memcpy(&bits, &a, sizeof bits);
    bits = 0x5f3759df - (bits >> 1);
    memcpy(&y, &bits, sizeof y);
    y *= 1.5f - 0.5f * a * y * y;
    return y * (1.5f - 0.5f * a * y * y);
}

// To the nearest integer, for |v| <= 32768: what is cut off is positive.
static inline int16_t rounded(float v)
{
    return (int16_t)((int32_t)(v + 32768.5f) - 32768);
}

static inline void normals_of(const int32_t *restrict row, int stride, const float scale[2], int count,
                              int16_t (*restrict texels)[2])
{
    const int32_t *south = row - stride, *north = row + stride;
    for (int i = 0; i < count; i++) {
        float slope_x = (float)(row[i + 1] - row[i - 1]) * scale[0];
        float slope_y = (float)(north[i] - south[i]) * scale[1];
        float down = -CLIPMAP_NORMAL_ONE * inverse_root(1.0f + (slope_x * slope_x + slope_y * slope_y));
        texels[i][0] = rounded(slope_x * down);
        texels[i][1] = rounded(slope_y * down);
    }
}

// A row of any length; the last chunk may compute again what the one before did.
static void normals_of_row(const int32_t *row, int stride, const float scale[2], int count,
                           int16_t (*texels)[2])
{
    if (count < CHUNK) {
        normals_of(row, stride, scale, count, texels);
        return;
    }
    for (int x = 0; x < count; x += CHUNK) {
        int at = x + CHUNK <= count ? x : count - CHUNK;
        normals_of(row + at, stride, scale, CHUNK, texels + at);
    }
}

// Texels for which half samples exist.
static struct clipmap_box half_extent(const struct terrain *terrain, int level)
{
    bool finer = level > terrain_info(terrain)->finest;
    struct terrain_extent e = terrain_level(terrain, finer ? level - 1 : level).extent;
    int step = finer ? 1 : 2;
    return (struct clipmap_box){{step * e.x0, step * e.y0}, {step * (e.x1 - 1), step * (e.y1 - 1)}};
}

void clipmap_normals_compute(const struct terrain *terrain, int level, const struct clipmap_box *texels,
                             const struct clipmap_normals_scratch *scratch)
{
    struct clipmap_box extent = half_extent(terrain, level), inner;
    for (int axis = 0; axis < 2; axis++) {
        inner.lo[axis] = clamped(texels->lo[axis], extent.lo[axis], extent.hi[axis]);
        inner.hi[axis] = clamped(texels->hi[axis], extent.lo[axis], extent.hi[axis]);
    }
    int width = (int)(texels->hi[0] - texels->lo[0] + 1), count = (int)(inner.hi[0] - inner.lo[0] + 1);
    int west = (int)clamped(inner.lo[0] - texels->lo[0], 0, width - count);
    struct window window = {inner.lo[0] - 1, inner.lo[1] - 1, count + 2,
                            (int)(inner.hi[1] - inner.lo[1] + 1) + 2, scratch->heights};
    int bits = read_half_samples(terrain, level, &window, scratch->coarse);
    struct terrain_level l = terrain_level(terrain, level);
    double quantum_m = terrain_info(terrain)->quantum_m / (1 << bits);
    const float scale[2] = {(float)(quantum_m / l.spacing_m[0]), (float)(quantum_m / l.spacing_m[1])};
    for (int64_t y = texels->lo[1]; y <= texels->hi[1]; y++) {
        int64_t row = clamped(y, inner.lo[1], inner.hi[1]) - window.y0;
        int16_t(*out)[2] = scratch->texels + (y - texels->lo[1]) * width;
        normals_of_row(window.samples + row * window.width + 1, window.width, scale, count, out + west);
        for (int x = 0; x < west; x++) memcpy(out[x], out[west], sizeof *out);
        for (int x = west + count; x < width; x++) memcpy(out[x], out[west + count - 1], sizeof *out);
    }
}

int clipmap_normals_window(const struct terrain *terrain, int level, const struct clipmap_box *samples,
                           struct clipmap_box *window)
{
    bool finer = level > terrain_info(terrain)->finest;
    for (int axis = 0; axis < 2;
         axis++) { // texels 2 lo .. 2 hi + 1 and their neighbours; U reaches two samples
        window->lo[axis] = finer ? 2 * samples->lo[axis] - 1 : samples->lo[axis] - 2;
        window->hi[axis] = finer ? 2 * samples->hi[axis] + 2 : samples->hi[axis] + 3;
    }
    return finer ? level - 1 : level;
}

// ---- the toroidal store ----------------------------------------------------

bool clipmap_normals_scratch_init(struct clipmap_normals_scratch *scratch, int size)
{
    size_t side = (size_t)size, coarse = side / 2 + 5;
    scratch->heights = malloc((side + 2) * (side + 2) * sizeof *scratch->heights);
    scratch->coarse = malloc(coarse * coarse * sizeof *scratch->coarse);
    scratch->texels = malloc(side * side * sizeof *scratch->texels);
    if (scratch->heights && scratch->coarse && scratch->texels) return true;
    return fail("clipmap: no memory for a normal map of %d x %d texels", size, size);
}

void clipmap_normals_scratch_finish(struct clipmap_normals_scratch *scratch)
{
    free(scratch->heights);
    free(scratch->coarse);
    free(scratch->texels);
    *scratch = (struct clipmap_normals_scratch){NULL, NULL, NULL};
}

uint64_t clipmap_normals_move(struct clipmap_normals *normals, const struct clipmap_box *samples,
                              const struct clipmap_normals_scratch *scratch, clipmap_normals_write_fn *write,
                              void *user)
{
    struct clipmap_box now = clipmap_empty, exposed[4], pieces[4];
    if (!clipmap_box_is_empty(samples))
        for (int axis = 0; axis < 2; axis++) {
            now.lo[axis] = 2 * samples->lo[axis];
            now.hi[axis] = 2 * samples->hi[axis] + 1;
        }
    int exposed_count = clipmap_exposed(&normals->clip, &now, exposed);
    uint64_t texels = 0;
    for (int i = 0; i < exposed_count; i++) {
        int piece_count = clipmap_unwrap(&exposed[i], normals->size, pieces);
        for (int p = 0; p < piece_count; p++) {
            const struct clipmap_box *piece = &pieces[p];
            clipmap_normals_compute(normals->terrain, normals->level, piece, scratch);
            write(user, clipmap_slot(piece->lo[0], normals->size), clipmap_slot(piece->lo[1], normals->size),
                  (int)(piece->hi[0] - piece->lo[0] + 1), (int)(piece->hi[1] - piece->lo[1] + 1),
                  (const int16_t(*)[2])scratch->texels);
        }
        texels += clipmap_box_samples(&exposed[i]);
    }
    normals->clip = now;
    return texels;
}
