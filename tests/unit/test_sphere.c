// Terrain on a sphere: places, grids that go around, their levels, and detail made on demand.
// SPDX-License-Identifier: MIT
#include "common/terrain/detail.h"
#include "common/terrain/sphere.h"
#include "common/terrain/terrain.h"
#include "tests/planet.h"

#include <string.h>

enum { COLUMNS = 96, ROWS = 49 };

static void places_and_worlds_agree(void **state)
{
    (void)state;
    struct terrain *terrain = test_planet(COLUMNS, 3000, 5, 0);
    uint64_t seed = 1;
    double worst = 0, worst_axes = 0;
    int count = test_size(20000, 1000000);
    for (int k = 0; k < count; k++) {
        double place[3] = {test_uniform(&seed, -M_PI, M_PI) * RADIUS,
                           test_uniform(&seed, -M_PI / 2, M_PI / 2) * RADIUS,
                           test_uniform(&seed, -430, 3 * RADIUS)};
        if (k % 7 == 0) place[1] = (k % 2 ? 0.5 : -0.5) * M_PI * RADIUS;
        double world[3], back[3], again[3], up[3], axes[3][3];
        terrain_world_from_place(terrain, place, world);
        terrain_place_from_world(terrain, world, back);
        terrain_world_from_place(terrain, back, again);
        terrain_up(terrain, world, up);
        terrain_axes(terrain, place, axes);
        double distance = sqrt(world[0] * world[0] + world[1] * world[1] + world[2] * world[2]);
        assert_true(fabs(distance - (RADIUS + place[2])) <= 1e-15 * 4 * distance);
        for (int axis = 0; axis < 3; axis++) {
            worst = fmax(worst, fabs(again[axis] - world[axis]) / distance);
            worst_axes = fmax(worst_axes, fabs(up[axis] - axes[2][axis]));
            double ahead[3] = {place[0], place[1], place[2]}, there[3];
            ahead[2] += 1000;
            terrain_world_from_place(terrain, ahead, there);
            assert_true(fabs(there[axis] - world[axis] - 1000 * axes[2][axis]) < 1e-8 * 4);
        }
        double handed = axes[0][0] * (axes[1][1] * axes[2][2] - axes[1][2] * axes[2][1]) -
                        axes[0][1] * (axes[1][0] * axes[2][2] - axes[1][2] * axes[2][0]) +
                        axes[0][2] * (axes[1][0] * axes[2][1] - axes[1][1] * axes[2][0]);
        assert_true(fabs(handed - 1) < 1e-14);
    }
    FIGURE("place -> world -> place -> world: worst %.1e of the distance over %d places", worst, count);
    assert_true(worst < 1e-14 && worst_axes < 1e-14);
    terrain_destroy(terrain);
}

// Any window is the samples met on going east and north, over seam and poles.
static void windows_go_around(void **state)
{
    (void)state;
    struct terrain *terrain = test_planet(COLUMNS, 3000, 5, 3);
    const struct terrain_info *info = terrain_info(terrain);
    assert_int_equal(info->datum, TERRAIN_SPHERE);
    assert_true(info->wraps_x);
    assert_int_equal(info->finest, -3);
    uint64_t seed = 2;
    for (int level = info->finest; level <= info->coarsest; level++) {
        struct terrain_extent e = terrain_level(terrain, level).extent;
        int64_t columns = e.x1 - e.x0, pole = e.y1 - 1;
        assert_int_equal(e.y0, -pole);
        for (int k = 0; k < test_size(60, 3000); k++) {
            int64_t x = (int64_t)test_uniform(&seed, -3.0 * (double)columns, 3.0 * (double)columns);
            int64_t y = (int64_t)test_uniform(&seed, -2.5 * (double)pole, 2.5 * (double)pole);
            int32_t all[9][7], one;
            terrain_window(terrain, level, x, y, 7, 9, &all[0][0], TERRAIN_WAIT);
            for (int b = 0; b < 9; b++)
                for (int a = 0; a < 7; a++) {
                    int64_t i = x + a, j = y + b;
                    while (j > pole || j < -pole) {
                        j = j > pole ? 2 * pole - j : -2 * pole - j;
                        i += columns / 2;
                    }
                    while (i < e.x0) i += columns;
                    while (i >= e.x1) i -= columns;
                    terrain_window(terrain, level, i, j, 1, 1, &one, TERRAIN_WAIT);
                    assert_int_equal(all[b][a], one);
                    if (j == pole || j == -pole) {
                        int32_t other;
                        terrain_window(terrain, level, e.x0, j, 1, 1, &other, TERRAIN_WAIT);
                        assert_int_equal(one, other);
                    }
                }
        }
    }
    terrain_destroy(terrain);
}

