// Normal maps of the clipmap: planes and bumps within the bound of clipmap_normals.h, taken from the finer
// level, toroidal, straight over the map's border.  The writer is memory instead of a texture.
// SPDX-License-Identifier: MIT
#include "clipmap/clipmap_normals.h"
#include "tests/unit/test_clipmap.h"

#include "common/terrain/upsample.h"

#include <string.h>
#include <time.h>

// Of a texel, in its own steps (clipmap_normals.h): 0.5 + 2^-9 + 0.155 + 0.012.
static const double TEXEL_BOUND = 0.67;

static const struct test_map hills = {.width = 300,
                                      .height = 200,
                                      .first = {-151, -102},
                                      .spacing_m = {30, 25},
                                      .quantum_m = 0.1,
                                      .rough = 9,
                                      .seed = 11};

static struct clipmap_box box_of(int64_t x, int64_t y, int width, int height)
{
    return (struct clipmap_box){{x, y}, {x + width - 1, y + height - 1}};
}

static struct clipmap_normals_scratch scratch_for(int size)
{
    struct clipmap_normals_scratch scratch;
    assert_true(clipmap_normals_scratch_init(&scratch, size));
    return scratch;
}

static struct terrain *terrain_of(const int32_t *samples, int width, int height, const double spacing_m[2],
                                  double quantum_m)
{
    struct terrain_grid grid = {.name = "test",
                                .samples = samples,
                                .width = width,
                                .height = height,
                                .first = {-width / 2, -height / 3},
                                .spacing_m = {spacing_m[0], spacing_m[1]},
                                .quantum_m = quantum_m};
    struct terrain *terrain = terrain_from_grid(&grid, NULL);
    assert_non_null(terrain);
    return terrain;
}

// The texel, in double, of a surface with these slopes.
static void texel_of(double slope_x, double slope_y, double texel[2])
{
    double length = sqrt(1 + slope_x * slope_x + slope_y * slope_y);
    texel[0] = -CLIPMAP_NORMAL_ONE * slope_x / length;
    texel[1] = -CLIPMAP_NORMAL_ONE * slope_y / length;
}

static double worse(double worst, const int16_t texel[2], const double expected[2])
{
    return fmax(worst, fmax(fabs(texel[0] - expected[0]), fabs(texel[1] - expected[1])));
}

// ---- surfaces that are known -----------------------------------------------

// Every filter reproduces planes up to the border and beyond, so one normal holds everywhere at every level.
static void planes_have_one_normal(void **state)
{
    (void)state;
    enum { WIDTH = 70, HEIGHT = 45, STEEP = 4 };
    static const int slopes[][2] = {{0, 0}, {256, 0}, {0, -512}, {1024, 768}, {-4096, 16384}};
    static const double spacing_m[2] = {30, 20};
    struct clipmap_normals_scratch scratch = scratch_for(64);
    double worst = 0;
    for (size_t s = 0; s < sizeof slopes / sizeof *slopes; s++) {
        int32_t samples[WIDTH * HEIGHT];
        for (int i = 0; i < WIDTH * HEIGHT; i++)
            samples[i] = slopes[s][0] * (i % WIDTH) + slopes[s][1] * (i / WIDTH);
        struct terrain *terrain = terrain_of(samples, WIDTH, HEIGHT, spacing_m, 0.01);
        double expected[2];
        texel_of(slopes[s][0] * 0.01 / spacing_m[0], slopes[s][1] * 0.01 / spacing_m[1], expected);
        for (int level = 0; level < STEEP && level <= terrain_info(terrain)->coarsest; level++)
            for (int part = 0; part < 9; part++) {
                struct clipmap_box box = box_of((part % 3 - 1) * (WIDTH >> level) - 30,
                                                (part / 3 - 1) * (HEIGHT >> level) - 30, 64, 60);
                clipmap_normals_compute(terrain, level, &box, &scratch);
                for (int i = 0; i < 64 * 60; i++) worst = worse(worst, scratch.texels[i], expected);
            }
        terrain_destroy(terrain);
    }
    FIGURE("normals of planes: at most %.3f of a texel's steps off (bound %.2f)", worst, TEXEL_BOUND);
    assert_true(worst <= TEXEL_BOUND);
    clipmap_normals_scratch_finish(&scratch);
}

