// Persistent grid mapping as drawn: heights exact where they must be, all visible ground covered, the outline
// where it is. SPDX-License-Identifier: MIT
#include "tests/gpu/test_pgm.h"

// ---- heights ---------------------------------------------------------------

static int32_t flat_height(int i, int j)
{
    (void)i, (void)j;
    return 88488;
}

struct heights {
    const struct terrain *terrain;
    const struct view *view;
    double worst, aside; // cells of the finest level; the latter against heights read half a sample aside
    float low, high;
    size_t vertices;
};

static void gather_heights(const float *triangles, size_t count, void *user)
{
    struct heights *heights = user;
    for (size_t v = 0; v < 3 * count; v++) {
        heights->low = fminf(heights->low, triangles[3 * v + 2]);
        heights->high = fmaxf(heights->high, triangles[3 * v + 2]);
    }
    heights->vertices += 3 * count;
}

static const char *const readings[] = {"filter=triangle lod=floor", "filter=bilinear lod=ceil",
                                       "filter=nearest lod=published", "filter=triangle lod=floor bias=6"};
enum { READINGS = sizeof readings / sizeof *readings };

static void test_flat_ground_is_exactly_flat(void **state)
{
    struct gpu *gpu = *state;
    struct terrain *terrain = make_terrain(300, 200, NULL, 30, 0.1, 0.06, flat_height); // 8848.86 m
    const double eye[3] = {4000, 3000, 9000};
    struct view view = make_view(terrain, eye, 30, -20, 5, 60, 640, 480);
    double eye_quanta = view.eye_m[2] / 0.1 - 0.6;
    for (int k = 0; k < READINGS; k++) {
        struct renderer *renderer = make_pgm(gpu, terrain, readings[k]);
        struct heights heights = {.low = INFINITY, .high = -INFINITY};
        capture_frame(gpu, renderer, terrain, &view, gather_heights, &heights);
        assert_true(heights.vertices > 1000 && heights.low == heights.high);
        double exact = (88488 - eye_quanta) * 0.1;
        assert_true(fabs((double)heights.low - exact) <=
                    fabs(exact) * 0x1p-22); // two roundings of the way there
        struct frame_error error = measure_frame(gpu, renderer, terrain, &view, NULL);
        assert_true(error.ground > 1000 && error.holes == 0);
        double largest = 0;
        for (size_t p = 0; p < 640 * 480; p++)
            if (error.kind[p] == PIXEL_GROUND) largest = fmax(largest, (double)error.error_px[p]);
        if (k == 0) FIGURE("flat at 8848.86 m: error_px max %.2g (bound 1e-3)", largest);
        assert_true(largest <= 1e-3 &&
                    error.misses + error.spills <= 4); // the outline, as closely as brute has it
        frame_error_finish(&error);
        pgm_renderer.destroy(renderer);
    }
    terrain_destroy(terrain);
}

static int32_t ramp_height(int i, int j)
{
    return 64 * i - 32 * j;
}

// Every vertex over the map, held against the plane that the samples lie in.
static void gather_ramp(const float *triangles, size_t count, void *user)
{
    struct heights *heights = user;
    const double *outline = terrain_info(heights->terrain)->outline_m, *eye = heights->view->eye_m;
    for (size_t v = 0; v < 3 * count; v++, triangles += 3) {
        double x = (double)triangles[0] + eye[0], y = (double)triangles[1] + eye[1];
        if (x < outline[0] || x > outline[2] || y < outline[1] || y > outline[3]) continue;
        double exact = (64 * x / 10 - 32 * y / 10) / 64 * 10 - eye[2];
        double allowed_digits = 4e-7 * (fabs(x - eye[0]) + fabs(y - eye[1]) + fabs(exact)); // of float32
        double off = (double)triangles[2] - exact, rise = 5; // of half a cell eastwards
        heights->worst = fmax(heights->worst, (fabs(off) - allowed_digits) / 10);
        heights->aside = fmax(heights->aside, (fabs(off - rise) - allowed_digits) / 10);
        heights->vertices++;
    }
}

