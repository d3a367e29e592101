// The pyramid of a colour image: pixels at every level where they say they are, whatever the size.
// SPDX-License-Identifier: MIT
#include "tests/test.h"

#include "pgm/pgm_atlas.h"

static struct scene_colour make_image(int width, int height)
{
    struct scene_colour image = {.name = "made", .width = width, .height = height};
    image.pixels = malloc((size_t)width * (size_t)height * 4);
    assert_non_null(image.pixels);
    return image;
}

static int channel(uint32_t word, int c)
{
    return (int)(word >> 8 * c & 255);
}

// A ramp keeps its colour at each pixel's centre, but for what rounding leaves: half a step a level.
static void test_pixels_lie_where_they_say(void **state)
{
    (void)state;
    static const int sizes[][2] = {{1, 1}, {7, 31}, {64, 64}, {100, 37}, {255, 129}};
    for (size_t k = 0; k < sizeof sizes / sizeof *sizes; k++) {
        int width = sizes[k][0], height = sizes[k][1];
        struct scene_colour image = make_image(width, height);
        for (int j = 0; j < height; j++) // the first row is the north edge
            for (int i = 0; i < width; i++) {
                uint8_t *pixel = image.pixels + 4 * (j * width + i);
                pixel[0] = (uint8_t)i;
                pixel[1] = (uint8_t)(height - 1 - j);
                pixel[2] = 7, pixel[3] = 255;
            }
        struct pgm_picture picture;
        assert_true(pgm_picture_init(&picture, &image, PGM_PICTURE_LEVELS_MAX));
        int last = picture.levels - 1;
        assert_true(picture.width[last] <= 8 && picture.height[last] <= 8);
        for (int level = 0; level <= last; level++)
            for (int j = 0; j << level < height; j++)
                for (int i = 0; i << level < width; i++) {
                    uint32_t word = pgm_picture_word(&picture, level, i, j);
                    assert_true(channel(word, 2) == 7 && channel(word, 3) == 255);
                    if ((i + 1) << level > width || (j + 1) << level > height) continue; // hangs over
                    double x = ldexp(i + 0.5, level) - 0.5, y = ldexp(j + 0.5, level) - 0.5;
                    assert_true(fabs(channel(word, 0) - x) <= 0.5 * level &&
                                fabs(channel(word, 1) - y) <= 0.5 * level);
                }
        assert_int_equal(pgm_picture_word(&picture, 0, -5, -5), pgm_picture_word(&picture, 0, 0, 0));
        assert_int_equal(pgm_picture_word(&picture, 0, width + 9, height),
                         pgm_picture_word(&picture, 0, width - 1, height - 1));
        pgm_picture_finish(&picture);
        free(image.pixels);
    }
}

static void test_levels_end_where_asked(void **state)
{
    (void)state;
    struct scene_colour image = make_image(300, 200);
    for (int most = 1; most < 9; most++) {
        struct pgm_picture picture;
        assert_true(pgm_picture_init(&picture, &image, most));
        assert_int_equal(picture.levels, most < 7 ? most : 7); // 300 150 75 38 19 10 5
        pgm_picture_finish(&picture);
    }
    free(image.pixels);
}

static struct terrain *make_terrain(int side, int64_t first, double spacing_m)
{
    int32_t *samples = calloc((size_t)side * (size_t)side, sizeof *samples);
    assert_non_null(samples);
    struct terrain_grid grid = {.name = "flat",
                                .samples = samples,
                                .width = side,
                                .height = side,
                                .first = {first, -first},
                                .spacing_m = {spacing_m, spacing_m},
                                .quantum_m = 1};
    struct terrain *terrain = terrain_from_grid(&grid, NULL);
    assert_non_null(terrain);
    free(samples);
    return terrain;
}

// The atlas places pixels over the map from edge to edge, and its texels are the words of a cell's corners.
static void test_an_atlas_of_colours(void **state)
{
    (void)state;
    struct terrain *terrain = make_terrain(101, 3000000, 10); // 1 km wide, 30 000 km off
    struct scene_colour image = make_image(50, 40);
    for (size_t i = 0; i < (size_t)4 * 50 * 40; i++) image.pixels[i] = (uint8_t)(i * 37 % 251);
    struct pgm_picture picture;
    assert_true(pgm_picture_init(&picture, &image, PGM_PICTURE_LEVELS_MAX));
    struct pgm_storage storage = {.picture = &picture, .most_texels = 4096, .budget_bytes = 65536};
    struct pgm_atlas atlas = {0};
    assert_true(pgm_atlas_layout(&atlas, terrain, &storage) && pgm_atlas_is_whole(&atlas));
    assert_true(pgm_atlas_whole_bytes(terrain, &storage) <= pgm_atlas_bytes(&atlas));
    const double *outline = terrain_info(terrain)->outline_m;
    uint64_t seed = 9;
    for (int step = 0; step < 200; step++) {
        struct view view;
        double share[2] = {test_uniform(&seed, -1, 2), test_uniform(&seed, -1, 2)};
        struct camera camera = {.eye_m = {outline[0] + 1000 * share[0], outline[1] + 1000 * share[1], 500},
                                .fov_vertical = 1};
        view_init(&view, terrain, &camera, 64, 64, 0);
        for (int k = 0; k < atlas.levels; k++) {
            struct pgm_place eye = pgm_atlas_place(&atlas, terrain, &view, k);
            for (int axis = 0; axis < 2; axis++) {
                double pixel_m = ldexp(1000.0 / (axis ? 40 : 50), k);
                double centre_m = outline[axis] + ((double)eye.cell[axis] + 0.5) * pixel_m;
                assert_true(fabs(eye.spacing_m[axis] - pixel_m) < 1e-6);
                // float32 holds a part of a pixel to 2^-24, the eye's double its place to 2^-27 m.
                assert_true(fabs(centre_m + (double)eye.fraction[axis] * pixel_m - view.eye_m[axis]) <=
                            pixel_m * 1e-7 + 1e-7);
            }
        }
    }
    static uint32_t texels[4 * 2000];
    atlas.texels = texels;
    for (int k = 0; k < atlas.levels; k++) {
        const struct terrain_extent *box = &atlas.slots[k].window.extent;
        const uint32_t *texel = texels;
        pgm_atlas_texels(&atlas, terrain, k, box);
        for (int64_t y = box->y0; y < box->y1; y++)
            for (int64_t x = box->x0; x < box->x1; x++, texel += 4)
                for (int corner = 0; corner < 4; corner++)
                    assert_int_equal(texel[corner],
                                     pgm_picture_word(&picture, k, x + corner % 2, y + corner / 2));
    }
    pgm_picture_finish(&picture);
    free(image.pixels);
    terrain_destroy(terrain);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_pixels_lie_where_they_say),
        cmocka_unit_test(test_levels_end_where_asked),
        cmocka_unit_test(test_an_atlas_of_colours),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
