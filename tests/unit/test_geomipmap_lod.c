// Error of a level (numerics.md G2, C3) and error allowed (C1, C2).
// SPDX-License-Identifier: MIT
#include "common/terrain/terrain.h"
#include "geomipmap/geomipmap_lod.h"
#include "geomipmap/geomipmap_tiles.h"
#include "tests/unit/test_geomipmap.h"

#include <string.h>

enum { MAX_ROW = 33, FINE = 8 }; // FINE: samples a cell of the dense check

// ---- patches ------------------------------------------------------------------------------------

// Midpoint displacement: heights of a (2^bits + 1)^2 patch that falls off by `rough` from one scale to the
// next.
static void make_fractal(int bits, double rough, uint64_t *seed, int32_t *out)
{
    int row = (1 << bits) + 1;
    double z[MAX_ROW * MAX_ROW] = {0}, amplitude = 20000;
    for (int step = 1 << bits; step >= 1; step /= 2, amplitude *= rough)
        for (int j = 0; j < row; j += step)
            for (int i = 0; i < row; i += step) {
                int a = i / (2 * step) * 2 * step, b = j / (2 * step) * 2 * step;
                int c = i % (2 * step) ? a + 2 * step : i, d = j % (2 * step) ? b + 2 * step : j;
                bool old = step < 1 << bits && i % (2 * step) == 0 && j % (2 * step) == 0;
                double mean = step == 1 << bits
                                  ? 0
                                  : (z[b * row + a] + z[b * row + c] + z[d * row + a] + z[d * row + c]) / 4;
                if (!old) z[j * row + i] = mean + test_uniform(seed, -amplitude, amplitude);
            }
    for (int k = 0; k < row * row; k++) out[k] = (int32_t)lround(z[k]);
}

static void make_noise(int bits, uint64_t *seed, int32_t *out)
{
    int row = (1 << bits) + 1;
    for (int k = 0; k < row * row; k++) out[k] = (int32_t)(test_random(seed) % 40001) - 20000;
}

static void measure(const struct geomipmap_plan *plan, enum geomipmap_delta delta, const int32_t *heights,
                    int lane, float error[GEOMIPMAP_MAX_LEVELS])
{
    static double lanes[MAX_ROW * MAX_ROW * GEOMIPMAP_LANES];
    float all[GEOMIPMAP_LANES][GEOMIPMAP_MAX_LEVELS];
    double range[GEOMIPMAP_LANES] = {0};
    int row = (1 << (plan->bits + plan->height)) + 1;
    int32_t low = INT32_MAX, high = INT32_MIN;
    for (int k = 0; k < row * row; k++) {
        low = heights[k] < low ? heights[k] : low;
        high = heights[k] > high ? heights[k] : high;
    }
    for (int k = 0; k < row * row; k++) // the other lanes hold something else
        for (int l = 0; l < GEOMIPMAP_LANES; l++) lanes[k * GEOMIPMAP_LANES + l] = (k * 37 + l * 11) % 101;
    for (int k = 0; k < row * row; k++) lanes[k * GEOMIPMAP_LANES + lane] = (double)heights[k] - low;
    for (int l = 0; l < GEOMIPMAP_LANES; l++) range[l] = 101;
    range[lane] = (double)high - low;
    geomipmap_plan_measure(plan, delta, &(struct geomipmap_heights){.finest = lanes}, range, all);
    memcpy(error, all[lane], sizeof all[lane]);
}

// ---- the dense check: all in integers -----------------------------------------------------------

// Finest surface at (x, y) / FINE cells, times FINE.
static int64_t finest_at(const int32_t *heights, int row, int x, int y)
{
    int i = x / FINE, j = y / FINE, u = x % FINE, v = y % FINE;
    if (i == row - 1) i--, u = FINE;
    if (j == row - 1) j--, v = FINE;
    const int32_t *z = heights + j * row + i;
    int64_t z00 = z[0], z10 = z[1], z01 = z[row], z11 = z[row + 1];
    if (u >= v) return z00 * FINE + u * (z10 - z00) + v * (z11 - z10);
    return z00 * FINE + v * (z01 - z00) + u * (z11 - z01);
}

