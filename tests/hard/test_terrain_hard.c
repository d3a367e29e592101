// Hard cases of the terrain: numerics.md A11, B9, B11, B13, E1 to E5, each with the naive form that must fail
// it. SPDX-License-Identifier: MIT
#include "tests/test.h"

#include "common/terrain/heightfield.h"
#include "common/terrain/synthesis.h"
#include "common/terrain/terrain.h"
#include "common/terrain/upsample.h"

#include <string.h>

static const enum terrain_filter FILTERS[] = {TERRAIN_FILTER_LINEAR, TERRAIN_FILTER_HALFBAND,
                                              TERRAIN_FILTER_TENT, TERRAIN_FILTER_DECIMATE};

static struct terrain *build(const int32_t *samples, int64_t width, int64_t height, int64_t x0, int64_t y0,
                             const struct terrain_options *options)
{
    struct terrain_grid grid = {"case", samples, width, height, {x0, y0}, {1, 1}, 1, 0};
    struct terrain *terrain = terrain_from_grid(&grid, options);
    assert_non_null(terrain);
    return terrain;
}

static int32_t sample(const struct terrain *terrain, int level, int64_t i, int64_t j)
{
    int32_t q;
    terrain_window(terrain, level, i, j, 1, 1, &q, TERRAIN_WAIT);
    return q;
}

// ---- E1: voids -------------------------------------------------------------

static int make_voids(int32_t *samples, int width, int height, int pattern, uint64_t *random)
{
    int count = width * height, voids = 0;
    for (int i = 0; i < count; i++) {
        int x = i % width, y = i / width;
        bool is_void = false;
        switch (pattern % 7) {
        case 0:
            is_void = test_random(random) % 10 == 0;
            break;
        case 1:
            is_void = test_random(random) % 100 != 0;
            break;
        case 2:
            is_void = abs(x - width / 2) < width / 3 && abs(y - height / 2) < height / 3;
            break;
        case 3:
            is_void = x == 0 || y == 0 || x == width - 1 || y == height - 1;
            break;
        case 4:
            is_void = i != (int)(test_random(random) % (uint64_t)count);
            break;
        case 5:
            is_void = (x + y) & 1;
            break;
        case 6:
            is_void = y > height / 2;
            break;
        }
        if (is_void) samples[i] = HEIGHTFIELD_VOID;
    }
    for (int i = 0; i < count; i++) voids += samples[i] == HEIGHTFIELD_VOID;
    if (voids == count) { // one height at least
        samples[count / 2] = 50;
        voids--;
    }
    return voids;
}