static double bump(double x_m, double y_m)
{
    return 400 * exp(-(x_m * x_m / 2 + y_m * y_m) / (500.0 * 500.0));
}

// Level 1 is shaded from level 0, whose samples are the bump's, each rounded by half a quantum at most: the
// central difference over 2 g errs by q / 2g along each axis, and a normal's part by no more than the slopes,
// |dn_x/dp| + |dn_x/dq| <= 1 + 0.39.
static void a_bump_has_its_central_differences(void **state)
{
    (void)state;
    enum { SIDE = 161 };
    static const double spacing_m[2] = {25, 20}, quantum_m = 0.01;
    int32_t *samples = malloc(sizeof *samples * SIDE * SIDE);
    assert_non_null(samples);
    for (int i = 0; i < SIDE * SIDE; i++)
        samples[i] = (int32_t)lrint(
            bump((i % SIDE - SIDE / 2) * spacing_m[0], (i / SIDE - SIDE / 3) * spacing_m[1]) / quantum_m);
    struct terrain *terrain = terrain_of(samples, SIDE, SIDE, spacing_m, quantum_m);
    struct clipmap_normals_scratch scratch = scratch_for(SIDE - 2);
    struct clipmap_box box = box_of(1 - SIDE / 2, 1 - SIDE / 3, SIDE - 2, SIDE - 2);
    clipmap_normals_compute(terrain, 1, &box, &scratch);
    double worst = 0, bound = TEXEL_BOUND + CLIPMAP_NORMAL_ONE * 1.39 * quantum_m / (2 * spacing_m[1]);
    for (int i = 0; i < (SIDE - 2) * (SIDE - 2); i++) {
        double x = (double)(box.lo[0] + i % (SIDE - 2)) * spacing_m[0], expected[2];
        double y = (double)(box.lo[1] + i / (SIDE - 2)) * spacing_m[1];
        texel_of((bump(x + spacing_m[0], y) - bump(x - spacing_m[0], y)) / (2 * spacing_m[0]),
                 (bump(x, y + spacing_m[1]) - bump(x, y - spacing_m[1])) / (2 * spacing_m[1]), expected);
        worst = worse(worst, scratch.texels[i], expected);
    }
    FIGURE("normals of a bump: at most %.2f steps from its central differences (bound %.2f)", worst, bound);
    assert_true(worst <= bound);
    clipmap_normals_scratch_finish(&scratch);
    terrain_destroy(terrain);
    free(samples);
}

// ---- which level a normal is taken from ------------------------------------

static double sample_at(const struct terrain *terrain, int level, int64_t i, int64_t j)
{
    int32_t height;
    assert_true(terrain_window(terrain, level, i, j, 1, 1, &height, TERRAIN_WAIT));
    return height;
}

// U along one axis at half sample h, of values at whole samples.
typedef double along_fn(const struct terrain *terrain, int level, int64_t at, int64_t other);

static double u_of_column(const struct terrain *terrain, int level, int64_t h, int64_t i)
{
    int64_t j = clipmap_floor_div(h, 2);
    if (h == 2 * j) return sample_at(terrain, level, i, j);
    return (9 * (sample_at(terrain, level, i, j) + sample_at(terrain, level, i, j + 1)) -
            sample_at(terrain, level, i, j - 1) - sample_at(terrain, level, i, j + 2)) /
           16;
}

static double u_at(const struct terrain *terrain, int level, int64_t x, int64_t y)
{
    int64_t i = clipmap_floor_div(x, 2);
    along_fn *u = u_of_column;
    if (x == 2 * i) return u(terrain, level, y, i);
    return (9 * (u(terrain, level, y, i) + u(terrain, level, y, i + 1)) - u(terrain, level, y, i - 1) -
            u(terrain, level, y, i + 2)) /
           16;
}