// Largest excess of |drawn - finest| over `allowed` quanta in one triangle: positive means that the bound
// is broken.  All products are integers below 2^53, and allowed is a float: nothing is rounded.
static double triangle_excess(const int32_t *heights, int row, const uint16_t v[3], double allowed)
{
    int x[3], y[3], low_x = INT32_MAX, high_x = 0, low_y = INT32_MAX, high_y = 0;
    for (int k = 0; k < 3; k++) {
        x[k] = v[k] % row * FINE, y[k] = v[k] / row * FINE;
        low_x = x[k] < low_x ? x[k] : low_x, high_x = x[k] > high_x ? x[k] : high_x;
        low_y = y[k] < low_y ? y[k] : low_y, high_y = y[k] > high_y ? y[k] : high_y;
    }
    int64_t area = (int64_t)(x[1] - x[0]) * (y[2] - y[0]) - (int64_t)(x[2] - x[0]) * (y[1] - y[0]);
    double worst = -INFINITY;
    for (int j = low_y; j <= high_y; j++)
        for (int i = low_x; i <= high_x; i++) {
            int64_t b = (int64_t)(i - x[0]) * (y[2] - y[0]) - (int64_t)(x[2] - x[0]) * (j - y[0]);
            int64_t c = (int64_t)(x[1] - x[0]) * (j - y[0]) - (int64_t)(i - x[0]) * (y[1] - y[0]);
            int64_t a = area - b - c;
            if (a < 0 || b < 0 || c < 0) continue;
            int64_t drawn = a * heights[v[0]] + b * heights[v[1]] + c * heights[v[2]];
            int64_t difference = llabs(drawn * FINE - finest_at(heights, row, i, j) * area);
            double excess = (double)difference - allowed * (double)(area * FINE);
            if (excess > worst) worst = excess;
        }
    return worst;
}

struct excess {
    bool stable, published; // broken somewhere?
};

// Every triangle of every set, against both bounds.  Triangles that several sets share are looked at once.
static struct excess check_patch(const struct geomipmap_mesh *mesh, const struct geomipmap_plan *plan,
                                 const int32_t *heights, int lane)
{
    static uint64_t seen[1 << 16];
    struct excess found = {false, false};
    float stable[GEOMIPMAP_MAX_LEVELS], published[GEOMIPMAP_MAX_LEVELS];
    int vertices = (1 << mesh->bits) + 1, row = (1 << (mesh->bits + plan->height)) + 1, set = 0;
    measure(plan, GEOMIPMAP_STABLE, heights, lane, stable);
    measure(plan, GEOMIPMAP_PUBLISHED, heights, lane, published);
    for (int level = 0; level < mesh->bits; level++) {
        assert_true(published[level] <= stable[level]);
        // An added border is nowhere farther from the level's own triangles than one of its vertices, so at
        // most twice as wrong.
        assert_true((double)stable[level] <= 2 * (double)published[level] * (1 + 1e-6));
        memset(seen, 0, sizeof seen);
        for (int sets = (level + 1) * (level + 1) * (level + 1) * (level + 1); sets > 0; sets--, set++) {
            const uint16_t *index = mesh->indices + mesh->parts[set].first;
            for (int i = 0; i < mesh->parts[set].count; i += 3) {
                uint64_t key = 1 + ((uint64_t)index[i] << 32 | (uint64_t)index[i + 1] << 16 | index[i + 2]);
                uint64_t *cell = &seen[key * 0x9e3779b97f4a7c15u >> 48];
                if (*cell == key) continue;
                *cell = key;
                uint16_t v[3]; // in samples of the finest level
                for (int k = 0; k < 3; k++)
                    v[k] = (uint16_t)((index[i + k] / vertices << plan->height) * row +
                                      (index[i + k] % vertices << plan->height));
                if (triangle_excess(heights, row, v, (double)stable[level]) > 0) found.stable = true;
                if (triangle_excess(heights, row, v, (double)published[level]) > 0) found.published = true;
            }
        }
    }
    return found;
}

