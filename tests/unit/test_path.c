// Flights: even, smooth, above the ground, finite whatever the keys (numerics.md, E6).
// SPDX-License-Identifier: MIT
#include "common/view/path.h"

#include "tests/test.h"

#include <string.h>

static const double degree = M_PI / 180;

typedef double (*height_function)(int64_t i, int64_t j, int64_t width, int64_t height, uint64_t *seed);

static double flat_height(int64_t i, int64_t j, int64_t width, int64_t height, uint64_t *seed)
{
    (void)i, (void)j, (void)width, (void)height, (void)seed;
    return 8848;
}

static double cliff_height(int64_t i, int64_t j, int64_t width, int64_t height, uint64_t *seed)
{
    (void)j, (void)height, (void)seed;
    return i < width / 2 ? 0 : 20000;
}

static double hills_height(int64_t i, int64_t j, int64_t width, int64_t height, uint64_t *seed)
{
    (void)width, (void)height;
    double z = 0;
    for (double wave = 200, tall = 3000; wave > 1; wave /= 2.3, tall /= 2)
        z += tall * sin((double)i / wave + 0.7 * wave) * cos((double)j / wave + 0.3 * wave);
    return z + test_uniform(seed, -100, 100);
}

static double noise_height(int64_t i, int64_t j, int64_t width, int64_t height, uint64_t *seed)
{
    (void)i, (void)j, (void)width, (void)height;
    return test_uniform(seed, 0, 60000);
}

static struct terrain *make_terrain(int64_t width, int64_t height, double spacing_x, double spacing_y,
                                    int64_t first, height_function function)
{
    uint64_t seed = 21;
    int32_t *samples = malloc((size_t)(width * height) * sizeof *samples);
    for (int64_t j = 0; j < height; j++)
        for (int64_t i = 0; i < width; i++)
            samples[j * width + i] = (int32_t)function(i, j, width, height, &seed);
    struct terrain_grid grid = {.name = "test",
                                .samples = samples,
                                .width = width,
                                .height = height,
                                .first = {first, -first},
                                .spacing_m = {spacing_x, spacing_y},
                                .quantum_m = 0.1};
    struct terrain *terrain = terrain_from_grid(&grid, &(struct terrain_options){0});
    free(samples);
    assert_non_null(terrain);
    return terrain;
}

static double clamp(double value, double low, double high)
{
    return fmin(fmax(value, low), high);
}

static double height_over_ground(const struct terrain *terrain, const struct camera *camera)
{
    const struct terrain_info *info = terrain_info(terrain);
    double q = NAN, x = clamp(camera->eye_m[0], info->outline_m[0], info->outline_m[2]);
    double y = clamp(camera->eye_m[1], info->outline_m[1], info->outline_m[3]);
    assert_true(terrain_truth_at(terrain, x, y, &q, NULL));
    return camera->eye_m[2] - (q * info->quantum_m + info->offset_m);
}

static bool finite_camera(const struct camera *camera)
{
    return isfinite(camera->eye_m[0]) && isfinite(camera->eye_m[1]) && isfinite(camera->eye_m[2]) &&
           isfinite(camera->yaw) && isfinite(camera->pitch) && isfinite(camera->roll);
}

// Angle by which the whole camera turns from one view to the next.
static double turn_between(const struct view *a, const struct view *b)
{
    double trace = 0;
    for (int axis = 0; axis < 3; axis++)
        trace +=
            a->right[axis] * b->right[axis] + a->up[axis] * b->up[axis] + a->forward[axis] * b->forward[axis];
    return acos(clamp((trace - 1) / 2, -1, 1));
}

struct flown {
    double min_height, max_height, min_z, max_z, worst_turn, yaw_range, length;
};