static void e1_any_void_pattern(void **state)
{
    (void)state;
    uint64_t random = 1;
    int cases = test_size(140, 7000), total = 0;
    for (int n = 0; n < cases; n++) {
        int width = 1 + (int)(test_random(&random) % 60), height = 1 + (int)(test_random(&random) % 60);
        int32_t samples[60 * 60];
        for (int i = 0; i < width * height; i++) samples[i] = (int32_t)(test_random(&random) % 9000) - 430;
        int voids = make_voids(samples, width, height, n, &random);
        int32_t low = INT32_MAX, high = INT32_MIN;
        for (int i = 0; i < width * height; i++) {
            if (samples[i] == HEIGHTFIELD_VOID) continue;
            low = samples[i] < low ? samples[i] : low;
            high = samples[i] > high ? samples[i] : high;
        }
        struct terrain_options options = {.filter = FILTERS[n % 4], .synthesize_levels = n % 2, .seed = 2};
        struct terrain *terrain = build(samples, width, height, -5, 3, &options);
        struct terrain *again = build(samples, width, height, -5, 3, &options);
        assert_int_equal(terrain_info(terrain)->voids_filled, voids);
        struct terrain_level stored = terrain_level(terrain, 0);
        double quantum = terrain_info(terrain)->quantum_m;
        assert_true(stored.min_q * quantum >= low && stored.max_q * quantum <= high);
        size_t stride;
        const int32_t *filled = terrain_samples(terrain, 0, &stride);
        for (int i = 0; i < width * height; i++) // what was known is kept
            assert_true(samples[i] == HEIGHTFIELD_VOID || filled[i] * quantum == samples[i]);
        // No other level has seen a void: they are those of the filled grid.
        options.refine_bits = 0;
        int32_t whole[60 * 60];
        for (int i = 0; i < width * height; i++) whole[i] = (int32_t)(filled[i] * quantum);
        struct terrain *clean = build(whole, width, height, -5, 3, &options);
        for (int l = terrain_info(terrain)->finest; l <= terrain_info(terrain)->coarsest; l++) {
            struct terrain_extent e = terrain_level(terrain, l).extent;
            size_t count = (size_t)((e.x1 - e.x0) * (e.y1 - e.y0)) * sizeof(int32_t);
            const int32_t *values = terrain_samples(terrain, l, &stride);
            if (terrain_info(clean)->quantum_m == quantum)
                assert_memory_equal(values, terrain_samples(clean, l, &stride), count);
            assert_memory_equal(values, terrain_samples(again, l, &stride), count);
            assert_true(terrain_level(terrain, l).min_q >= -QUANTA_LIMIT &&
                        terrain_level(terrain, l).max_q <= QUANTA_LIMIT);
        }
        total += voids;
        terrain_destroy(terrain);
        terrain_destroy(again);
        terrain_destroy(clean);
    }
    FIGURE("E1: %d void patterns, %d voids filled within the range of the valid heights", cases, total);
    // Power: taken for heights, one void lowers a 2 x 2 mean by 8192 m; and NaN never equals what is
    // declared.
    assert_int_equal((100 + 100 + 100 - 32768) / 4, 75 - 8192);
    volatile double nan_height = (double)NAN, declared = (double)NAN;
    assert_false(nan_height == declared);
    assert_true(heightfield_is_void(nan_height, true, declared) && heightfield_is_void(-INFINITY, false, 0));
    assert_true(heightfield_is_void(-9999, false, 0) && heightfield_is_void(65535, true, 65535));
    assert_false(heightfield_is_void(65535, false, 0));
}

// ---- E2: sixteen bits ------------------------------------------------------

static void e2_deep_and_high_round_trip(void **state)
{
    (void)state;
    char folder[] = "/tmp/relief-test-XXXXXX", path[64], side[64];
    assert_non_null(mkdtemp(folder));
    snprintf(path, sizeof path, "%s/deep.png", folder);
    snprintf(side, sizeof side, "%s/deep.json", folder);
    const double heights[6] = {-11034, 8848, -430, 0, 21134, 1};
    struct heightfield field = {.name = "deep", .width = 3, .height = 2, .spacing_m = {1, 1}}, back;
    assert_true(heightfield_quantise(&field, heights, HEIGHTFIELD_FLOAT_BITS));
    assert_true(heightfield_save(&field, path, "test") && heightfield_load(&back, path));
    for (int i = 0; i < 6; i++) assert_true(back.samples[i] * back.quantum_m + back.offset_m == heights[i]);
    heightfield_finish(&field);
    heightfield_finish(&back);
    unlink(path);
    unlink(side);
    rmdir(folder);
    // Power: what a cast to 16 bits makes of them.
    assert_int_equal((uint16_t)-430, 65106);
    assert_int_equal((uint16_t)88480, 22944); // 8848 m in decimetres
}

// ---- E3: planes ------------------------------------------------------------