static void stable_error_holds_for_every_border(void **state)
{
    (void)state;
    uint64_t seed = 4;
    static const int sizes[][2] = {{3, 0}, {4, 0}, {3, 1}, {2, 2}, {3, 2}}; // bits, height
    for (size_t size = 0; size < sizeof sizes / sizeof sizes[0]; size++) {
        int bits = sizes[size][0], height = sizes[size][1], patches = test_size(200, 900);
        int stable = 0, published = 0;
        struct geomipmap_mesh mesh;
        struct geomipmap_plan plan;
        assert_true(geomipmap_mesh_init(&mesh, bits, GEOMIPMAP_ADD, false));
        assert_true(geomipmap_plan_init(&plan, bits, height));
        for (int patch = 0; patch < patches; patch++) {
            int32_t heights[MAX_ROW * MAX_ROW];
            if (patch % 4 == 3)
                make_noise(bits + height, &seed, heights);
            else
                make_fractal(bits + height, test_uniform(&seed, 0.45, 0.75), &seed, heights);
            struct excess found = check_patch(&mesh, &plan, heights, patch % GEOMIPMAP_LANES);
            stable += found.stable;
            published += found.published;
        }
        FIGURE("%d patches of %d x %d, every %d. sample: stable error broken in %d, published in %d", patches,
               (1 << bits) + 1, (1 << bits) + 1, 1 << height, stable, published);
        assert_int_equal(stable, 0);
        assert_true(published > 0); // the check has power
        geomipmap_plan_finish(&plan);
        geomipmap_mesh_finish(&mesh);
    }
}

// ---- the metric `mean` --------------------------------------------------------------------------

// Mean distance over the samples of a patch where every step-th is drawn, cell by cell.
static double mean_error(const int32_t *heights, int side, int step)
{
    double sum = 0;
    for (int j = 0; j < side; j++)
        for (int i = 0; i < side; i++) {
            const int32_t *z = heights + j / step * step * (side + 1) + i / step * step;
            double u = (double)(i % step) / step, v = (double)(j % step) / step;
            double east = z[step], north = z[step * (side + 1)], far = z[step * (side + 2)];
            double drawn = u >= v ? z[0] + u * (east - z[0]) + v * (far - east)
                                  : z[0] + v * (north - z[0]) + u * (far - north);
            sum += fabs(drawn - heights[j * (side + 1) + i]);
        }
    return sum / (side * side);
}

// The level that is chosen costs least, error and triangles at the price that was set, among all levels,
// wherever ever coarser levels save ever less.
static void savings_choose_the_cheapest_level(void **state)
{
    (void)state;
    uint64_t seed = 14;
    int chosen[GEOMIPMAP_MAX_LEVELS] = {0}, judged = 0;
    static const int sizes[][2] = {{4, 0}, {3, 1}, {3, 2}}; // bits, height
    for (int size = 0; size < 3; size++) {
        int bits = sizes[size][0], height = sizes[size][1], side = 1 << (bits + height);
        struct geomipmap_plan plan;
        assert_true(geomipmap_plan_init(&plan, bits, height));
        for (int patch = 0; patch < test_size(100, 2000); patch++) {
            int32_t heights[MAX_ROW * MAX_ROW];
            float saving[GEOMIPMAP_MAX_LEVELS];
            double error[GEOMIPMAP_MAX_LEVELS];
            make_fractal(bits + height, test_uniform(&seed, 0.4, 0.7), &seed, heights);
            measure(&plan, GEOMIPMAP_SAVING, heights, patch % GEOMIPMAP_LANES, saving);
            bool convex = true;
            for (int l = 0; l < bits; l++) {
                int step = 1 << (height + l);
                error[l] = mean_error(heights, side, step);
                double finer = step > 1 ? mean_error(heights, side, step / 2) : 0;
                double expected = (error[l] - finer) * step * step;
                assert_true(fabs((double)saving[l] - expected) <= 1e-6 * (fabs(expected) + error[l]));
                convex = convex && (l == 0 || saving[l] > saving[l - 1]);
            }
            if (!convex) continue;
            double allowed = (double)saving[patch % bits] * test_uniform(&seed, 0.5, 2);
            int level = geomipmap_choose(saving, bits, allowed, bits, allowed);
            for (int l = 0; l < bits; l++) {
                double triangles[2] = {ldexp(1, -2 * (height + l)), ldexp(1, -2 * (height + level))};
                double costs[2] = {error[l] + allowed / 3 * triangles[0],
                                   error[level] + allowed / 3 * triangles[1]};
                assert_true(costs[1] <= costs[0] * (1 + 1e-6));
            }
            chosen[level]++, judged++;
        }
        geomipmap_plan_finish(&plan);
    }
    FIGURE("%d tiles: level 0 chosen %d times, 1 %d times, 2 %d times, 3 %d times, each the cheapest", judged,
           chosen[0], chosen[1], chosen[2], chosen[3]);
    for (int l = 0; l < 4; l++) assert_true(chosen[l] > 0);
}

