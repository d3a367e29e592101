// Where persistent grid mapping reads its heights: every kind of texel, one texture or many, whole levels or
// tiles about the viewer.  SPDX-License-Identifier: MIT
#include "tests/gpu/test_pgm.h"

#include "common/scene/scene.h"

static int32_t hilly_height(int i, int j)
{
    double x = i * 0.049, y = j * 0.043;
    double hills = sin(x) * cos(1.3 * y) + 0.5 * sin(2.7 * x + 1) * sin(2.3 * y) + 0.2 * cos(7 * x - 5 * y);
    return (int32_t)lrint(1200 * hills * fabs(hills) * sin(0.012 * i + 0.5));
}

static int32_t tall_height(int i, int j) // spans more than 16 bits
{
    return 60 * hilly_height(i, j);
}

struct vertices {
    float *data;
    size_t count, most;
};

static void keep_vertices(const float *triangles, size_t count, void *user)
{
    struct vertices *vertices = user;
    assert_true(vertices->count + 9 * count <= vertices->most);
    memcpy(vertices->data + vertices->count, triangles, 9 * count * sizeof(float));
    vertices->count += 9 * count;
}

static struct vertices capture(struct gpu *gpu, struct renderer *renderer, const struct terrain *terrain,
                               const struct view *view)
{
    struct vertices vertices = {.most = 9 * 200000};
    vertices.data = malloc(vertices.most * sizeof(float));
    assert_non_null(vertices.data);
    capture_frame(gpu, renderer, terrain, view, keep_vertices, &vertices);
    return vertices;
}

static void rest(struct renderer *renderer, const struct view *view)
{
    for (int frame = 0; frame < 500; frame++) {
        renderer->type->begin_frame(renderer, frame);
        assert_true(renderer->type->update(renderer, view, 1));
    }
}

static struct view some_view(const struct terrain *terrain, uint64_t *seed)
{
    const double eye[3] = {test_uniform(seed, 500, 14000), test_uniform(seed, 500, 14000),
                           test_uniform(seed, 600, 2500)};
    return make_view(terrain, eye, test_uniform(seed, 0, 360), test_uniform(seed, -60, 10),
                     test_uniform(seed, -20, 20), 60, 320, 240);
}

// Largest difference of height, quanta, of vertices over the map, and of place anywhere.
static void compare_forms(struct gpu *gpu, const struct terrain *terrain, const char *a, const char *b,
                          double *height_q, double *place_m)
{
    struct renderer *first = make_pgm(gpu, terrain, a), *second = make_pgm(gpu, terrain, b);
    const struct terrain_info *info = terrain_info(terrain);
    uint64_t seed = 31;
    for (int k = 0; k < test_size(8, 200); k++) {
        struct view view = some_view(terrain, &seed);
        rest(first, &view);
        rest(second, &view);
        struct vertices v = capture(gpu, first, terrain, &view), w = capture(gpu, second, terrain, &view);
        assert_true(v.count == w.count && v.count > 9000);
        for (size_t i = 0; i < v.count; i += 3) {
            double x = (double)v.data[i] + view.eye_m[0], y = (double)v.data[i + 1] + view.eye_m[1];
            *place_m = fmax(*place_m, fabs((double)v.data[i] - (double)w.data[i]));
            if (x < info->outline_m[0] || x > info->outline_m[2] || y < info->outline_m[1] ||
                y > info->outline_m[3])
                continue;
            *height_q =
                fmax(*height_q, fabs((double)v.data[i + 2] - (double)w.data[i + 2]) / info->quantum_m);
        }
        free(v.data);
        free(w.data);
    }
    pgm_renderer.destroy(first);
    pgm_renderer.destroy(second);
}

// Packed and plain texels hold the same samples: what they blend differs by roundings of heights below 2^12
// (2^18) quanta and of the place within a cell, of which a slope of at most 300 (18000) quanta a cell makes
// 2^-23 x 300 x cells from the eye (2^10).
static void test_every_texel_gives_the_same_heights(void **state)
{
    static const char *const filters[] = {"nearest", "bilinear", "triangle"};
    for (int tall = 0; tall < 2; tall++) {
        struct terrain *terrain = make_terrain(512, 500, NULL, 30, 0.5, 0, tall ? tall_height : hilly_height);
        double bound_q = tall ? 60 * 0.05 : 0.05, worst = 0, place_m = 0;
        for (int filter = 1; filter < 3; filter++) {
            char plain[64], packed[64];
            snprintf(plain, sizeof plain, "rows=96 filter=%s", filters[filter]);
            snprintf(packed, sizeof packed, "rows=96 filter=%s fetch=packed", filters[filter]);
            compare_forms(*state, terrain, plain, packed, &worst, &place_m);
        }
        FIGURE("packed against plain, heights of %s bits: %.2g quanta apart (bound %.2g)", tall ? "32" : "16",
               worst, bound_q);
        assert_true(worst <= bound_q && place_m == 0);
        double many_q = 0;
        compare_forms(*state, terrain, "rows=96", "rows=96 textures=many", &many_q, &place_m);
        assert_true(many_q == 0 && place_m == 0);
        terrain_destroy(terrain);
    }
}