// Central differences of the half samples, from the finer level or from U of the level itself.
static void expected_at(const struct terrain *terrain, int level, bool finer, int64_t x, int64_t y,
                        double expected[2])
{
    along_fn *read = finer ? sample_at : u_at;
    int from = finer ? level - 1 : level;
    const double quantum_m = terrain_info(terrain)->quantum_m;
    struct terrain_level l = terrain_level(terrain, level);
    texel_of((read(terrain, from, x + 1, y) - read(terrain, from, x - 1, y)) * quantum_m / l.spacing_m[0],
             (read(terrain, from, x, y + 1) - read(terrain, from, x, y - 1)) * quantum_m / l.spacing_m[1],
             expected);
}

// U rounds to a quantum / 2^bits, which errs as the bump's rounding does; hills of 2^16 quanta leave 5 bits.
static void taken_from_the_finer_level_and_through_u_at_the_finest(void **state)
{
    (void)state;
    struct terrain *terrain = test_terrain(&hills);
    enum { SIDE = 60 };
    struct clipmap_normals_scratch scratch = scratch_for(SIDE);
    uint64_t seed = 3, upsampled = 0, checked[2] = {0, 0};
    double worst[2] = {0, 0};
    double u_bound = TEXEL_BOUND + CLIPMAP_NORMAL_ONE * 1.39 * hills.quantum_m / 32 / hills.spacing_m[1];
    assert_true(terrain_info(terrain)->max_q < 43690 && terrain_info(terrain)->min_q > -43690);
    for (int level = 0; level < 3; level++)
        for (int trial = 0; trial < test_size(3, 30); trial++) {
            struct clipmap_box box =
                box_of(((int64_t)(test_random(&seed) % 160) - 100) >> level,
                       ((int64_t)(test_random(&seed) % 100) - 70) >> level, SIDE >> level, SIDE >> level);
            clipmap_normals_compute(terrain, level, &box, &scratch);
            for (int64_t y = box.lo[1], i = 0; y <= box.hi[1]; y++)
                for (int64_t x = box.lo[0]; x <= box.hi[0]; x++, i++, checked[level > 0]++) {
                    double expected[2], own[2];
                    expected_at(terrain, level, level > 0, x, y, expected);
                    expected_at(terrain, level, false, x, y, own);
                    worst[level > 0] = worse(worst[level > 0], scratch.texels[i], expected);
                    upsampled += level > 0 && worse(0, scratch.texels[i], own) > 100;
                }
        }
    FIGURE("normals from the finer level: %.3f steps (bound %.2f); through U: %.2f (bound %.2f); %lu texels",
           worst[1], TEXEL_BOUND, worst[0], u_bound, checked[0] + checked[1]);
    FIGURE("%lu of %lu texels differ from upsampled geometry by more than 100 steps", upsampled, checked[1]);
    assert_true(worst[1] <= TEXEL_BOUND && worst[0] <= u_bound);
    assert_true(upsampled > checked[1] / 2); // normals of upsampled geometry would fail
    clipmap_normals_scratch_finish(&scratch);
    terrain_destroy(terrain);
}

// ---- borders and sizes -----------------------------------------------------

static void beyond_the_border_the_nearest_normal_holds(void **state)
{
    (void)state;
    struct terrain *terrain = test_terrain(&hills);
    enum { SIDE = 40 };
    struct clipmap_normals_scratch scratch = scratch_for(SIDE), one = scratch_for(1);
    uint64_t seed = 4;
    for (int trial = 0; trial < test_size(60, 600); trial++) {
        int level = (int)(test_random(&seed) % 4);
        struct terrain_extent e = terrain_level(terrain, level ? level - 1 : 0).extent;
        int step = level ? 1 : 2;
        struct clipmap_box box =
            box_of(step * (trial & 1 ? e.x0 : e.x1) - (int64_t)(test_random(&seed) % 60),
                   step * (trial & 2 ? e.y0 : e.y1) - (int64_t)(test_random(&seed) % 60), SIDE, SIDE);
        clipmap_normals_compute(terrain, level, &box, &scratch);
        for (int i = 0; i < SIDE * SIDE; i++) {
            int64_t x = box.lo[0] + i % SIDE, y = box.lo[1] + i / SIDE;
            x = x < step * e.x0 ? step * e.x0 : x > step * (e.x1 - 1) ? step * (e.x1 - 1) : x;
            y = y < step * e.y0 ? step * e.y0 : y > step * (e.y1 - 1) ? step * (e.y1 - 1) : y;
            struct clipmap_box texel = box_of(x, y, 1, 1);
            clipmap_normals_compute(terrain, level, &texel, &one);
            assert_memory_equal(scratch.texels[i], one.texels[0], sizeof one.texels[0]);
        }
    }
    clipmap_normals_scratch_finish(&scratch);
    clipmap_normals_scratch_finish(&one);
    terrain_destroy(terrain);
}

