// U, D and the noise between levels: exact values, exact polynomials, independence of the window.
// SPDX-License-Identifier: MIT
#include "tests/test.h"

#include "common/terrain/generate.h"
#include "common/terrain/synthesis.h"
#include "common/terrain/terrain.h"
#include "common/terrain/upsample.h"

#include <string.h>

static int64_t floor_half(int64_t x)
{
    return x >= 0 ? x / 2 : -((1 - x) / 2);
}

static int64_t floor_divide(int64_t a, int64_t b)
{
    return a >= 0 ? a / b : -((b - 1 - a) / b);
}

// U at one fine sample, as numerics.md section 5 writes it; `coarse` gives any coarse sample.
static int64_t plain_u(int32_t (*coarse)(int64_t i, int64_t j), int64_t x, int64_t y)
{
    static const int64_t W[4] = {-1, 9, 9, -1};
    int64_t i = floor_half(x), j = floor_half(y), sum = 0;
    if (x % 2 == 0 && y % 2 == 0) return coarse(i, j);
    for (int k = 0; k < 4; k++) {
        if (y % 2 == 0) sum += W[k] * coarse(i - 1 + k, j);
        if (x % 2 == 0) sum += W[k] * coarse(i, j - 1 + k);
        for (int m = 0; m < 4 && x % 2 && y % 2; m++) sum += W[k] * W[m] * coarse(i - 1 + k, j - 1 + m);
    }
    return x % 2 && y % 2 ? floor_divide(sum + 128, 256) : floor_divide(sum + 8, 16);
}

static int32_t noise(int64_t i, int64_t j) // full range of quanta
{
    uint64_t random = (uint64_t)i * 0x9e3779b97f4a7c15u ^ (uint64_t)j * 0xd1342543de82ef95u;
    return (int32_t)(test_random(&random) % (2 * QUANTA_LIMIT + 1)) - QUANTA_LIMIT;
}

static int32_t extremes(int64_t i, int64_t j) // the pattern of signs that makes the sum of U largest
{
    int a = (int)((i % 4 + 4) % 4), b = (int)((j % 4 + 4) % 4);
    return ((a == 0 || a == 3) ^ (b == 0 || b == 3)) ? -QUANTA_LIMIT : QUANTA_LIMIT;
}

static int32_t cubic(int64_t i, int64_t j) // multiples of 16 so that every U is whole
{
    return (int32_t)(16 *
                     (i * i * i - 4 * i * i * j + 3 * j * j - 7 * i * j * j + 2 * j * j * j + 11 * i - 5));
}

static void predict(int32_t (*coarse)(int64_t i, int64_t j), int64_t x0, int64_t y0, int width, int height,
                    int32_t *fine)
{
    int columns = upsample_coarse_size(x0, width), rows = upsample_coarse_size(y0, height);
    int32_t *window = malloc((size_t)columns * (size_t)rows * sizeof *window);
    for (int j = 0; j < rows; j++)
        for (int i = 0; i < columns; i++)
            window[j * columns + i] = coarse(floor_half(x0) - 1 + i, floor_half(y0) - 1 + j);
    upsample(window, x0, y0, width, height, fine);
    free(window);
}

static void u_is_the_formula_in_any_window(void **state) // numerics.md, B10 and section 5
{
    (void)state;
    uint64_t random = 1;
    int windows = test_size(200, 10000);
    static int32_t fine[1100 * 40];
    int32_t (*const sources[])(int64_t, int64_t) = {noise, extremes};
    for (int n = 0; n < windows; n++) {
        int width = 1 + (int)(test_random(&random) % (n % 20 ? 40 : 1100)),
            height = 1 + (int)(test_random(&random) % 40);
        int64_t x0 = (int64_t)(test_random(&random) % 100) - 50,
                y0 = (int64_t)(test_random(&random) % 100) - 50;
        if (n % 3 == 0) x0 += 10000000000, y0 -= 10000000000;
        predict(sources[n % 2], x0, y0, width, height, fine);
        for (int j = 0; j < height; j++)
            for (int i = 0; i < width; i++)
                assert_int_equal(fine[j * width + i], plain_u(sources[n % 2], x0 + i, y0 + j));
    }
    FIGURE("windows of U equal to the formula: %d", windows);
}

