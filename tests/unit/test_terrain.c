// The one terrain: windows, bounds, extrema, errors of levels and truth against the plainest reading of their
// contracts. SPDX-License-Identifier: MIT
#define _GNU_SOURCE
#include "tests/test.h"

#include "common/terrain/pyramid.h"
#include "common/terrain/synthesis.h"
#include "common/terrain/terrain.h"
#include "common/terrain/upsample.h"

#include <sched.h>
#include <string.h>
#include <time.h>

static int64_t clamp(int64_t value, int64_t low, int64_t high)
{
    return value < low ? low : value > high ? high : value;
}

// Rough ground: steps up to 100 and a few of 10,000.
static struct terrain *rough(int64_t width, int64_t height, int64_t x0, int64_t y0,
                             const struct terrain_options *options, uint64_t seed)
{
    int32_t *samples = malloc((size_t)(width * height) * sizeof *samples);
    for (int64_t i = 0; i < width * height; i++)
        samples[i] = (int32_t)(test_random(&seed) % 101) + (test_random(&seed) % 50 == 0 ? 10000 : 0) - 5000;
    struct terrain_grid grid = {"rough", samples, width, height, {x0, y0}, {30, 20}, 0.25, 100};
    struct terrain *terrain = terrain_from_grid(&grid, options);
    assert_non_null(terrain);
    free(samples);
    return terrain;
}

static const int64_t ORIGINS[][2] = {{0, 0}, {-7, 5}, {-1, -1}, {10000000000, -10000000001}};

static void windows_are_the_samples(void **state)
{
    (void)state;
    uint64_t random = 1;
    int windows = test_size(300, 20000);
    int32_t out[40 * 40];
    for (size_t origin = 0; origin < sizeof ORIGINS / sizeof *ORIGINS; origin++) {
        struct terrain_options options = {.synthesize_levels = 2};
        struct terrain *terrain = rough(45, 70, ORIGINS[origin][0], ORIGINS[origin][1], &options, 2);
        const struct terrain_info *info = terrain_info(terrain);
        for (int n = 0; n < windows; n++) {
            int level =
                info->finest + (int)(test_random(&random) % (uint64_t)(info->coarsest - info->finest + 1));
            struct terrain_extent e = terrain_level(terrain, level).extent;
            size_t stride;
            const int32_t *samples = terrain_samples(terrain, level, &stride);
            int width = 1 + (int)(test_random(&random) % 40), height = 1 + (int)(test_random(&random) % 40);
            int64_t far = n % 10 == 0 ? 10000000000 : 0; // now and then from the far side of the world
            int64_t x0 = e.x0 - 50 + (int64_t)(test_random(&random) % (uint64_t)(e.x1 - e.x0 + 100)) - far;
            int64_t y0 = e.y0 - 50 + (int64_t)(test_random(&random) % (uint64_t)(e.y1 - e.y0 + 100)) + far;
            assert_true(terrain_window(terrain, level, x0, y0, width, height, out,
                                       n & 1 ? TERRAIN_TRY : TERRAIN_WAIT));
            for (int j = 0; j < height; j++)
                for (int i = 0; i < width; i++) {
                    int64_t x = clamp(x0 + i, e.x0, e.x1 - 1) - e.x0,
                            y = clamp(y0 + j, e.y0, e.y1 - 1) - e.y0;
                    assert_int_equal(out[j * width + i], samples[(size_t)y * stride + (size_t)x]);
                }
        }
        assert_true(terrain_window(terrain, 0, INT64_MIN, INT64_MAX, 2, 2, out, TERRAIN_WAIT));
        terrain_destroy(terrain);
    }
    FIGURE("terrain windows equal to the samples: %d", windows * 4);
}