static void test_a_ramp_is_read_right_at_every_level(void **state)
{
    struct gpu *gpu = *state;
    struct terrain *terrain = make_terrain(515, 387, NULL, 10, 10.0 / 64, 0, ramp_height);
    const double eye[3] = {2500, 1900, 3500};
    double worst = 0, aside = 0;
    for (int bias = -8; bias <= 8; bias += 2)
        for (int bilinear = 0; bilinear < 2; bilinear++) {
            char options[64];
            snprintf(options, sizeof options, "rows=150 bias=%d filter=%s", bias,
                     bilinear ? "bilinear" : "triangle");
            struct renderer *renderer = make_pgm(gpu, terrain, options);
            for (int yaw = 0; yaw < 360; yaw += 60) {
                struct view view = make_view(terrain, eye, yaw, -35, 0, 75, 640, 480);
                struct heights heights = {.terrain = terrain, .view = &view};
                capture_frame(gpu, renderer, terrain, &view, gather_ramp, &heights);
                assert_true(heights.vertices > 1000);
                worst = fmax(worst, heights.worst);
                aside = fmax(aside, heights.aside);
            }
            pgm_renderer.destroy(renderer);
        }
    FIGURE("A11 ramp at biases -8 .. 8: worst height %.2g cells off (bound 1e-3), half a sample aside %.2g",
           worst, aside);
    assert_true(worst <= 1e-3 && aside > 0.4);
    terrain_destroy(terrain);
}

// ---- coverage: A7, PG1 to PG3 ----------------------------------------------

static int32_t hilly_height(int i, int j)
{
    double x = i * 0.049, y = j * 0.043;
    double hills = sin(x) * cos(1.3 * y) + 0.5 * sin(2.7 * x + 1) * sin(2.3 * y) + 0.2 * cos(7 * x - 5 * y);
    return (int32_t)lrint(1200 * hills * fabs(hills) * sin(0.012 * i + 0.5));
}

struct uncovered {
    uint64_t ground, bare;
};

// A place to stand: anywhere, or the lowest of 64 places, where hills stand over the eye close by.
static void choose_eye(const struct terrain *terrain, bool valley, uint64_t *seed, double eye[3])
{
    const struct terrain_info *info = terrain_info(terrain);
    double lowest_q = INFINITY;
    for (int place = 0; place < (valley ? 64 : 1); place++) {
        double x = test_uniform(seed, 100, 15000), y = test_uniform(seed, 100, 15000), ground_q;
        assert_true(terrain_truth_at(terrain, x, y, &ground_q, NULL));
        if (ground_q >= lowest_q) continue;
        lowest_q = ground_q;
        eye[0] = x;
        eye[1] = y;
    }
    double above = pow(10, test_uniform(seed, 0.3, valley ? 1.5 : 3));
    eye[2] = info->quantum_m * lowest_q + info->offset_m + above;
}

enum { ROLLED = 1, VALLEYS = 2 };

// Visible ground without a triangle of the grid above or below it.
static struct uncovered count_uncovered(struct gpu *gpu, const struct terrain *terrain, const char *options,
                                        int views, int kind)
{
    struct renderer *renderer = make_pgm(gpu, terrain, options);
    struct truth_surface *surface = truth_surface_create(terrain);
    struct truth truth;
    assert_true(surface && truth_init(&truth, 160, 120));
    struct uncovered all = {0, 0};
    uint64_t seed = 5;
    for (int k = 0; k < views; k++) {
        double eye[3] = {0, 0, 0};
        choose_eye(terrain, kind & VALLEYS && k % 2, &seed, eye);
        double pitch = test_uniform(&seed, -90, 25), roll = kind & ROLLED ? test_uniform(&seed, -90, 90) : 0;
        struct view view = make_view(terrain, eye, test_uniform(&seed, 0, 360), pitch, roll,
                                     test_uniform(&seed, 20, 100), 160, 120);
        truth_cast(&truth, surface, &view, 0);
        struct places *hits = truth_places(&truth, 0);
        assert_non_null(hits);
        capture_frame(gpu, renderer, terrain, &view, places_feed, hits);
        double low, high;
        for (uint64_t hit = 0; hit < truth.ground; hit++) all.bare += !places_height(hits, hit, &low, &high);
        all.ground += truth.ground;
        places_destroy(hits);
    }
    truth_finish(&truth);
    truth_surface_destroy(surface);
    pgm_renderer.destroy(renderer);
    return all;
}

