// Synthesised levels of planets: posts, what they are made of, and how rough they are in the world.
// SPDX-License-Identifier: MIT
#include "common/terrain/detail.h"
#include "tests/planet.h"

#include <stdlib.h>

// Posts are between half the distance of rows and all of it apart, unless a turn does not come out even.  The
// cosine of latitude is right within .0016 (detail.c), near a pole within 2 % of itself.
static void posts_are_as_far_apart_as_rows(void **state)
{
    (void)state;
    static const int COLUMNS[] = {4320, 1024, 96, 36};
    for (int c = 0; c < 4; c++) {
        struct detail detail = {.grid = {-COLUMNS[c] / 2, COLUMNS[c], COLUMNS[c] / 4}};
        for (int level = 0; level >= -14; level -= 7) {
            struct sphere_grid grid = sphere_level(&detail.grid, level);
            int most = 0;
            while (grid.columns % ((int64_t)4 << most) == 0) most++;
            for (int64_t row = 0, step = 1 + grid.pole / 5000; row <= grid.pole; row += step) {
                int e = detail_exponent(&detail, level, row);
                double room = cos(M_PI / 2 * (double)row / (double)grid.pole), apart = ldexp(room, e);
                assert_int_equal(e, detail_exponent(&detail, level, -row));
                assert_int_equal(e, detail_exponent(&detail, level, 2 * grid.pole - row));
                assert_true(apart <= 1.02 && e <= most);
                assert_true(apart > 0.49 || e == most);
            }
        }
    }
}

struct region {
    double south_m, north_m;
};

// Standard deviation of slope along the parallel and along the meridian.
static void roughness(const struct terrain *terrain, const struct region *region, double deviation[2])
{
    const struct terrain_info *info = terrain_info(terrain);
    double sum[2] = {0, 0}, squares[2] = {0, 0};
    int count = test_size(4000, 100000);
    uint64_t seed = 3;
    for (int k = 0; k < count; k++) {
        double slope[2], height_q, x_m = test_uniform(&seed, -0.1, 0.1) * info->radius_m;
        double y_m = test_uniform(&seed, region->south_m, region->north_m);
        assert_true(terrain_truth_at(terrain, x_m, y_m, &height_q, slope));
        slope[0] /= cos(y_m / info->radius_m);
        for (int axis = 0; axis < 2; axis++) {
            double s = slope[axis] * info->quantum_m;
            sum[axis] += s / count;
            squares[axis] += s * s / count;
        }
    }
    for (int axis = 0; axis < 2; axis++) deviation[axis] = sqrt(squares[axis] - sum[axis] * sum[axis]);
}

// Noise that tapers towards the poles leaves them smooth; noise of every column makes walls there.  Posts are
// closer than rows by up to a factor of 2, and slopes along the parallel as much steeper.
static void poles_are_as_rough_as_the_equator(void **state)
{
    (void)state;
    struct terrain *terrain = test_planet(1024, 2500, 9, 14);
    double *sigma_q = ((struct detail *)(uintptr_t)terrain_detail(terrain))->sigma_q; // that of smooth hills
    for (int k = 1; k <= 14; k++) sigma_q[k] = 40 * pow(0.65, k) / terrain_info(terrain)->quantum_m;
    double pole_m = M_PI / 2 * RADIUS;
    const struct region regions[] = {{-3000, 3000},
                                     {pole_m - 3000, pole_m - 300},
                                     {-pole_m + 100, -pole_m + 300},
                                     {pole_m - 60, pole_m - 5},
                                     {pole_m / 90 * 78, pole_m / 90 * 78 + 3000}};
    double equator[2], there[2];
    roughness(terrain, &regions[0], equator);
    for (int k = 1; k < 5; k++) {
        roughness(terrain, &regions[k], there);
        FIGURE("slope deviates by %.3f along the parallel and %.3f along the meridian %g km from a pole; by "
               "%.3f and %.3f on the equator",
               there[0], there[1], (pole_m - fmin(fabs(regions[k].south_m), fabs(regions[k].north_m))) / 1e3,
               equator[0], equator[1]);
        for (int axis = 0; axis < 2; axis++)
            assert_true(there[axis] > 0.7 * equator[axis] && there[axis] < 2 * equator[axis]);
    }
    terrain_destroy(terrain);
}

// What windows are cut from: no noise, so that one sample's share of all others can be told.
static struct detail quiet_detail(int columns, int32_t *samples)
{
    return (struct detail){.grid = {-columns / 2, columns, columns / 4}, .samples = samples};
}

