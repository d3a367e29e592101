// The Mars paper's block coder and its run lengths (numerics.md, B10 and B12), and the clipmap paper's
// pyramid. SPDX-License-Identifier: MIT
#include "tests/folder.h"

#include "common/terrain/relief/codec_mars.h"
#include "common/terrain/relief/filter_fit.h"
#include "common/terrain/relief/relief_file.h"
#include "common/terrain/relief/relief_pack.h"
#include "common/terrain/upsample.h"

#include <string.h>

// ---- run lengths (B12) -----------------------------------------------------

static void check_runs(const int32_t *values, size_t count)
{
    uint8_t *bytes = malloc(4 * count + 1);
    int32_t *back = malloc((count + 1) * sizeof *back);
    size_t size = runs_encode(values, count, bytes);
    bool narrow = true;
    for (size_t i = 0; i < count; i++) narrow &= values[i] == (int16_t)values[i];
    assert_true(size <= (narrow ? 2 : 4) * count + 1); // never more than plain values and a byte
    assert_int_equal(runs_decode(bytes, size, back, count), size);
    assert_memory_equal(back, values, count * sizeof *back);
    for (size_t cut = 0; cut < size;
         cut += 1 + size / 50) { // of its own, so that a sanitizer sees a read beyond
        uint8_t *part = malloc(cut + 1);
        memcpy(part, bytes, cut);
        assert_int_equal(runs_decode(part, cut, back, count), 0);
        free(part);
    }
    free(bytes);
    free(back);
}

static void test_runs_give_back_what_they_took(void **state)
{
    (void)state;
    enum { MOST = 70000 };
    int32_t *values = calloc(MOST, sizeof *values);
    uint64_t dice = 1;
    check_runs(values, MOST); // a run of more than 65,536
    check_runs(values, 1);
    for (int i = 0; i < MOST; i++) values[i] = 1 + (int32_t)(test_random(&dice) % 60000) - 30001 * (i & 1);
    check_runs(values, MOST); // no zero at all, or hardly any
    for (int i = 0; i < 4000; i++) values[i] = (int32_t)(test_random(&dice) % (1u << 27)) - (1 << 26);
    check_runs(values, 4000); // wide
    for (int n = 0; n < test_size(200, 20000); n++) {
        size_t count = 1 + test_random(&dice) % 3000, rare = 1 + test_random(&dice) % 50;
        for (size_t i = 0; i < count; i++)
            values[i] = test_random(&dice) % rare ? 0 : (int32_t)(test_random(&dice) % 200) - 100;
        check_runs(values, count);
    }
    free(values);
}

static void test_runs_survive_any_bytes(void **state)
{
    (void)state;
    int32_t values[300];
    uint64_t dice = 2;
    for (int n = 0; n < test_size(20000, 1000000); n++) {
        size_t size = test_random(&dice) % 40;
        uint8_t *bytes = malloc(size + 1);
        for (size_t i = 0; i < size; i++) bytes[i] = (uint8_t)test_random(&dice);
        if (size) bytes[0] = (uint8_t)(bytes[0] % 3 * 2);
        assert_true(runs_decode(bytes, size, values, 1 + test_random(&dice) % 300) <= size);
        free(bytes);
    }
}

// ---- error growth (B10) ----------------------------------------------------

struct growth {
    double max, mean;
};

// Error of the finest level after so many levels.
static struct growth growth_of(const int32_t *samples, int side, int levels, struct mars_form form)
{
    size_t count = (size_t)side * (size_t)side, room = mars_most(side, side);
    uint8_t *bytes = malloc(room);
    int32_t *back = malloc(count * sizeof *back);
    form.least = 1 + (side - 1) / (1 << levels); // sides are 2^k + 1
    size_t size = mars_encode(samples, side, side, &form, bytes, room);
    assert_true(size > 0 && size <= room);
    assert_true(mars_decode(bytes, size, side, side, &form, back));
    assert_false(mars_decode(bytes, size - 1, side, side, &form, back));
    assert_true(mars_decode(bytes, size, side, side, &form, back));
    struct growth g = {0, 0};
    for (size_t i = 0; i < count; i++) {
        g.max = fmax(g.max, abs(back[i] - samples[i]));
        g.mean += (double)(back[i] - samples[i]) / (double)count;
    }
    free(bytes);
    free(back);
    return g;
}