static struct flown fly(const struct terrain *terrain, const struct path *path, int fine)
{
    struct flown flown = {INFINITY, -INFINITY, INFINITY, -INFINITY, 0, 0, 0};
    double low_yaw = INFINITY, high_yaw = -INFINITY;
    struct view last;
    for (int frame = 0; frame < 96; frame++) {
        struct camera camera = path_camera(path, frame, 96);
        struct view view;
        view_init(&view, terrain, &camera, 64, 48, 0);
        if (frame) flown.worst_turn = fmax(flown.worst_turn, turn_between(&last, &view));
        low_yaw = fmin(low_yaw, camera.yaw);
        high_yaw = fmax(high_yaw, camera.yaw);
        last = view;
    }
    struct camera before = path_camera(path, 0, fine);
    for (int frame = 0; frame < fine; frame++) {
        struct camera camera = path_camera(path, frame, fine);
        assert_true(finite_camera(&camera));
        double height = height_over_ground(terrain, &camera);
        flown.min_height = fmin(flown.min_height, height);
        flown.max_height = fmax(flown.max_height, height);
        flown.min_z = fmin(flown.min_z, camera.eye_m[2]);
        flown.max_z = fmax(flown.max_z, camera.eye_m[2]);
        flown.length += hypot(camera.eye_m[0] - before.eye_m[0], camera.eye_m[1] - before.eye_m[1]);
        before = camera;
    }
    flown.yaw_range = high_yaw - low_yaw;
    return flown;
}

// ---- a path for any terrain ------------------------------------------------

static void any_terrain_gets_a_flight(void **state)
{
    (void)state;
    const struct {
        const char *name;
        int64_t width, height;
        double spacing_x, spacing_y;
        int64_t first;
        height_function function;
    } cases[] = {
        {"hills 513x513", 513, 513, 30, 30, 0, hills_height},
        {"hills 300x700, 74x92 m", 300, 700, 74, 92, -100, hills_height},
        {"hills 18x675", 18, 675, 10, 10, 0, hills_height},
        {"noise 257x257", 257, 257, 1, 1, 0, noise_height},
        {"cliff 129x129", 129, 129, 1, 1, 0, cliff_height},
        {"flat 65x65", 65, 65, 5, 5, 0, flat_height},
        {"flat 2x2", 2, 2, 30, 30, 0, flat_height},
        {"cliff 2x2", 2, 2, 1, 1, 0, cliff_height},
        {"hills 3x3", 3, 3, 1000, 1000, 0, hills_height},
        {"hills 1x17", 1, 17, 10, 10, 0, hills_height},
        {"hills 17x1", 17, 1, 10, 10, 0, hills_height},
        {"flat 1x1", 1, 1, 10, 10, 0, flat_height},
        {"hills 257x257 at 1e7 samples", 257, 257, 1, 1, 10000000, hills_height},
        {"hills 257x257, 1 mm", 257, 257, 0.001, 0.001, 0, flat_height},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct terrain *terrain = make_terrain(cases[i].width, cases[i].height, cases[i].spacing_x,
                                               cases[i].spacing_y, cases[i].first, cases[i].function);
        struct path *path = path_for_terrain(terrain, 96, 60 * degree);
        assert_non_null(path);
        assert_int_equal(path_frames(path), 96);
        struct flown flown = fly(terrain, path, test_size(20000, 400000));
        FIGURE("auto path, %s: %.4g..%.4g m over ground, turns %.1f degrees over all, %.2f a frame at most",
               cases[i].name, flown.min_height, flown.max_height, flown.yaw_range / degree,
               flown.worst_turn / degree);
        assert_true(flown.min_height > 0);
        assert_true(flown.worst_turn < 6 * degree);
        assert_true(flown.max_z > flown.min_z); // climbs and dives
        const double *outline = terrain_info(terrain)->outline_m;
        double sides[2] = {outline[2] - outline[0], outline[3] - outline[1]};
        assert_true(flown.length >= 0.7 * fmax(sides[0], sides[1]));
        if (fmin(sides[0], sides[1]) > 0.5 * fmax(sides[0], sides[1]))
            assert_true(flown.yaw_range > 45 * degree); // turns where there is room
        path_destroy(path);
        terrain_destroy(terrain);
    }
}

