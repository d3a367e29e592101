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
    static const char *const forms[] = {"rows=80",          "rows=80 fragment=one",  "rows=80 fetch=packed",
                                        "rows=80 memory=3", "rows=80 textures=many", "rows=80 fetch=mipmap"};
    for (int yaw = 0; yaw < 360; yaw += test_size(180, 60)) {
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
    for (int yaw = 0; yaw < 360; yaw += test_size(120, 45)) {
        struct view view = over(terrain, yaw);
        uint8_t *two = shade(*state, terrain, &own, &view, "rows=40");
        uint8_t *one = shade(*state, terrain, &own, &view, "rows=40 fragment=one");
        uint8_t *automatic =
            shade(*state, terrain, &own, &view, "rows=40 fragment=one coordinates=automatic");
        uint8_t *tiled = shade(*state, terrain, &own, &view, "rows=40 memory=8");
        uint8_t *many = shade(*state, terrain, &own, &view, "rows=40 textures=many");
        wrong += differing(one, automatic, 16);
        parent += differing(one, two, 16);
        assert_memory_equal(two, tiled, WIDTH * HEIGHT * 4);
        assert_memory_equal(two, many, WIDTH * HEIGHT * 4);
        free(many);
        free(two);
        free(one);
        free(automatic);
        free(tiled);
    }
    double pixels = 360.0 / test_size(120, 45) * WIDTH * HEIGHT;
    FIGURE("Figure 15: %.2g %% of pixels wrong where texels are interpolated between vertices; without the "
           "parent's fetch %.2g %% differ",
           100 * wrong / pixels, 100 * parent / pixels);
    assert_true(wrong > 100);
    terrain_destroy(terrain);
}

// ---- colour ----------------------------------------------------------------

typedef uint8_t channel_fn(int i, int j, int channel); // of a pixel, i east and j south

static struct scene_colour make_image(int width, int height, channel_fn *channel_of)
{
    struct scene_colour image = {.name = "made", .width = width, .height = height};
    image.pixels = malloc((size_t)width * (size_t)height * 4);
    assert_non_null(image.pixels);
    snprintf(image.sha256, sizeof image.sha256, "%d %d %p", width, height, (void *)image.pixels);
    for (int j = 0; j < height; j++)
        for (int i = 0; i < width; i++)
            for (int c = 0; c < 4; c++)
                image.pixels[4 * (j * width + i) + c] = c < 3 ? channel_of(i, j, c) : 255;
    return image;
}

static uint8_t ramp_channel(int i, int j, int channel) // means of four are exact at every level
{
    return (uint8_t)(channel == 0 ? 4 * i : channel == 1 ? 4 * j : 252 - 2 * (i + j));
}

static uint8_t checker_channel(int i, int j, int channel)
{
    return (i + j + channel) % 2 ? 254 : 0;
}

static uint8_t blotchy_channel(int i, int j, int channel)
{
    return (uint8_t)lrint(128 + 60 * sin(0.11 * i + channel) + 60 * cos(0.13 * j - channel));
}

// A linear ramp of colours is itself at every level, filtered by whatever is linear.
static void test_a_ramp_of_colours_is_draped_like_the_common_one(void **state)
{
    struct terrain *terrain = make_terrain(1024, 1024, NULL, 30, 0.25, 0, ramp_height);
    struct scene_colour image = make_image(64, 64, ramp_channel);
    const struct scene_effects drape = {SCENE_SHADING_COMMON, &image}, owned = {SCENE_SHADING_OWN, &image};
    static const char *const forms[] = {
        "rows=80",           "rows=80 bias=5",       "rows=80 fragment=one", "rows=80 bias=4 textures=many",
        "rows=80 memory=12", "rows=80 fetch=mipmap", "rows=80 fetch=packed"};
    for (int yaw = 0; yaw < 360; yaw += test_size(180, 60)) {
        const double eye[3] = {15000, 15000, 6000};
        struct view view = make_view(terrain, eye, yaw, -60, 0, 50, WIDTH, HEIGHT); // far from the border
        uint8_t *common = shade(*state, terrain, &drape, &view, "rows=80");
        for (size_t k = 0; k < sizeof forms / sizeof *forms; k++) {
            uint8_t *picture = shade(*state, terrain, &owned, &view, forms[k]);
            // Shading may be off by 3, as above; the hardware's filter weighs in 256 steps (a pixel's 4 by
            // 1/64) and rounds to bytes twice, between pixels and between mipmaps: 2, lit by at most 1.35.
            assert_int_equal(differing(common, picture, 6), 0);
            free(picture);
        }
        uint8_t *again = shade(*state, terrain, &drape, &view, "rows=80");
        assert_memory_equal(common, again, WIDTH * HEIGHT * 4); // no texture of the scene's was displaced
        free(again);
        free(common);
    }
    free(image.pixels);
    terrain_destroy(terrain);
}