static void e3_flat_is_exact(void **state)
{
    (void)state;
    const double heights[] = {0, 1000, 8848.86};
    for (int h = 0; h < 3; h++)
        for (int filter = 0; filter < 4; filter++) {
            double height_m[40 * 23];
            for (int i = 0; i < 40 * 23; i++) height_m[i] = heights[h];
            struct heightfield field = {.name = "flat", .width = 40, .height = 23, .spacing_m = {30, 30}};
            assert_true(heightfield_quantise(&field, height_m, HEIGHTFIELD_FLOAT_BITS));
            struct terrain_grid grid = {"flat",          field.samples, 40, 23, {-9, 4}, {30, 30},
                                        field.quantum_m, field.offset_m};
            struct terrain_options options = {.filter = FILTERS[filter], .synthesize_levels = 2, .seed = 1};
            struct terrain *terrain = terrain_from_grid(&grid, &options);
            const struct terrain_info *info = terrain_info(terrain);
            for (int l = info->finest; l <= info->coarsest; l++) {
                struct terrain_level level = terrain_level(terrain, l);
                assert_true(level.rms_error_m == 0 && level.max_error_m == 0);
                assert_true(level.min_q * info->quantum_m + info->offset_m == heights[h]);
                assert_true(level.max_q * info->quantum_m + info->offset_m == heights[h]);
            }
            terrain_destroy(terrain);
            heightfield_finish(&field);
        }
}

// The plane a x + b y + c at sample (i, j) of a level, in source quanta.
static double plane(const int64_t p[3], int level, int64_t i, int64_t j)
{
    return ldexp((double)(p[0] * i + p[1] * j), level) + (double)p[2];
}

static void e3_tilted_planes_are_exact(void **state)
{
    (void)state;
    uint64_t random = 3;
    int cases = test_size(60, 2000);
    for (int n = 0; n < cases; n++) {
        int width = 1 + (int)(test_random(&random) % 100), height = 1 + (int)(test_random(&random) % 100);
        int64_t p[3] = {(int64_t)(test_random(&random) % 201) - 100,
                        (int64_t)(test_random(&random) % 201) - 100, 7};
        int64_t x0 = (int64_t)(test_random(&random) % 200) - 100,
                y0 = (int64_t)(test_random(&random) % 200) - 100;
        int32_t *samples = malloc((size_t)(width * height) * sizeof *samples);
        for (int j = 0; j < height; j++)
            for (int i = 0; i < width; i++) samples[j * width + i] = (int32_t)plane(p, 0, x0 + i, y0 + j);
        struct terrain_options options = {.filter = FILTERS[n % 4], .synthesize_levels = n % 3};
        struct terrain *terrain = build(samples, width, height, x0, y0, &options);
        const struct terrain_info *info = terrain_info(terrain);
        for (int l = info->finest; l <= info->coarsest; l++) {
            struct terrain_extent e = terrain_level(terrain, l).extent;
            // Borders included: U and D extrapolate linearly.  A line of samples tells no slope across
            // itself.
            for (int64_t j = e.y0; j < e.y1 && width > 1 && height > 1; j++)
                for (int64_t i = e.x0; i < e.x1; i++)
                    assert_true(sample(terrain, l, i, j) * info->quantum_m == plane(p, l, i, j));
            if (width > 1 && height > 1) assert_true(terrain_level(terrain, l).max_error_m == 0);
        }
        terrain_destroy(terrain);
        free(samples);
    }
    FIGURE("E3: %d tilted planes exact at every level, borders included", cases);
    // Power: D with reflected ghosts bends the plane at the border, by (9 - 1 * 3) * 2 / 32 of the slope on
    // each side.
    double bent = 0;
    for (int k = -3; k <= 3; k++) {
        static const double W[7] = {-1, 0, 9, 16, 9, 0, -1};
        bent += W[k + 3] / 32 * abs(k);
    }
    assert_true(bent == 6 * 2 / 32. && bent > 0x1p-23);
}

// ---- E4 and E5: exact answers of the filters -------------------------------

// Share of a needle's height that level l keeps at its place: decimation all, half-band and tent a half along
// each axis and level.  The dual of linear interpolation sends (a, b, b, 0 ..), the needle and its neighbours
// along an axis, to (6 a + 4 b, 2 b - a, 2 b - a, 0 ..) / 8.
static double kept_of_a_needle(enum terrain_filter filter, int l)
{
    if (filter == TERRAIN_FILTER_DECIMATE) return 1;
    if (filter != TERRAIN_FILTER_LINEAR) return ldexp(1, -2 * l);
    double a = 1, b = 0;
    for (; l > 0; l--) {
        double next = (6 * a + 4 * b) / 8;
        b = (2 * b - a) / 8;
        a = next;
    }
    return a * a;
}