static void u_keeps_cubics(void **state)
{
    (void)state;
    int32_t fine[40 * 40];
    predict(cubic, -17, -20, 40, 40, fine);
    for (int64_t j = 0; j < 40; j++)
        for (int64_t i = 0; i < 40; i++) {
            double x = (double)(i - 17) / 2, y = (double)(j - 20) / 2;
            double z =
                16 * (x * x * x - 4 * x * x * y + 3 * y * y - 7 * x * y * y + 2 * y * y * y + 11 * x - 5);
            assert_true(fine[j * 40 + i] == z);
        }
}

// ---- D ---------------------------------------------------------------------

// D in rationals from the definition: ghosts on the line through the end and the sample four cells inside.
static double ghosted(const int32_t *line, int64_t stride, int64_t size, int64_t at)
{
    int64_t cells = size - 1 < 4 ? size - 1 : 4, end = at < 0 ? 0 : size - 1;
    if (at >= 0 && at < size) return line[at * stride];
    int64_t inner = at < 0 ? cells : size - 1 - cells;
    double z = line[end * stride];
    return cells ? z + (double)llabs(at - end) * (z - line[inner * stride]) / (double)cells : z;
}

static void d_is_the_formula(void **state)
{
    (void)state;
    static const double WEIGHTS[4][7] = {{0, -1 / 8., 2 / 8., 6 / 8., 2 / 8., -1 / 8., 0},
                                         {-1 / 32., 0, 9 / 32., 16 / 32., 9 / 32., 0, -1 / 32.},
                                         {0, 0, 1 / 4., 2 / 4., 1 / 4., 0, 0},
                                         {0, 0, 0, 1, 0, 0, 0}};
    uint64_t random = 2;
    for (int n = 0; n < test_size(150, 5000); n++) {
        int64_t size[2] = {1 + (int64_t)(test_random(&random) % 40),
                           1 + (int64_t)(test_random(&random) % 40)};
        int64_t first[2] = {(int64_t)(test_random(&random) % 20) - 10,
                            (int64_t)(test_random(&random) % 20) - 10};
        int32_t fine[40 * 40], coarse[25 * 25];
        for (int64_t i = 0; i < size[0] * size[1]; i++)
            fine[i] = (int32_t)(test_random(&random) % 200001) - 100000;
        enum terrain_filter filter = (enum terrain_filter)(n % 4);
        double gain = 0; // sum of the weights' magnitudes
        for (int k = 0; k < 7; k++) gain += fabs(WEIGHTS[filter][k]);
        assert_true(downsample(fine, first, size, filter, coarse));
        int64_t columns = downsample_size(first[0], size[0]), rows = downsample_size(first[1], size[1]);
        for (int64_t j = 0; j < rows; j++)
            for (int64_t i = 0; i < columns; i++) {
                double sum = 0;
                for (int b = -3; b <= 3; b++) { // along y over rows that are extended along x
                    double row[64];
                    int64_t x = 2 * (downsample_first(first[0]) + i) - first[0];
                    int64_t y = 2 * (downsample_first(first[1]) + j) - first[1] + b;
                    int64_t cells = size[1] - 1 < 4 ? size[1] - 1 : 4, end = y < 0 ? 0 : size[1] - 1;
                    int64_t inner = y < 0 ? cells : size[1] - 1 - cells;
                    for (int a = -3; a <= 3; a++) {
                        if (y >= 0 && y < size[1])
                            row[a + 3] = ghosted(fine + y * size[0], 1, size[0], x + a);
                        else {
                            double z = ghosted(fine + end * size[0], 1, size[0], x + a);
                            double z_inner = ghosted(fine + inner * size[0], 1, size[0], x + a);
                            row[a + 3] =
                                cells ? z + (double)llabs(y - end) * (z - z_inner) / (double)cells : z;
                        }
                        sum += WEIGHTS[filter][a + 3] * WEIGHTS[filter][b + 3] * row[a + 3];
                    }
                }
                // Half a quantum from the last rounding; ghosts are rounded towards the border sample, each
                // by less than 1 along x and by less than 1 / 2^shift along y.
                bool inside = 2 * (downsample_first(first[0]) + i) - first[0] >= 3 &&
                              2 * (downsample_first(first[0]) + i) - first[0] <= size[0] - 4;
                inside &= 2 * (downsample_first(first[1]) + j) - first[1] >= 3 &&
                          2 * (downsample_first(first[1]) + j) - first[1] <= size[1] - 4;
                double expected = sum, got = coarse[j * columns + i];
                assert_true(fabs(got - expected) <= (inside ? 0.5 : 0.5 + gain * gain * 9));
            }
    }
}

