// The clipmap as drawn: watertight, the same picture whatever way led to a view, culled without a trace,
// exact on flat ground. SPDX-License-Identifier: MIT
#include "tests/gpu/test_clipmap.h"

// ---- B3 --------------------------------------------------------------------

static void b3_count(struct fixture *f, const struct terrain *terrain, const char *settings, int views,
                     struct drops *drops)
{
    struct renderer *renderer = create(f, terrain, settings);
    uint64_t seed = 3;
    for (int i = 0; i < views; i++) {
        struct view view = view_over(terrain, &seed, 2, 3000);
        update(renderer, &view);
        count_drops(f, renderer, terrain, &view, drops);
    }
    clipmap_renderer.destroy(renderer);
}

static void b3_no_pixel_is_dropped(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = test_terrain(&hills);
    static const int sizes[] = {15, 31, 63, 127, 255, 511};
    struct drops split = {0, 0, 0}, zero_area = {0, 0, 0}, none = {0, 0, 0};
    for (int s = 0; s < 6; s++) {
        int views = sizes[s] < 100 ? 60 : 10;
        char settings[64];
        snprintf(settings, sizeof settings, "n=%d", sizes[s]);
        b3_count(f, terrain, settings, test_size(views, 2000), &split);
        snprintf(settings, sizeof settings, "n=%d stitch=zero-area", sizes[s]);
        b3_count(f, terrain, settings, test_size(views, 300), &zero_area);
        snprintf(settings, sizeof settings, "n=%d stitch=none", sizes[s]);
        b3_count(f, terrain, settings, test_size(views, 300), &none);
    }
    FIGURE("B3: pixels dropped in %lu views, position and depth pass: split edges %lu %lu, zero-area "
           "triangles %lu %lu, "
           "no stitches %lu %lu",
           split.views, split.position, split.depth, zero_area.position, zero_area.depth, none.position,
           none.depth);
    assert_int_equal(split.position + split.depth, 0);
    assert_int_equal(zero_area.position, 0);
    assert_true(none.position > 0 && none.depth > 0);
    terrain_destroy(terrain);
}

// ---- the same picture ------------------------------------------------------

// B15: culling takes nothing away, also with the eye inside a block's box, below ground, and off the map.
static void culling_leaves_no_trace(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = test_terrain(&hills);
    struct renderer *culled = create(f, terrain, "n=31 cull=on"),
                    *whole = create(f, terrain, "n=31 cull=off");
    uint64_t seed = 15, triangles[2] = {0, 0};
    int views = test_size(100, 2000);
    for (int i = 0; i < views; i++) {
        struct view view = view_over(terrain, &seed, 0.2, 20000);
        if (i % 5 == 0)
            view.eye_height -= (int64_t)test_uniform(&seed, 0, 300 * 10 * 256); // up to 300 m lower
        if (i % 7 == 0)
            view.eye_lattice[0] += (int64_t)ldexp(test_uniform(&seed, -3e3, 3e3), view.lattice_bits);
        const struct terrain_info *info = terrain_info(terrain);
        view.eye_m[0] = (double)view.eye_lattice[0] * ldexp(info->spacing_m[0], -view.lattice_bits);
        view.eye_m[2] = (double)view.eye_height * info->quantum_m / 256 + info->offset_m;
        struct renderer_stats stats[2];
        draw(f, culled, terrain, &view);
        uint64_t with = picture_hash(f);
        clipmap_renderer.stats(culled, &stats[0]);
        draw(f, whole, terrain, &view);
        clipmap_renderer.stats(whole, &stats[1]);
        assert_int_equal(with, picture_hash(f));
        for (int r = 0; r < 2; r++) triangles[r] += stats[r].triangles;
    }
    FIGURE("B15: %d views alike; culled %.3f of the triangles", views,
           (double)triangles[0] / (double)triangles[1]);
    assert_true(triangles[0] < triangles[1]);
    clipmap_renderer.destroy(culled);
    clipmap_renderer.destroy(whole);
    terrain_destroy(terrain);
}