// A planet turned by some columns has the turned levels; one that is mirrored or padded at the seam had not.
static void levels_know_no_seam(void **state)
{
    (void)state;
    enum { TURN = 40 };
    struct terrain *terrain = test_planet(COLUMNS, 3000, 5, 0);
    static int32_t turned[ROWS * COLUMNS];
    terrain_window(terrain, 0, -COLUMNS / 2 + TURN, -(ROWS / 2), COLUMNS, ROWS, turned, TERRAIN_WAIT);
    struct terrain_grid grid = {.name = "turned",
                                .samples = turned,
                                .width = COLUMNS,
                                .height = ROWS,
                                .first = {-COLUMNS / 2, 0},
                                .spacing_m = {1, 1},
                                .quantum_m = 1};
    struct terrain_options options = {.radius_m = RADIUS};
    struct terrain *other = terrain_from_grid(&grid, &options);
    assert_int_equal(terrain_info(terrain)->coarsest, 3); // 96 / 2^3 = 12 columns, poles at rows +-3
    for (int level = 1; level <= terrain_info(terrain)->coarsest; level++) {
        struct terrain_extent e = terrain_level(terrain, level).extent;
        for (int64_t j = e.y0; j < e.y1; j++) {
            int32_t a[COLUMNS], b[COLUMNS];
            int width = (int)(e.x1 - e.x0);
            terrain_window(terrain, level, e.x0 + TURN / (1 << level), j, width, 1, a, TERRAIN_WAIT);
            terrain_window(other, level, e.x0, j, width, 1, b, TERRAIN_WAIT);
            assert_memory_equal(a, b, (size_t)width * sizeof *a);
        }
        assert_true(terrain_level(terrain, level).max_error_m == terrain_level(other, level).max_error_m);
    }
    terrain_destroy(terrain);
    terrain_destroy(other);
}

static void bounds_hold_all_samples(void **state)
{
    (void)state;
    struct terrain *terrain = test_planet(COLUMNS, 3000, 5, 4);
    const struct terrain_info *info = terrain_info(terrain);
    uint64_t seed = 3;
    for (int k = 0; k < test_size(400, 20000); k++) {
        int level = info->finest + k % (info->coarsest - info->finest + 1);
        struct terrain_extent e = terrain_level(terrain, level).extent;
        int64_t columns = e.x1 - e.x0, pole = e.y1 - 1;
        int64_t x = (int64_t)test_uniform(&seed, -2.0 * (double)columns, 2.0 * (double)columns);
        int64_t y = (int64_t)test_uniform(&seed, -1.2 * (double)pole, 1.2 * (double)pole);
        int width = 1 + (int)(test_random(&seed) % 40), height = 1 + (int)(test_random(&seed) % 12);
        int32_t all[40 * 12], low, high;
        if (height > 2 * pole) height = (int)(2 * pole);
        terrain_window(terrain, level, x, y, width, height, all, TERRAIN_WAIT);
        terrain_bounds(terrain, level, x, y, x + width - 1, y + height - 1, &low, &high);
        for (int s = 0; s < width * height; s++) assert_in_range(all[s] - low, 0, high - low);
        struct terrain_level whole = terrain_level(terrain, level);
        for (int s = 0; s < width * height; s++)
            assert_in_range(all[s] - whole.min_q, 0, whole.max_q - whole.min_q);
    }
    terrain_destroy(terrain);
}