static void levels_cover_the_map(void **state)
{
    (void)state;
    for (size_t origin = 0; origin < sizeof ORIGINS / sizeof *ORIGINS; origin++)
        for (int size = 1; size < 40; size++) {
            struct terrain_options options = {.synthesize_levels = size % 3};
            struct terrain *terrain =
                rough(size, 41 - size, ORIGINS[origin][0], ORIGINS[origin][1], &options, 3);
            const struct terrain_info *info = terrain_info(terrain);
            for (int l = info->finest; l <= info->coarsest; l++) {
                struct terrain_level level = terrain_level(terrain, l);
                // Whole samples around the outline: the first at or before it, the last at or behind it, none
                // more.
                double first[2] = {(double)level.extent.x0 * level.spacing_m[0],
                                   (double)level.extent.y0 * level.spacing_m[1]};
                double last[2] = {(double)(level.extent.x1 - 1) * level.spacing_m[0],
                                  (double)(level.extent.y1 - 1) * level.spacing_m[1]};
                for (int axis = 0; axis < 2; axis++) {
                    assert_true(first[axis] <= info->outline_m[axis]);
                    assert_true(info->outline_m[axis] - first[axis] < level.spacing_m[axis]);
                    assert_true(last[axis] >= info->outline_m[axis + 2]);
                    assert_true(last[axis] - info->outline_m[axis + 2] < level.spacing_m[axis]);
                }
            }
            struct terrain_extent coarsest = terrain_level(terrain, info->coarsest).extent;
            assert_true(coarsest.x1 - coarsest.x0 <= 8 && coarsest.y1 - coarsest.y0 <= 8);
            terrain_destroy(terrain);
        }
}

static void grid_is_level_zero(void **state)
{
    (void)state;
    const int32_t samples[6] = {1, -2, 3, 4, 5, -6};
    struct terrain_grid grid = {"six", samples, 3, 2, {-1, 7}, {10, 5}, 0.5, -3};
    struct terrain *terrain = terrain_from_grid(&grid, NULL);
    const struct terrain_info *info = terrain_info(terrain);
    size_t stride;
    const int32_t *kept = terrain_samples(terrain, 0, &stride);
    for (size_t y = 0; y < 2; y++)
        for (size_t x = 0; x < 3; x++) assert_int_equal(kept[y * stride + x], samples[y * 3 + x]);
    assert_true(info->outline_m[0] == -10 && info->outline_m[1] == 35 && info->outline_m[2] == 10 &&
                info->outline_m[3] == 40);
    assert_true(info->quantum_m == 0.5 && info->offset_m == -3 && info->min_q == -6 && info->max_q == 5);
    terrain_destroy(terrain);
    // Refining multiplies the samples and divides the quantum.
    terrain = terrain_from_grid(&grid, &(struct terrain_options){.refine_bits = 3});
    kept = terrain_samples(terrain, 0, &stride);
    assert_int_equal(kept[1], -16);
    assert_true(terrain_info(terrain)->quantum_m == 0.0625);
    terrain_destroy(terrain);
}

static void bounds_hold_the_samples(void **state)
{
    (void)state;
    uint64_t random = 4;
    int queries = test_size(2000, 200000);
    struct terrain *terrain =
        rough(211, 133, -50, 10000000000, &(struct terrain_options){.synthesize_levels = 1}, 5);
    const struct terrain_info *info = terrain_info(terrain);
    const struct terrain_extrema *extrema = terrain_extrema(terrain);
    for (int n = 0; n < queries; n++) {
        int level =
            info->finest + (int)(test_random(&random) % (uint64_t)(info->coarsest - info->finest + 1));
        struct terrain_extent e = terrain_level(terrain, level).extent;
        size_t stride;
        const int32_t *samples = terrain_samples(terrain, level, &stride);
        int64_t a[2], b[2], width = e.x1 - e.x0, height = e.y1 - e.y0;
        a[0] = (int64_t)(test_random(&random) % (uint64_t)(width + 20)) - 10;
        a[1] = (int64_t)(test_random(&random) % (uint64_t)(height + 20)) - 10;
        b[0] = a[0] + (int64_t)(test_random(&random) % (uint64_t)width);
        b[1] = a[1] + (int64_t)(test_random(&random) % (uint64_t)height);
        int32_t min_q, max_q, low = INT32_MAX, high = INT32_MIN, loose_low = INT32_MAX,
                              loose_high = INT32_MIN;
        terrain_bounds(terrain, level, e.x0 + a[0], e.y0 + a[1], e.x0 + b[0], e.y0 + b[1], &min_q, &max_q);
        for (int axis = 0; axis < 2; axis++) { // what is asked for lies in the extent
            a[axis] = clamp(a[axis], 0, (axis ? height : width) - 1);
            b[axis] = clamp(b[axis], 0, (axis ? height : width) - 1);
        }
        // Nodes at which eight span the longer side are at most a quarter of it wide, plus the eight-sample
        // leaves.
        int64_t slack = (b[0] - a[0] > b[1] - a[1] ? b[0] - a[0] : b[1] - a[1]) / 4 + 8;
        for (int64_t y = clamp(a[1] - slack, 0, height - 1); y <= clamp(b[1] + slack, 0, height - 1); y++)
            for (int64_t x = clamp(a[0] - slack, 0, width - 1); x <= clamp(b[0] + slack, 0, width - 1); x++) {
                int32_t q = samples[(size_t)y * stride + (size_t)x];
                loose_low = q < loose_low ? q : loose_low;
                loose_high = q > loose_high ? q : loose_high;
                if (x < a[0] || x > b[0] || y < a[1] || y > b[1]) continue;
                low = q < low ? q : low;
                high = q > high ? q : high;
            }
        assert_true(min_q <= low && max_q >= high);
        assert_true(min_q >= loose_low && max_q <= loose_high);
    }
    const struct terrain_extrema_nodes *root = &extrema->nodes[extrema->heights - 1];
    assert_true(root->width == 1 && root->height == 1 && root->min_q[0] == info->min_q &&
                root->max_q[0] == info->max_q);
    terrain_destroy(terrain);
}