// Share of the triangles that culling leaves, |pitch| <= 15 degrees, 90 degrees across.
static double share_drawn_level(struct fixture *f, const struct terrain *terrain, const char *settings)
{
    char text[128];
    snprintf(text, sizeof text, "%s cull=on", settings);
    struct renderer *culled = create(f, terrain, text);
    snprintf(text, sizeof text, "%s cull=off", settings);
    struct renderer *whole = create(f, terrain, text);
    uint64_t seed = 64;
    double share = 0;
    int views = test_size(100, 2000);
    for (int i = 0; i < views; i++) {
        struct camera camera = {
            .eye_m = {test_uniform(&seed, 2000, 10000), test_uniform(&seed, 1000, 8000), 0},
            .yaw = test_uniform(&seed, -4, 4),
            .pitch = test_uniform(&seed, -0.2618, 0.2618),
            .fov_vertical = 2 * atan(0.75)};
        double ground_q;
        assert_true(terrain_truth_at(terrain, camera.eye_m[0], camera.eye_m[1], &ground_q, NULL));
        camera.eye_m[2] = ground_q * hills.quantum_m + test_uniform(&seed, 2, 300);
        struct view view;
        view_init(&view, terrain, &camera, WIDTH, HEIGHT, 0);
        struct renderer_stats stats[2];
        update(culled, &view);
        update(whole, &view);
        clipmap_renderer.stats(culled, &stats[0]);
        clipmap_renderer.stats(whole, &stats[1]);
        share += (double)stats[0].triangles / (double)stats[1].triangles / views;
    }
    clipmap_renderer.destroy(culled);
    clipmap_renderer.destroy(whole);
    return share;
}

static void triangles_drawn_level(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = test_terrain(&hills);
    static const int sizes[] = {31, 63, 127, 255};
    for (int s = 0; s < 4; s++) {
        char settings[64];
        snprintf(settings, sizeof settings, "n=%d", sizes[s]);
        double blocks = share_drawn_level(f, terrain, settings);
        snprintf(settings, sizeof settings, "n=%d stitch=zero-area layout=strips", sizes[s]);
        double strips = share_drawn_level(f, terrain, settings);
        FIGURE("culling, n=%d, |pitch| <= 15 degrees, 90 degrees across: %.3f of the triangles; cropped "
               "rectangles, as published: %.3f (section 6.4: about 1/3)",
               sizes[s], blocks, strips);
        assert_true(blocks <= 0.40);
        assert_true(strips <= 0.40);
    }
    terrain_destroy(terrain);
}

static const float *depths(struct fixture *f, struct renderer *renderer, const struct terrain *terrain,
                           const struct view *view)
{
    update(renderer, view);
    gpu_set_view(f->gpu, terrain, view);
    gpu_target_begin(f->gpu, &f->depth_target);
    clipmap_renderer.draw(renderer, 0, PASS_DEPTH);
    gpu_target_read(f->gpu, &f->depth_target, f->depths);
    return f->depths;
}

// Back faces left out where nothing is clipped: each pixel shows what it shows with both faces, or, where
// that is a back face (a ridge line within the sub-pixel grid), the front face behind it, or the sky there.
static void unclipped_back_faces_are_not_missed(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = test_terrain(&hills);
    static const char *const settings[] = {"n=63 faces=both", "n=63 faces=safe", "n=63 faces=front"};
    struct renderer *renderers[3];
    float *drawn[3];
    for (int r = 0; r < 3; r++) {
        renderers[r] = create(f, terrain, settings[r]);
        assert_non_null(drawn[r] = malloc(PIXELS * sizeof *drawn[r]));
    }
    uint64_t seed = 30, behind = 0, undrawn = 0, ground_pixels = 0;
    int views = test_size(40, 2000);
    for (int i = 0; i < views; i++) {
        struct view view = view_over(terrain, &seed, 2, 3000);
        for (int r = 0; r < 3; r++)
            memcpy(drawn[r], depths(f, renderers[r], terrain, &view), PIXELS * sizeof *drawn[r]);
        for (int p = 0; p < PIXELS; p++) {
            float both = drawn[0][p], safe = drawn[1][p], front = drawn[2][p];
            assert_true(front <= safe && safe <= both);
            assert_true(safe == both || safe == front);
            ground_pixels += both > 0;
            behind += safe < both;
            undrawn += both > 0 && safe == 0;
        }
    }
    FIGURE("faces=safe: of %lu pixels %lu show the front face behind a back face, %lu nothing", ground_pixels,
           behind, undrawn);
    assert_true(behind > 0); // else nothing was culled
    for (int r = 0; r < 3; r++) {
        clipmap_renderer.destroy(renderers[r]);
        free(drawn[r]);
    }
    terrain_destroy(terrain);
}