// A mountain and a trench far from each other: U leaves the range of the samples that it reads, not that of
// the map.  What nobody has made is compared with nothing.
static void made_levels_are_bound_where_they_are(void **state)
{
    (void)state;
    enum { HIGH = 4000 };
    static int32_t samples[COLUMNS * ROWS];
    samples[ROWS / 2 * COLUMNS + COLUMNS / 4] = HIGH;
    samples[ROWS / 2 * COLUMNS + COLUMNS / 4 * 3] = -HIGH;
    struct terrain_grid grid = {.name = "two", .samples = samples, .width = COLUMNS, .height = ROWS};
    grid.spacing_m[0] = grid.spacing_m[1] = grid.quantum_m = 1;
    for (int finer = 0; finer <= 2; finer += 2) {
        struct terrain_options options = {.radius_m = RADIUS, .synthesize_levels = finer, .refine_bits = 1};
        struct terrain *terrain = terrain_from_grid(&grid, &options);
        struct terrain_level level = terrain_level(terrain, terrain_info(terrain)->finest);
        double noise_q = 0, high_q = 2 * HIGH;
        for (int l = -1; l >= -finer; l--)
            noise_q += DETAIL_NORM_MIXED * (DETAIL_DEVIATE * terrain_level(terrain, l).noise_q + 1.5);
        // On so small a planet, bounds that begin at the equator reach to where posts get farther apart.
        double over_q = finer ? DETAIL_OVERSHOOT(DETAIL_NORM_MIXED) * high_q + noise_q + 1 : 0;
        assert_true(level.max_q >= high_q && level.max_q <= high_q + over_q);
        assert_true(level.min_q <= -high_q && level.min_q >= -high_q - over_q);
        assert_true(level.max_error_m == 0 && level.rms_error_m == 0);
        assert_true(isnan(terrain_level(terrain, 1).rms_error_m) == (finer > 0));
        assert_true(isnan(terrain_level(terrain, 1).max_error_m) == (finer > 0));
        terrain_destroy(terrain);
    }
}

// The same sample from any window, and a surface that goes on over the seam and is one height at a pole.
static void truth_is_one_surface(void **state)
{
    (void)state;
    for (int finer = 0; finer <= 14; finer += 7) {
        struct terrain *terrain = test_planet(COLUMNS, 3000, 5, finer);
        const struct terrain_info *info = terrain_info(terrain);
        uint64_t seed = 4;
        for (int k = 0; k < test_size(300, 20000); k++) {
            double x = test_uniform(&seed, -M_PI, M_PI) * RADIUS,
                   y = test_uniform(&seed, -M_PI / 2, M_PI / 2) * RADIUS;
            double here, turned, cell = ldexp(info->spacing_m[0], info->finest), slope[2];
            assert_true(terrain_truth_at(terrain, x, y, &here, slope));
            assert_true(terrain_truth_at(terrain, x + 2 * M_PI * RADIUS, y, &turned, NULL));
            // Rounding of the place moves it by at most 1e-8 m; the surface moves no more than its slope
            // says.
            assert_true(fabs(here - turned) <= 1e-6 * (1 + fabs(slope[0]) * cell + fabs(here)));
            double east, west, step = 1e-7 * cell;
            terrain_truth_at(terrain, M_PI * RADIUS - step, y, &west, slope);
            double beyond[2]; // the slope on the other side: each rises by its own
            terrain_truth_at(terrain, -M_PI * RADIUS + step, y, &east, beyond);
            assert_true(fabs(east - west) <= 1e-3 + step * (fabs(slope[0]) + fabs(beyond[0])));
            double pole, other;
            terrain_truth_at(terrain, x, M_PI / 2 * RADIUS, &pole, NULL);
            terrain_truth_at(terrain, 0, M_PI / 2 * RADIUS, &other, NULL);
            assert_true(fabs(pole - other) < 1e-6);
        }
        terrain_destroy(terrain);
    }
}

static void detail_is_the_same_from_any_window(void **state)
{
    (void)state;
    struct terrain *terrain = test_planet(COLUMNS, 3000, 5, 14);
    const struct terrain_info *info = terrain_info(terrain);
    assert_true(terrain_samples(terrain, info->finest, &(size_t){0}) == NULL);
    static int32_t large[150 * 130], small[150 * 130];
    uint64_t seed = 6;
    for (int k = 0; k < test_size(6, 200); k++) {
        int level = -1 - k % 14;
        struct terrain_extent e = terrain_level(terrain, level).extent;
        int64_t x = (int64_t)test_uniform(&seed, (double)e.x0, (double)e.x1);
        int64_t y = (int64_t)test_uniform(&seed, 1.1 * (double)e.y0, 1.1 * (double)e.y1);
        terrain_window(terrain, level, x, y, 150, 130, large, TERRAIN_WAIT);
        for (int part = 0; part < 20; part++) {
            int a = (int)(test_random(&seed) % 100), b = (int)(test_random(&seed) % 100);
            int width = 1 + (int)(test_random(&seed) % 50), height = 1 + (int)(test_random(&seed) % 30);
            terrain_window(terrain, level, x + a, y + b, width, height, small, TERRAIN_WAIT);
            for (int j = 0; j < height; j++)
                assert_memory_equal(small + j * width, large + (b + j) * 150 + a,
                                    (size_t)width * sizeof *small);
        }
    }
    terrain_destroy(terrain);
}

