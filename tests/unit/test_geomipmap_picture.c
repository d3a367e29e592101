// Pictures cut along map blocks: means, rectangles that cover, bytes; the light on slopes that are known.
// SPDX-License-Identifier: MIT
#include "geomipmap/geomipmap_picture.h"
#include "tests/unit/test_geomipmap.h"

static void pyramid_halves_to_one_pixel(void **state)
{
    (void)state;
    static const int sizes[][3] = {{1, 1, 4}, {8, 8, 1}, {37, 5, 4}, {1, 300, 1}, {640, 479, 4}};
    uint64_t seed = 1;
    for (int s = 0; s < 5; s++) {
        int width = sizes[s][0], height = sizes[s][1], channels = sizes[s][2];
        uint8_t *pixels = malloc((size_t)(width * height * channels));
        assert_non_null(pixels);
        for (int i = 0; i < width * height * channels; i++) pixels[i] = (uint8_t)test_random(&seed);
        struct geomipmap_picture picture;
        assert_true(geomipmap_picture_init(&picture, width, height, channels, pixels));
        for (int n = 1; n < picture.levels; n++) {
            const struct geomipmap_picture_level *fine = &picture.level[n - 1], *coarse = &picture.level[n];
            assert_int_equal(coarse->width, fine->width > 1 ? fine->width / 2 : 1);
            assert_int_equal(coarse->height, fine->height > 1 ? fine->height / 2 : 1);
            for (int y = 0; y < coarse->height; y++)
                for (int x = 0; x < coarse->width; x++)
                    for (int c = 0; c < channels; c++) {
                        double sum = 0;
                        for (int k = 0; k < 4; k++) {
                            int i = fine->width > 1 ? 2 * x + k % 2 : 0,
                                j = fine->height > 1 ? 2 * y + k / 2 : 0;
                            sum += fine->pixels[(j * fine->width + i) * channels + c];
                        }
                        double mean = coarse->pixels[(y * coarse->width + x) * channels + c];
                        assert_true(fabs(mean - sum / 4) <= 0.5);
                    }
        }
        assert_int_equal(picture.level[picture.levels - 1].width, 1);
        assert_int_equal(picture.level[picture.levels - 1].height, 1);
        geomipmap_picture_finish(&picture);
        free(pixels);
    }
}

// A bilinear filter at any place of the part, on any mipmap, reads pixels of the rectangle alone, or those at
// the picture's edge.
static void rectangles_hold_what_a_filter_reads(void **state)
{
    (void)state;
    uint64_t seed = 2;
    static uint8_t pixels[700 * 500];
    struct geomipmap_picture picture;
    assert_true(geomipmap_picture_init(&picture, 700, 500, 1, pixels));
    for (int k = 0; k < test_size(20000, 1000000); k++) {
        int n = (int)(test_random(&seed) % (uint64_t)picture.levels);
        int width = picture.level[n].width, height = picture.level[n].height;
        double a[4], x = test_uniform(&seed, -0.2, 1.1), y = test_uniform(&seed, -0.2, 1.1);
        a[0] = x, a[1] = y;
        a[2] = x + test_uniform(&seed, 1e-6, 0.4), a[3] = y + test_uniform(&seed, 1e-6, 0.4);
        struct geomipmap_rect r = geomipmap_picture_rect(&picture, n, a);
        assert_true(r.x >= 0 && r.y >= 0 && r.width > 0 && r.height > 0);
        assert_true(r.x + r.width <= width && r.y + r.height <= height);
        for (int n_mip = 0; n_mip <= GEOMIPMAP_MIPMAPS; n_mip++)
            for (int end = 0; end < 4; end += 2) {
                int size = 1 << n_mip;
                assert_int_equal(r.x % size, 0); // mipmaps of two rectangles stand on the same pixels
                assert_int_equal(r.y % size, 0);
                double u = floor(a[end] * width / size - 0.5) * size,
                       v = floor(a[end + 1] * height / size - 0.5) * size;
                double i0 = fmin(fmax(u, 0), width - 1), i1 = fmin(fmax(u + 2 * size - 1, 0), width - 1);
                double j0 = fmin(fmax(v, 0), height - 1), j1 = fmin(fmax(v + 2 * size - 1, 0), height - 1);
                assert_true(i0 >= r.x && i1 < r.x + r.width);
                assert_true(j0 >= r.y && j1 < r.y + r.height);
            }
    }
    geomipmap_picture_finish(&picture);
}