static void d_is_the_adjoint_of_u(void **state)
{
    (void)state;
    // The response of U to a coarse impulse, halved, is the half-band filter: <U a, b> = 2 <a, D b> along
    // each axis.
    int32_t coarse[8 * 8] = {0}, fine[16 * 16], single[31] = {0};
    coarse[3 * 8 + 3] = 1 << 12;
    assert_int_equal(upsample_coarse_size(2, 9), 8); // samples 2..10 need the coarse 0..7
    upsample(coarse, 2, 2, 9, 9, fine);              // fine sample 6 stands on the impulse
    int64_t first[2] = {0, 0}, size[2] = {31, 1};
    for (int tap = -3; tap <= 3; tap++) {
        int32_t result[16];
        memset(single, 0, sizeof single);
        single[14 + tap] = 1 << 12;
        assert_true(downsample(single, first, size, TERRAIN_FILTER_HALFBAND, result));
        int32_t u = 6 + tap - 2 < 0 ? 0 : fine[(6 - 2) * 9 + 6 + tap - 2];
        assert_int_equal(2 * result[7], u);
    }
}

// A surface that a coarse grid draws, linear along the edges of its cells, gives that grid back.
static void d_is_the_dual_of_linear_interpolation(void **state)
{
    (void)state;
    enum { COARSE = 40, FINE = 2 * COARSE - 1 };
    static int32_t coarse[COARSE * COARSE], fine[FINE * FINE], back[COARSE * COARSE];
    static const enum terrain_filter filters[] = {TERRAIN_FILTER_LINEAR, TERRAIN_FILTER_HALFBAND};
    uint64_t random = 5;
    for (int k = 0; k < COARSE * COARSE; k++) coarse[k] = 4 * (int32_t)(test_random(&random) % 10000);
    for (int j = 0; j < FINE; j++)
        for (int i = 0; i < FINE; i++) {
            const int32_t *c = coarse + j / 2 * COARSE + i / 2;
            int right = i & 1, up = (j & 1) * COARSE;
            fine[j * FINE + i] = (c[0] + c[right] + c[up] + c[right + up]) / 4;
        }
    int64_t first[2] = {0, 0}, size[2] = {FINE, FINE};
    int changed[2] = {0};
    for (int f = 0; f < 2; f++) {
        assert_true(downsample(fine, first, size, filters[f], back));
        for (int j = 1; j < COARSE - 1; j++) // beyond the border there are ghosts
            for (int i = 1; i < COARSE - 1; i++) changed[f] += back[j * COARSE + i] != coarse[j * COARSE + i];
    }
    assert_int_equal(changed[0], 0);
    assert_true(changed[1] > 0);
}

// ---- noise -----------------------------------------------------------------