// Tiles in a fraction of the memory, at rest: the same heights to the last bit.
static void test_tiles_at_rest_give_the_same_heights(void **state)
{
    struct terrain *terrain = make_terrain(512, 500, NULL, 30, 0.5, 0, hilly_height);
    static const char *const forms[] = {"", "textures=many", "fetch=packed", "filter=bilinear lod=ceil"};
    for (size_t k = 0; k < 4; k++) {
        char whole[96], tiled[96];
        snprintf(whole, sizeof whole, "rows=48 memory=0 %s", forms[k]);
        snprintf(tiled, sizeof tiled, "rows=48 memory=%s %s", k == 2 ? "3" : "0.4", forms[k]);
        double height_q = 0, place_m = 0;
        compare_forms(*state, terrain, whole, tiled, &height_q, &place_m);
        assert_true(height_q == 0 && place_m == 0);
        struct renderer *renderer = make_pgm(*state, terrain, tiled);
        assert_true(counter(renderer, "tile_side") < 500);
        pgm_renderer.destroy(renderer);
    }
    terrain_destroy(terrain);
}

static void test_many_textures_hold_plain_texels(void **state)
{
    struct terrain *terrain = make_terrain(64, 64, NULL, 30, 0.5, 0, hilly_height);
    struct renderer_desc desc = {
        .gpu = *state, .terrain = terrain, .effects = &common_effects, .width = 320, .height = 240};
    static const char *const others[] = {"packed", "mipmap", "linear"};
    for (size_t k = 0; k < 3; k++) {
        renderer_default_knobs(&pgm_renderer, desc.knobs);
        assert_true(renderer_parse_knob(&pgm_renderer, "textures", "many", desc.knobs));
        assert_true(renderer_parse_knob(&pgm_renderer, "fetch", others[k], desc.knobs));
        assert_null(pgm_renderer.create(&desc));
    }
    terrain_destroy(terrain);
}

// ---- A11, A12 --------------------------------------------------------------

static int32_t ramp_height(int i, int j)
{
    return 64 * i - 32 * j;
}

struct ramp {
    const struct terrain *terrain;
    const struct view *view;
    double worst; // cells of the finest level
};

static void gather_ramp(const float *triangles, size_t count, void *user)
{
    struct ramp *ramp = user;
    const double *outline = terrain_info(ramp->terrain)->outline_m, *eye = ramp->view->eye_m;
    double margin = 600; // levels end in repeated samples
    for (size_t v = 0; v < 3 * count; v++, triangles += 3) {
        double x = (double)triangles[0] + eye[0], y = (double)triangles[1] + eye[1];
        if (x < outline[0] + margin || x > outline[2] - margin || y < outline[1] + margin ||
            y > outline[3] - margin)
            continue;
        double exact = (64 * x / 10 - 32 * y / 10) / 64 * 10 - eye[2];
        ramp->worst = fmax(ramp->worst, fabs((double)triangles[2] - exact) / 10);
    }
}

// Every form but the hardware's lies where the samples do; the hardware's is printed.
static void test_every_texel_lies_where_its_sample_does(void **state)
{
    struct terrain *terrain = make_terrain(515, 387, NULL, 10, 10.0 / 64, 0, ramp_height);
    static const char *const forms[] = {"fetch=mipmap", "filter=bilinear", "fetch=packed", "memory=0.2",
                                        "memory=2 fetch=packed filter=bilinear"};
    double worst[5];
    for (int k = 0; k < 5; k++) {
        worst[k] = 0;
        for (int bias = 0; bias <= 4; bias++) {
            char options[96];
            snprintf(options, sizeof options, "rows=100 bias=%d %s", bias, forms[k]);
            struct renderer *renderer = make_pgm(*state, terrain, options);
            for (int yaw = 0; yaw < 360; yaw += 60) {
                const double eye[3] = {1500 + 5 * yaw, 1900, 3500};
                struct view view = make_view(terrain, eye, yaw, -50, 0, 60, 320, 240);
                struct ramp ramp = {terrain, &view, 0};
                capture_frame(*state, renderer, terrain, &view, gather_ramp, &ramp);
                worst[k] = fmax(worst[k], ramp.worst);
            }
            pgm_renderer.destroy(renderer);
        }
        if (k) assert_true(worst[k] <= 1e-3);
    }
    FIGURE("A11 ramp, cells off: plain %.2g, packed %.2g, tiled %.2g, both %.2g (bound 1e-3); mipmaps of the "
           "hardware %.2g",
           worst[1], worst[2], worst[3], worst[4], worst[0]);
    terrain_destroy(terrain);
}