// B6: after any walk, with teleports, a view's triangles are those of a renderer that has seen nothing else.
static void walks_draw_what_a_fresh_renderer_draws(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = test_terrain(&hills);
    uint64_t seed = 6;
    int walks = test_size(20, 1000);
    struct renderer *walked = create(f, terrain, "n=63");
    for (int i = 0; i < walks; i++) {
        struct view view = view_over(terrain, &seed, 2, 2000);
        for (int step = 0; step < 20; step++) {
            update(walked, &view);
            for (int axis = 0; axis < 2; axis++)
                view.eye_lattice[axis] += (int64_t)(test_uniform(&seed, -70, 70) * 4096);
        }
        view = view_over(terrain, &seed, 2, 2000);
        struct renderer *fresh = create(f, terrain, "n=63");
        assert_int_equal(capture_hash(f, walked, terrain, &view), capture_hash(f, fresh, terrain, &view));
        clipmap_renderer.destroy(fresh);
    }
    FIGURE("B6: %d walks with teleports, captured triangles equal those of a fresh renderer", walks);
    clipmap_renderer.destroy(walked);
    terrain_destroy(terrain);
}

// B14: far from the origin everything is as at the origin, bit for bit.
static void far_away_is_like_here(void **state)
{
    struct fixture *f = *state;
    struct test_map far = hills;
    far.first[0] += (int64_t)3 << 30, far.first[1] -= (int64_t)5 << 30;
    struct terrain *terrains[2] = {test_terrain(&hills), test_terrain(&far)};
    struct renderer *renderers[2] = {create(f, terrains[0], "n=31"), create(f, terrains[1], "n=31")};
    uint64_t seed = 14;
    for (int i = 0; i < 20; i++) {
        struct view here = view_over(terrains[0], &seed, 2, 2000), there = here;
        for (int axis = 0; axis < 2; axis++) {
            int64_t cells = far.first[axis] - hills.first[axis];
            there.eye_lattice[axis] += cells * ((int64_t)1 << here.lattice_bits);
            there.eye_m[axis] += (double)cells * hills.spacing_m[axis];
        }
        assert_int_equal(capture_hash(f, renderers[0], terrains[0], &here),
                         capture_hash(f, renderers[1], terrains[1], &there));
    }
    for (int i = 0; i < 2; i++) {
        clipmap_renderer.destroy(renderers[i]);
        terrain_destroy(terrains[i]);
    }
}

struct lattice { // where the eye stands, in cells of the finest level
    double eye[2], spacing_m;
    uint64_t vertices, wrong, wrong_absolute;
};

// Every vertex drawn is a sample of the finest level, but for the rounding of its distance to the eye.
static void check_lattice(const float *triangles, size_t count, void *user)
{
    struct lattice *lattice = user;
    for (size_t i = 0; i < 9 * count; i += 3)
        for (int axis = 0; axis < 2; axis++) {
            double cells = (double)triangles[i + (size_t)axis] / lattice->spacing_m;
            double rounding = ldexp(fabs(cells), -24), place = lattice->eye[axis] + cells;
            if (rounding > 0.25) continue;
            lattice->vertices++;
            lattice->wrong += fabs(place - round(place)) > rounding;
            float absolute = (float)(round(place) * lattice->spacing_m) -
                             (float)(lattice->eye[axis] * lattice->spacing_m); // B14: as it is not done
            lattice->wrong_absolute += fabs((double)absolute / lattice->spacing_m - cells) > rounding;
        }
}