// One texture a level, and tiles about the viewer, give what whole levels in one atlas give, bit for bit;
// texels interpolated between vertices do not.
static void test_colours_come_from_tiles(void **state)
{
    struct terrain *terrain = make_terrain(1024, 1024, NULL, 30, 0.5, 0, hilly_height);
    struct scene_colour image = make_image(701, 513, blotchy_channel);
    const struct scene_effects owned = {SCENE_SHADING_OWN, &image};
    int wrong = 0, parent = 0;
    for (int yaw = 0; yaw < 360; yaw += test_size(120, 45)) {
        struct view view = over(terrain, yaw);
        uint8_t *two = shade(*state, terrain, &owned, &view, "rows=40");
        uint8_t *one = shade(*state, terrain, &owned, &view, "rows=40 fragment=one");
        uint8_t *automatic =
            shade(*state, terrain, &owned, &view, "rows=40 fragment=one coordinates=automatic");
        uint8_t *tiled = shade(*state, terrain, &owned, &view, "rows=40 memory=12");
        uint8_t *many = shade(*state, terrain, &owned, &view, "rows=40 textures=many");
        assert_memory_equal(two, tiled, WIDTH * HEIGHT * 4);
        assert_memory_equal(two, many, WIDTH * HEIGHT * 4);
        wrong += differing(one, automatic, 16);
        parent += differing(one, two, 16);
        free(two);
        free(one);
        free(automatic);
        free(tiled);
        free(many);
    }
    double pixels = 360.0 / test_size(120, 45) * WIDTH * HEIGHT;
    FIGURE("Figure 15 with a colour image: %.2g %% of pixels wrong where texels are interpolated between "
           "vertices; without the parent's fetch %.2g %% differ",
           100 * wrong / pixels, 100 * parent / pixels);
    assert_true(wrong > 100);
    struct renderer *renderer = make_shaded_pgm(*state, terrain, &owned, "rows=40 memory=12");
    struct renderer_stats stats;
    pgm_renderer.stats(renderer, &stats);
    assert_true(stats.resident_bytes <= 13 << 20); // the grid is far below 1 MiB
    pgm_renderer.destroy(renderer);
    free(image.pixels);
    terrain_destroy(terrain);
}

// Colours follow the level: what differs from pixel to pixel is grey one level up.
static void test_colours_have_their_own_level(void **state)
{
    struct terrain *terrain = make_terrain(1024, 1024, NULL, 30, 0.25, 0, ramp_height);
    struct scene_colour image = make_image(512, 512, checker_channel); // pixels of two samples
    const struct scene_effects owned = {SCENE_SHADING_OWN, &image};
    const double eye[3] = {15000, 15000, 4000};
    struct view view = make_view(terrain, eye, 30, -89, 0, 50, WIDTH, HEIGHT);
    for (int step = 0; step < 2; step++) {
        // At rows=100 a sample is some 40 m across: level 0 of 30 m, and of colours of 60 m.
        uint8_t *picture = shade(*state, terrain, &owned, &view, step ? "rows=100 bias=3" : "rows=100");
        int low = 255, high = 0;
        for (int p = 0; p < WIDTH * HEIGHT; p++) {
            low = picture[4 * p] < low ? picture[4 * p] : low;
            high = picture[4 * p] > high ? picture[4 * p] : high;
        }
        if (step)
            assert_true(high - low <= 2); // one light on a plane; steps of 255 and of the words
        else
            assert_true(high - low > 100);
        free(picture);
    }
    free(image.pixels);
    terrain_destroy(terrain);
}

static void test_no_gl_errors(void **state)
{
    assert_true(gpu_debug_errors(*state) == 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_plane_is_shaded_like_its_triangles),
        cmocka_unit_test(test_interpolated_texels_are_wrong_between_levels),
        cmocka_unit_test(test_a_ramp_of_colours_is_draped_like_the_common_one),
        cmocka_unit_test(test_colours_come_from_tiles),
        cmocka_unit_test(test_colours_have_their_own_level),
        cmocka_unit_test(test_no_gl_errors),
    };
    return cmocka_run_group_tests(tests, start_gpu, stop_gpu);
}