// The sums of the shares, without their signs, that samples of level 0 have in each of a level over the
// northern third.
static double largest_norm(int columns, int level, bool mixed)
{
    enum { WIDTH = 128 };
    const int32_t ALL = 1 << 21;
    int64_t pole = columns / 4, fine_pole = pole << -level, south = fine_pole * (mixed ? 2 : 1) / 3;
    int64_t north = mixed ? fine_pole : south + (8 << -level), height = north - south + 1;
    int32_t *samples = calloc((size_t)(columns * (2 * pole + 1)), sizeof *samples);
    int32_t *window = malloc((size_t)(WIDTH * height) * sizeof *window);
    double *norms = calloc((size_t)(WIDTH * height), sizeof *norms), largest = 0;
    assert_true(samples && window && norms);
    struct detail detail = quiet_detail(columns, samples);
    for (int64_t j = (south >> -level) - 6; j <= pole && j <= (north >> -level) + 6; j++)
        for (int64_t i = 0; i < (j == pole ? 1 : columns); i++) {
            int32_t *at = samples + (j + pole) * columns + i;
            for (int64_t k = 0; k < (j == pole ? columns : 1); k++) at[k] = ALL;
            detail_window(&detail, level, 0, south, WIDTH, (int)height, window);
            for (int64_t k = 0; k < WIDTH * height; k++) norms[k] += abs(window[k]) / (double)ALL;
            for (int64_t k = 0; k < (j == pole ? columns : 1); k++) at[k] = 0;
        }
    for (int64_t k = 0; k < WIDTH * height; k++) largest = fmax(largest, norms[k]);
    free(samples);
    free(window);
    free(norms);
    return largest;
}

static void samples_are_within_the_norm_of_what_they_are_made_of(void **state)
{
    (void)state;
    static const int COLUMNS[] = {64, 96, 48, 80, 112, 128};
    double plain = largest_norm(64, -3, false), mixed = 0;
    for (int c = 0; c < test_size(2, 6); c++)
        mixed = fmax(mixed, largest_norm(COLUMNS[c], test_size(-2, -3), true));
    FIGURE("norm of detail: %.4f at most, %.4f where posts get farther apart", plain, mixed);
    // Each of the shares is rounded to a quantum of 2^21 in every level.
    assert_true(plain <= DETAIL_NORM && mixed <= DETAIL_NORM_MIXED);
    assert_true(mixed > plain + 0.05); // the rows in question were met
}

// Samples between posts are linear; posts come alone, too, as far apart as asked for.
static void posts_stand_for_rows(void **state)
{
    (void)state;
    enum { SIDE = 40 };
    struct terrain *terrain = test_planet(1024, 3000, 9, 14);
    const struct detail *detail = terrain_detail(terrain);
    uint64_t seed = 4;
    int between = 0;
    for (int n = 0; n < test_size(300, 10000); n++) {
        int level = -1 - n % 14, e = 0;
        struct sphere_grid grid = sphere_level(&detail->grid, level);
        double from_pole = ldexp(1, -level) * exp(test_uniform(&seed, log(1e-4), log(200)));
        int64_t y = (n & 1 ? 1 : -1) * (grid.pole - (int64_t)from_pole);
        int64_t post = (int64_t)test_uniform(&seed, 0, 1000);
        int32_t posts[SIDE], beside[2];
        e = detail_exponent(detail, level, y);
        detail_posts(detail, level, e, post, y, SIDE, 1, posts);
        for (int k = 0; k + 1 < SIDE; k++) {
            int64_t scale = (int64_t)1 << e, at = (int64_t)test_uniform(&seed, 0, (double)scale);
            terrain_window(terrain, level, grid.first + (post + k) * scale + at, y, 1, 1, &beside[0],
                           TERRAIN_WAIT);
            double line = posts[k] + (double)at / (double)scale * ((double)posts[k + 1] - posts[k]);
            assert_true(fabs(beside[0] - line) <= 0.5);
            between += at > 0;
        }
        if (e == 0) continue;
        int32_t fewer[SIDE / 4];
        int wider = grid.columns % ((int64_t)16 << e) == 0 ? 2 : 0;
        detail_posts(detail, level, e + wider, (post >> wider) + 1, y, SIDE / 4 - 1, 1, fewer);
        for (int k = 0; k < SIDE / 4 - 1; k++) {
            int64_t one = (((post >> wider) + 1 + k) << wider) - post;
            if (one < SIDE) assert_int_equal(fewer[k], posts[one]);
        }
    }
    assert_true(between > 1000);
    terrain_destroy(terrain);
}