static void e4_needle(void **state)
{
    (void)state;
    enum { SIDE = 129, LEVELS = 4, H = 1 << 20 };
    static int32_t samples[SIDE * SIDE];
    memset(samples, 0, sizeof samples);
    samples[64 * SIDE + 64] = H;
    for (int filter = 0; filter < 4; filter++) {
        struct terrain_options options = {.filter = FILTERS[filter]};
        struct terrain *terrain = build(samples, SIDE, SIDE, 0, 0, &options);
        for (int l = 0; l <= LEVELS; l++) {
            double kept = kept_of_a_needle(FILTERS[filter], l);
            assert_true(sample(terrain, l, 64 >> l, 64 >> l) == kept * H);
            // The error is that of the needle's height, and it is the maximum: nothing hides it.
            if (FILTERS[filter] != TERRAIN_FILTER_DECIMATE)
                assert_true(terrain_level(terrain, l).max_error_m == H - kept * H);
        }
        terrain_destroy(terrain);
        // Beside the lattice of a coarser level decimation loses it altogether.
        struct terrain *shifted = build(samples, SIDE, SIDE, 1, 1, &options);
        if (FILTERS[filter] == TERRAIN_FILTER_DECIMATE)
            assert_true(terrain_level(shifted, 1).max_q == 0 && terrain_level(shifted, 1).max_error_m == H);
        terrain_destroy(shifted);
    }
}

static void e5_checkerboard(void **state)
{
    (void)state;
    enum { SIDE = 40 };
    int32_t samples[SIDE * SIDE];
    for (int j = 0; j < SIDE; j++)
        for (int i = 0; i < SIDE; i++) samples[j * SIDE + i] = (i + j) & 1 ? 10 : -10;
    for (int filter = 0; filter < 4; filter++) {
        struct terrain_options options = {.filter = FILTERS[filter]};
        struct terrain *terrain = build(samples, SIDE, SIDE, 0, 0, &options);
        int32_t expected = FILTERS[filter] == TERRAIN_FILTER_DECIMATE ? -10 : 0;
        for (int64_t j = 2; j < SIDE / 2 - 2; j++)
            for (int64_t i = 2; i < SIDE / 2 - 2; i++) assert_int_equal(sample(terrain, 1, i, j), expected);
        terrain_destroy(terrain);
    }
}

// ---- A11: registration -----------------------------------------------------

static void a11_ramp_stays_in_place(void **state)
{
    (void)state;
    const int64_t origins[] = {0, -1, 5, 100};
    enum { WIDTH = 675, HEIGHT = 20 };
    static int32_t samples[WIDTH * HEIGHT];
    for (int o = 0; o < 4; o++)
        for (int filter = 0; filter < 4; filter++) {
            for (int i = 0; i < WIDTH * HEIGHT; i++) samples[i] = (int32_t)(1000 * (origins[o] + i % WIDTH));
            struct terrain_options options = {.filter = FILTERS[filter]};
            struct terrain *terrain = build(samples, WIDTH, HEIGHT, origins[o], 0, &options);
            for (int l = 0; l <= terrain_info(terrain)->coarsest; l++) {
                struct terrain_extent e = terrain_level(terrain, l).extent;
                for (int64_t i = e.x0; i < e.x1; i++) // z = x: 1000 quanta are one spacing of level 0
                    assert_true(fabs((double)sample(terrain, l, i, e.y0) / 1000 - ldexp((double)i, l)) <=
                                1e-3);
            }
            terrain_destroy(terrain);
        }
    // Power: mips of 2 x 2 boxes, floor-halved, read as if they stood on the samples.
    double box[WIDTH], worst = 0;
    int count = WIDTH;
    for (int i = 0; i < WIDTH; i++) box[i] = i;
    for (int l = 1; l <= 5; l++) {
        count /= 2;
        for (int i = 0; i < count; i++) box[i] = (box[2 * i] + box[2 * i + 1]) / 2;
        for (int i = 0; i < count; i++) worst = fmax(worst, fabs(box[i] - ldexp(i, l)));
    }
    assert_true(worst == 15.5);
}