static void test_all_visible_ground_is_covered(void **state)
{
    struct gpu *gpu = *state;
    struct terrain *terrain = make_terrain(512, 512, NULL, 30, 0.5, 0, hilly_height);
    int views = test_size(40, 1000);
    static const char *const good[] = {"rows=60",
                                       "rows=60 extension=stable",
                                       "rows=60 law=uniform",
                                       "rows=20 law=log plane=ground",
                                       "rows=60 cull=on",
                                       "rows=60 law=focus",
                                       "rows=200 law=target target=3",
                                       "rows=60 shrink=on",
                                       "rows=60 strips=on extension=stable"};
    for (size_t k = 0; k < sizeof good / sizeof *good; k++) {
        struct uncovered all = count_uncovered(gpu, terrain, good[k], views, ROLLED | VALLEYS);
        if (all.bare) FIGURE("%s: %lu of %lu ground pixels uncovered", good[k], all.bare, all.ground);
        assert_true(all.bare == 0 && all.ground > 1000);
    }
    // Power: each correction taken away uncovers ground; for the width it is flat ground that shows it.
    struct terrain *flat = make_terrain(512, 512, NULL, 30, 0.5, 0, flat_height);
    static const char *const bad[] = {"rows=60 extension=none", "rows=60 extension=published",
                                      "rows=60 extension=stable widening=off",
                                      "rows=60 extension=stable camera=published"};
    double shares[4];
    for (size_t k = 0; k < 4; k++) {
        struct uncovered all =
            count_uncovered(gpu, k == 2 ? flat : terrain, bad[k], views, k == 2 ? 0 : ROLLED | VALLEYS);
        shares[k] = 100.0 * (double)all.bare / (double)all.ground;
        if (all.bare == 0) FIGURE("%s: all ground covered", bad[k]);
        assert_true(all.bare > 0);
    }
    terrain_destroy(flat);
    FIGURE("A7, PG1-PG3 ground pixels uncovered over %d views: 0; without extension %.2g %%, as printed %.2g "
           "%%; "
           "without widening %.2g %%; camera as printed %.2g %%",
           views, shares[0], shares[1], shares[2], shares[3]);
    terrain_destroy(terrain);
}

// ---- A9: straight down -----------------------------------------------------

// Gentle enough that nothing hides anything from above.
static int32_t rolling_height(int i, int j)
{
    return hilly_height(i, j) / 8;
}

static void test_straight_down_is_nothing_special(void **state)
{
    struct gpu *gpu = *state;
    struct terrain *terrain = make_terrain(512, 512, NULL, 30, 0.5, 0, rolling_height);
    struct renderer *renderer = make_pgm(gpu, terrain, "rows=150");
    double worst = 0;
    size_t drawn = 0;
    for (int yaw = 0; yaw < 360; yaw += 45) {
        const double eye[3] = {7700, 7700, 3000};
        struct view down = make_view(terrain, eye, yaw, -90, 0, 60, 320, 240);
        struct view nearly = make_view(terrain, eye, yaw, -89.999, 0, 60, 320, 240);
        float *a = draw_frame(gpu, renderer, terrain, &down, PASS_POSITION);
        float *b = draw_frame(gpu, renderer, terrain, &nearly, PASS_POSITION);
        for (size_t p = 0; p < 320 * 240; p++) {
            assert_true((a[4 * p + 3] > 0) == (b[4 * p + 3] > 0));
            if (!(a[4 * p + 3] > 0)) continue;
            // The pixel's two points may differ by what the camera turned, 0.001 degrees, and by the bound.
            double away = 0;
            for (int axis = 0; axis < 3; axis++)
                away = hypot(away, (double)a[4 * p + axis] - (double)b[4 * p + axis]);
            worst = fmax(worst, down.pixels_per_tangent * away / fabs((double)a[4 * p + 2]));
            drawn++;
        }
        free(a);
        free(b);
    }
    FIGURE("A9 straight down against 89.999 degrees: %.3f px (bound 0.1), %zu pixels", worst, drawn);
    assert_true(drawn > 8 * 70000 && worst <= 0.1);
    pgm_renderer.destroy(renderer);
    terrain_destroy(terrain);
}

// ---- A10: the map's edge ---------------------------------------------------

static int32_t tilted_height(int i, int j)
{
    return 8 * i + 4 * j;
}

