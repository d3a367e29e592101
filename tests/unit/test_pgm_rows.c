// How many rows a frame takes and how they are spread: sky, strips, focus and target.
// SPDX-License-Identifier: MIT
#include "tests/test.h"

#include "pgm/pgm_mesh.h"
#include "pgm/pgm_rows.h"

enum { MOST_ROWS = 400 };
static const double degree = 0.017453292519943295;

static double flat_highest(const void *user, const double rect_m[4])
{
    (void)rect_m;
    return *(const double *)user;
}

static struct pgm_world flat_world(const double *ground_m)
{
    struct pgm_world world = {.outline_m = {-50000, -50000, 50000, 50000},
                              .lowest_m = *ground_m,
                              .highest_m = *ground_m,
                              .ground_m = *ground_m,
                              .spacing_m = 10,
                              .levels = 13,
                              .highest_in = flat_highest,
                              .user = ground_m};
    for (int k = 0; k < world.levels; k++) world.error_m[k] = 0.1 * ldexp(world.spacing_m, k);
    return world;
}

static struct view level_view(double height_m, double pitch)
{
    struct view view = {.pitch = pitch, .width = 640, .height = 480, .near_m = 0.1};
    view.eye_m[2] = height_m;
    view.right[1] = -1;
    view.forward[0] = cos(pitch), view.forward[2] = sin(pitch);
    view.up[0] = -sin(pitch), view.up[2] = cos(pitch);
    view.tan_half[1] = tan(30 * degree);
    view.tan_half[0] = view.tan_half[1] * 4 / 3;
    view.pixels_per_tangent = 240 / view.tan_half[1];
    return view;
}

static struct pgm_settings settings_of(int rows, int columns)
{
    return (struct pgm_settings){.rows = rows,
                                 .columns = columns,
                                 .camera = PGM_CAMERA_STABLE,
                                 .extension = PGM_EXTENSION_TIGHT,
                                 .law = PGM_LAW_HALF_LOG,
                                 .fall = PGM_FALL_STABLE,
                                 .lod = PGM_LOD_FLOOR,
                                 .spread = PGM_SPREAD_NEAR,
                                 .widening = true,
                                 .focus = {0, -0.4},
                                 .focus_width = 0.3,
                                 .target_px = 1,
                                 .share = 1};
}

struct laid {
    struct pgm_sampler sampler;
    struct pgm_settings used;
    struct pgm_row rows[2 * MOST_ROWS + 1];
};

static void lay(struct laid *laid, const struct view *view, const struct pgm_settings *settings,
                int most_rows)
{
    static const double ground_m = 0;
    struct pgm_world world = flat_world(&ground_m);
    pgm_sampler_aim(&laid->sampler, view, &world, settings);
    assert_false(laid->sampler.empty);
    pgm_rows_fit(&laid->sampler, view, &world, settings, most_rows, &laid->used);
    assert_true(laid->used.rows >= 1 && laid->used.rows <= most_rows);
    assert_true(laid->used.columns >= 1 && laid->used.columns <= settings->columns);
    assert_true((most_rows - laid->used.rows) % PGM_TILE == 0);
    assert_true(laid->used.columns % PGM_TILE == 0 || laid->used.columns == settings->columns);
    pgm_rows_lay(&laid->sampler, view, &world, &laid->used, laid->rows);
    for (int j = 0; j < laid->used.rows; j++)
        assert_true(laid->rows[j].forward_m > laid->rows[j + 1].forward_m);
    assert_true(fabs(laid->rows[0].forward_m / laid->sampler.far_m - 1) < 1e-9);
    assert_true(fabs(laid->rows[laid->used.rows].forward_m - laid->sampler.near_m) <
                1e-9 * laid->sampler.far_m);
}

static void test_the_whole_grid_is_used_unless_asked(void **state)
{
    (void)state;
    static struct laid laid;
    for (int pitch = -90; pitch <= 20; pitch += 5) {
        struct view view = level_view(800, pitch * degree);
        for (int law = PGM_LAW_UNIFORM; law <= PGM_LAW_FOCUS; law++) {
            struct pgm_settings settings = settings_of(100, 70);
            settings.law = (enum pgm_law)law;
            lay(&laid, &view, &settings, 100);
            assert_true(laid.used.rows == 100 && laid.used.columns == 70 && laid.used.extra_rows == 0);
        }
    }
}

// Half the window is sky when looking level over flat ground, and less of it the farther down one looks.
static void test_sky_takes_rows_away(void **state)
{
    (void)state;
    static struct laid laid;
    int before = 0;
    for (int pitch = 25; pitch >= -90; pitch -= 5) {
        struct view view = level_view(800, pitch * degree);
        struct pgm_settings settings = settings_of(MOST_ROWS, 64);
        settings.shrink = true;
        lay(&laid, &view, &settings, MOST_ROWS);
        double share = fmin(fmax((30.0 - pitch) / 60, 0), 1); // the horizon is at 0
        assert_true(laid.used.rows >= before);
        assert_true(laid.used.rows >= MOST_ROWS * share - MOST_ROWS * 0.02 - 1);
        assert_true(laid.used.rows <= MOST_ROWS * share + PGM_TILE);
        before = laid.used.rows;
    }
    assert_true(before == MOST_ROWS);
}