static void extrema_nodes_are_exact(void **state)
{
    (void)state;
    const int64_t sizes[][2] = {{1, 1}, {2, 2}, {1, 17}, {17, 1}, {18, 75}, {33, 33}, {65, 40}};
    for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++) {
        struct terrain *terrain = rough(sizes[s][0], sizes[s][1], -3, 8, NULL, 6 + s);
        const struct terrain_extrema *extrema = terrain_extrema(terrain);
        size_t stride;
        const int32_t *samples = terrain_samples(terrain, 0, &stride);
        for (int k = 0; k < extrema->heights; k++)
            for (int64_t j = 0; j < extrema->nodes[k].height; j++)
                for (int64_t i = 0; i < extrema->nodes[k].width; i++) {
                    int32_t low = INT32_MAX, high = INT32_MIN;
                    for (int64_t y = j << k; y <= ((j + 1) << k) && y < sizes[s][1]; y++)
                        for (int64_t x = i << k; x <= ((i + 1) << k) && x < sizes[s][0]; x++) {
                            int32_t q = samples[(size_t)y * stride + (size_t)x];
                            low = q < low ? q : low;
                            high = q > high ? q : high;
                        }
                    int64_t at = j * extrema->nodes[k].width + i;
                    assert_int_equal(extrema->nodes[k].min_q[at], low);
                    assert_int_equal(extrema->nodes[k].max_q[at], high);
                }
        terrain_destroy(terrain);
    }
}

// The surface of a level at a place given in its own samples, the plainest way.
static double surface(const struct terrain *terrain, int level, double x, double y)
{
    struct terrain_extent e = terrain_level(terrain, level).extent;
    size_t stride;
    const int32_t *samples = terrain_samples(terrain, level, &stride);
    int64_t i = clamp((int64_t)floor(x), e.x0, e.x1 - 2 < e.x0 ? e.x0 : e.x1 - 2);
    int64_t j = clamp((int64_t)floor(y), e.y0, e.y1 - 2 < e.y0 ? e.y0 : e.y1 - 2);
    double u = x - (double)i, v = y - (double)j;
    int64_t i1 = clamp(i + 1, e.x0, e.x1 - 1), j1 = clamp(j + 1, e.y0, e.y1 - 1);
    double sw = samples[(size_t)(j - e.y0) * stride + (size_t)(i - e.x0)];
    double se = samples[(size_t)(j - e.y0) * stride + (size_t)(i1 - e.x0)];
    double nw = samples[(size_t)(j1 - e.y0) * stride + (size_t)(i - e.x0)];
    double ne = samples[(size_t)(j1 - e.y0) * stride + (size_t)(i1 - e.x0)];
    return u >= v ? (1 - u) * sw + (u - v) * se + v * ne : (1 - v) * sw + (v - u) * nw + u * ne;
}