// A needle of height H: the error is H at every level that skips it (E4).
static void needle_costs_its_height(void **state)
{
    (void)state;
    for (int bits = 2; bits <= 5; bits++) {
        struct geomipmap_plan plan;
        assert_true(geomipmap_plan_init(&plan, bits, 0));
        int row = (1 << bits) + 1;
        int32_t heights[MAX_ROW * MAX_ROW] = {0};
        heights[row * (row / 2 + 1) + row / 2 + 1] = 1000; // odd: only level 0 has it
        float error[GEOMIPMAP_MAX_LEVELS];
        measure(&plan, GEOMIPMAP_STABLE, heights, 0, error);
        assert_true(error[0] == 0);
        for (int level = 1; level < bits; level++) {
            assert_true((double)error[level] >= 1000);
            assert_true((double)error[level] <= 1000 * (1 + 1e-6));
        }
        geomipmap_plan_finish(&plan);
    }
}

static void flat_and_level_zero_have_no_error(void **state)
{
    (void)state;
    uint64_t seed = 9;
    for (int bits = 2; bits <= 5; bits++) {
        struct geomipmap_plan plan;
        assert_true(geomipmap_plan_init(&plan, bits, 0));
        int32_t heights[MAX_ROW * MAX_ROW];
        float error[GEOMIPMAP_MAX_LEVELS];
        for (int k = 0; k < MAX_ROW * MAX_ROW; k++) heights[k] = 88480;
        measure(&plan, GEOMIPMAP_STABLE, heights, 1, error);
        for (int level = 0; level < bits; level++) assert_true(error[level] == 0);
        assert_int_equal(geomipmap_choose(error, bits, 0, bits, 0), bits - 1); // delta 0 <= allowed 0 (G3)
        make_noise(bits, &seed, heights);
        measure(&plan, GEOMIPMAP_STABLE, heights, 2, error);
        assert_true(error[0] == 0);
        assert_int_equal(geomipmap_choose(error, bits, 0, bits, 0), 0);
        geomipmap_plan_finish(&plan);
    }
}

// ---- what is allowed ----------------------------------------------------------------------------

static struct view make_view(double yaw, double pitch, double roll, double fov, int width, int height)
{
    const int32_t flat[4] = {0};
    const struct terrain_grid grid = {
        .name = "flat", .samples = flat, .width = 2, .height = 2, .spacing_m = {1, 1}, .quantum_m = 1};
    struct terrain *terrain = terrain_from_grid(&grid, &(struct terrain_options){0});
    assert_non_null(terrain);
    const struct camera camera = {{0.5, 0.5, 100}, yaw, pitch, roll, fov};
    struct view view;
    view_init(&view, terrain, &camera, width, height, 0.5);
    terrain_destroy(terrain);
    return view;
}

// Vertical segments of the allowed length with a seen end at the stated depth: how many show as more than
// tau?
static int count_broken(enum geomipmap_metric metric, const struct view *view, double tau, int count,
                        uint64_t *seed, double *worst)
{
    struct geomipmap_judge judge;
    geomipmap_judge_init(&judge, metric, tau, view, 1);
    int broken = 0;
    for (int i = 0; i < count; i++) {
        double depth = view->near_m * exp(test_uniform(seed, 0, 8)), seen[3], length;
        double tx = test_uniform(seed, -1, 1) * view->tan_half[0];
        double ty = test_uniform(seed, -1, 1) * view->tan_half[1];
        for (int axis = 0; axis < 3; axis++)
            seen[axis] = depth * (view->forward[axis] + tx * view->right[axis] + ty * view->up[axis]);
        double distance = sqrt(seen[0] * seen[0] + seen[1] * seen[1] + seen[2] * seen[2]);
        double error = geomipmap_allowed(&judge, depth, distance) * (i & 1 ? 1 : -1);
        view_project_vertical(view, seen[0], seen[1], seen[2], seen[2] + error, &length);
        if (length > tau * (1 + 1e-9)) broken++;
        *worst = fmax(*worst, length / tau);
    }
    return broken;
}