static void test_a_share_of_the_grid(void **state)
{
    (void)state;
    static struct laid laid;
    struct view view = level_view(800, -20 * degree);
    for (double share = 1; share > 1e-3; share *= 0.8) {
        struct pgm_settings settings = settings_of(MOST_ROWS, 640);
        settings.share = share;
        lay(&laid, &view, &settings, MOST_ROWS);
        double rows = MOST_ROWS * sqrt(share), columns = 640 * sqrt(share);
        assert_true(laid.used.rows >= rows && laid.used.rows <= rows + 1 + PGM_TILE);
        assert_true(laid.used.columns >= columns && laid.used.columns <= columns + 1 + PGM_TILE);
    }
}

// Strips leave the rows above the lower edge as they are without any extension, and are as dense.
static void test_strips_keep_the_rows_of_the_window(void **state)
{
    (void)state;
    static struct laid plain, strips, stretched;
    static const double ground_m = 0;
    int with_strips = 0;
    for (int pitch = -40; pitch <= 0; pitch += 4)
        for (int law = PGM_LAW_UNIFORM; law <= PGM_LAW_LOG; law++) {
            struct view view = level_view(800, pitch * degree);
            struct pgm_settings settings = settings_of(200, 64);
            settings.law = (enum pgm_law)law;
            settings.extension = PGM_EXTENSION_STABLE;
            struct pgm_world world = flat_world(&ground_m);
            world.highest_m = 700;
            static const double peak_m = 700;
            world.user = &peak_m;
            pgm_sampler_aim(&strips.sampler, &view, &world, &settings);
            plain.sampler = stretched.sampler = strips.sampler;
            plain.sampler.near_m = plain.sampler.edge_m;
            if (strips.sampler.edge_m <= strips.sampler.near_m) continue;
            pgm_rows_lay(&plain.sampler, &view, &world, &settings, plain.rows);
            pgm_rows_lay(&stretched.sampler, &view, &world, &settings, stretched.rows);
            settings.strips = true;
            pgm_rows_fit(&strips.sampler, &view, &world, &settings, 400, &strips.used);
            pgm_rows_lay(&strips.sampler, &view, &world, &strips.used, strips.rows);
            int own = strips.used.rows - strips.used.extra_rows, used = strips.used.rows;
            assert_true(strips.used.extra_rows > 0 && own == 200 && used <= 400);
            for (int j = 0; j <= 200; j++)
                assert_true(fabs(strips.rows[j].forward_m / plain.rows[j].forward_m - 1) < 1e-12);
            assert_true(fabs(strips.rows[used].forward_m - strips.sampler.near_m) < 1e-6 * 50000);
            double last = strips.rows[own].fall - strips.rows[own - 1].fall;
            if (used < 400) assert_true(strips.rows[own + 1].fall - strips.rows[own].fall <= last * 1.001);
            // Stretched, the same rows reach farther: each is sparser.
            assert_true(stretched.rows[199].fall - stretched.rows[198].fall >
                        plain.rows[199].fall - plain.rows[198].fall);
            with_strips++;
        }
    FIGURE("%d views whose lower edge is extended by strips", with_strips);
    assert_true(with_strips > 10);
}

static void test_focus_draws_the_grid_together(void **state)
{
    (void)state;
    for (double width = 0.02; width < 20; width *= 3)
        for (double at = 0; at <= 1; at += 0.125) {
            double before = 0, least = 1, where = 0;
            for (int i = 1; i <= 1000; i++) {
                double place = pgm_focus(i / 1000.0, at, width);
                assert_true(place > before);
                if (place - before < least) least = place - before, where = place;
                before = place;
            }
            assert_true(before == 1 && pgm_focus(0, at, width) == 0);
            assert_true(fabs(where - at) < 0.01 + 0.1 * width);
        }
    assert_true(pgm_focus(0.37, 0.5, 0) == 0.37);
    // Rows: more of them within 0.15 of the window about the focus than half-log rows have.
    static struct laid even, drawn;
    struct view view = level_view(800, -30 * degree);
    struct pgm_settings settings = settings_of(200, 64);
    lay(&even, &view, &settings, 200);
    settings.law = PGM_LAW_FOCUS;
    lay(&drawn, &view, &settings, 200);
    int counts[2] = {0, 0};
    for (int j = 0; j <= 200; j++)
        for (int k = 0; k < 2; k++) {
            double away = atan2(-800, (k ? drawn : even).rows[j].forward_m) + 30 * degree;
            counts[k] += fabs(tan(away) / view.tan_half[1] + 0.4) < 0.15;
        }
    assert_true(counts[1] > 1.5 * counts[0]);
}