// ---- B9: small and odd worlds ----------------------------------------------

static void b9_small_worlds(void **state)
{
    (void)state;
    static const int64_t sizes[][2] = {{1, 1},  {2, 2},  {3, 3},   {1, 2},    {2, 1},
                                       {1, 17}, {17, 1}, {16, 16}, {18, 675}, {675, 18}};
    static const int64_t origins[][2] = {{0, 0}, {-1, -1}, {-7, 5}, {10000000000, -10000000000}};
    static int32_t samples[675 * 18];
    int32_t window[9 * 9];
    uint64_t random = 4;
    for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++)
        for (size_t o = 0; o < sizeof origins / sizeof *origins; o++)
            for (int finer = 0; finer < 3; finer++) {
                int64_t width = sizes[s][0], height = sizes[s][1];
                for (int64_t i = 0; i < width * height; i++)
                    samples[i] = (int32_t)(test_random(&random) % 2000);
                struct terrain_options options = {.synthesize_levels = finer, .min_size = s % 2 ? 1 : 0};
                struct terrain *terrain =
                    build(samples, width, height, origins[o][0], origins[o][1], &options);
                const struct terrain_info *info = terrain_info(terrain);
                assert_true(info->coarsest < 20);
                for (int l = info->finest; l <= info->coarsest; l++) {
                    struct terrain_extent e = terrain_level(terrain, l).extent;
                    int32_t low, high;
                    assert_true(terrain_window(terrain, l, e.x0 - 4, e.y1 - 4, 9, 9, window, TERRAIN_WAIT));
                    terrain_bounds(terrain, l, e.x0 - 4, e.y1 - 4, e.x0 + 4, e.y1 + 4, &low, &high);
                    for (int i = 0; i < 81; i++) assert_true(window[i] >= low && window[i] <= high);
                    assert_true(isfinite(terrain_level(terrain, l).rms_error_m));
                }
                struct terrain_level finest = terrain_level(terrain, info->finest);
                for (int64_t j = finest.extent.y0; j < finest.extent.y1; j += 3)
                    for (int64_t i = finest.extent.x0; i < finest.extent.x1; i++) {
                        double q, slope[2];
                        assert_true(terrain_truth_at(terrain, (double)i * finest.spacing_m[0],
                                                     (double)j * finest.spacing_m[1], &q, slope));
                        assert_true(q == sample(terrain, info->finest, i, j));
                        assert_true(isfinite(slope[0]) && isfinite(slope[1]));
                    }
                double q;
                assert_false(
                    terrain_truth_at(terrain, info->outline_m[2] + 0.25, info->outline_m[1], &q, NULL));
                assert_true(terrain_extrema(terrain)->heights >= 1);
                terrain_destroy(terrain);
            }
}

// ---- B11: overshoot --------------------------------------------------------