// B2, B14: 20 levels, 1/1024 m between the finest samples, 1e7 m from the origin, on a strip so that it is so
// long.
static void many_levels_far_away_stay_exact(void **state)
{
    struct fixture *f = *state;
    struct test_map strip = {.width = ((int64_t)1 << 22) - 3,
                             .height = 3,
                             .first = {(int64_t)10240000000, -(int64_t)10240000000},
                             .spacing_m = {0x1p-10, 0x1p-10},
                             .quantum_m = 0x1p-12,
                             .flat_q = 1000};
    struct terrain *terrain = test_terrain(&strip);
    struct renderer *renderer = create(f, terrain, "n=15 cull=off");
    struct lattice lattice = {.spacing_m = 0x1p-10};
    uint64_t seed = 2;
    double levels = 0;
    for (int i = 0; i < 50; i++) {
        struct view view = view_over(terrain, &seed, 0.001, 0.004);
        for (int axis = 0; axis < 2; axis++)
            lattice.eye[axis] = ldexp((double)view.eye_lattice[axis], -view.lattice_bits);
        capture(f, renderer, terrain, &view, check_lattice, &lattice);
        struct renderer_stats stats;
        clipmap_renderer.stats(renderer, &stats);
        levels = fmax(levels, stats.counters[0].value);
    }
    FIGURE("B2, B14: %g levels at 1e7 m: %lu of %lu coordinates off the lattice (%lu from absolute float32)",
           levels, lattice.wrong, lattice.vertices, lattice.wrong_absolute);
    assert_true(levels == 20);
    assert_int_equal(lattice.wrong, 0);
    assert_true(lattice.wrong_absolute > lattice.vertices / 2);
    clipmap_renderer.destroy(renderer);
    terrain_destroy(terrain);
}

// Both views of a frame keep their own selection, in any order of draws.
static void two_views_keep_apart(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = test_terrain(&hills);
    struct renderer *both = create(f, terrain, "n=31"), *single = create(f, terrain, "n=31");
    uint64_t seed = 8;
    struct view views[2] = {view_over(terrain, &seed, 2, 200), view_over(terrain, &seed, 2, 2000)};
    uint64_t alone[2], together[2];
    for (int i = 0; i < 2; i++) alone[i] = capture_hash(f, single, terrain, &views[i]);
    clipmap_renderer.begin_frame(both, 0);
    assert_true(clipmap_renderer.update(both, views, 2));
    for (int i = 1; i >= 0; i--) {
        together[i] = 1;
        gpu_set_view(f->gpu, terrain, &views[i]);
        assert_true(gpu_capture_begin(f->gpu, hash_triangles, &together[i]));
        clipmap_renderer.draw(both, i, PASS_POSITION);
        gpu_capture_end(f->gpu);
    }
    assert_int_equal(alone[0], together[0]);
    assert_int_equal(alone[1], together[1]);
    assert_true(alone[0] != alone[1]);
    clipmap_renderer.destroy(both);
    clipmap_renderer.destroy(single);
    terrain_destroy(terrain);
}

// ---- exact heights ---------------------------------------------------------

struct heights {
    float expected;
    uint64_t vertices, wrong;
};

static void check_heights(const float *triangles, size_t count, void *user)
{
    struct heights *heights = user;
    for (size_t i = 2; i < 9 * count; i += 3, heights->vertices++)
        heights->wrong += triangles[i] != heights->expected;
}

static void flat_ground_is_exactly_flat(void **state)
{
    struct fixture *f = *state;
    static const int32_t heights_q[] = {0, 1000000, 884886, -43000};
    for (int h = 0; h < 4; h++) {
        struct test_map map = hills;
        map.rough = 0, map.flat_q = heights_q[h], map.quantum_m = 0.01;
        struct terrain *terrain = test_terrain(&map);
        struct renderer *renderer = create(f, terrain, "n=31");
        uint64_t seed = 20, vertices = 0;
        for (int i = 0; i < 30; i++) {
            struct view view = view_over(terrain, &seed, 1, 8000);
            double eye_q = (double)view.eye_height / 256, whole = floor(eye_q);
            struct heights heights = {
                .expected = ((float)((double)map.flat_q - whole) - (float)(eye_q - whole)) * 0.01f};
            capture(f, renderer, terrain, &view, check_heights, &heights);
            assert_int_equal(heights.wrong, 0);
            vertices += heights.vertices;
        }
        assert_true(vertices > 0);
        clipmap_renderer.destroy(renderer);
        terrain_destroy(terrain);
    }
}

// ---- B9, B8 ----------------------------------------------------------------

struct bounds {
    double low[2], high[2];
};

static void widen(const float *triangles, size_t count, void *user)
{
    struct bounds *bounds = user;
    for (size_t i = 0; i < 9 * count; i++)
        if (i % 3 < 2) {
            bounds->low[i % 3] = fmin(bounds->low[i % 3], (double)triangles[i]);
            bounds->high[i % 3] = fmax(bounds->high[i % 3], (double)triangles[i]);
        }
}

