// Regions fitted to the frustum: what a narrow view sees lies in finer levels.
// SPDX-License-Identifier: MIT
#include "clipmap/clipmap_fit.h"
#include "tests/unit/test_clipmap.h"

static const struct test_map plain = {.width = 1500,
                                      .height = 1500,
                                      .first = {-700, -600},
                                      .spacing_m = {25, 25},
                                      .quantum_m = 0.1,
                                      .rough = 2,
                                      .seed = 5};

struct fitted {
    struct clipmap_shape shape;
    struct view view;
    struct view_origin eyes[CLIPMAP_MAX_LEVELS];
    struct clipmap_fit fits[CLIPMAP_MAX_LEVELS];
};

static void fit(struct fitted *fitted, const struct terrain *terrain, int n, const struct camera *camera)
{
    const struct terrain_info *info = terrain_info(terrain);
    const struct terrain_extent extent = terrain_level(terrain, info->finest).extent;
    const struct clipmap_rules rules = {
        .n = n, .transition = 0.1, .alpha = CLIPMAP_ALPHA_STABLE, .fade = true, .throttle = 1};
    clipmap_shape_init(&fitted->shape, &rules, info->coarsest - info->finest + 1, &extent, 25);
    view_init(&fitted->view, terrain, camera, 640, 480, 0);
    for (int k = 0; k < fitted->shape.levels; k++) fitted->eyes[k] = view_level_origin(&fitted->view, k);
    clipmap_fit(&fitted->shape, terrain, &fitted->view, fitted->eyes, fitted->fits);
}

static struct camera camera_anywhere(uint64_t *seed, double fov_horizontal)
{
    return (struct camera){.eye_m = {test_uniform(seed, -9000, 9000), test_uniform(seed, -7000, 7000),
                                     test_uniform(seed, 40, 90)},
                           .yaw = test_uniform(seed, -4, 4),
                           .pitch = test_uniform(seed, -0.03, 0.03),
                           .fov_vertical = 2 * atan(0.75 * tan(fov_horizontal / 2))};
}

// A part of its square, no larger than n, and with room round each point of the square that the frustum sees.
static void fits_hold_what_is_seen(void **state)
{
    (void)state;
    struct terrain *terrain = test_terrain(&plain);
    uint64_t seed = 1, seen = 0;
    for (int i = 0; i < test_size(300, 2000); i++) {
        struct fitted fitted;
        struct camera camera = camera_anywhere(&seed, test_uniform(&seed, 0.05, 1.5));
        camera.pitch = test_uniform(&seed, -1.5, 0.2);
        camera.roll = test_uniform(&seed, -0.5, 0.5);
        fit(&fitted, terrain, 63, &camera);
        for (int k = 0; k + 1 < fitted.shape.levels; k++) {
            const struct clipmap_fit *fit = &fitted.fits[k];
            struct clipmap_box square = clipmap_square(fit->n, &fitted.eyes[k]);
            square = clipmap_box_common(&square, &fitted.shape.map[k]);
            struct clipmap_box region = clipmap_box_common(&square, &fit->seen);
            assert_in_range(fit->n, 63, 2 * 63);
            for (int axis = 0; axis < 2; axis++) assert_true(region.hi[axis] - region.lo[axis] < 63);
            for (int p = 0; p < 40 && !clipmap_box_is_empty(&square); p++) {
                int64_t at[2];
                double relative[3], pixel[2];
                for (int axis = 0; axis < 2; axis++) {
                    at[axis] = square.lo[axis] + (int64_t)(test_random(&seed) %
                                                           (uint64_t)(square.hi[axis] - square.lo[axis] + 1));
                    relative[axis] = ((double)(at[axis] - fitted.eyes[k].base[axis]) -
                                      (double)fitted.eyes[k].fraction[axis]) *
                                     terrain_level(terrain, k).spacing_m[axis];
                }
                int32_t height_q;
                terrain_window(terrain, k, at[0], at[1], 1, 1, &height_q, TERRAIN_WAIT);
                relative[2] = height_q * plain.quantum_m - fitted.view.eye_m[2];
                if (!view_project(&fitted.view, relative, pixel) || pixel[0] < 0 || pixel[0] > 640 ||
                    pixel[1] < 0 || pixel[1] > 480)
                    continue;
                const struct clipmap_box place = {{at[0], at[1]}, {at[0], at[1]}};
                assert_true(clipmap_box_holds(&region, &place));
                seen++;
            }
        }
    }
    FIGURE("fitted regions: %lu seen samples of the squares are all in them", seen);
    assert_true(seen > 1000);
    terrain_destroy(terrain);
}