enum { CLIFF_CELL = 256, CLIFF_Q = 1000 };

static int32_t cliff_height(int i, int j)
{
    (void)j;
    return i < CLIFF_CELL ? -CLIFF_Q : CLIFF_Q;
}

struct cliff {
    const struct view *view;
    size_t low, high, between;
};

static void gather_cliff(const float *triangles, size_t count, void *user)
{
    struct cliff *cliff = user;
    for (size_t v = 0; v < 3 * count; v++, triangles += 3) {
        double x = (double)triangles[0] + cliff->view->eye_m[0],
               height = (double)triangles[2] + cliff->view->eye_m[2];
        if (fabs(x - CLIFF_CELL * 10) < 1000) continue; // a coarse cell may straddle the cliff here
        bool low = fabs(height + CLIFF_Q) < 1e-2, high = fabs(height - CLIFF_Q) < 1e-2;
        cliff->low += low;
        cliff->high += high;
        cliff->between += !low && !high;
    }
}

// The lowest and the highest ground lie side by side in the atlas, in tiles whose ends meet: nothing bleeds.
static void test_tiles_do_not_bleed(void **state)
{
    struct terrain *terrain = make_terrain(512, 512, NULL, 10, 1, 0, cliff_height);
    static const char *const forms[] = {"memory=0.03 filter=bilinear", "memory=0.25 fetch=packed",
                                        "memory=0.03 textures=many", "filter=bilinear",
                                        "memory=0.06 fetch=linear"}; // the hardware's sampler knows no tiles
    enum { FORMS = sizeof forms / sizeof *forms, LINEAR = FORMS - 1 };
    size_t between = 0;
    for (size_t k = 0; k < FORMS; k++) {
        char options[96];
        snprintf(options, sizeof options, "rows=48 %s", forms[k]);
        struct renderer *renderer = make_pgm(*state, terrain, options);
        size_t low = 0, high = 0;
        for (int step = 0; step < 40; step++) {
            const double eye[3] = {2000 + 30.0 * step, 1000 + 60.0 * step, 1500};
            struct view view = make_view(terrain, eye, 9 * step, -50, 0, 70, 320, 240);
            struct cliff cliff = {.view = &view};
            capture_frame(*state, renderer, terrain, &view, gather_cliff, &cliff);
            if (k < LINEAR) assert_int_equal(cliff.between, 0);
            between += cliff.between;
            low += cliff.low, high += cliff.high;
        }
        assert_true(low > 1000 && high > 1000);
        pgm_renderer.destroy(renderer);
    }
    FIGURE("A12 heights between two tiles of -%d and %d: none; with the hardware's filter %zu", CLIFF_Q,
           CLIFF_Q, between);
    assert_true(between > 0);
    terrain_destroy(terrain);
}

// ---- two views of one atlas ------------------------------------------------

// Ground pixels of view k, of those that the renderer was updated to, and how many no triangle covers.
static uint64_t count_bare(struct gpu *gpu, struct renderer *renderer, const struct terrain *terrain,
                           const struct truth_surface *surface, const struct view *views, int k,
                           uint64_t *ground)
{
    struct truth truth;
    struct gpu_target target; // a draw needs one
    assert_true(truth_init(&truth, views[k].width, views[k].height));
    truth_cast(&truth, surface, &views[k], 0);
    struct places *hits = truth_places(&truth, 0);
    assert_non_null(hits);
    gpu_set_view(gpu, terrain, &views[k]);
    assert_true(gpu_target_init(gpu, &target, views[k].width, views[k].height, GL_RGBA32F));
    gpu_target_begin(gpu, &target);
    assert_true(gpu_capture_begin(gpu, places_feed, hits));
    renderer->type->draw(renderer, k, PASS_POSITION);
    gpu_capture_end(gpu);
    gpu_target_finish(&target);
    double low, high;
    uint64_t bare = 0;
    for (uint64_t hit = 0; hit < truth.ground; hit++) bare += !places_height(hits, hit, &low, &high);
    *ground += truth.ground;
    places_destroy(hits);
    truth_finish(&truth);
    return bare;
}