static void truth_is_the_finest_surface(void **state)
{
    (void)state;
    uint64_t random = 7;
    int places = test_size(20000, 1000000);
    for (size_t origin = 0; origin < 3; origin++) {
        struct terrain_options options = {.synthesize_levels = (int)origin};
        struct terrain *terrain = rough(23, 19, ORIGINS[origin][0], ORIGINS[origin][1], &options, 8);
        const struct terrain_info *info = terrain_info(terrain);
        struct terrain_level finest = terrain_level(terrain, info->finest);
        for (int n = 0; n < places; n++) {
            double x = test_uniform(&random, info->outline_m[0], info->outline_m[2]);
            double y = test_uniform(&random, info->outline_m[1], info->outline_m[3]), q, slope[2];
            if (n % 3 == 0)
                x = info->outline_m[n & 2], y = n % 5 ? y : info->outline_m[1 + (n & 2)]; // borders, corners
            assert_true(terrain_truth_at(terrain, x, y, &q, slope));
            double expected =
                surface(terrain, info->finest, x / finest.spacing_m[0], y / finest.spacing_m[1]);
            assert_true(fabs(q - expected) <= 1e-6);
            double step = 1e-7 * finest.spacing_m[0], q_east;
            if (n % 3 && terrain_truth_at(terrain, x + step, y, &q_east, NULL) && n % 100 == 1) {
                double slope_there[2];
                terrain_truth_at(terrain, x + step, y, &q_east, slope_there);
                if (slope_there[0] == slope[0] && slope_there[1] == slope[1]) // the same triangle
                    assert_true(fabs((q_east - q) - slope[0] * step) <= 1e-7);
            }
        }
        double q;
        assert_false(terrain_truth_at(terrain, info->outline_m[0] - 1e-6, info->outline_m[1], &q, NULL));
        assert_false(terrain_truth_at(terrain, info->outline_m[2], info->outline_m[3] + 1e-6, &q, NULL));
        assert_false(terrain_truth_at(terrain, (double)NAN, info->outline_m[1], &q, NULL));
        terrain_destroy(terrain);
    }
}

static void level_errors_are_measured(void **state)
{
    (void)state;
    for (size_t n = 0; n < 4; n++) {
        size_t origin = n % 3;
        struct terrain_options options = {.synthesize_levels = 2, .filter = (enum terrain_filter)n};
        struct terrain *terrain = rough(37, 150, ORIGINS[origin][0], ORIGINS[origin][1], &options, 9);
        const struct terrain_info *info = terrain_info(terrain);
        struct terrain_extent f = terrain_level(terrain, info->finest).extent;
        size_t stride;
        const int32_t *truth = terrain_samples(terrain, info->finest, &stride);
        for (int l = info->finest; l <= info->coarsest; l++) {
            struct terrain_level level = terrain_level(terrain, l);
            double scale = ldexp(1, info->finest - l), squares = 0, max = 0;
            for (int64_t y = f.y0; y < f.y1; y++)
                for (int64_t x = f.x0; x < f.x1; x++) {
                    double d = surface(terrain, l, (double)x * scale, (double)y * scale) -
                               truth[(size_t)(y - f.y0) * stride + (size_t)(x - f.x0)];
                    squares += d * d;
                    max = fabs(d) > max ? fabs(d) : max;
                }
            double rms = sqrt(squares / (double)((f.x1 - f.x0) * (f.y1 - f.y0)));
            assert_true(fabs(level.rms_error_m - rms * info->quantum_m) <= 1e-9 * rms);
            assert_true(fabs(level.max_error_m - max * info->quantum_m) <= 1e-9 * max);
        }
        terrain_destroy(terrain);
    }
}

static uint64_t digest(const struct terrain *terrain)
{
    uint64_t hash = 1469598103934665603u;
    const struct terrain_info *info = terrain_info(terrain);
    for (int l = info->finest; l <= info->coarsest; l++) {
        struct terrain_level level = terrain_level(terrain, l);
        size_t stride;
        const int32_t *samples = terrain_samples(terrain, l, &stride);
        size_t count = stride * (size_t)(level.extent.y1 - level.extent.y0);
        for (size_t i = 0; i < count; i++) hash = (hash ^ (uint32_t)samples[i]) * 1099511628211u;
        uint64_t bits;
        memcpy(&bits, &level.rms_error_m, sizeof bits);
        hash = (hash ^ bits) * 1099511628211u;
    }
    return hash;
}