// Worst distance of a pixel drawn or undrawn against the truth to where it changes in its column.
static void check_outline(struct gpu *gpu, const struct terrain *terrain, struct renderer *renderer,
                          const double eye[3], double yaw, double pitch, double *worst, uint64_t *ground)
{
    struct view view = make_view(terrain, eye, yaw, pitch, 0, 60, 640, 480);
    struct frame_error error = measure_frame(gpu, renderer, terrain, &view, NULL);
    const double *outline = terrain_info(terrain)->outline_m;
    float *positions = draw_frame(gpu, renderer, terrain, &view, PASS_POSITION);
    for (size_t p = 0; p < 640 * 480; p++) {
        if (positions[4 * p + 3] == 0) continue;
        double guard = 1e-6 * 40000;
        for (int axis = 0; axis < 2; axis++) {
            double x = (double)positions[4 * p + (size_t)axis] + view.eye_m[axis];
            assert_true(x >= outline[axis] - guard && x <= outline[axis + 2] + guard);
        }
    }
    assert_int_equal(error.holes, 0);
    for (size_t p = 0; p < 640 * 480; p++)
        if (error.kind[p] == PIXEL_MISS || error.kind[p] == PIXEL_SPILL)
            *worst = fmax(*worst, (double)error.error_px[p]);
    *ground += error.ground;
    free(positions);
    frame_error_finish(&error);
}

static void test_the_map_ends_at_its_outline(void **state)
{
    struct gpu *gpu = *state;
    struct terrain *terrain = make_terrain(301, 223, NULL, 30, 0.5, 0, tilted_height);
    struct renderer *renderer = make_pgm(gpu, terrain, "rows=150");
    double worst = 0;
    uint64_t ground = 0;
    const double corner[3] = {-3000, -2500, 2500}, inside[3] = {8700, 6000, 2300},
                 beyond[3] = {4000, 9000, 4000};
    for (int yaw = 0; yaw < 360; yaw += 30) {
        check_outline(gpu, terrain, renderer, corner, yaw, -25, &worst, &ground);
        check_outline(gpu, terrain, renderer, inside, yaw, -15, &worst, &ground);
        check_outline(gpu, terrain, renderer, beyond, yaw, -40, &worst, &ground);
    }
    FIGURE("A10 the outline is at most %.2f px off (bound 1), %lu ground pixels", worst, ground);
    assert_true(worst <= 1 && ground > 100000);
    pgm_renderer.destroy(renderer);
    terrain_destroy(terrain);
}

// Published: what lies beyond the map reads clamped coordinates, and is drawn.
static void test_clamped_coordinates_make_curtains(void **state)
{
    struct gpu *gpu = *state;
    struct terrain *terrain = make_terrain(301, 223, NULL, 30, 0.5, 0, tilted_height);
    const double *outline = terrain_info(terrain)->outline_m;
    struct renderer *renderer = make_pgm(gpu, terrain, "rows=150 edge=clamped");
    size_t drawn = 0, beyond = 0;
    for (int yaw = 0; yaw < 360; yaw += 30) {
        const double eye[3] = {-3000, -2500, 2500};
        struct view view = make_view(terrain, eye, yaw, -25, 0, 60, 320, 240);
        float *positions = draw_frame(gpu, renderer, terrain, &view, PASS_POSITION);
        for (size_t p = 0; p < 320 * 240; p++) {
            if (positions[4 * p + 3] == 0) continue;
            bool outside = false;
            for (int axis = 0; axis < 2; axis++) {
                double x = (double)positions[4 * p + (size_t)axis] + view.eye_m[axis];
                outside = outside || x < outline[axis] - 1 || x > outline[axis + 2] + 1;
            }
            drawn++;
            beyond += outside;
        }
        free(positions);
    }
    FIGURE("A10 coordinates clamped to the map, as published: %.2g %% of the pixels drawn lie beyond it",
           100.0 * (double)beyond / (double)drawn);
    assert_true(beyond > 1000);
    pgm_renderer.destroy(renderer);
    terrain_destroy(terrain);
}

// ---- A2: the horizon -------------------------------------------------------

// Ground 50 000 km wide under an eye one metre up: h / D is 2e-8.
static void test_the_published_fall_loses_the_horizon(void **state)
{
    struct gpu *gpu = *state;
    struct terrain *terrain = make_terrain(512, 512, NULL, 1e5, 0.1, 0, flat_height);
    static const char *const forms[] = {"rows=60 law=uniform", "rows=60 law=uniform fall=published"};
    size_t drawn[2] = {0, 0};
    for (int k = 0; k < 2; k++) {
        struct renderer *renderer = make_pgm(gpu, terrain, forms[k]);
        for (int fov = 30; fov < 100; fov += 3) {
            const double eye[3] = {2.5e7, 2.5e7, 8849.8};
            struct view view = make_view(terrain, eye, 10, 0, 0, fov, 320, 240);
            float *positions = draw_frame(gpu, renderer, terrain, &view, PASS_POSITION);
            for (size_t p = 0; p < 320 * 240; p++) drawn[k] += positions[4 * p + 3] != 0;
            free(positions);
        }
        pgm_renderer.destroy(renderer);
    }
    FIGURE("A2 sin A - y cos A as published leaves out %.2g %% of the ground's pixels at h / D = 2e-8",
           100.0 - 100.0 * (double)drawn[1] / (double)drawn[0]);
    assert_true(drawn[1] < drawn[0]);
    terrain_destroy(terrain);
}