static void safe_metric_holds_anywhere_in_the_window(void **state)
{
    (void)state;
    static const double fovs[] = {1, 60, 90, 120, 170};
    static const char *const names[] = {"paper", "depth", "safe"};
    int cases = test_size(200, 4000), broken[3] = {0};
    double worst[3] = {0};
    uint64_t seed = 11;
    for (int f = 0; f < 5; f++)
        for (int i = 0; i < 40; i++) {
            double pitch = i == 0 ? -M_PI / 2 : i == 1 ? M_PI / 2 : test_uniform(&seed, -1.5, 1.5);
            struct view view = make_view(test_uniform(&seed, -4, 4), pitch, test_uniform(&seed, -4, 4),
                                         fovs[f] * M_PI / 180, i % 3 ? 640 : 64, i % 5 ? 480 : 48);
            double tau = 0.25 * (1 << i % 6);
            for (int metric = 0; metric < 3; metric++)
                broken[metric] +=
                    count_broken((enum geomipmap_metric)metric, &view, tau, cases, &seed, &worst[metric]);
        }
    for (int metric = 0; metric < 3; metric++)
        FIGURE("metric %s: tau broken by %d of %d segments, worst %.3f times", names[metric], broken[metric],
               5 * 40 * cases, worst[metric]);
    assert_int_equal(broken[GEOMIPMAP_SAFE], 0);
    assert_true(worst[GEOMIPMAP_SAFE] > 0.9); // and it is no looser than it must be
    assert_true(broken[GEOMIPMAP_PAPER] > 0);
    assert_true(broken[GEOMIPMAP_DEPTH] > 0);
}

// The closed form never allows less than K d sqrt(1 + T^2) / w <= tau, the bound of numerics.md C1, once
// the displaced end is no nearer than the seen one.
static void safe_metric_is_at_least_as_tight_as_c1(void **state)
{
    (void)state;
    uint64_t seed = 3;
    for (int i = 0; i < 1000; i++) {
        struct view view = make_view(test_uniform(&seed, -4, 4), test_uniform(&seed, -1.5, 1.5),
                                     test_uniform(&seed, -4, 4), test_uniform(&seed, 0.1, 2.8), 640, 480);
        struct geomipmap_judge judge;
        geomipmap_judge_init(&judge, GEOMIPMAP_SAFE, 1, &view, 1);
        double t2 = view.tan_half[0] * view.tan_half[0] + view.tan_half[1] * view.tan_half[1];
        assert_true(judge.vertical_px <= view.pixels_per_tangent * sqrt(1 + t2) * (1 + 1e-12));
    }
}

// ---- tiles --------------------------------------------------------------------------------------

static struct terrain *make_terrain(int width, int height, int32_t scale, uint64_t *seed)
{
    int32_t *samples = malloc((size_t)width * (size_t)height * sizeof *samples);
    assert_non_null(samples);
    for (int k = 0; k < width * height; k++) samples[k] = (int32_t)(test_random(seed) % 1000) * scale;
    const struct terrain_grid grid = {.name = "noise",
                                      .samples = samples,
                                      .width = width,
                                      .height = height,
                                      .first = {-5, 100000000000},
                                      .spacing_m = {2, 3},
                                      .quantum_m = 0.5,
                                      .offset_m = -7};
    struct terrain *terrain = terrain_from_grid(&grid, &(struct terrain_options){0});
    assert_non_null(terrain);
    free(samples);
    return terrain;
}

static struct geomipmap_range know(struct geomipmap_tiles *tiles, struct geomipmap_place place,
                                   const float **error)
{
    struct geomipmap_range range;
    geomipmap_tiles_begin(tiles);
    if (!geomipmap_tiles_know(tiles, place, &range, error)) {
        assert_true(geomipmap_tiles_measure(tiles));
        assert_true(geomipmap_tiles_know(tiles, place, &range, error));
    }
    return range;
}