static void threads_change_nothing(void **state) // numerics.md, E10
{
    (void)state;
    struct terrain_options options = {.synthesize_levels = 2, .seed = 11};
    struct terrain *many = terrain_builtin(&options);
    assert_non_null(many);
    cpu_set_t all, one;
    assert_int_equal(sched_getaffinity(0, sizeof all, &all), 0);
    CPU_ZERO(&one);
    for (int cpu = 0; cpu < CPU_SETSIZE; cpu++)
        if (CPU_ISSET(cpu, &all) && CPU_COUNT(&one) == 0) CPU_SET(cpu, &one);
    assert_int_equal(sched_setaffinity(0, sizeof one, &one), 0);
    struct terrain *single = terrain_builtin(&options);
    assert_int_equal(sched_setaffinity(0, sizeof all, &all), 0);
    assert_true(digest(many) == digest(single));
    options.seed = 12;
    struct terrain *other = terrain_builtin(&options);
    assert_true(digest(many) != digest(other)); // the digest has power
    terrain_destroy(many);
    terrain_destroy(single);
    terrain_destroy(other);
}

static void builtin_is_large_and_quick(void **state)
{
    (void)state;
    struct timespec from, to;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &from);
    struct terrain *terrain = terrain_builtin(&(struct terrain_options){.synthesize_levels = 3, .seed = 1});
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &to);
    const struct terrain_info *info = terrain_info(terrain);
    assert_true(info->samples > 8000000);
    struct terrain_level stored = terrain_level(terrain, 0);
    assert_int_equal(stored.min_q * info->quantum_m, 236);
    assert_int_equal(stored.max_q * info->quantum_m, 1076);
    assert_true(info->max_q < QUANTA_LIMIT && info->min_q > -QUANTA_LIMIT);
    assert_true(info->spacing_m[0] == 74.21 && info->spacing_m[1] == 92.66);
    FIGURE("default terrain: %.1f M samples, %.0f MB, built in %.2f CPU s", (double)info->samples / 1e6,
           (double)terrain_resident_bytes(terrain) / 1e6,
           (double)(to.tv_sec - from.tv_sec) + (double)(to.tv_nsec - from.tv_nsec) * 1e-9);
    terrain_destroy(terrain);
}

static void bad_grids_are_refused(void **state)
{
    (void)state;
    const int32_t good[4] = {1, 2, 3, 4}, voids[4] = {INT32_MIN, INT32_MIN, INT32_MIN, INT32_MIN};
    const int32_t high[4] = {1, 2, 3, 1 << 22};
    struct terrain_grid grid = {"grid", good, 2, 2, {0, 0}, {1, 1}, 1, 0};
    struct terrain *terrain = terrain_from_grid(&grid, NULL);
    assert_non_null(terrain);
    terrain_destroy(terrain);
    struct terrain_grid bad[] = {grid, grid, grid, grid, grid, grid};
    bad[0].samples = voids;
    bad[1].samples = high;
    bad[2].width = 0;
    bad[3].spacing_m[1] = 0;
    bad[4].quantum_m = (double)NAN;
    bad[5].offset_m = INFINITY;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) assert_null(terrain_from_grid(&bad[i], NULL));
    assert_null(terrain_from_grid(&grid, &(struct terrain_options){.synthesize_levels = 9}));
    grid.width = grid.height = 1 << 20;
    assert_null(terrain_from_grid(&grid, NULL)); // refused before its samples are read
    terrain_destroy(NULL);
}

static void place_is_world_on_the_plane(void **state)
{
    (void)state;
    struct terrain *terrain = rough(4, 4, 0, 0, NULL, 10);
    const double place[3] = {12.5, -7.25, 1234.5};
    double world[3], back[3], up[3];
    terrain_world_from_place(terrain, place, world);
    terrain_place_from_world(terrain, world, back);
    terrain_up(terrain, world, up);
    assert_memory_equal(place, world, sizeof place);
    assert_memory_equal(place, back, sizeof place);
    assert_true(up[0] == 0 && up[1] == 0 && up[2] == 1);
    terrain_destroy(terrain);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(windows_are_the_samples),     cmocka_unit_test(levels_cover_the_map),
        cmocka_unit_test(grid_is_level_zero),          cmocka_unit_test(bounds_hold_the_samples),
        cmocka_unit_test(extrema_nodes_are_exact),     cmocka_unit_test(truth_is_the_finest_surface),
        cmocka_unit_test(level_errors_are_measured),   cmocka_unit_test(threads_change_nothing),
        cmocka_unit_test(builtin_is_large_and_quick),  cmocka_unit_test(bad_grids_are_refused),
        cmocka_unit_test(place_is_world_on_the_plane),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