// Samples of cell centres come back out of the grid by the same rule within its error for a smooth map; a map
// of one height keeps it.
static void pixel_centres_become_grid_lines(void **state)
{
    (void)state;
    enum { W = 144, H = 72 };
    static int32_t pixels[H][W];
    for (int flat = 0; flat < 2; flat++) {
        for (int j = 0; j < H; j++)
            for (int i = 0; i < W; i++) {
                double longitude = 2 * M_PI * (i + 0.5) / W, latitude = M_PI * (j + 0.5) / H - M_PI / 2;
                pixels[j][i] =
                    flat ? 777 : (int32_t)lrint(1e5 * cos(latitude) * cos(longitude) + 5e4 * sin(latitude));
            }
        int32_t *grid = sphere_from_pixels(&pixels[0][0], W, H);
        assert_non_null(grid);
        double worst = 0;
        for (int j = 0; j <= H; j++)
            for (int i = 0; i < W; i++) {
                double longitude = 2 * M_PI * i / W, latitude = M_PI * j / H - M_PI / 2;
                double exact = flat ? 777 : 1e5 * cos(latitude) * cos(longitude) + 5e4 * sin(latitude);
                worst = fmax(worst, fabs(grid[j * W + i] - exact));
            }
        free(grid);
        // The 4-point rule errs by 3/128 h^4 f'''' on each axis, f'''' at most 1.2e5 here (1e5 cos + 5e4
        // sin), the seen-over-the-pole rows included; rounding adds one quantum for the samples and half for
        // the sum.
        double h = 2 * M_PI / W;
        assert_true(worst <= (flat ? 0 : 2 * 3.0 / 128 * h * h * h * h * 1.2e5 + 1.5 * 1.5625));
    }
}

static void real_planets_load_as_spheres(void **state)
{
    (void)state;
    static const struct {
        const char *file;
        int64_t columns, rows;
        double radius_m;
    } CASES[] = {{"earth_etopo5_4320x2161.png", 4320, 2161, 6371007},
                 {"mars_mola_4ppd_1440x720.png", 1440, 721, 3396190}};
    for (int k = 0; k < 2; k++) {
        char path[1024];
        if (!test_data(CASES[k].file, path)) continue;
        struct terrain *terrain = terrain_load(path, &(struct terrain_options){.synthesize_levels = 14});
        assert_non_null(terrain);
        const struct terrain_info *info = terrain_info(terrain);
        struct terrain_extent e = terrain_level(terrain, 0).extent;
        assert_int_equal(info->datum, TERRAIN_SPHERE);
        assert_int_equal(e.x1 - e.x0, CASES[k].columns);
        assert_int_equal(e.y1 - e.y0, CASES[k].rows);
        assert_true(info->radius_m == CASES[k].radius_m);
        double finest_m = ldexp(info->spacing_m[0], info->finest);
        assert_true(finest_m < 1);
        double height_q = 0;
        if (k == 0) { // Everest, on a grid of 9 km, and the Dead Sea, as this grid places it
            terrain_truth_at(terrain, 86.925 / 180 * M_PI * info->radius_m,
                             27.988 / 180 * M_PI * info->radius_m, &height_q, NULL);
            double everest_m = height_q * info->quantum_m + info->offset_m;
            terrain_truth_at(terrain, 35.36 / 180 * M_PI * info->radius_m, 31.5 / 180 * M_PI * info->radius_m,
                             &height_q, NULL);
            double dead_sea_m = height_q * info->quantum_m + info->offset_m;
            FIGURE("Everest %.0f m, the Dead Sea %.0f m, finest spacing %.2f m", everest_m, dead_sea_m,
                   finest_m);
            assert_true(everest_m > 5500 && dead_sea_m < -200);
        } else { // Olympus Mons
            terrain_truth_at(terrain, -133.8 / 180 * M_PI * info->radius_m,
                             18.65 / 180 * M_PI * info->radius_m, &height_q, NULL);
            double olympus_m = height_q * info->quantum_m + info->offset_m;
            FIGURE("Olympus Mons %.0f m, finest spacing %.2f m", olympus_m, finest_m);
            assert_true(olympus_m > 18000);
        }
        terrain_destroy(terrain);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(places_and_worlds_agree),
        cmocka_unit_test(windows_go_around),
        cmocka_unit_test(levels_know_no_seam),
        cmocka_unit_test(bounds_hold_all_samples),
        cmocka_unit_test(made_levels_are_bound_where_they_are),
        cmocka_unit_test(truth_is_one_surface),
        cmocka_unit_test(detail_is_the_same_from_any_window),
        cmocka_unit_test(pixel_centres_become_grid_lines),
        cmocka_unit_test(real_planets_load_as_spheres),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
