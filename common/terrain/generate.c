// SPDX-License-Identifier: MIT
#include "common/terrain/generate.h"

#include "common/report.h"
#include "common/terrain/synthesis.h"
#include "common/terrain/upsample.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct shape {
    const struct generate_options *options;
    double relief_m;
    int64_t width, height;
    double *height_m;
};

// ---- shapes given by a formula: height at sample (x, y), y north -----------

static double flat(const struct shape *s, int64_t x, int64_t y)
{
    (void)x, (void)y;
    return s->relief_m;
}

static double ramp(const struct shape *s, int64_t x, int64_t y) // rises eastwards
{
    (void)y;
    return s->width > 1 ? s->relief_m * (double)x / (double)(s->width - 1) : 0;
}

static double ridge(const struct shape *s, int64_t x,
                    int64_t y) // north to south, at 70 % of the way east, 5 % wide
{
    (void)y;
    double half_width = fmax(2, 0.025 * (double)s->width);
    double distance = fabs((double)x - rint(0.7 * (double)(s->width - 1)));
    return s->relief_m * fmax(0, 1 - distance / half_width);
}

static double needle(const struct shape *s, int64_t x, int64_t y)
{
    return x == s->width / 2 && y == s->height / 2 ? s->relief_m : 0;
}

static double checker(const struct shape *s, int64_t x, int64_t y) // -relief where x + y is even
{
    return (x + y) & 1 ? s->relief_m : -s->relief_m;
}

static double cliff(const struct shape *s, int64_t x, int64_t y) // the eastern half stands high
{
    (void)y;
    return x >= s->width / 2 ? s->relief_m : 0;
}

static double wall(const struct shape *s, int64_t x,
                   int64_t y) // one sample thick, all round a quarter of the map
{
    int64_t west = s->width / 4, east = s->width - 1 - west, south = s->height / 4,
            north = s->height - 1 - south;
    bool inside = x >= west && x <= east && y >= south && y <= north;
    return inside && (x == west || x == east || y == south || y == north) ? s->relief_m : 0;
}

static double plateau(const struct shape *s, int64_t x,
                      int64_t y) // with a trench; depths and heights of the Earth
{
    double u = (double)x / (double)s->width, v = (double)y / (double)s->height;
    if (fabs(u - 0.7) < 0.1 && fabs(v - 0.5) < 0.25) return s->relief_m;
    if (fabs(u - 0.25) < 0.02) return s->relief_m * (-11034.0 / 8848.0);
    return 0;
}

static double crater(const struct shape *s, int64_t x, int64_t y) // a bowl, a rim, and what was thrown out
{
    double radius = fmax(1, 0.25 * (double)(s->width < s->height ? s->width : s->height));
    double r = hypot((double)(x - s->width / 2), (double)(y - s->height / 2)) / radius;
    return r < 1 ? s->relief_m * (1.25 * r * r - 1) : 0.25 * s->relief_m / (r * r * r);
}

// ---- fractal ---------------------------------------------------------------

// Noise of H = 0.85 added level by level to U of the coarser level, as the clipmap paper synthesises (section
// 8).
static bool fractal_levels(const struct shape *s, int64_t x0, int64_t y0, int width, int height, int level,
                           int top, int32_t *out)
{
    enum { RELIEF_Q = 1 << 17 }; // spread of the coarsest noise; all levels together stay below 2^21
    const double hurst = 0.85;
    if (level == top) {
        memset(out, 0, (size_t)width * (size_t)height * sizeof *out);
    } else {
        int columns = upsample_coarse_size(x0, width), rows = upsample_coarse_size(y0, height);
        int32_t *coarse = malloc((size_t)columns * (size_t)rows * sizeof *coarse);
        bool good =
            coarse && fractal_levels(s, (x0 >> 1) - 1, (y0 >> 1) - 1, columns, rows, level + 1, top, coarse);
        if (good) upsample(coarse, x0, y0, width, height, out);
        free(coarse);
        if (!good) return false;
    }
    double sigma_q = RELIEF_Q * exp2(-hurst * (top - level));
    for (int y = 0; y < height; y++)
        synthesis_add_row(out + (size_t)y * (size_t)width, width, x0, y0 + y, level, s->options->seed,
                          sigma_q);
    return true;
}