// Heights on both sides of a row are those on it, also where cells on one side are twice as wide; poles are
// one height.
static void the_surface_has_no_gaps(void **state)
{
    (void)state;
    struct terrain *terrain = test_planet(1024, 3000, 9, 14);
    const struct terrain_info *info = terrain_info(terrain);
    const struct detail *detail = terrain_detail(terrain);
    struct sphere_grid grid = sphere_level(&detail->grid, info->finest);
    double spacing_m = ldexp(info->spacing_m[1], info->finest), worst = 0;
    uint64_t seed = 6;
    int borders = 0;
    for (int64_t n = 1; n < grid.pole / 2; n += n < 100 ? 1 : n / 50) {
        int64_t row = grid.pole - n;
        while (n > 100 && row < grid.pole && n % 3 == 0 &&
               detail_exponent(detail, info->finest, row) == detail_exponent(detail, info->finest, row + 1) &&
               row > grid.pole - 3 * n)
            row--;
        borders +=
            detail_exponent(detail, info->finest, row) != detail_exponent(detail, info->finest, row + 1);
        for (int k = 0; k < 20; k++) {
            double x_m = test_uniform(&seed, -3, 3) * RADIUS, q[2], slope[2][2], step_m = 1e-6 * spacing_m;
            for (int side = 0; side < 2; side++)
                assert_true(terrain_truth_at(terrain, x_m,
                                             (double)row * spacing_m + (side ? step_m : -step_m), &q[side],
                                             slope[side]));
            double steep = step_m * (fabs(slope[0][1]) + fabs(slope[1][1]));
            worst = fmax(worst, fabs(q[1] - q[0]) - steep);
        }
    }
    FIGURE("over rows, %d of them where cells get wider, heights jump by at most %.1e quanta", borders,
           worst);
    assert_true(borders > 10);
    assert_true(worst < 1e-3); // places are rounded at 2^-52 of the radius, slopes are of 1e3 quanta a metre
    terrain_destroy(terrain);
}

struct reading {
    struct sphere_grid grid;
    struct terrain_extent extent;
    int64_t samples;
};

// Heights of nothing in particular; only what was foretold is read.
static void read_foretold(void *user, int64_t x0, int64_t y0, int width, int height, int32_t *out)
{
    struct reading *reading = user;
    for (int64_t y = y0; y < y0 + height; y++)
        for (int64_t x = x0; x < x0 + width; x++) {
            const struct terrain_extent *e = &reading->extent;
            int64_t column = x, line = y;
            bool found = false;
            sphere_fold(&reading->grid, &column, &line);
            for (int64_t j = e->y0; j < e->y1; j++) {
                int64_t i = e->x0, row = j;
                sphere_fold(&reading->grid, &i, &row);
                int64_t ahead = column >= i ? column - i : column - i + reading->grid.columns;
                found = found || (row == line && ahead < e->x1 - e->x0);
            }
            assert_true(found);
            reading->samples++;
            *out++ = (int32_t)(column * 7919 % 1000 + line);
        }
}

static void windows_read_what_they_foretell(void **state)
{
    (void)state;
    struct reading reading = {.grid = {-512, 1024, 256}};
    struct detail detail = {.grid = reading.grid, .read = read_foretold, .user = &reading};
    uint64_t seed = 8;
    static int32_t out[80 * 80];
    for (int n = 0; n < test_size(400, 20000); n++) {
        int level = -1 - n % 14;
        struct sphere_grid grid = sphere_level(&detail.grid, level);
        double from_pole = ldexp(1, -level) * exp(test_uniform(&seed, log(1e-3), log(256)));
        int64_t y = (n & 1 ? 1 : -1) * (grid.pole - (int64_t)from_pole);
        int64_t x = grid.first + (int64_t)test_uniform(&seed, 0, (double)grid.columns);
        int width = 1 + (int)(test_random(&seed) % 80), height = 1 + (int)(test_random(&seed) % 80);
        reading.extent = detail_under(&detail, level, x, y, width, height);
        detail_window(&detail, level, x, y, width, height, out);
    }
    assert_true(reading.samples > 10000);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(posts_are_as_far_apart_as_rows),
        cmocka_unit_test(poles_are_as_rough_as_the_equator),
        cmocka_unit_test(samples_are_within_the_norm_of_what_they_are_made_of),
        cmocka_unit_test(posts_stand_for_rows),
        cmocka_unit_test(the_surface_has_no_gaps),
        cmocka_unit_test(windows_read_what_they_foretell),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