// Maps smaller than a level, one of them a single line: no crash, covered to the outline, nothing drawn
// beyond it.
static void small_maps(void **state)
{
    struct fixture *f = *state;
    static const int64_t maps[][2] = {{1, 1}, {2, 2}, {3, 3}, {1, 17}, {17, 1}, {16, 16}, {18, 675}, {2, 40}};
    static const char *const layouts[] = {"n=15 cull=off", "n=15 cull=off layout=strips"};
    const size_t count = sizeof maps / sizeof *maps;
    for (size_t run = 0; run < 2 * count; run++) {
        size_t m = run % count;
        struct test_map map = hills;
        map.width = maps[m][0], map.height = maps[m][1], map.first[0] = -1, map.first[1] = 5, map.rough = 20;
        struct terrain *terrain = test_terrain(&map);
        struct renderer *renderer = create(f, terrain, layouts[run / count]);
        const double *o = terrain_info(terrain)->outline_m;
        uint64_t seed = 9;
        for (int i = 0; i < RENDERER_MAX_COUNTERS; i++) {
            struct view view = view_over(terrain, &seed, 1, 3000);
            struct bounds bounds = {{INFINITY, INFINITY}, {-INFINITY, -INFINITY}};
            capture(f, renderer, terrain, &view, widen, &bounds);
            draw(f, renderer, terrain, &view);
            for (int p = 0; p < PIXELS; p++) {
                if (f->pixels[p][3] == 0) continue;
                for (int axis = 0; axis < 2; axis++) {
                    double at = (double)f->pixels[p][axis] + view.eye_m[axis];
                    assert_true(at >= o[axis] - 0.01 && at <= o[axis + 2] + 0.01);
                }
            }
            if (maps[m][0] == 1 || maps[m][1] == 1) continue; // a line has no area
            for (int axis = 0; axis < 2; axis++) {
                assert_true(bounds.low[axis] + view.eye_m[axis] <= o[axis] + 0.01);
                assert_true(bounds.high[axis] + view.eye_m[axis] >= o[axis + 2] - 0.01);
            }
        }
        clipmap_renderer.destroy(renderer);
        terrain_destroy(terrain);
    }
}

// From high above and from far away the map is still there.
static void far_viewers_see_the_map(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = test_terrain(&hills);
    struct renderer *renderer = create(f, terrain, "n=31");
    for (double away = 1e3; away < 1e9; away *= 10) {
        struct camera camera = {
            .eye_m = {8000 + away, 8000, 500 + away}, .yaw = acos(-1), .pitch = -0.785398, .fov_vertical = 1};
        if (away > 1e5) camera.fov_vertical = 1e5 / away;
        struct view view;
        view_init(&view, terrain, &camera, WIDTH, HEIGHT, 0);
        draw(f, renderer, terrain, &view);
        assert_true(ground(f, PIXELS / 2 + WIDTH / 2));
    }
    clipmap_renderer.destroy(renderer);
    terrain_destroy(terrain);
}

static void even_n_is_refused(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = test_terrain(&hills);
    struct renderer_desc desc = {
        .gpu = f->gpu, .terrain = terrain, .effects = &effects, .width = WIDTH, .height = HEIGHT};
    renderer_default_knobs(&clipmap_renderer, desc.knobs);
    desc.knobs[renderer_knob_index(&clipmap_renderer, "n")] = 64;
    assert_null(clipmap_renderer.create(&desc));
    clipmap_renderer.destroy(NULL);
    terrain_destroy(terrain);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(b3_no_pixel_is_dropped),
        cmocka_unit_test(culling_leaves_no_trace),
        cmocka_unit_test(triangles_drawn_level),
        cmocka_unit_test(unclipped_back_faces_are_not_missed),
        cmocka_unit_test(walks_draw_what_a_fresh_renderer_draws),
        cmocka_unit_test(far_away_is_like_here),
        cmocka_unit_test(many_levels_far_away_stay_exact),
        cmocka_unit_test(two_views_keep_apart),
        cmocka_unit_test(flat_ground_is_exactly_flat),
        cmocka_unit_test(small_maps),
        cmocka_unit_test(far_viewers_see_the_map),
        cmocka_unit_test(even_n_is_refused),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
