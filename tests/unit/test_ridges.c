// Ridge lines that the sub-pixel grid broke open are drawn ground; cracks are not. SPDX-License-Identifier:
// MIT
#include "bench/error/ridges.h"
#include "bench/error/truth.h"
#include "tests/test.h"

#include <string.h>

enum { WIDTH = 64, HEIGHT = 48, PIXEL = 20 * WIDTH + 30 };

// A camera at the origin that looks along +x; the map below it is of no account.
static struct view looking_east(void)
{
    struct view view = {.width = WIDTH,
                        .height = HEIGHT,
                        .pixels_per_tangent = 50,
                        .near_m = 0.1,
                        .forward = {1, 0, 0},
                        .right = {0, -1, 0},
                        .up = {0, 0, 1}};
    return view;
}

// The corner seen `dx`, `dy` pixels from the centre of PIXEL, `depth` away.
static void corner(const struct view *view, float *out, double dx, double dy, double depth)
{
    double x = PIXEL % WIDTH + 0.5 + dx - 0.5 * WIDTH, y = PIXEL / WIDTH + 0.5 + dy - 0.5 * HEIGHT;
    out[0] = (float)depth;
    out[1] = (float)(-x * depth / view->pixels_per_tangent);
    out[2] = (float)(y * depth / view->pixels_per_tangent);
}

// Whether a pixel drawn from below at `drawn` metres is explained by the triangle, turned to the eye or away.
static bool explained(double corners[3][3], double drawn, bool towards)
{
    static float positions[WIDTH * HEIGHT * 4];
    struct view view = looking_east();
    struct ridges ridges = {0};
    float triangle[9];
    for (int k = 0; k < 3; k++) {
        const double *c = corners[towards ? k : 2 - k];
        corner(&view, triangle + 3 * k, c[0], c[1], c[2]);
    }
    memset(positions, 0, sizeof positions);
    corner(&view, positions + 4 * PIXEL, 0, 0, drawn);
    positions[4 * PIXEL + 3] = -1;
    assert_true(ridges_begin(&ridges, &view, positions));
    assert_int_equal(ridges.count, 1);
    ridges_feed(&ridges, triangle, 1);
    bool found = positions[4 * PIXEL + 3] == 1;
    assert_int_equal(ridges.count, found ? 0 : 1);
    ridges_finish(&ridges);
    return found;
}

// The rim of a fold as it was drawn: two triangles that face the eye share an edge through the pixel's
// centre, one of them a sliver over which the depth runs 120 m; the far slope won.
static void a_fold_is_explained(void **state)
{
    (void)state;
    double near_slope[3][3] = {{-4.521, -1.203, 8662.45}, {0.114, 0.029, 8782.39}, {-4.632, -0.642, 8781.61}};
    double sliver[3][3] = {{-4.521, -1.203, 8662.45}, {0.191, 0.027, 8660.37}, {0.114, 0.029, 8782.39}};
    assert_true(explained(near_slope, 8783.389, true));
    assert_true(explained(sliver, 8783.389, true));
    assert_false(explained(near_slope, 8783.389, false)); // it faces away itself
    assert_false(explained(near_slope, 8700, true));      // behind what was drawn
}

// A triangle beside the pixel explains it up to the grid's step and no farther, whatever way the edge runs.
static void the_reach_is_the_grids(void **state)
{
    (void)state;
    uint64_t seed = 4;
    int tries = test_size(2000, 200000);
    for (int k = 0; k < tries; k++) {
        double turn = test_uniform(&seed, 0, 2 * M_PI), away = TRUTH_SNAP_PX * (k % 2 ? 1.01 : 0.99);
        double c = cos(turn), s = sin(turn), half = test_uniform(&seed, 1, 20),
               deep = test_uniform(&seed, 1, 20);
        const double local[3][2] = {
            {away, half}, {away, -half}, {away + deep, 0}}; // an edge, and a corner beyond it
        double corners[3][3];
        for (int i = 0; i < 3; i++) {
            corners[i][0] = c * local[i][0] - s * local[i][1];
            corners[i][1] = s * local[i][0] + c * local[i][1];
            corners[i][2] = 10;
        }
        bool found =
            explained(corners, 11, true) || explained(corners, 11, false); // one of the two faces the eye
        assert_int_equal(found, k % 2 == 0);
    }
    FIGURE("ridges: %d edges, the reach is %.5f px to 1 %%", tries, TRUTH_SNAP_PX);
}

// Depth within the reach: a plane that leans runs its slope times the reach nearer, but not past its own
// corners.
static void leaning_planes(void **state)
{
    (void)state;
    uint64_t seed = 5;
    int checked = 0;
    for (int k = 0; k < test_size(2000, 200000); k++) {
        double slope = pow(10, test_uniform(&seed, -3, -1)) / 100; // of 1 / depth, a pixel
        double nearness = 1.0 / 100, reach = slope * TRUTH_SNAP_PX;
        double corners[3][3] = {{-4, -3, 0}, {5, -3, 0}, {0, 6, 0}}, nearest = 0;
        for (int i = 0; i < 3; i++) {
            double n = nearness + slope * corners[i][0] / 8;
            corners[i][2] = 1 / n;
            nearest = fmax(nearest, n);
        }
        double least = 1 / fmin(nearness + reach / 8, nearest);
        bool over =
            explained(corners, least * (1 + 1e-5), true) || explained(corners, least * (1 + 1e-5), false);
        bool under =
            explained(corners, least * (1 - 1e-5), true) || explained(corners, least * (1 - 1e-5), false);
        assert_true(over && !under);
        checked++;
    }
    assert_true(checked > 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_fold_is_explained),
        cmocka_unit_test(the_reach_is_the_grids),
        cmocka_unit_test(leaning_planes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