static bool fractal(const struct shape *s)
{
    size_t count = (size_t)s->width * (size_t)s->height;
    int32_t *q = malloc(count * sizeof *q);
    int top = 0;
    while (((int64_t)4 << top) < (s->width > s->height ? s->width : s->height)) top++;
    bool good = q && fractal_levels(s, 0, 0, (int)s->width, (int)s->height, 0, top, q);
    int32_t low = INT32_MAX, high = INT32_MIN;
    for (size_t i = 0; good && i < count; i++) {
        low = q[i] < low ? q[i] : low;
        high = q[i] > high ? q[i] : high;
    }
    for (size_t i = 0; good && i < count; i++)
        s->height_m[i] = high > low ? s->relief_m * (double)(q[i] - low) / (double)(high - low) : 0;
    free(q);
    return good;
}

// Fractal ground with scattered voids (one in 50), a block and a border of them.
static bool voids(const struct shape *s)
{
    if (!fractal(s)) return false;
    for (int64_t y = 0; y < s->height; y++)
        for (int64_t x = 0; x < s->width; x++) {
            bool scattered = synthesis_normal(x, y, 100, s->options->seed) > 2.054; // 2 % of the deviates
            bool block = llabs(x - s->width / 3) < s->width / 10 && llabs(y - s->height / 3) < s->height / 10;
            bool border = y >= s->height - s->height / 20;
            if (scattered || block || border) s->height_m[y * s->width + x] = NAN;
        }
    return true;
}

// ---- the table -------------------------------------------------------------

static const struct kind {
    const char *name;
    double relief_m;     // by itself
    double relief_step;  // and so many metres a metre of spacing
    double relief_width; // and so many metres a metre of the map's longer side
    double (*height)(const struct shape *shape, int64_t x, int64_t y);
    bool (*fill)(const struct shape *shape);
} KINDS[] = {
    {"fractal", 0, 0, 0.05, NULL, fractal}, {"flat", 0, 0, 0, flat, NULL},
    {"ramp", 0, 0, 0.1, ramp, NULL},        {"ridge", 2000, 0, 0, ridge, NULL},
    {"needle", 1000, 0, 0, needle, NULL},   {"checker", 10, 0, 0, checker, NULL},
    {"cliff", 0, 1000, 0, cliff, NULL},     {"wall", 65535, 0, 0, wall, NULL},
    {"plateau", 8848, 0, 0, plateau, NULL}, {"crater", 0, 0, 0.05, crater, NULL},
    {"voids", 0, 0, 0.05, NULL, voids},
};

static const struct kind *find_kind(const char *name)
{
    for (size_t i = 0; i < sizeof KINDS / sizeof *KINDS; i++)
        if (strcmp(KINDS[i].name, name) == 0) return &KINDS[i];
    return NULL;
}

double generate_default_relief(const struct generate_options *options)
{
    const struct kind *kind = find_kind(options->kind);
    int cells = (options->width > options->height ? options->width : options->height) - 1;
    if (!kind) return 0;
    return kind->relief_m + kind->relief_step * options->spacing_m +
           kind->relief_width * cells * options->spacing_m;
}

bool generate(struct heightfield *field, const struct generate_options *options)
{
    enum { BITS = 15 }; // either side of the middle: what a 16-bit file holds
    memset(field, 0, sizeof *field);
    const struct kind *kind = find_kind(options->kind);
    if (!kind) return fail("%s: no such kind of terrain; %s is accepted", options->kind, GENERATE_KINDS);
    if (options->width < 1 || options->height < 1 || !(options->spacing_m > 0))
        return fail("%s: %dx%d samples %g m apart; at least 1x1 and a positive spacing are expected",
                    kind->name, options->width, options->height, options->spacing_m);
    struct shape shape = {options, options->relief_m, options->width, options->height, NULL};
    if (shape.relief_m == 0) shape.relief_m = generate_default_relief(options);
    snprintf(field->name, sizeof field->name, "%s", kind->name);
    field->width = options->width;
    field->height = options->height;
    field->spacing_m[0] = field->spacing_m[1] = options->spacing_m;
    shape.height_m = malloc((size_t)shape.width * (size_t)shape.height * sizeof *shape.height_m);
    bool good = shape.height_m && (!kind->fill || kind->fill(&shape));
    for (int64_t y = 0; good && kind->height && y < shape.height; y++)
        for (int64_t x = 0; x < shape.width; x++)
            shape.height_m[y * shape.width + x] = kind->height(&shape, x, y);
    good = good && heightfield_quantise(field, shape.height_m, BITS);
    free(shape.height_m);
    if (good) return true;
    heightfield_finish(field);
    return fail("%s: %d x %d samples do not fit in memory", kind->name, options->width, options->height);
}