static void auto_paths_are_the_terrains_own(void **state)
{
    (void)state;
    struct camera last[2];
    for (int run = 0; run < 2; run++) {
        struct terrain *terrain = make_terrain(257, 257, 30, 30, 0, hills_height);
        struct path *path = path_for_terrain(terrain, 96, 60 * degree);
        last[run] = path_camera(path, 37, 96);
        path_destroy(path);
        terrain_destroy(terrain);
    }
    assert_memory_equal(&last[0], &last[1], sizeof last[0]);
}

// ---- keys ------------------------------------------------------------------

static const double no_clearance = -1e9;

static void passes_its_keys_at_even_speed(void **state)
{
    (void)state;
    struct terrain *terrain = make_terrain(257, 257, 30, 30, 0, flat_height);
    uint64_t seed = 22;
    double worst_key = 0, slowest = 1, fastest = 1;
    for (int n = 0; n < test_size(20, 500); n++) {
        struct path_key keys[7];
        for (int i = 0; i < 7; i++)
            keys[i] = (struct path_key){.x_m = 900.0 * i + test_uniform(&seed, -300, 300),
                                        .y_m = test_uniform(&seed, 0, 3000),
                                        .height_m = test_uniform(&seed, 900, 2000),
                                        .yaw = test_uniform(&seed, -9, 9)};
        struct path *path = path_from_keys(terrain, keys, 7, 96, no_clearance, 1);
        enum { FINE = 4001 };
        double nearest[7], steps[FINE], total = 0;
        for (int i = 0; i < 7; i++) nearest[i] = INFINITY;
        struct camera before = path_camera(path, 0, FINE);
        for (int frame = 0; frame < FINE; frame++) {
            struct camera camera = path_camera(path, frame, FINE);
            double *e = camera.eye_m, *b = before.eye_m;
            steps[frame] = hypot(hypot(e[0] - b[0], e[1] - b[1]), e[2] - b[2]);
            total += steps[frame];
            for (int i = 0; i < 7; i++)
                nearest[i] = fmin(nearest[i], hypot(hypot(e[0] - keys[i].x_m, e[1] - keys[i].y_m),
                                                    e[2] - keys[i].height_m));
            before = camera;
        }
        double mean = total / (FINE - 1);
        for (int i = 0; i < 7; i++) worst_key = fmax(worst_key, nearest[i] / mean);
        for (int frame = 1; frame < FINE; frame++) {
            slowest = fmin(slowest, steps[frame] / mean);
            fastest = fmax(fastest, steps[frame] / mean);
        }
        path_destroy(path);
    }
    FIGURE("keys: missed by at most %.3f steps; speed %.4f..%.4f of the mean", worst_key, slowest, fastest);
    assert_true(worst_key <= 0.51); // half a step, where the curve bends
    // Steps are chords: shorter than their arc only where the curve turns within a step.
    assert_true(slowest >= 0.97 && fastest <= 1.01);
    terrain_destroy(terrain);
}

static void yaw_takes_the_shorter_arc(void **state)
{
    (void)state;
    struct terrain *terrain = make_terrain(9, 9, 30, 30, 0, flat_height);
    const struct path_key keys[] = {{.x_m = 0, .height_m = 2000, .yaw = 170 * degree},
                                    {.x_m = 100, .height_m = 2000, .yaw = -170 * degree},
                                    {.x_m = 200, .height_m = 2000, .yaw = 550 * degree}};
    struct path *path = path_from_keys(terrain, keys, 3, 96, no_clearance, 1);
    for (int frame = 0; frame < 96; frame++) {
        double yaw = path_camera(path, frame, 96).yaw / degree;
        assert_true(yaw >= 165 && yaw <= 195); // a spline may swing a little wide, never the long way round
    }
    assert_true(fabs(path_camera(path, 95, 96).yaw - 190 * degree) < 1e-9);
    path_destroy(path);
    terrain_destroy(terrain);
}