static void tiles_cover_maps_of_any_size(void **state)
{
    (void)state;
    static const int sizes[][4] = {{1, 1, 1, 1},   {2, 2, 1, 1},   {3, 3, 1, 1},
                                   {1, 17, 1, 1},  {17, 1, 1, 1},  {16, 16, 1, 1},
                                   {18, 67, 2, 5}, {17, 18, 1, 2}, {129, 50, 8, 4}};
    uint64_t seed = 5;
    for (size_t s = 0; s < sizeof sizes / sizeof sizes[0]; s++) {
        struct terrain *terrain = make_terrain(sizes[s][0], sizes[s][1], 1, &seed);
        struct geomipmap_tiles one, three;
        int merge = (int)s % 4;
        assert_true(geomipmap_tiles_init(&one, terrain, 4, merge, GEOMIPMAP_STABLE, false, 1));
        assert_true(geomipmap_tiles_init(&three, terrain, 4, merge, GEOMIPMAP_STABLE, false, 3));
        assert_int_equal(one.grid[0].columns, sizes[s][2]);
        assert_int_equal(one.grid[0].rows, sizes[s][3]);
        for (int height = 0; height <= merge; height++)
            for (int tile = 0; tile < one.grid[height].columns * one.grid[height].rows; tile++) {
                int32_t heights[17 * 17];
                const struct geomipmap_place place = {height, tile % one.grid[height].columns,
                                                      tile / one.grid[height].columns};
                const float *errors, *same_errors;
                struct geomipmap_range range = know(&one, place, &errors),
                                       same = know(&three, place, &same_errors),
                                       bounds = geomipmap_tiles_bounds(&one, place);
                assert_memory_equal(&range, &same, sizeof range);
                assert_memory_equal(errors, same_errors, 4 * sizeof(float));
                assert_true(bounds.low <= range.low && bounds.high >= range.high);
                geomipmap_tiles_read(&one, NULL, place, NULL, heights);
                for (int k = 0; k < 17 * 17; k++)
                    assert_in_range(heights[k] + 1, range.low + 1, range.high + 1);
            }
        assert_false(one.wide);
        geomipmap_tiles_finish(&one);
        geomipmap_tiles_finish(&three);
        terrain_destroy(terrain);
    }
}

// ---- tiles drawn with the levels of the pyramid -------------------------------------------------

// A form that neighbours may ask for: sides as fine as the tile or finer, corners as fine as their sides or
// finer still.
static struct geomipmap_form random_form(int height, int level, uint64_t *seed)
{
    struct geomipmap_form form = {.inside = (uint8_t)(height + level)};
    for (int n = 0; n < GEOMIPMAP_SIDES; n++)
        form.side[n] = (uint8_t)(height + (int)(test_random(seed) % (uint64_t)(level + 1)));
    for (int n = 0; n < GEOMIPMAP_SIDES; n++) {
        int next = form.side[(n + 1) % GEOMIPMAP_SIDES], most = form.side[n] < next ? form.side[n] : next;
        form.corner[n] = (uint8_t)(test_random(seed) % (uint64_t)(most + 1));
    }
    return form;
}

// Largest distance of a drawn tile from the finest samples under it, quanta.
static double form_error(const struct terrain *terrain, const struct geomipmap_tiles *tiles,
                         struct geomipmap_place place, const struct geomipmap_form *form)
{
    int cells = 1 << tiles->bits, row = cells + 1, step = 1 << place.height, neighbours[GEOMIPMAP_SIDES];
    int32_t *heights = malloc((size_t)row * (size_t)row * sizeof *heights);
    uint16_t *list = malloc(geomipmap_mesh_bound(tiles->bits) * sizeof *list);
    assert_true(heights && list);
    geomipmap_tiles_read(tiles, NULL, place, form, heights);
    for (int n = 0; n < GEOMIPMAP_SIDES; n++) neighbours[n] = form->side[n] - place.height;
    int count = geomipmap_mesh_write(tiles->bits, form->inside - place.height, neighbours, list);
    struct terrain_extent e = terrain_level(terrain, tiles->finest).extent;
    int64_t x0 = tiles->x0 + (int64_t)place.column * cells * step,
            y0 = tiles->y0 + (int64_t)place.row * cells * step;
    double worst = 0;
    for (int t = 0; t < count; t += 3) {
        int x[3], y[3], low[2] = {INT32_MAX, INT32_MAX}, high[2] = {0, 0};
        for (int k = 0; k < 3; k++) {
            x[k] = list[t + k] % row * step, y[k] = list[t + k] / row * step;
            low[0] = x[k] < low[0] ? x[k] : low[0], high[0] = x[k] > high[0] ? x[k] : high[0];
            low[1] = y[k] < low[1] ? y[k] : low[1], high[1] = y[k] > high[1] ? y[k] : high[1];
        }
        double area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0]);
        for (int j = low[1]; j <= high[1]; j++)
            for (int i = low[0]; i <= high[0]; i++) {
                double b = ((i - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (j - y[0])) / area;
                double c = ((x[1] - x[0]) * (j - y[0]) - (i - x[0]) * (y[1] - y[0])) / area;
                bool ground = x0 + i >= e.x0 && x0 + i < e.x1 && y0 + j >= e.y0 && y0 + j < e.y1;
                if (b < 0 || c < 0 || b + c > 1 || !ground) continue;
                int32_t truth;
                terrain_window(terrain, tiles->finest, x0 + i, y0 + j, 1, 1, &truth, TERRAIN_WAIT);
                double drawn =
                    (1 - b - c) * heights[list[t]] + b * heights[list[t + 1]] + c * heights[list[t + 2]];
                worst = fmax(worst, fabs(drawn - truth));
            }
    }
    free(heights);
    free(list);
    return worst;
}