// Rows and columns fall as the target is let go; each step is what the levels' errors allow.
static void test_a_target_takes_the_rows_it_needs(void **state)
{
    (void)state;
    static struct laid laid;
    struct view view = level_view(800, -15 * degree);
    int rows = MOST_ROWS + 1, columns = 2001;
    bool within = false;
    for (double target = 0.1; target < 60; target *= 1.5) {
        struct pgm_settings settings = settings_of(MOST_ROWS, 2000);
        settings.law = PGM_LAW_TARGET;
        settings.target_px = target;
        lay(&laid, &view, &settings, MOST_ROWS);
        assert_true(laid.used.rows <= rows && laid.used.columns <= columns);
        rows = laid.used.rows, columns = laid.used.columns;
        if (rows > MOST_ROWS - PGM_TILE || columns > 2000 - PGM_TILE || rows < 3 * PGM_TILE) continue;
        within = true;
        for (int j = 1; j <= rows; j++) {
            double middle = 0.5 * (laid.rows[j - 1].forward_m + laid.rows[j].forward_m);
            double depth = middle * cos(view.pitch) - 800 * sin(view.pitch);
            // p99.9 at spacing s is 0.1 s.
            double allowed = target * depth / view.pixels_per_tangent / 0.1;
            double step = laid.rows[j - 1].forward_m - laid.rows[j].forward_m;
            // Rows stand in bins of 1/256 of the way, within which the wanted spacing varies.
            assert_true(step <= allowed * 1.15);
            assert_true(2 * laid.rows[j].half_width_m / columns <= allowed * 1.15);
        }
    }
    assert_true(within && rows < MOST_ROWS / 4);
}

// Distributions whose p99.9 is known: of P(|error| > x) = exp(-x^b) the rms is sqrt(Gamma(1 + 2 / b)), and
// the largest of N is log(N)^(1 / b).
static void test_tails_are_told_from_rms_and_largest(void **state)
{
    (void)state;
    for (double b = 0.5; b <= 3; b *= 1.25)
        for (double samples = 1e4; samples < 1e9; samples *= 100) {
            double rms = sqrt(tgamma(1 + 2 / b)), largest = pow(log(samples), 1 / b);
            assert_true(fabs(pgm_error_p999(7 * rms, 7 * largest, samples) / 7 / pow(log(1000), 1 / b) - 1) <
                        1e-9);
        }
    assert_true(pgm_error_p999(0, 0, 1e6) == 0 && pgm_error_p999(2, 2, 1e6) == 2);
    assert_true(isfinite(pgm_error_p999(1, 1e9, 1e6)) && pgm_error_p999(1, 5, 4) == 5);
}

// A crease of slope 1 at 0, read by a mesh of spacing 1 whose vertices stand d aside of it.
static void test_a_mesh_between_samples_errs_at_creases(void **state)
{
    (void)state;
    enum { STEPS = 1000 };
    double squares = 0;
    for (int i = 0; i < STEPS; i++)
        for (int j = 0; j < STEPS; j++) {
            double d = (i + 0.5) / STEPS, x = (j + 0.5) / STEPS - d; // of the cell from -d to 1 - d
            double error = (x + d) * (1 - d) - fmax(x, 0);
            squares += error * error / STEPS / STEPS;
        }
    // The parent, which drops the crease's sample: a triangle 1/2 high.
    double parent = sqrt(1.0 / 12), unaligned = pgm_error_unaligned(0, parent);
    assert_true(fabs(unaligned / sqrt(squares) - 1) < 1e-3);
    assert_true(pgm_error_unaligned(3, 3) == 3 && pgm_error_unaligned(3, 1) == 3);
}

// Machines whose frame takes a fixed part and a part for the triangles, and noise of 3 %: the share settles
// where the frame time is held within 5 % and the noise, or at an end.
static void test_a_frame_time_is_held(void **state)
{
    (void)state;
    uint64_t seed = 17;
    for (int machine = 0; machine < test_size(200, 5000); machine++) {
        double fixed = test_uniform(&seed, 0, 5), whole = pow(10, test_uniform(&seed, 0, 2)), share = 1,
               ms = 0;
        const double hold = 16;
        for (int frame = 0; frame < 200; frame++) {
            ms = fixed + whole * share;
            share = pgm_hold_share(share, ms * test_uniform(&seed, 0.97, 1.03), hold);
        }
        ms = fixed + whole * share;
        assert_true(share > 0 && share <= 1);
        if (fixed + whole <= hold * 0.9)
            assert_true(share == 1);
        else
            assert_true(fabs(ms / hold - 1) <= 0.15); // a step of at most 10 % from within 5 % of noise
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_the_whole_grid_is_used_unless_asked),
        cmocka_unit_test(test_sky_takes_rows_away),
        cmocka_unit_test(test_a_share_of_the_grid),
        cmocka_unit_test(test_strips_keep_the_rows_of_the_window),
        cmocka_unit_test(test_focus_draws_the_grid_together),
        cmocka_unit_test(test_a_target_takes_the_rows_it_needs),
        cmocka_unit_test(test_tails_are_told_from_rms_and_largest),
        cmocka_unit_test(test_a_mesh_between_samples_errs_at_creases),
        cmocka_unit_test(test_a_frame_time_is_held),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