static void hard_keys_stay_finite(void **state)
{
    (void)state;
    struct terrain *terrain = make_terrain(33, 33, 30, 30, 0, hills_height);
    const struct path_key a = {.x_m = 100, .y_m = 100, .height_m = 50, .above_ground = true};
    struct path_key b = a, c = a, down = a, far = a;
    b.x_m = 300;
    c.yaw = 90 * degree;
    down.x_m = 500;
    down.pitch = -90 * degree;
    down.roll = 180 * degree;
    far.x_m = 1e9;
    const struct {
        const char *name;
        int count;
        struct path_key keys[6];
    } cases[] = {
        {"one key", 1, {a}},
        {"one key twice", 2, {a, a}},
        {"one key six times", 6, {a, a, a, a, a, a}},
        {"repeated first", 4, {a, a, b, down}},
        {"repeated inside", 5, {a, b, b, b, down}},
        {"repeated last", 4, {a, b, down, down}},
        {"turn on the spot", 2, {a, c}},
        {"turn on the spot inside", 4, {b, a, c, down}},
        {"there and back", 3, {a, b, a}},
        {"straight down", 3, {a, down, b}},
        {"far off the map", 3, {a, far, b}},
        {"very near", 3, {a, {.x_m = 100 + 1e-9, .y_m = 100, .height_m = 50, .above_ground = true}, b}},
    };
    double worst_axes = 0;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct path *path = path_from_keys(terrain, cases[i].keys, cases[i].count, 96, 2, 60 * degree);
        assert_non_null(path);
        for (int frames = 1; frames < 400; frames = 2 * frames + 1)
            for (int frame = 0; frame < frames; frame++) {
                struct camera camera = path_camera(path, frame, frames);
                struct view view;
                assert_true(finite_camera(&camera));
                view_init(&view, terrain, &camera, 1, 1, 0);
                double *axes[] = {view.right, view.up, view.forward};
                for (int k = 0; k < 3; k++)
                    worst_axes = fmax(worst_axes, fabs(hypot(hypot(axes[k][0], axes[k][1]), axes[k][2]) - 1));
                assert_true(height_over_ground(terrain, &camera) >= 2 - 1e-9);
            }
        path_destroy(path);
    }
    FIGURE("hard keys: %zu sets, worst axis length off by %.2g", sizeof cases / sizeof cases[0], worst_axes);
    assert_true(worst_axes <= 1e-6);
    assert_null(path_from_keys(terrain, &a, 0, 96, 2, 1));
    terrain_destroy(terrain);
}

static void a_turn_on_the_spot_turns(void **state)
{
    (void)state;
    struct terrain *terrain = make_terrain(33, 33, 30, 30, 0, flat_height);
    const struct path_key keys[] = {{.x_m = 100, .height_m = 2000}, {.x_m = 100, .height_m = 2000, .yaw = 1}};
    struct path *path = path_from_keys(terrain, keys, 2, 11, no_clearance, 1);
    for (int frame = 0; frame < 11; frame++) {
        struct camera camera = path_camera(path, frame, 11);
        assert_true(fabs(camera.yaw - 0.1 * frame) < 1e-9);
        assert_true(camera.eye_m[0] == 100);
    }
    path_destroy(path);
    terrain_destroy(terrain);
}

// ---- the ground ------------------------------------------------------------

static void stays_clear_of_the_ground(void **state)
{
    (void)state;
    height_function functions[] = {hills_height, noise_height, cliff_height};
    uint64_t seed = 23;
    double worst = INFINITY;
    for (int n = 0; n < test_size(12, 200); n++) {
        struct terrain *terrain = make_terrain(129, 129, 7, 9, -64, functions[n % 3]);
        struct path_key keys[5];
        for (int i = 0; i < 5; i++)
            keys[i] = (struct path_key){.x_m = test_uniform(&seed, -600, 600),
                                        .y_m = test_uniform(&seed, -500, 1500),
                                        .height_m = test_uniform(&seed, -50, 50),
                                        .above_ground = i % 2};
        struct path *path = path_from_keys(terrain, keys, 5, 96, 3, 1);
        for (int frame = 0; frame < 20000; frame++) {
            struct camera camera = path_camera(path, frame, 20000);
            worst = fmin(worst, height_over_ground(terrain, &camera));
        }
        path_destroy(path);
        terrain_destroy(terrain);
    }
    FIGURE("clearance: asked 3 m, nearest %.6f m", worst);
    assert_true(worst >= 3 - 1e-9);
}