static void b11_cliff_overshoots_without_wrapping(void **state)
{
    (void)state;
    enum { SIDE = 8 };
    int32_t coarse[SIDE * SIDE], fine[9 * 9];
    for (int i = 0; i < SIDE * SIDE; i++) coarse[i] = i % SIDE >= SIDE / 2 ? 65535 : 0;
    assert_int_equal(upsample_coarse_size(2, 9), SIDE);
    upsample(coarse, 2, 2, 9, 9, fine); // fine sample x stands on coarse sample x / 2
    int32_t low = INT32_MAX, high = INT32_MIN;
    for (int i = 0; i < 81; i++) {
        low = fine[i] < low ? fine[i] : low;
        high = fine[i] > high ? fine[i] : high;
    }
    assert_int_equal(low, -4096);
    assert_int_equal(high, 69631);
    assert_int_equal((uint16_t)low, 61440); // power: in 16 bits they wrap
    assert_int_equal((uint16_t)high, 4095);
    // The worst there is: 28.1 % of the range on either side, also for the largest quanta there are.
    uint64_t random = 5;
    for (int n = 0; n < test_size(2000, 200000); n++) {
        for (int i = 0; i < SIDE * SIDE; i++)
            coarse[i] = test_random(&random) & 1 ? QUANTA_LIMIT : -QUANTA_LIMIT;
        upsample(coarse, 2, 2, 9, 9, fine);
        for (int i = 0; i < 81; i++) assert_true(abs(fine[i]) <= 1.5625 * QUANTA_LIMIT + 1);
    }
    // A terrain of such cliffs keeps its promise to float32.
    int32_t samples[20 * 20];
    for (int i = 0; i < 400; i++) samples[i] = test_random(&random) & 1 ? QUANTA_LIMIT : -QUANTA_LIMIT;
    struct terrain *terrain = build(samples, 20, 20, 0, 0, &(struct terrain_options){.synthesize_levels = 2});
    for (int l = -2; l <= terrain_info(terrain)->coarsest; l++) {
        struct terrain_level level = terrain_level(terrain, l);
        assert_true(level.min_q >= -QUANTA_LIMIT && level.max_q <= QUANTA_LIMIT);
    }
    terrain_destroy(terrain);
}

// ---- B13: noise far away ---------------------------------------------------

static void b13_noise_is_fixed_to_the_ground(void **state)
{
    (void)state;
    enum { SIDE = 60 };
    static int32_t samples[SIDE * SIDE];
    const int64_t origins[][2] = {
        {0, 0}, {-30, -31}, {10000000000, -10000000000}}; // 1e7 m in samples of 1 mm
    uint64_t random = 6;
    for (int i = 0; i < SIDE * SIDE; i++) samples[i] = (int32_t)(test_random(&random) % 1000);
    for (int o = 0; o < 3; o++) {
        struct terrain_options options = {.synthesize_levels = 2, .seed = 77};
        struct terrain *terrain = build(samples, SIDE, SIDE, origins[o][0], origins[o][1], &options);
        for (int level = -1; level >= -2; level--) {
            int64_t x0 = origins[o][0] * (1 << -level) + 20, y0 = origins[o][1] * (1 << -level) + 20;
            int32_t coarse[40 * 40], fine[40 * 40], predicted[40 * 40];
            int size = upsample_coarse_size(x0, 40);
            terrain_window(terrain, level + 1, (x0 >> 1) - 1, (y0 >> 1) - 1, size, size, coarse,
                           TERRAIN_WAIT);
            terrain_window(terrain, level, x0, y0, 40, 40, fine, TERRAIN_WAIT);
            upsample(coarse, x0, y0, 40, 40, predicted);
            double sigma = 0;
            for (int i = 0; i < 1600;
                 i++) { // what was added is one sigma times the deviate of the absolute sample
                double z = synthesis_normal(x0 + i % 40, y0 + i / 40, level, 77),
                       added = fine[i] - predicted[i];
                if (sigma == 0 && fabs(z) > 1) sigma = added / z;
            }
            assert_true(sigma > 10);
            for (int i = 0; i < 1600;
                 i++) { // half a quantum of rounding here, and half over |z| > 1 in sigma
                double z = synthesis_normal(x0 + i % 40, y0 + i / 40, level, 77),
                       added = fine[i] - predicted[i];
                assert_true(fabs(added - sigma * z) <= 0.5 + 0.5 * fabs(z));
            }
        }
        terrain_destroy(terrain);
    }
    // Twenty levels, each with its own noise at the same indices.
    double product = 0;
    int count = 0;
    for (int level = -1; level > -20; level--)
        for (int64_t i = 0; i < 1000; i++, count++) {
            int64_t at = 10000000000 + i;
            product += synthesis_normal(at, -at, level, 1) * synthesis_normal(at, -at, level - 1, 1);
        }
    assert_true(fabs(product / count) < 5 / sqrt(count));
}