// The highest and lowest heights there are, next to each other, on maps down to one sample: no overflow (the
// sanitizer would say), and every texel is part of a unit normal.
static void extreme_heights_and_tiny_maps(void **state)
{
    (void)state;
    static const int sizes[][2] = {{1, 1}, {2, 2}, {1, 9}, {9, 1}, {3, 2}, {12, 12}};
    static const double spacing_m[2] = {1, 1};
    struct clipmap_normals_scratch scratch = scratch_for(48);
    uint64_t seed = 8;
    for (int trial = 0; trial < test_size(200, 4000); trial++) {
        const int *size = sizes[(size_t)trial % (sizeof sizes / sizeof *sizes)];
        int32_t samples[144];
        for (int i = 0; i < size[0] * size[1]; i++)
            samples[i] = test_random(&seed) & 1 ? QUANTA_LIMIT : -QUANTA_LIMIT;
        struct terrain *terrain = terrain_of(samples, size[0], size[1], spacing_m, 1);
        for (int level = 0; level <= terrain_info(terrain)->coarsest; level++) {
            struct clipmap_box box = box_of(-24, -24, 48, 48);
            clipmap_normals_compute(terrain, level, &box, &scratch);
            for (int i = 0; i < 48 * 48; i++) {
                double x = scratch.texels[i][0], y = scratch.texels[i][1];
                assert_true(sqrt(x * x + y * y) <= CLIPMAP_NORMAL_ONE + 1);
            }
        }
        terrain_destroy(terrain);
    }
    clipmap_normals_scratch_finish(&scratch);
}

// ---- the toroidal store ----------------------------------------------------

struct memory { // stands for a level's texture
    int16_t (*slots)[2];
    uint16_t *writes; // since the step began
    int size;
    bool slips; // writes a column too far: what the test must see
};

static void write_memory(void *user, int slot_x, int slot_y, int width, int height,
                         const int16_t (*texels)[2])
{
    struct memory *memory = user;
    assert_true(slot_x >= 0 && slot_y >= 0 && slot_x + width <= memory->size &&
                slot_y + height <= memory->size);
    int slip = memory->slips && slot_x + width < memory->size;
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            size_t slot = (size_t)(slot_y + y) * (size_t)memory->size + (size_t)(slot_x + x + slip);
            memcpy(memory->slots[slot], texels[y * width + x], sizeof memory->slots[slot]);
            memory->writes[slot]++;
        }
}

static uint64_t wrong_texels(const struct clipmap_normals *normals, const struct memory *memory,
                             const struct clipmap_normals_scratch *scratch)
{
    uint64_t wrong = 0;
    const struct clipmap_box *clip = &normals->clip;
    clipmap_normals_compute(normals->terrain, normals->level, clip, scratch);
    int width = (int)(clip->hi[0] - clip->lo[0] + 1);
    for (int64_t y = clip->lo[1]; y <= clip->hi[1]; y++)
        for (int64_t x = clip->lo[0]; x <= clip->hi[0]; x++) {
            size_t slot = (size_t)clipmap_slot(y, memory->size) * (size_t)memory->size +
                          (size_t)clipmap_slot(x, memory->size);
            size_t fresh = (size_t)(y - clip->lo[1]) * (size_t)width + (size_t)(x - clip->lo[0]);
            wrong += memcmp(memory->slots[slot], scratch->texels[fresh], sizeof *memory->slots) != 0;
        }
    return wrong;
}

static int64_t step_of(uint64_t *seed, int n)
{
    const int64_t steps[] = {0, 0, 1, -1, 2, -2, 3, -5, n - 1, n, n + 1, -n, -n - 1, -n + 1, 5000, -5000};
    return steps[test_random(seed) % (sizeof steps / sizeof *steps)];
}