static void test_errors_add_up_in_the_open_loop_only(void **state)
{
    (void)state;
    enum { SIDE = 257, LEVELS = 7 };
    static int32_t samples[SIDE * SIDE];
    uint64_t dice = 3;
    for (int i = 0; i < SIDE * SIDE; i++)
        samples[i] = (int32_t)(9000 + 4000 * sin(i % SIDE * 0.021) * cos(i / SIDE * 0.017)) +
                     (int32_t)(test_random(&dice) % 400);
    const struct mars_form published = {0}, open = {.rounded = true},
                           closed = {.closed = true, .rounded = true}, floored = {.closed = true};
    struct growth first = {0}, last = {0};
    for (int levels = 1; levels <= LEVELS; levels++) {
        struct growth g = growth_of(samples, SIDE, levels, published),
                      o = growth_of(samples, SIDE, levels, open),
                      c = growth_of(samples, SIDE, levels, closed),
                      f = growth_of(samples, SIDE, levels, floored);
        FIGURE("B10, step 2, %d levels: published max %.0f mean %.2f; rounded open loop max %.0f mean %.2f; "
               "closed "
               "loop max %.0f mean %.2f; closed, bit dropped max %.0f mean %.2f",
               levels, g.max, g.mean, o.max, o.mean, c.max, c.mean, f.max, f.mean);
        assert_true(c.max <= 1);               // half a step, at any depth
        assert_true(f.max <= 2 && f.mean < 0); // a step, and one way
        if (levels == 1) first = g;
        last = g;
    }
    // Each level drops half a unit on average, and U keeps a mean: seven levels drop seven halves.
    assert_true(fabs(first.mean + 0.5) < 0.1 && fabs(last.mean + 0.5 * LEVELS) < 0.5);
    assert_true(last.max > 2); // more than any closed loop
    assert_true(growth_of(samples, SIDE, LEVELS, open).max > 1);
}

// ---- the pyramid -----------------------------------------------------------

static struct heightfield hills(int width, int height)
{
    struct heightfield field = {.name = "hills",
                                .width = width,
                                .height = height,
                                .spacing_m = {30, 30},
                                .quantum_m = 1,
                                .samples = malloc((size_t)width * (size_t)height * sizeof(int32_t))};
    uint64_t dice = 5;
    for (int i = 0; i < width * height; i++)
        field.samples[i] = (int32_t)(3000 + 900 * sin(i % width * 0.11) * cos(i / width * 0.07)) +
                           (int32_t)(test_random(&dice) % 30);
    return field;
}

// Largest difference of a level of the file from the level that D made of the source.
static int32_t worst_of(const struct relief *relief, int level, const struct patch *wanted)
{
    int64_t width = rect_width(&wanted->rect), height = rect_height(&wanted->rect);
    int32_t *samples = malloc((size_t)(width * height) * sizeof *samples), worst = 0;
    assert_true(relief_window(relief, level, 0, 0, width, height, samples));
    for (int64_t i = 0; i < width * height; i++) {
        int32_t off = abs(samples[i] - wanted->samples[i]);
        worst = off > worst ? off : worst;
    }
    free(samples);
    return worst;
}

static void check_pyramid(int width, int height, int max_m, bool scaled)
{
    struct heightfield field = hills(width, height);
    struct relief_pack_options options = {.layout = LAYOUT_PYRAMID, .max_m = max_m, .scaled = scaled};
    struct relief_header header;
    assert_true(relief_pack(&field, &options, in_folder("pyramid.relief"), &header));
    struct relief *relief = relief_open(in_folder("pyramid.relief"));
    assert_non_null(relief);
    const struct grid *grid = relief_grid(relief);
    struct patch level = {{0, 0, width, height}, field.samples};
    bool looser = false;
    for (int l = 0; l < grid->count; l++) {
        int32_t worst = worst_of(relief, l, &level);
        assert_true(worst <= (scaled ? (2 * max_m + 1) << l : max_m));
        looser |= worst > max_m;
        struct patch bands[CODER_BANDS] = {{{0, 0, 0, 0}, NULL}};
        bands[0].samples = malloc((size_t)(width * height) * sizeof(int32_t));
        assert_true(layout_pyramid_reduce(&level, bands));
        free(level.samples);
        level = bands[0];
    }
    if (scaled && max_m > 1) assert_true(looser); // the scaled form does what it is selected for
    free(level.samples);
    relief_close(relief);
}

