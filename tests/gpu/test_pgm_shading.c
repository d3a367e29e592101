// Shading of persistent grid mapping's own: words fetched by each fragment from the atlas.
// SPDX-License-Identifier: MIT
#include "tests/gpu/test_pgm.h"

static const struct scene_effects own = {.shading = SCENE_SHADING_OWN};

enum { WIDTH = 320, HEIGHT = 240 };

static int32_t ramp_height(int i, int j)
{
    return 10 * i - 6 * j;
}

static int32_t hilly_height(int i, int j)
{
    double x = i * 0.09, y = j * 0.08;
    return (int32_t)lrint(900 * sin(x) * cos(1.3 * y) + 300 * sin(2.7 * x + 1) * sin(2.3 * y));
}

static uint8_t *shade(struct gpu *gpu, const struct terrain *terrain, const struct scene_effects *effects,
                      const struct view *view, const char *options)
{
    struct renderer *renderer = make_shaded_pgm(gpu, terrain, effects, options);
    for (int frame = 0; frame < 300; frame++) { // until tiles are full
        renderer->type->begin_frame(renderer, frame);
        assert_true(renderer->type->update(renderer, view, 1));
    }
    uint8_t *picture = draw_frame(gpu, renderer, terrain, view, PASS_SHADED);
    pgm_renderer.destroy(renderer);
    return picture;
}

// Pixels that differ by more than `allowed` of 255 in a channel.
static int differing(const uint8_t *a, const uint8_t *b, int allowed)
{
    int count = 0;
    for (int p = 0; p < WIDTH * HEIGHT; p++) {
        int most = 0;
        for (int c = 0; c < 3; c++) {
            int difference = abs(a[4 * p + c] - b[4 * p + c]);
            if (difference > most) most = difference;
        }
        count += most > allowed;
    }
    return count;
}

static struct view over(const struct terrain *terrain, double yaw)
{
    const double *outline = terrain_info(terrain)->outline_m;
    const double eye[3] = {0.5 * (outline[0] + outline[2]), 0.5 * (outline[1] + outline[3]), 2500};
    return make_view(terrain, eye, yaw, -35, 0, 60, WIDTH, HEIGHT);
}

// A plane has one normal: of its triangles, and of every sample of every level but at the map's border.
static void test_a_plane_is_shaded_like_its_triangles(void **state)
{
    struct terrain *terrain = make_terrain(1024, 1024, NULL, 30, 0.25, 0, ramp_height);
    static const char *const forms[] = {"rows=80", "rows=80 fragment=one", "rows=80 fetch=packed",
                                        "rows=80 memory=3"};
    for (int yaw = 0; yaw < 360; yaw += 60) {
        const double eye[3] = {15000, 15000, 6000};
        struct view view = make_view(terrain, eye, yaw, -60, 0, 50, WIDTH, HEIGHT); // far from the border
        uint8_t *common = shade(*state, terrain, &common_effects, &view, "rows=80");
        for (size_t k = 0; k < sizeof forms / sizeof *forms; k++) {
            uint8_t *picture = shade(*state, terrain, &own, &view, forms[k]);
            // A step of 255 for rounding, one for the words' 2^-15 and one for derivatives of float32 places.
            assert_int_equal(differing(common, picture, 3), 0);
            free(picture);
        }
        free(common);
    }
    terrain_destroy(terrain);
}

// Interpolated texels sweep over other tiles of the atlas between rows of different levels; a fragment that
// finds its own does not, and sees what it sees from tiles about the viewer too.
static void test_interpolated_texels_are_wrong_between_levels(void **state)
{
    struct terrain *terrain = make_terrain(1024, 1024, NULL, 30, 0.5, 0, hilly_height);
    int wrong = 0, parent = 0;
    for (int yaw = 0; yaw < 360; yaw += 45) {
        struct view view = over(terrain, yaw);
        uint8_t *two = shade(*state, terrain, &own, &view, "rows=40");
        uint8_t *one = shade(*state, terrain, &own, &view, "rows=40 fragment=one");
        uint8_t *automatic =
            shade(*state, terrain, &own, &view, "rows=40 fragment=one coordinates=automatic");
        uint8_t *tiled = shade(*state, terrain, &own, &view, "rows=40 memory=8");
        wrong += differing(one, automatic, 16);
        parent += differing(one, two, 16);
        assert_memory_equal(two, tiled, WIDTH * HEIGHT * 4);
        free(two);
        free(one);
        free(automatic);
        free(tiled);
    }
    double pixels = 8.0 * WIDTH * HEIGHT;
    FIGURE("Figure 15: %.2g %% of pixels wrong where texels are interpolated between vertices; without the "
           "parent's fetch %.2g %% differ",
           100 * wrong / pixels, 100 * parent / pixels);
    assert_true(wrong > 100);
    terrain_destroy(terrain);
}

static void test_forms_without_shading_say_so(void **state)
{
    struct terrain *terrain = make_terrain(64, 64, NULL, 30, 0.5, 0, hilly_height);
    struct renderer_desc desc = {
        .gpu = *state, .terrain = terrain, .effects = &own, .width = WIDTH, .height = HEIGHT};
    renderer_default_knobs(&pgm_renderer, desc.knobs);
    assert_true(renderer_parse_knob(&pgm_renderer, "textures", "many", desc.knobs));
    assert_null(pgm_renderer.create(&desc));
    assert_true(renderer_parse_knob(&pgm_renderer, "textures", "atlas", desc.knobs));
    assert_true(renderer_parse_knob(&pgm_renderer, "fetch", "mipmap", desc.knobs));
    assert_null(pgm_renderer.create(&desc));
    terrain_destroy(terrain);
    assert_true(gpu_debug_errors(*state) == 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_plane_is_shaded_like_its_triangles),
        cmocka_unit_test(test_interpolated_texels_are_wrong_between_levels),
        cmocka_unit_test(test_forms_without_shading_say_so),
    };
    return cmocka_run_group_tests(tests, start_gpu, stop_gpu);
}