// Follows a clip region of n x n samples; returns the texels that differ from a fresh build at the end.
static uint64_t walk(const struct terrain *terrain, int level, int n, int gap, bool slips, uint64_t *seed)
{
    int size = 2 * n + gap;
    size_t count = (size_t)size * (size_t)size;
    struct memory memory = {calloc(count, sizeof *memory.slots), calloc(count, sizeof *memory.writes), size,
                            slips};
    assert_true(memory.slots && memory.writes);
    struct clipmap_normals normals = {terrain, level, size, clipmap_empty};
    struct clipmap_normals_scratch scratch = scratch_for(size);
    int64_t x = (int64_t)(test_random(seed) % 200) - 100, y = (int64_t)(test_random(seed) % 200) - 100;
    for (int step = 0; step < 40; step++) {
        x += step_of(seed, n);
        y += step_of(seed, n);
        struct clipmap_box samples = box_of(x, y, n, n);
        memset(memory.writes, 0, count * sizeof *memory.writes);
        uint64_t texels = clipmap_normals_move(&normals, &samples, &scratch, write_memory, &memory),
                 written = 0;
        for (size_t slot = 0; slot < count; slot++) {
            assert_true(slips || memory.writes[slot] <= 1);
            written += memory.writes[slot];
        }
        assert_int_equal(texels, written);
        assert_true(normals.clip.lo[0] == 2 * x && normals.clip.hi[1] == 2 * (y + n - 1) + 1);
    }
    uint64_t wrong = wrong_texels(&normals, &memory, &scratch);
    clipmap_normals_scratch_finish(&scratch);
    free(memory.slots);
    free(memory.writes);
    return wrong;
}

static void walks_leave_what_a_fresh_build_has(void **state)
{
    (void)state;
    struct terrain *terrain = test_terrain(&hills);
    uint64_t seed = 6, seen = 0;
    int walks = test_size(100, 1000);
    for (int i = 0; i < walks; i++)
        assert_int_equal(
            walk(terrain, (int)(test_random(&seed) % 4), i % 2 ? 17 : 33, i % 3 * 7, false, &seed), 0);
    for (int i = 0; i < 20; i++) seen += walk(terrain, 0, 17, 3, true, &seed) > 0;
    FIGURE("normals: %d walks of 40 steps equal a fresh build bit for bit; a slip is seen in %lu of 20",
           walks, seen);
    assert_true(seen > 15);
    terrain_destroy(terrain);
}

// ---- speed: printed, not asserted ------------------------------------------

static double cpu_ms(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec * 1e3 + (double)t.tv_nsec * 1e-6;
}

static void a_full_refill_of_255(void **state)
{
    (void)state;
    const struct test_map wide = {
        .width = 700, .height = 700, .spacing_m = {30, 25}, .quantum_m = 0.1, .rough = 9};
    struct terrain *terrain = test_terrain(&wide);
    struct clipmap_normals_scratch scratch = scratch_for(510);
    double least[2] = {INFINITY, INFINITY};
    for (int trial = 0; trial < 40; trial++)
        for (int level = 0; level < 2; level++) {
            struct clipmap_box box = box_of(50, 50, 510, 510);
            double start = cpu_ms();
            clipmap_normals_compute(terrain, level, &box, &scratch);
            least[level] = fmin(least[level], cpu_ms() - start);
        }
    FIGURE("normals of a 255 x 255 level, 510 x 510 texels: %.2f ms from the finer level, %.2f ms through U",
           least[1], least[0]);
    clipmap_normals_scratch_finish(&scratch);
    terrain_destroy(terrain);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(planes_have_one_normal),
        cmocka_unit_test(a_bump_has_its_central_differences),
        cmocka_unit_test(taken_from_the_finer_level_and_through_u_at_the_finest),
        cmocka_unit_test(beyond_the_border_the_nearest_normal_holds),
        cmocka_unit_test(extreme_heights_and_tiny_maps),
        cmocka_unit_test(walks_leave_what_a_fresh_build_has),
        cmocka_unit_test(a_full_refill_of_255),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