// A level line of keys into a cliff.  The lift is a maximum spread over three means, each over 2 r + 1 nodes
// with r = nodes / 72: one mean of values within the cliff's height D changes by at most D / (2 r + 1) a
// node, so over a line of length L the climb is no steeper than about 36 D / L.  Lifting each node alone
// would climb the cliff itself.
static void lifts_without_a_jump(void **state)
{
    (void)state;
    struct terrain *terrain = make_terrain(257, 3, 1, 1, 0, cliff_height);
    struct path_key keys[9];
    for (int i = 0; i < 9; i++) keys[i] = (struct path_key){.x_m = 32.0 * i, .y_m = 1, .height_m = 5};
    struct path *path = path_from_keys(terrain, keys, 9, 96, 2, 1);
    enum { FINE = 20001 };
    double steepest = 0, rise = 2000 + 2 - 5, length = 256;
    struct camera before = path_camera(path, 0, FINE);
    for (int frame = 1; frame < FINE; frame++) {
        struct camera camera = path_camera(path, frame, FINE);
        double run = camera.eye_m[0] - before.eye_m[0];
        if (run > 0) steepest = fmax(steepest, fabs(camera.eye_m[2] - before.eye_m[2]) / run);
        before = camera;
    }
    FIGURE("lift: a cliff of slope 2000 is climbed at slope %.1f, bound %.1f", steepest,
           36 * rise / length * 1.05);
    assert_true(steepest <= 36 * rise / length * 1.05); // nodes are whole: 5 %
    path_destroy(path);
    terrain_destroy(terrain);
}

// ---- cameras and frames ----------------------------------------------------

static void frames_resample_the_same_flight(void **state)
{
    (void)state;
    struct terrain *terrain = make_terrain(129, 129, 30, 30, 0, hills_height);
    struct path *path = path_for_terrain(terrain, 96, 1);
    for (int frame = 0; frame < 96; frame++) {
        struct camera coarse = path_camera(path, frame, 96), fine = path_camera(path, 2 * frame, 191);
        assert_memory_equal(&coarse, &fine, sizeof coarse);
    }
    struct camera first = path_camera(path, 0, 1), last = path_camera(path, 95, 96),
                  end = path_camera(path, 6, 7);
    struct camera start = path_camera(path, 0, 96);
    assert_memory_equal(&first, &start, sizeof first);
    assert_memory_equal(&last, &end, sizeof last);
    path_destroy(path);
    terrain_destroy(terrain);
}

static void rows_are_used_as_they_are(void **state)
{
    (void)state;
    struct camera rows[48];
    uint64_t seed = 24;
    for (int i = 0; i < 48; i++)
        rows[i] =
            (struct camera){{test_uniform(&seed, 0, 9), test_uniform(&seed, 0, 9), test_uniform(&seed, 0, 9)},
                            0.1 * i,
                            -0.2,
                            0,
                            1};
    struct path *path = path_from_cameras(rows, 48);
    assert_int_equal(path_frames(path), 48);
    for (int i = 0; i < 48; i++) {
        struct camera camera = path_camera(path, i, 48);
        assert_memory_equal(camera.eye_m, rows[i].eye_m, sizeof camera.eye_m);
        assert_true(fabs(camera.yaw - rows[i].yaw) < 1e-12);
    }
    struct camera middle = path_camera(path, 1, 95);
    assert_true(fabs(middle.eye_m[0] - 0.5 * (rows[0].eye_m[0] + rows[1].eye_m[0])) < 1e-12);
    path_destroy(path);
    assert_null(path_from_cameras(rows, 0));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(any_terrain_gets_a_flight),       cmocka_unit_test(auto_paths_are_the_terrains_own),
        cmocka_unit_test(passes_its_keys_at_even_speed),   cmocka_unit_test(yaw_takes_the_shorter_arc),
        cmocka_unit_test(hard_keys_stay_finite),           cmocka_unit_test(a_turn_on_the_spot_turns),
        cmocka_unit_test(stays_clear_of_the_ground),       cmocka_unit_test(lifts_without_a_jump),
        cmocka_unit_test(frames_resample_the_same_flight), cmocka_unit_test(rows_are_used_as_they_are),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