static void test_pyramid_is_as_accurate_on_all_levels(void **state)
{
    (void)state;
    static const int SIZES[][2] = {{1, 1}, {1, 50}, {9, 8}, {65, 64}, {129, 66}, {200, 257}};
    for (size_t n = 0; n < sizeof SIZES / sizeof *SIZES; n++)
        for (int max_m = 0; max_m < 9; max_m += 4) check_pyramid(SIZES[n][0], SIZES[n][1], max_m, false);
    check_pyramid(200, 257, 8, true);
}

// ---- the filter ------------------------------------------------------------

static bool load(struct heightfield *field, const char *name)
{
    char path[1024];
    if (!test_data(name, path)) return false;
    assert_true(heightfield_load(field, path));
    return true;
}

static double rms_of_taps(const struct heightfield *field, enum terrain_filter filter)
{
    const struct filter_taps *taps = filter_taps(filter);
    double half[FILTER_HALF];
    for (int k = 0; k < FILTER_HALF; k++) half[k] = ldexp(taps->half[k], -taps->shift);
    return field->quantum_m * filter_rms_q(field->samples, field->width, field->height, half);
}

static void test_optimal_filter_is_the_solution(void **state)
{
    (void)state;
    static const char *const LEARNT[] = {"bigtujunga_30m_1197x643.png", "everest_srtm3_1201.png",
                                         "jacksboro_403x344.png"};
    struct filter_sums sums = {0}, own = {0};
    struct heightfield field = {0};
    double half[FILTER_HALF];
    for (int i = 0; i < 3; i++) {
        if (!load(&field, LEARNT[i])) return;
        filter_sums_add(&sums, field.samples, field.width, field.height);
        heightfield_finish(&field);
    }
    assert_true(filter_solve(&sums, half));
    const struct filter_taps *taps = filter_taps(TERRAIN_FILTER_OPTIMAL);
    for (int k = 0; k < FILTER_HALF; k++) // rounded, the middle one so that they sum to 1
        assert_true(fabs(ldexp(half[k], taps->shift) - taps->half[k]) <= (k ? 0.5 : 5.5));
    if (!load(&field, "puget_srtm3_strip_3601x1201.png")) return;
    filter_sums_add(&own, field.samples, field.width, field.height);
    assert_true(filter_solve(&own, half));
    double best = field.quantum_m * filter_rms_q(field.samples, field.width, field.height, half);
    double rms[TERRAIN_FILTERS];
    for (enum terrain_filter f = 0; f < TERRAIN_FILTERS; f++) {
        rms[f] = rms_of_taps(&field, f);
        if (f != TERRAIN_FILTER_OPTIMAL) assert_true(rms[f] > rms_of_taps(&field, TERRAIN_FILTER_OPTIMAL));
    }
    FIGURE("rms of U(D(T)) - T, Puget strip: optimal %.3f m (solved on this map %.3f), linear %.3f, "
           "half-band %.3f, "
           "tent %.3f, decimate %.3f",
           rms[TERRAIN_FILTER_OPTIMAL], best, rms[TERRAIN_FILTER_LINEAR], rms[TERRAIN_FILTER_HALFBAND],
           rms[TERRAIN_FILTER_TENT], rms[TERRAIN_FILTER_DECIMATE]);
    assert_true(rms[TERRAIN_FILTER_OPTIMAL] <= 1.01 * best); // taps of other maps serve
    heightfield_finish(&field);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_runs_give_back_what_they_took),
        cmocka_unit_test(test_runs_survive_any_bytes),
        cmocka_unit_test(test_errors_add_up_in_the_open_loop_only),
        cmocka_unit_test(test_pyramid_is_as_accurate_on_all_levels),
        cmocka_unit_test(test_optimal_filter_is_the_solution),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