static void noise_is_normal(void **state)
{
    (void)state;
    int side = test_size(1000, 8000);
    double sum = 0, squares = 0, fourth = 0, count = (double)side * side;
    double east = 0, north = 0, level = 0, seed = 0, period = 0;
    int beyond[4] = {0};
    for (int j = 0; j < side; j++)
        for (int i = 0; i < side; i++) {
            double z = synthesis_normal(i - side / 2, j - side / 2, -1, 7);
            sum += z, squares += z * z, fourth += z * z * z * z;
            for (int k = 0; k < 4; k++) beyond[k] += z > k;
            east += z * synthesis_normal(i - side / 2 + 1, j - side / 2, -1, 7);
            north += z * synthesis_normal(i - side / 2, j - side / 2 + 1, -1, 7);
            level += z * synthesis_normal(i - side / 2, j - side / 2, -2, 7);
            seed += z * synthesis_normal(i - side / 2, j - side / 2, -1, 8);
            period += z * synthesis_normal(i - side / 2 + 50, j - side / 2, -1,
                                           7); // the published table repeats here
        }
    double sigma = 1 / sqrt(count); // of each mean of products; five of them is one in 1.7 million
    assert_true(fabs(sum / count) < 5 * sigma);
    assert_true(fabs(squares / count - 1) < 5 * sqrt(2) * sigma);
    assert_true(fabs(fourth / count - 2.97) <
                5 * sqrt(96) * sigma); // excess kurtosis -8.008/16.167^2 = -0.03
    assert_true(fabs(east / count) < 5 * sigma && fabs(north / count) < 5 * sigma &&
                fabs(level / count) < 5 * sigma);
    assert_true(fabs(seed / count) < 5 * sigma && fabs(period / count) < 5 * sigma);
    static const double TAIL[4] = {0.5, 0.158655, 0.022750, 0.001350};
    // A density of kurtosis -0.03 moves a tail by at most 0.03/24 of the third derivative of the normal one
    // (1.38): 0.0017.
    for (int k = 0; k < 4; k++) assert_true(fabs(beyond[k] / count - TAIL[k]) < 0.0018 + 5 * 0.5 * sigma);
}

static void noise_is_the_same_by_any_road(void **state) // numerics.md, B13
{
    (void)state;
    uint64_t random = 3;
    for (int n = 0; n < test_size(2000, 100000); n++) {
        int64_t i0 = (int64_t)(test_random(&random) >> 20) -
                     ((int64_t)1 << 43); // as far as 1 mm samples at 1e7 m and beyond
        int64_t j = (int64_t)(test_random(&random) >> 20) - ((int64_t)1 << 43);
        int level = -(int)(test_random(&random) % 20) - 1, count = 1 + (int)(test_random(&random) % 60);
        int32_t row[60] = {0};
        synthesis_add_row(row, count, i0, j, level, 5, 1000);
        for (int i = count - 1; i >= 0; i--)
            assert_int_equal(row[i], (int32_t)floor(1000 * synthesis_normal(i0 + i, j, level, 5) + 0.5));
    }
}

static void published_noise_is_the_table(void **state) // section 8
{
    (void)state;
    static struct synthesis_table table;
    synthesis_fill_table(&table, 5);
    for (int64_t j = -130; j < 130; j++)
        for (int64_t i0 = -120; i0 < 20; i0 += 7) {
            int32_t row[120] = {0};
            synthesis_add_table_row(row, 120, i0, j, &table, 1000);
            for (int64_t i = 0; i < 120; i++) {
                double z = table.deviates[(j % 50 + 50) % 50][((i0 + i) % 50 + 50) % 50];
                assert_int_equal(row[i], (int32_t)floor(1000 * z + 0.5));
            }
        }
}