// Looking out flat through at most 52 degrees, into azimuth a +- p with tan p at most 0.483, widened by 1 %
// where the view is pitched: of a square of half side h the frustum sees at most h (tan(p - a) + min(tan(p +
// a), 1)) along an axis, which is largest where p + a is 45 degrees: 1.13 h.  With the pad on both sides, and
// four samples for rounding to even ones, the largest h that fits n is at least (n - 2 pad - 4) / 1.13 - 1,
// and the square has 2 h + 1 samples.
static void narrow_views_reach_farther(void **state)
{
    (void)state;
    struct terrain *terrain = test_terrain(&plain);
    uint64_t seed = 2;
    enum { N = 127 };
    double least = INFINITY, mean = 0;
    int views = test_size(300, 2000);
    for (int i = 0; i < views; i++) {
        struct fitted fitted;
        struct camera camera = camera_anywhere(&seed, test_uniform(&seed, 0.3, 0.9));
        fit(&fitted, terrain, N, &camera);
        double reach = (double)fitted.fits[0].n / N;
        least = fmin(least, reach);
        mean += reach / views;
    }
    FIGURE("fitted regions, n=%d, 17 to 52 degrees across: squares of %.2f n, at least %.2f n", N, mean,
           least);
    assert_true(least * N >= 2 * ((N - 2 * (ceil(0.1 * N) + 2) - 4) / 1.13 - 1) + 1);
    terrain_destroy(terrain);
}

// Level that a place is drawn in: the finest whose active region holds it.
static int level_drawn(const struct fitted *fitted, const struct clipmap_region *regions,
                       const double relative[2])
{
    for (int k = 0; k < fitted->shape.levels; k++) {
        struct clipmap_box place;
        for (int axis = 0; axis < 2; axis++) {
            double cell = relative[axis] / ldexp(25, k) + (double)fitted->eyes[k].fraction[axis];
            place.lo[axis] = place.hi[axis] = fitted->eyes[k].base[axis] + (int64_t)floor(cell);
        }
        if (clipmap_box_holds(&regions[k].active, &place)) return k;
    }
    return fitted->shape.levels;
}

static void narrow_views_see_finer_levels(void **state)
{
    (void)state;
    struct terrain *terrain = test_terrain(&plain);
    uint64_t seed = 4, places = 0;
    double sums[2] = {0, 0};
    for (int i = 0; i < test_size(300, 2000); i++) {
        struct fitted fitted;
        struct camera camera = camera_anywhere(&seed, test_uniform(&seed, 0.2, 0.8));
        struct clipmap_region regions[2][CLIPMAP_MAX_LEVELS];
        fit(&fitted, terrain, 63, &camera);
        clipmap_regions(&fitted.shape, fitted.eyes, 0, NULL, NULL, regions[0]);
        clipmap_regions(&fitted.shape, fitted.eyes, 0, fitted.fits, NULL, regions[1]);
        for (int p = 0; p < 50; p++, places++) {
            double away = 100 * pow(100, test_uniform(&seed, 0, 1)),
                   aside = away * fitted.view.tan_half[0] * test_uniform(&seed, -1, 1);
            double relative[2] = {away * cos(camera.yaw) - aside * sin(camera.yaw),
                                  away * sin(camera.yaw) + aside * cos(camera.yaw)};
            for (int r = 0; r < 2; r++) sums[r] += level_drawn(&fitted, regions[r], relative);
        }
    }
    FIGURE("fitted regions, n=63, 11 to 46 degrees across: places are drawn in level %.2f on the mean, in "
           "squares "
           "about the viewer in %.2f",
           sums[1] / (double)places, sums[0] / (double)places);
    assert_true(sums[1] < sums[0]);
    terrain_destroy(terrain);
}

static void wide_views_keep_their_squares(void **state)
{
    (void)state;
    struct terrain *terrain = test_terrain(&plain);
    uint64_t seed = 3;
    for (int i = 0; i < 100; i++) {
        struct fitted fitted;
        bool wide = i % 2;
        struct camera camera = camera_anywhere(&seed, wide ? 1.58 : 0.5);
        if (!wide) camera.pitch = 1; // nothing but sky
        fit(&fitted, terrain, 31, &camera);
        for (int k = 0; k < fitted.shape.levels; k++) {
            assert_int_equal(fitted.fits[k].n, 31);
            assert_true(clipmap_box_equal(&fitted.fits[k].seen, &fitted.shape.map[k]));
        }
    }
    terrain_destroy(terrain);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(fits_hold_what_is_seen),
        cmocka_unit_test(narrow_views_reach_farther),
        cmocka_unit_test(narrow_views_see_finer_levels),
        cmocka_unit_test(wide_views_keep_their_squares),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