// Tiles follow the first viewer.  The second, who may be far from them, sees coarser ground, but all of it.
static void test_two_views_share_the_tiles(void **state)
{
    struct terrain *terrain = make_terrain(512, 500, NULL, 30, 0.5, 0, hilly_height);
    struct truth_surface *surface = truth_surface_create(terrain);
    assert_non_null(surface);
    struct renderer *renderer = make_pgm(*state, terrain, "rows=100 memory=0.1 budget=64");
    assert_true(counter(renderer, "tile_side") < 250);
    uint64_t seed = 5, bare[2] = {0, 0}, ground = 0;
    for (int frame = 0; frame < test_size(12, 200); frame++) {
        struct view views[2] = {some_view(terrain, &seed), some_view(terrain, &seed)};
        renderer->type->begin_frame(renderer, frame);
        assert_true(renderer->type->update(renderer, views, 2));
        for (int k = 1; k >= 0; k--)
            bare[k] += count_bare(*state, renderer, terrain, surface, views, k, &ground);
    }
    FIGURE("two views of one atlas: %lu and %lu of %lu ground pixels uncovered", bare[0], bare[1], ground);
    assert_true(bare[0] == 0 && bare[1] == 0 && ground > 10000);
    pgm_renderer.destroy(renderer);
    truth_surface_destroy(surface);
    terrain_destroy(terrain);
}

// ---- the Cascades in 4 MiB -------------------------------------------------

static void test_cascades_in_four_mebibytes(void **state)
{
    struct gpu *gpu = *state;
    char path[1024];
    if (!test_data("puget_cascades_72m_2049x2817.png", path)) return;
    struct scene *scene = scene_load("bench/scenes/cascades.json", NULL, 320, 240);
    assert_non_null(scene);
    struct renderer *whole = make_pgm(gpu, scene->terrain, "rows=300 memory=0");
    struct renderer *capped = make_pgm(gpu, scene->terrain, "rows=300 memory=4 budget=128");
    assert_true(counter(capped, "atlas_bytes") <= 4 << 20 && counter(whole, "atlas_bytes") > 4 << 20);
    uint64_t holes = 0, ground = 0;
    double most_bytes = 0;
    int frames = test_size(24, 384), coarsened = 0;
    for (int frame = 0; frame < frames; frame++) {
        struct view view;
        scene_view(scene, frame, frames, &view);
        pgm_renderer.begin_frame(capped, frame);
        assert_true(pgm_renderer.update(capped, &view, 1));
        most_bytes = fmax(most_bytes, counter(capped, "refilled_bytes"));
        coarsened += counter(capped, "rows_coarsened") > 0;
        struct frame_error error = measure_frame(gpu, capped, scene->terrain, &view, NULL);
        holes += error.holes;
        ground += error.ground;
        frame_error_finish(&error);
        if (frame % (frames / 8)) continue;
        rest(capped, &view);
        assert_true(counter(capped, "rows_coarsened") == 0);
        void *a = draw_frame(gpu, whole, scene->terrain, &view, PASS_SHADED);
        void *b = draw_frame(gpu, capped, scene->terrain, &view, PASS_SHADED);
        assert_memory_equal(a, b, 320 * 240 * 4);
        free(a);
        free(b);
    }
    FIGURE("Cascades in 4 MiB, 128 KiB a frame: %lu holes of %lu ground pixels, at most %.0f KiB uploaded a "
           "frame, levels late in %d of %d frames; at rest the picture is that of whole levels",
           holes, ground, most_bytes / 1024, coarsened, frames);
    assert_int_equal(holes, 0);
    assert_true(most_bytes > 0 && most_bytes <= 128 * 1024);
    pgm_renderer.destroy(whole);
    pgm_renderer.destroy(capped);
    scene_destroy(scene);
}

static void test_no_gl_errors(void **state)
{
    assert_true(gpu_debug_errors(*state) == 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_every_texel_gives_the_same_heights),
        cmocka_unit_test(test_tiles_at_rest_give_the_same_heights),
        cmocka_unit_test(test_many_textures_hold_plain_texels),
        cmocka_unit_test(test_every_texel_lies_where_its_sample_does),
        cmocka_unit_test(test_tiles_do_not_bleed),
        cmocka_unit_test(test_two_views_share_the_tiles),
        cmocka_unit_test(test_cascades_in_four_mebibytes),
        cmocka_unit_test(test_no_gl_errors),
    };
    return cmocka_run_group_tests(tests, start_gpu, stop_gpu);
}