// ---- the contract ----------------------------------------------------------

static void count_captured(const float *triangles, size_t count, void *user)
{
    (void)triangles;
    *(size_t *)user += count;
}

static void test_triangles_are_those_of_the_grid(void **state)
{
    struct gpu *gpu = *state;
    struct terrain *terrain = make_terrain(512, 512, NULL, 30, 0.5, 0, hilly_height);
    const double eye[3] = {7000, 7000, 1500};
    struct view view = make_view(terrain, eye, 20, -30, 10, 60, 320, 240);
    static const char *const options[] = {"rows=150 aspect=4", "rows=37 aspect=1.5", "rows=1 aspect=0.05",
                                          "rows=64 cull=on"};
    static const uint64_t expected[] = {2 * 150 * 600, 2 * 37 * 56, 2, 0};
    for (int k = 0; k < 4; k++) {
        struct renderer *renderer = make_pgm(gpu, terrain, options[k]);
        gpu_reset_counters(gpu);
        free(draw_frame(gpu, renderer, terrain, &view, PASS_SHADED));
        uint64_t counted = gpu_counters(gpu).triangles;
        struct renderer_stats stats;
        pgm_renderer.stats(renderer, &stats);
        size_t captured = 0;
        capture_frame(gpu, renderer, terrain, &view, count_captured, &captured);
        assert_true(stats.triangles == counted && captured == counted);
        if (expected[k]) assert_true(counted == expected[k]);
        assert_true(isnan(stats.claimed_error_px) && stats.resident_bytes > 512 * 512 * 2);
        pgm_renderer.destroy(renderer);
    }
    terrain_destroy(terrain);
}

static void test_culled_and_repeated_pictures_are_the_same(void **state)
{
    struct gpu *gpu = *state;
    struct terrain *terrain = make_terrain(512, 512, NULL, 30, 0.5, 0, hilly_height);
    struct renderer *all = make_pgm(gpu, terrain, "rows=64"),
                    *culled = make_pgm(gpu, terrain, "rows=64 cull=on");
    uint64_t seed = 9, drawn = 0, submitted = 0;
    for (int k = 0; k < test_size(60, 2000); k++) {
        const double eye[3] = {test_uniform(&seed, -2000, 17000), test_uniform(&seed, -2000, 17000),
                               test_uniform(&seed, 500, 4000)};
        struct view view = make_view(terrain, eye, test_uniform(&seed, 0, 360), test_uniform(&seed, -90, 30),
                                     test_uniform(&seed, -180, 180), test_uniform(&seed, 10, 110), 96, 64);
        void *a = draw_frame(gpu, all, terrain, &view, PASS_POSITION);
        void *b = draw_frame(gpu, culled, terrain, &view, PASS_POSITION);
        void *c = draw_frame(gpu, all, terrain, &view, PASS_POSITION);
        assert_memory_equal(a, b, 96 * 64 * 16);
        assert_memory_equal(a, c, 96 * 64 * 16);
        struct renderer_stats stats;
        pgm_renderer.stats(culled, &stats);
        drawn += stats.triangles;
        pgm_renderer.stats(all, &stats);
        submitted += stats.triangles;
        free(a);
        free(b);
        free(c);
    }
    FIGURE("tiles outside the view: %.1f %% of the grid's triangles",
           100 - 100.0 * (double)drawn / (double)submitted);
    assert_true(drawn < submitted);
    pgm_renderer.destroy(all);
    pgm_renderer.destroy(culled);
    terrain_destroy(terrain);
}