static double residual_rms(const struct terrain *terrain, int level)
{
    struct terrain_extent e = terrain_level(terrain, level).extent;
    int width = (int)(e.x1 - e.x0) - 8, height = (int)(e.y1 - e.y0) - 8;
    int64_t x0 = e.x0 + 4, y0 = e.y0 + 4; // away from the border, where U only extrapolates
    int columns = upsample_coarse_size(x0, width), rows = upsample_coarse_size(y0, height);
    int32_t *coarse = malloc((size_t)columns * (size_t)rows * sizeof *coarse);
    int32_t *fine = malloc(2 * (size_t)width * (size_t)height * sizeof *fine),
            *predicted = fine + (size_t)width * (size_t)height;
    terrain_window(terrain, level + 1, floor_half(x0) - 1, floor_half(y0) - 1, columns, rows, coarse,
                   TERRAIN_WAIT);
    terrain_window(terrain, level, x0, y0, width, height, fine, TERRAIN_WAIT);
    upsample(coarse, x0, y0, width, height, predicted);
    double squares = 0, count = (double)width * height;
    for (int i = 0; i < width * height; i++)
        squares += (double)(fine[i] - predicted[i]) * (double)(fine[i] - predicted[i]);
    free(coarse);
    free(fine);
    return sqrt(squares / count);
}

static void noise_follows_the_residuals(void **state)
{
    (void)state;
    struct heightfield field;
    struct generate_options made = {
        .kind = "fractal", .width = 513, .height = 513, .spacing_m = 30, .seed = 4};
    assert_true(generate(&field, &made));
    struct terrain_grid grid = {"fractal", field.samples,   513,           513, {0, 0},
                                {30, 30},  field.quantum_m, field.offset_m};
    struct terrain *terrain =
        terrain_from_grid(&grid, &(struct terrain_options){.synthesize_levels = 3, .seed = 4});
    // The line through the logarithms of the residuals of levels 0 to 4 (513 down to 33 samples a side).
    double sum = 0, slope = 0;
    for (int l = 0; l < 5; l++) {
        double log_rms = log2(residual_rms(terrain, l));
        sum += log_rms;
        slope += (l - 2) * log_rms / 10;
    }
    assert_true(slope > 0.5 && slope < 1.2); // made with H = 0.85; D takes a share from each level
    for (int l = -1; l >= -3; l--) {
        // What was added is what U does not predict; its rms is that of n deviates: good to 1 / sqrt(2 n),
        // and rounding to whole quanta adds 1/12 to the variance.
        double rms = residual_rms(terrain, l), expected = exp2(sum / 5 + slope * (l - 2)), n = 1e6;
        FIGURE("noise of level %d: %.1f quanta rms, the residuals of stored levels call for %.1f", l, rms,
               expected);
        assert_true(fabs(rms / expected - 1) < 5 / sqrt(2 * n) + 1 / (24 * expected * expected));
    }
    terrain_destroy(terrain);
    heightfield_finish(&field);
    // Flat ground has no residuals: nothing is made up.
    int32_t flat[40 * 40];
    for (int i = 0; i < 40 * 40; i++) flat[i] = 77;
    grid = (struct terrain_grid){"flat", flat, 40, 40, {0, 0}, {30, 30}, 1, 0};
    terrain = terrain_from_grid(&grid, &(struct terrain_options){.synthesize_levels = 2});
    struct terrain_level finest = terrain_level(terrain, -2);
    assert_true(finest.min_q == finest.max_q);
    terrain_destroy(terrain);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(u_is_the_formula_in_any_window),
        cmocka_unit_test(u_keeps_cubics),
        cmocka_unit_test(d_is_the_formula),
        cmocka_unit_test(d_is_the_adjoint_of_u),
        cmocka_unit_test(d_is_the_dual_of_linear_interpolation),
        cmocka_unit_test(noise_is_normal),
        cmocka_unit_test(noise_is_the_same_by_any_road),
        cmocka_unit_test(published_noise_is_the_table),
        cmocka_unit_test(noise_follows_the_residuals),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