// The error of a level holds for every form in which it may be drawn; `published` does not.
static void errors_of_levels_hold_for_every_form(void **state)
{
    (void)state;
    uint64_t seed = 9;
    for (int bits = 3; bits <= 4; bits++)
        for (int merge = 0; merge <= 2; merge++) {
            const struct test_map map = {.width = 203,
                                         .height = 170,
                                         .first = {-37, 5},
                                         .spacing_m = {1, 1},
                                         .quantum_m = 0.01,
                                         .height_m = 50,
                                         .rough = 0.6};
            struct terrain *terrain = test_fractal(&map, 17 + (uint64_t)merge);
            struct geomipmap_tiles stable, published;
            assert_true(geomipmap_tiles_init(&stable, terrain, bits, merge, GEOMIPMAP_STABLE, true, 1));
            assert_true(geomipmap_tiles_init(&published, terrain, bits, merge, GEOMIPMAP_PUBLISHED, true, 1));
            int broken[2] = {0, 0}, forms = test_size(300, 6000);
            double tightness = 0;
            for (int k = 0; k < forms; k++) {
                int height = (int)(test_random(&seed) % (uint64_t)(merge + 1));
                int level = (int)(test_random(&seed) % (uint64_t)bits);
                const struct geomipmap_grid *grid = &stable.grid[height];
                const struct geomipmap_place place = {height,
                                                      (int)(test_random(&seed) % (uint64_t)grid->columns),
                                                      (int)(test_random(&seed) % (uint64_t)grid->rows)};
                struct geomipmap_form form = random_form(height, level, &seed);
                double error = form_error(terrain, &stable, place, &form);
                const float *errors;
                know(&stable, place, &errors);
                broken[0] += error > (double)errors[level];
                tightness += errors[level] > 0 ? error / (double)errors[level] / forms : 1.0 / forms;
                know(&published, place, &errors);
                broken[1] += error > (double)errors[level];
            }
            FIGURE(
                "tiles of %d x %d, merge %d: %d forms, stable error broken in %d, published in %d; %.2f of "
                "it on average",
                (1 << bits) + 1, (1 << bits) + 1, merge, forms, broken[0], broken[1], tightness);
            assert_int_equal(broken[0], 0);
            assert_true(broken[1] > 0);
            geomipmap_tiles_finish(&stable);
            geomipmap_tiles_finish(&published);
            terrain_destroy(terrain);
        }
}

static void tall_tiles_are_noticed(void **state)
{
    (void)state;
    uint64_t seed = 6;
    struct terrain *terrain = make_terrain(40, 40, 4000, &seed);
    struct geomipmap_tiles tiles;
    assert_true(geomipmap_tiles_init(&tiles, terrain, 4, 0, GEOMIPMAP_STABLE, false, 1));
    assert_true(tiles.wide);
    geomipmap_tiles_finish(&tiles);
    terrain_destroy(terrain);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(stable_error_holds_for_every_border),
        cmocka_unit_test(savings_choose_the_cheapest_level),
        cmocka_unit_test(needle_costs_its_height),
        cmocka_unit_test(flat_and_level_zero_have_no_error),
        cmocka_unit_test(safe_metric_holds_anywhere_in_the_window),
        cmocka_unit_test(safe_metric_is_at_least_as_tight_as_c1),
        cmocka_unit_test(tiles_cover_maps_of_any_size),
        cmocka_unit_test(errors_of_levels_hold_for_every_form),
        cmocka_unit_test(tall_tiles_are_noticed),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