// Back faces left out where no triangle is clipped: each pixel shows what it shows with both faces or, where
// that is a back face (a ridge line within the sub-pixel grid), the front face behind it.
static void test_unclipped_back_faces_are_not_missed(void **state)
{
    struct gpu *gpu = *state;
    enum { WIDTH = 160, HEIGHT = 120 };
    struct terrain *terrain = make_terrain(512, 512, NULL, 30, 0.5, 0, hilly_height);
    static const char *const settings[] = {"rows=96 faces=both", "rows=96 faces=safe", "rows=96 faces=front"};
    struct renderer *renderers[3];
    for (int k = 0; k < 3; k++) renderers[k] = make_pgm(gpu, terrain, settings[k]);
    uint64_t seed = 41, behind = 0, undrawn = 0, drawn = 0;
    for (int i = 0; i < test_size(30, 2000); i++) {
        double eye[3];
        choose_eye(terrain, i % 2, &seed, eye);
        struct view view =
            make_view(terrain, eye, test_uniform(&seed, 0, 360), test_uniform(&seed, -70, 10),
                      test_uniform(&seed, -40, 40), test_uniform(&seed, 30, 90), WIDTH, HEIGHT);
        float *depths[3];
        for (int k = 0; k < 3; k++) depths[k] = draw_frame(gpu, renderers[k], terrain, &view, PASS_DEPTH);
        for (int p = 0; p < WIDTH * HEIGHT; p++) {
            float both = depths[0][p], safe = depths[1][p], front = depths[2][p];
            assert_true(front <= safe && safe <= both && (safe == both || safe == front));
            drawn += both > 0;
            behind += safe < both;
            undrawn += both > 0 && safe == 0;
        }
        for (int k = 0; k < 3; k++) free(depths[k]);
    }
    FIGURE("faces=safe: of %lu pixels %lu show the front face behind a back face, %lu nothing", drawn, behind,
           undrawn);
    assert_int_equal(undrawn, 0);
    assert_true(behind > 0 || test_size(1, 0)); // some are left out
    for (int k = 0; k < 3; k++) pgm_renderer.destroy(renderers[k]);
    terrain_destroy(terrain);
}

static void test_two_views_keep_their_own_rows(void **state)
{
    struct gpu *gpu = *state;
    struct terrain *terrain = make_terrain(512, 512, NULL, 30, 0.5, 0, hilly_height);
    struct renderer *renderer = make_pgm(gpu, terrain, "rows=64");
    const double eye[2][3] = {{7000, 7000, 1500}, {3000, 9000, 2500}};
    struct view views[2];
    void *alone[2];
    for (int k = 0; k < 2; k++) {
        views[k] = make_view(terrain, eye[k], 100 * k, -30, 0, 60, 96, 64);
        alone[k] = draw_frame(gpu, renderer, terrain, &views[k], PASS_POSITION);
    }
    struct gpu_target target;
    assert_true(gpu_target_init(gpu, &target, 96, 64, GL_RGBA32F));
    void *together = malloc(96 * 64 * 16);
    assert_non_null(together);
    assert_true(renderer->type->update(renderer, views, 2));
    for (int k = 1; k >= 0; k--) {
        gpu_set_view(gpu, terrain, &views[k]);
        gpu_target_begin(gpu, &target);
        renderer->type->draw(renderer, k, PASS_POSITION);
        gpu_target_read(gpu, &target, together);
        assert_memory_equal(together, alone[k], 96 * 64 * 16);
        free(alone[k]);
    }
    free(together);
    gpu_target_finish(&target);
    pgm_renderer.destroy(renderer);
    terrain_destroy(terrain);
}

static void test_no_gl_errors(void **state)
{
    assert_true(gpu_debug_errors(*state) == 0);
    pgm_renderer.destroy(NULL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_flat_ground_is_exactly_flat),
        cmocka_unit_test(test_a_ramp_is_read_right_at_every_level),
        cmocka_unit_test(test_all_visible_ground_is_covered),
        cmocka_unit_test(test_straight_down_is_nothing_special),
        cmocka_unit_test(test_the_map_ends_at_its_outline),
        cmocka_unit_test(test_clamped_coordinates_make_curtains),
        cmocka_unit_test(test_the_published_fall_loses_the_horizon),
        cmocka_unit_test(test_triangles_are_those_of_the_grid),
        cmocka_unit_test(test_culled_and_repeated_pictures_are_the_same),
        cmocka_unit_test(test_unclipped_back_faces_are_not_missed),
        cmocka_unit_test(test_two_views_keep_their_own_rows),
        cmocka_unit_test(test_no_gl_errors),
    };
    return cmocka_run_group_tests(tests, start_gpu, stop_gpu);
}
