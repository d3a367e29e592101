// The atlas of heights: every level in a slot of its own, whatever the shape and place of the map.
// SPDX-License-Identifier: MIT
#include "tests/test.h"

#include "pgm/pgm_atlas.h"

#include <math.h>

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

static const struct pgm_storage unlimited = {.most_texels = 16384, .budget_bytes = 65536};

static void check_layout(const struct pgm_atlas *atlas, const struct terrain *terrain)
{
    const struct terrain_info *info = terrain_info(terrain);
    assert_int_equal(atlas->finest, info->finest);
    assert_int_equal(atlas->levels, info->coarsest - info->finest + 1);
    for (int k = 0; k < atlas->levels; k++) {
        const struct pgm_slot *a = &atlas->slots[k];
        int width = a->window.width, height = a->window.height;
        assert_true(width > 0 && height > 0 && a->x >= 0 && a->y >= 0);
        assert_true(a->x + width <= atlas->width && a->y + height <= atlas->height);
        for (int m = 0; m < k; m++) {
            const struct pgm_slot *b = &atlas->slots[m];
            bool apart = a->x >= b->x + b->window.width || b->x >= a->x + width ||
                         a->y >= b->y + b->window.height || b->y >= a->y + height;
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
            assert_true(pgm_atlas_layout(&atlas, terrain, &unlimited));
            assert_true(pgm_atlas_is_whole(&atlas));
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
        assert_true(pgm_atlas_layout(&atlas, terrain, &unlimited));
        const struct terrain_info *info = terrain_info(terrain);
        int32_t lowest = INT32_MAX,
                highest = INT32_MIN; // filters overshoot: coarser levels may reach farther
        for (int level = info->finest; level <= info->coarsest; level++) {
            struct terrain_level l = terrain_level(terrain, level);
            if (l.min_q < lowest) lowest = l.min_q;
            if (l.max_q > highest) highest = l.max_q;
            int64_t low = (int64_t)l.min_q - atlas.base_q, high = (int64_t)l.max_q - atlas.base_q;
            if (atlas.narrow)
                assert_true(low >= INT16_MIN && high <= INT16_MAX);
            else
                assert_true(atlas.base_q == 0);
        }
        assert_int_equal(atlas.narrow, (int64_t)highest - lowest <= UINT16_MAX);
        assert_true(pgm_atlas_bytes(&atlas) ==
                    (size_t)atlas.width * (size_t)atlas.height * (atlas.narrow ? 2 : 4));
        terrain_destroy(terrain);
    }
}

// The largest tiles that fit, for any cap, any texel and any shape of map.
static void test_tiles_fill_the_memory_they_may_have(void **state)
{
    (void)state;
    static const int sizes[][2] = {{1500, 900}, {300, 1400}, {1024, 1024}};
    double least = 1;
    for (size_t k = 0; k < 3; k++) {
        struct terrain *terrain = make_terrain(sizes[k][0], sizes[k][1], -33, 100);
        for (int fetch = PGM_FETCH_PLAIN; fetch <= PGM_FETCH_PACKED; fetch++)
            for (size_t kib = 64; kib <= 16384; kib *= 2)
                for (int many = 0; many < 2; many++) {
                    struct pgm_storage storage = unlimited;
                    storage.fetch = (enum pgm_fetch)fetch;
                    storage.many = many;
                    storage.memory_bytes = kib * 1024;
                    struct pgm_atlas atlas = {0};
                    assert_true(pgm_atlas_layout(&atlas, terrain, &storage));
                    if (!many) check_layout(&atlas, terrain);
                    assert_true(pgm_atlas_bytes(&atlas) <= storage.memory_bytes);
                    assert_true(pgm_window_is_whole(&atlas.slots[atlas.levels - 1].window));
                    if (pgm_atlas_is_whole(&atlas)) continue;
                    double share = (double)pgm_atlas_bytes(&atlas) / (double)storage.memory_bytes;
                    least = share < least ? share : least;
                }
        terrain_destroy(terrain);
    }
    // One more texel a side must not fit: of three tiles that is 6 sides of texels, and columns of slots that
    // do not divide the height leave less than a half over.
    FIGURE("atlases of 64 KiB to 16 MiB hold at least %.0f %% of what they may (bound 50 %%)", 100 * least);
    assert_true(least >= 0.5);
}

static void test_terrain_that_does_not_fit_is_said_so(void **state)
{
    (void)state;
    struct terrain *terrain = make_terrain(700, 500, 0, 100);
    struct pgm_storage storage = unlimited;
    struct pgm_atlas atlas = {0};
    storage.memory_bytes = 1000;
    assert_false(pgm_atlas_layout(&atlas, terrain, &storage));
    storage.memory_bytes = 65536;
    storage.fetch = PGM_FETCH_MIPMAP;
    assert_false(pgm_atlas_layout(&atlas, terrain, &storage));
    storage = unlimited;
    storage.most_texels = 256; // a texture smaller than the map
    assert_true(pgm_atlas_layout(&atlas, terrain, &storage));
    assert_true(!pgm_atlas_is_whole(&atlas) && atlas.width <= 256 && atlas.height <= 256);
    terrain_destroy(terrain);
}

static int32_t sample_at(const struct terrain *terrain, int level, int64_t x, int64_t y)
{
    int32_t height;
    assert_true(terrain_window(terrain, level, x, y, 1, 1, &height, TERRAIN_WAIT));
    return height;
}

static int64_t floor_half(int64_t index)
{
    return index >= 0 ? index / 2 : -((1 - index) / 2);
}

// A packed texel holds the corners of its cell and of the parent's cell around it, at odd and negative
// indices too, in 16 and in 32 bits.
static void test_a_packed_texel_holds_a_footprint(void **state)
{
    (void)state;
    for (int wide = 0; wide < 2; wide++) {
        struct terrain *terrain = make_terrain(67, 45, -21, wide ? 100000 : 900);
        struct pgm_storage storage = unlimited;
        storage.fetch = PGM_FETCH_PACKED;
        struct pgm_atlas atlas = {0};
        assert_true(pgm_atlas_layout(&atlas, terrain, &storage));
        assert_true(atlas.narrow == !wide);
        static int32_t heights[8192], parents[8192];
        static uint32_t texels[8 * 4096];
        atlas.heights = heights, atlas.parents = parents, atlas.texels = texels;
        for (int k = 0; k < atlas.levels; k++) {
            const struct terrain_extent *e = &atlas.slots[k].window.extent;
            struct terrain_extent box = {e->x0 + (e->x1 - e->x0) / 5, e->y0, e->x1, e->y1};
            int parent = k + 1 < atlas.levels, words = wide ? 4 : 2;
            pgm_atlas_texels(&atlas, terrain, k, &box);
            const uint32_t *texel = texels;
            for (int64_t y = box.y0; y < box.y1; y++)
                for (int64_t x = box.x0; x < box.x1; x++, texel += 2 * words)
                    for (int corner = 0; corner < 8; corner++) {
                        int level = atlas.finest + k + (corner >= 4 ? parent : 0), c = corner % 4;
                        bool halved = corner >= 4 && parent;
                        int32_t expected = sample_at(terrain, level, (halved ? floor_half(x) : x) + c % 2,
                                                     (halved ? floor_half(y) : y) + c / 2);
                        const uint32_t *at = texel + (corner >= 4 ? words : 0);
                        int32_t held =
                            wide ? (int32_t)at[c] : (int16_t)(at[c / 2] >> (c % 2 ? 16 : 0)) + atlas.base_q;
                        assert_int_equal(held, expected);
                    }
        }
        terrain_destroy(terrain);
    }
}

// The shading words of a cell's corners, decoded, are unit normals of central differences.
static void test_shading_words_are_normals(void **state)
{
    (void)state;
    struct terrain *terrain = make_terrain(67, 45, -21, 3);
    struct pgm_storage storage = unlimited;
    storage.shaded = true;
    struct pgm_atlas atlas = {0};
    assert_true(pgm_atlas_layout(&atlas, terrain, &storage));
    static int32_t heights[8192];
    static uint32_t texels[4 * 4096];
    atlas.heights = heights, atlas.texels = texels;
    for (int k = 0; k < atlas.levels; k++) {
        const struct terrain_extent *box = &atlas.slots[k].window.extent;
        double spacing[2] = {ldexp(2, k), ldexp(3, k)};
        pgm_atlas_shading(&atlas, terrain, k, box);
        const uint32_t *word = texels;
        for (int64_t y = box->y0; y < box->y1; y++)
            for (int64_t x = box->x0; x < box->x1; x++)
                for (int corner = 0; corner < 4; corner++, word++) {
                    int64_t i = x + corner % 2, j = y + corner / 2;
                    double dx =
                        (sample_at(terrain, k, i + 1, j) - sample_at(terrain, k, i - 1, j)) / spacing[0] / 2;
                    double dy =
                        (sample_at(terrain, k, i, j + 1) - sample_at(terrain, k, i, j - 1)) / spacing[1] / 2;
                    double length = sqrt(dx * dx + dy * dy + 1);
                    assert_true(fabs((int16_t)(*word & 0xffff) / 32767.0 + dx / length) <= 0.51 / 32767);
                    assert_true(fabs((int16_t)(*word >> 16) / 32767.0 + dy / length) <= 0.51 / 32767);
                }
    }
    terrain_destroy(terrain);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_slots_lie_apart),
        cmocka_unit_test(test_texels_hold_every_height),
        cmocka_unit_test(test_tiles_fill_the_memory_they_may_have),
        cmocka_unit_test(test_terrain_that_does_not_fit_is_said_so),
        cmocka_unit_test(test_a_packed_texel_holds_a_footprint),
        cmocka_unit_test(test_shading_words_are_normals),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