// What a terrain with two synthesised levels adds to U, in its finest level: the noise of `level` at SIDE x
// SIDE samples.
enum { NOISE_SIDE = 200 };
static void added_noise(const struct terrain *terrain, int level, double (*noise)[NOISE_SIDE])
{
    static int32_t fine[NOISE_SIDE * NOISE_SIDE], predicted[NOISE_SIDE * NOISE_SIDE],
        coarse[(NOISE_SIDE / 2 + 4) * (NOISE_SIDE / 2 + 4)];
    int size = upsample_coarse_size(-100, NOISE_SIDE);
    terrain_window(terrain, level + 1, -51, -51, size, size, coarse, TERRAIN_WAIT);
    terrain_window(terrain, level, -100, -100, NOISE_SIDE, NOISE_SIDE, fine, TERRAIN_WAIT);
    upsample(coarse, -100, -100, NOISE_SIDE, NOISE_SIDE, predicted);
    double sigma = terrain_level(terrain, level).noise_q;
    for (int i = 0; i < NOISE_SIDE * NOISE_SIDE; i++)
        noise[i / NOISE_SIDE][i % NOISE_SIDE] = (fine[i] - predicted[i]) / sigma;
}

// Independent deviates: a mean product of n pairs is normal with deviation 1 / sqrt(n); five of them is one
// in 1.7 million.  The published table has a correlation of 1, up to the variance of its 2500 deviates (5
// sqrt(2 / 2500)) and half a quantum of rounding.
static void b13_published_table_repeats(void **state)
{
    (void)state;
    enum { STORED = 120 };
    static int32_t samples[STORED * STORED];
    static double noise[2][NOISE_SIDE][NOISE_SIDE];
    uint64_t random = 8;
    for (int i = 0; i < STORED * STORED; i++) samples[i] = (int32_t)(test_random(&random) % 1000);
    for (int published = 0; published < 2; published++) {
        struct terrain_options options = {
            .synthesize_levels = 2, .seed = 9, .noise = published ? TERRAIN_NOISE_TABLE : TERRAIN_NOISE_HASH};
        struct terrain *terrain = build(samples, STORED, STORED, -STORED / 2, -STORED / 2, &options);
        double period = 0, level = 0;
        int pairs = NOISE_SIDE * (NOISE_SIDE - SYNTHESIS_TABLE), all = NOISE_SIDE * NOISE_SIDE;
        for (int k = 0; k < 2; k++) added_noise(terrain, -1 - k, noise[k]);
        for (int j = 0; j < NOISE_SIDE; j++)
            for (int i = 0; i < NOISE_SIDE; i++) {
                level += noise[0][j][i] * noise[1][j][i];
                if (i + SYNTHESIS_TABLE < NOISE_SIDE)
                    period += noise[0][j][i] * noise[0][j][i + SYNTHESIS_TABLE];
            }
        FIGURE("B13 %s: correlation after %d samples %.3f, between levels %.3f",
               published ? "published table" : "hash", SYNTHESIS_TABLE, period / pairs, level / all);
        double sampling = 5 * sqrt(2.0 / (SYNTHESIS_TABLE * SYNTHESIS_TABLE)), rounding = 0.05;
        if (published) {
            assert_true(fabs(period / pairs - 1) < sampling + rounding);
            assert_true(fabs(level / all - 1) < sampling + rounding);
        } else {
            assert_true(fabs(period / pairs) < 5 / sqrt(pairs));
            assert_true(fabs(level / all) < 5 / sqrt(all));
        }
        terrain_destroy(terrain);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(e1_any_void_pattern),
        cmocka_unit_test(e2_deep_and_high_round_trip),
        cmocka_unit_test(e3_flat_is_exact),
        cmocka_unit_test(e3_tilted_planes_are_exact),
        cmocka_unit_test(e4_needle),
        cmocka_unit_test(e5_checkerboard),
        cmocka_unit_test(a11_ramp_stays_in_place),
        cmocka_unit_test(b9_small_worlds),
        cmocka_unit_test(b11_cliff_overshoots_without_wrapping),
        cmocka_unit_test(b13_noise_is_fixed_to_the_ground),
        cmocka_unit_test(b13_published_table_repeats),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
