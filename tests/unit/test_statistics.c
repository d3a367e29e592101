// Statistics of the harness against known answers.
// SPDX-License-Identifier: MIT
#include "bench/statistics.h"
#include "tests/test.h"

#include <string.h>

// E8: nearest rank with integers.  Percentile p of 1..n is the rank itself, ceil(p n).
static void test_percentile_is_nearest_rank(void **state)
{
    (void)state;
    const struct {
        int n, per_mille, expected;
    } cases[] = {{1, 500, 1},       {2, 500, 1},        {3, 500, 2},  {10, 999, 10},
                 {999, 999, 999},   {1000, 999, 999},   {100, 70, 7}, {200, 70, 14},
                 {2000, 999, 1998}, {1000, 1000, 1000}, {7, 1, 1}};
    for (size_t c = 0; c < sizeof cases / sizeof *cases; c++) {
        double values[2000];
        for (int i = 0; i < cases[c].n; i++) values[i] = cases[c].n - i;
        assert_true(percentile(values, (size_t)cases[c].n, cases[c].per_mille) == cases[c].expected);
    }
    assert_true(isnan(percentile(NULL, 0, 500)));
}

static void test_minimum_over_repeats_then_percentiles(void **state)
{
    (void)state;
    const double times[] = {5, 9, 1, 4, 3, 2, 6, 8, 7}; // 3 repeats of 3 frames: minima 4, 3, 1
    double least[3];
    minimum_over_repeats(times, 3, 3, least);
    assert_true(least[0] == 4 && least[1] == 3 && least[2] == 1);
    struct time_summary summary = summarize_times(times, 3, 3, 7);
    assert_true(summary.median == 3 && summary.min == 1 && summary.max == 4 && summary.has_ci);
    assert_true(summary.ci95[0] <= summary.median && summary.median <= summary.ci95[1]);
    assert_false(summarize_times(times, 2, 3, 7).has_ci);
}

static void test_rank_correlation_known_answers(void **state)
{
    (void)state;
    const double x[] = {1, 2, 3, 4, 5}, down[] = {50, 40, 30, 20, 10}, tied[] = {1, 1, 2, 2, 3},
                 flat[] = {3, 3, 3, 3, 3};
    assert_true(fabs(rank_correlation(x, x, 5) - 1) < 1e-12);
    assert_true(fabs(rank_correlation(x, down, 5) + 1) < 1e-12);
    assert_true(fabs(rank_correlation(x, tied, 5) - 0.9486832980505138) < 1e-12); // 9 / sqrt(10 * 9)
    assert_true(isnan(rank_correlation(x, flat, 5)));
    assert_true(isnan(rank_correlation(x, x, 2)));
}

static void test_curve_is_read_log_log(void **state)
{
    (void)state;
    const double xs[] = {8, 1, 2},
                 ys[] = {1, 64, 16}; // y = 64 / x^2 between 1 and 2, 16 (x/2)^-2 between 2 and 8
    assert_true(curve_at(xs, ys, 3, 2) == 16);
    assert_true(fabs(curve_at(xs, ys, 3, sqrt(2)) - 32) < 1e-12);
    assert_true(fabs(curve_at(xs, ys, 3, 4) - 4) < 1e-12);
    assert_true(isnan(curve_at(xs, ys, 3, 0.5)) && isnan(curve_at(xs, ys, 3, 9)));
    assert_true(isnan(curve_at(xs, ys, 0, 1)));
}

static void test_shuffle_is_seeded_and_fair(void **state)
{
    (void)state;
    int first[6] = {0};
    const int rounds = test_size(60000, 600000);
    struct random_state random = {3};
    for (int round = 0; round < rounds; round++) {
        int items[6] = {0, 1, 2, 3, 4, 5};
        random_shuffle(&random, items, 6);
        first[items[0]]++;
    }
    double expected = rounds / 6.0, deviation = sqrt(expected * 5 / 6);
    for (int i = 0; i < 6; i++) assert_true(fabs(first[i] - expected) < 5 * deviation); // 5 sigma
    struct random_state a = {9}, b = {9};
    assert_true(random_next(&a) == random_next(&b));
}

// Normal deviate, for simulated frame times.
static double deviate(uint64_t *seed)
{
    return sqrt(-2 * log(test_uniform(seed, 1e-12, 1))) * cos(6.283185307179586 * test_uniform(seed, 0, 1));
}

// The same renderer twice: the two intervals overlap, so the report says "cannot tell", in most trials.  The
// interval is of a median of minima over few repeats, which a bootstrap covers less often than its nominal 95
// %: what must hold is that a difference is not claimed where there is none.
static void test_same_renderer_twice_cannot_be_told_apart(void **state)
{
    (void)state;
    enum { FRAMES = 48, REPEATS = 9 };
    const int trials = test_size(60, 1000);
    int claimed = 0;
    uint64_t seed = 11;
    for (int trial = 0; trial < trials; trial++) {
        struct time_summary summary[2];
        for (int run = 0; run < 2; run++) {
            double times[REPEATS * FRAMES];
            for (int r = 0; r < REPEATS; r++) {
                double drift =
                    1 +
                    0.02 * fabs(deviate(&seed)); // a repeat is slow as a whole when others use the machine
                for (int f = 0; f < FRAMES; f++)
                    times[r * FRAMES + f] =
                        (20 + 5 * sin(f * 0.3)) * drift * (1 + 0.03 * fabs(deviate(&seed)));
            }
            summary[run] = summarize_times(times, REPEATS, FRAMES, (uint64_t)trial);
        }
        double a = summary[0].median, b = summary[1].median;
        bool apart = summary[0].ci95[1] < summary[1].ci95[0] || summary[1].ci95[1] < summary[0].ci95[0];
        claimed += apart && fabs(a - b) > 0.05 * fmin(a, b); // the stated floor: 5 %
    }
    FIGURE("A/A: a difference was claimed in %d of %d trials (at most 5 %% may be)", claimed, trials);
    assert_true(claimed * 20 <= trials);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_percentile_is_nearest_rank),
        cmocka_unit_test(test_minimum_over_repeats_then_percentiles),
        cmocka_unit_test(test_rank_correlation_known_answers),
        cmocka_unit_test(test_curve_is_read_log_log),
        cmocka_unit_test(test_shuffle_is_seeded_and_fair),
        cmocka_unit_test(test_same_renderer_twice_cannot_be_told_apart),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
