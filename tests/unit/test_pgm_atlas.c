// The atlas of heights: every level in a slot of its own, whatever the shape and place of the map.
// SPDX-License-Identifier: MIT
#include "tests/test.h"

#include "pgm/pgm_atlas.h"

static struct terrain *make_terrain(int width, int height, int64_t first, int32_t step)
{
    int32_t *samples = malloc((size_t)width * (size_t)height * sizeof *samples);
    assert_non_null(samples);
    for (int i = 0; i < width * height; i++) samples[i] = i % 7 * step;
    struct terrain_grid grid = {.name = "made",
                                .samples = samples,
                                .width = width,
                                .height = height,
                                .first = {first, -first},
                                .spacing_m = {2, 3},
                                .quantum_m = 1};
    struct terrain_options options = {.refine_bits = 0};
    struct terrain *terrain = terrain_from_grid(&grid, &options);
    assert_non_null(terrain);
    free(samples);
    return terrain;
}

static void check_layout(const struct pgm_atlas *atlas, const struct terrain *terrain)
{
    const struct terrain_info *info = terrain_info(terrain);
    assert_int_equal(atlas->finest, info->finest);
    assert_int_equal(atlas->levels, info->coarsest - info->finest + 1);
    for (int k = 0; k < atlas->levels; k++) {
        const struct pgm_slot *a = &atlas->slots[k];
        int64_t width = a->extent.x1 - a->extent.x0, height = a->extent.y1 - a->extent.y0;
        assert_true(width > 0 && height > 0 && a->x >= 0 && a->y >= 0);
        assert_true(a->x + width <= atlas->width && a->y + height <= atlas->height);
        for (int m = 0; m < k; m++) {
            const struct pgm_slot *b = &atlas->slots[m];
            bool apart = a->x >= b->x + (b->extent.x1 - b->extent.x0) || b->x >= a->x + width ||
                         a->y >= b->y + (b->extent.y1 - b->extent.y0) || b->y >= a->y + height;
            assert_true(apart);
        }
    }
}

static void test_slots_lie_apart(void **state)
{
    (void)state;
    static const int sizes[][2] = {{1, 1},   {2, 2},    {3, 3},    {1, 17},   {17, 1},
                                   {16, 16}, {675, 18}, {18, 675}, {513, 300}};
    static const int64_t firsts[] = {0, -77, 10000000001};
    for (size_t k = 0; k < sizeof sizes / sizeof *sizes; k++)
        for (size_t f = 0; f < sizeof firsts / sizeof *firsts; f++) {
            struct terrain *terrain = make_terrain(sizes[k][0], sizes[k][1], firsts[f], 100);
            struct pgm_atlas atlas = {0};
            pgm_atlas_layout(&atlas, terrain);
            check_layout(&atlas, terrain);
            terrain_destroy(terrain);
        }
}

static void test_texels_hold_every_height(void **state)
{
    (void)state;
    for (int32_t step = 1; step < 600000; step *= 3) {
        struct terrain *terrain = make_terrain(64, 64, 0, step);
        struct pgm_atlas atlas = {0};
        pgm_atlas_layout(&atlas, terrain);
        const struct terrain_info *info = terrain_info(terrain);
        for (int level = info->finest; level <= info->coarsest; level++) {
            struct terrain_level l = terrain_level(terrain, level);
            int64_t low = (int64_t)l.min_q - atlas.base_q, high = (int64_t)l.max_q - atlas.base_q;
            if (atlas.narrow)
                assert_true(low >= INT16_MIN && high <= INT16_MAX);
            else
                assert_true(atlas.base_q == 0);
        }
        if (6 * step < 40000) assert_true(atlas.narrow);
        if (6 * step > 65535) assert_false(atlas.narrow);
        assert_true(pgm_atlas_bytes(&atlas) ==
                    (size_t)atlas.width * (size_t)atlas.height * (atlas.narrow ? 2 : 4));
        terrain_destroy(terrain);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_slots_lie_apart),
        cmocka_unit_test(test_texels_hold_every_height),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