static void bytes_are_those_of_all_mipmaps(void **state)
{
    (void)state;
    static uint8_t pixels[4];
    struct geomipmap_picture picture;
    assert_true(geomipmap_picture_init(&picture, 1, 1, 4, pixels));
    const struct geomipmap_rect square = {0, 0, 256, 256}, odd = {5, 6, 5, 3}, line = {0, 0, 1, 4};
    assert_int_equal(geomipmap_rect_bytes(&picture, square), 4 * (65536 + 16384 + 4096 + 1024));
    assert_int_equal(geomipmap_rect_bytes(&picture, odd), 4 * (15 + 2 + 1));
    assert_int_equal(geomipmap_rect_bytes(&picture, line), 4 * (4 + 2 + 1));
    geomipmap_picture_finish(&picture);
}

static void level_has_pixels_of_the_spacing(void **state)
{
    (void)state;
    static uint8_t pixels[1024 * 4];
    struct geomipmap_picture picture;
    assert_true(geomipmap_picture_init(&picture, 1024, 4, 1, pixels));
    assert_int_equal(geomipmap_picture_level_for(&picture, 0), 0);
    assert_int_equal(geomipmap_picture_level_for(&picture, 1.0 / 1024), 0);
    assert_int_equal(geomipmap_picture_level_for(&picture, 1.01 / 1024), 1);
    assert_int_equal(geomipmap_picture_level_for(&picture, 1.0 / 64), 4);
    assert_int_equal(geomipmap_picture_level_for(&picture, 1e9), 10);
    geomipmap_picture_finish(&picture);
}

// An inclined plane is lit alike everywhere, up to the edge of the map, by the cosine that its normal has
// with the sun.
static void planes_are_lit_by_their_cosine(void **state)
{
    (void)state;
    static const double sun[3] = {-0.58, 0.58, 0.57};
    static const int slopes[][2] = {{0, 0}, {30, 0}, {0, -50}, {-40, 40}, {300, 300}, {300, -300}};
    enum { SIDE = 40 };
    for (int s = 0; s < 6; s++) {
        int32_t samples[SIDE * SIDE];
        for (int i = 0; i < SIDE * SIDE; i++) samples[i] = i % SIDE * slopes[s][0] + i / SIDE * slopes[s][1];
        const struct terrain_grid grid = {.name = "plane",
                                          .samples = samples,
                                          .width = SIDE,
                                          .height = SIDE,
                                          .spacing_m = {10, 20},
                                          .quantum_m = 0.1};
        struct terrain *terrain = terrain_from_grid(&grid, NULL);
        int width, height;
        uint8_t *light = geomipmap_light_map(terrain, 0, sun, &width, &height);
        assert_non_null(light);
        assert_int_equal(width, SIDE);
        assert_int_equal(height, SIDE);
        double x = slopes[s][0] * 0.1 / 10, y = slopes[s][1] * 0.1 / 20;
        double cosine = (sun[2] - x * sun[0] - y * sun[1]) / sqrt(1 + x * x + y * y);
        for (int i = 0; i < SIDE * SIDE; i++)
            assert_true(fabs(light[i] / 255.0 - fmax(cosine, 0)) <= 0.5 / 255 + 1e-12);
        free(light);
        terrain_destroy(terrain);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pyramid_halves_to_one_pixel),
        cmocka_unit_test(rectangles_hold_what_a_filter_reads),
        cmocka_unit_test(bytes_are_those_of_all_mipmaps),
        cmocka_unit_test(level_has_pixels_of_the_spacing),
        cmocka_unit_test(planes_are_lit_by_their_cosine),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
