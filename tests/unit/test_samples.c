// Percentiles of error samples: exact ranks, bounded memory. SPDX-License-Identifier: MIT
#include "bench/error/samples.h"
#include "tests/test.h"

#include <string.h>

static struct error_summary summary_of(const float *values, size_t count)
{
    struct error_samples samples = {0};
    assert_true(error_samples_add(&samples, values, count));
    struct error_summary summary = error_samples_summary(&samples);
    error_samples_finish(&samples);
    return summary;
}

static int compare_floats(const void *a, const void *b)
{
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

// Nearest rank with integers (E8), on every kind of order.
static void test_percentiles(void **state)
{
    (void)state;
    uint64_t random = 6;
    int checked = 0;
    const size_t counts[] = {1, 2, 3, 9, 10, 100, 999, 1000, 1001, 1999, 2000, 12345, 200000};
    float *values = malloc(200000 * sizeof *values), *sorted = malloc(200000 * sizeof *sorted);
    assert_true(values && sorted);
    for (size_t c = 0; c < sizeof counts / sizeof *counts; c++)
        for (int order = 0; order < 5; order++) {
            size_t n = counts[c];
            for (size_t k = 0; k < n; k++)
                values[k] = order == 0   ? (float)test_uniform(&random, 0, 2)
                            : order == 1 ? (float)k
                            : order == 2 ? (float)(n - k)
                            : order == 3 ? 0.5f
                                         : (float)(test_random(&random) % 3);
            memcpy(sorted, values, n * sizeof *values);
            qsort(sorted, n, sizeof *sorted, compare_floats);
            struct error_summary got = summary_of(values, n);
            assert_int_equal(got.samples, n);
            assert_true(got.p50 == (double)sorted[(500 * n + 999) / 1000 - 1]);
            assert_true(got.p99 == (double)sorted[(990 * n + 999) / 1000 - 1]);
            assert_true(got.p999 == (double)sorted[(999 * n + 999) / 1000 - 1]);
            assert_true(got.max == (double)sorted[n - 1] && (n >= 1000 || got.p999 == got.max));
            double sum = 0, squares = 0, over = 0;
            for (size_t k = 0; k < n; k++) {
                sum += (double)sorted[k], squares += (double)sorted[k] * (double)sorted[k];
                over += sorted[k] > 1;
            }
            assert_true(fabs(got.mean * (double)n - sum) <= 1e-9 * sum);
            assert_true(fabs(got.rms * got.rms * (double)n - squares) <= 1e-9 * squares);
            assert_true(got.share_over_1px == over / (double)n);
            checked++;
        }
    int naive = 0; // ranks by ceil(p N) in floating point
    for (int n = 1; n <= 200000; n++) naive += (int)ceil(0.07 * n) != (70 * n + 999) / 1000;
    FIGURE("percentiles: %d lists, exact; a floating-point rank is off for %d of 200000 counts", checked,
           naive);
    assert_true(naive > 0);
    free(values), free(sorted);
}

static void test_samples_grow_and_pass_nans(void **state)
{
    (void)state;
    struct error_samples samples = {0};
    struct error_summary none = error_samples_summary(&samples), zero = {0};
    assert_memory_equal(&none, &zero, sizeof zero);
    enum { PIECE = 1000 };
    float piece[PIECE];
    size_t kept = 0;
    for (int k = 0; k < test_size(2000, 100000); k++) {
        for (int i = 0; i < PIECE; i++) piece[i] = i % 4 ? (float)(i % 4) : NAN;
        assert_true(error_samples_add(&samples, piece, PIECE));
        kept += PIECE / 4 * 3;
    }
    assert_int_equal(samples.count, kept);
    struct error_summary summary = error_samples_summary(&samples);
    assert_int_equal(summary.samples, kept);
    assert_true(summary.mean == 2 && summary.p50 == 2 && summary.max == 3 && summary.p999 == 3);
    assert_true(fabs(summary.share_over_1px - 2.0 / 3) < 1e-12);
    error_samples_finish(&samples);
}

// A list that knows how many samples will come keeps the largest ones only: percentiles from p99 up are
// exact, the median is within 2^-11, and memory stays bounded, whatever the order.
static void test_few_are_kept(void **state)
{
    (void)state;
    uint64_t random = 7;
    size_t n = (size_t)test_size(3, 40) * 1000 * 1000 + 17;
    float *values = malloc(n * sizeof *values);
    assert_non_null(values);
    double worst = 0;
    for (int order = 0; order < 4; order++) {
        struct error_samples few = {.most = n}, all = {0};
        for (size_t k = 0; k < n; k++) {
            double at = (double)(order == 2 ? n - k : k) / (double)n;
            values[k] = order == 0   ? (float)exp(test_uniform(&random, -14, 7))
                        : order == 3 ? 0
                                     : (float)(at * at);
        }
        size_t half = n / 2;
        assert_true(error_samples_add(&few, values, half) &&
                    error_samples_add(&few, values + half, n - half));
        assert_true(error_samples_add(&all, values, n));
        assert_true((double)few.capacity * sizeof(float) <= error_samples_bytes((double)n));
        assert_true(few.kept_count < n / 5 && all.kept_count == n);
        struct error_summary got = error_samples_summary(&few), whole = error_samples_summary(&all);
        assert_true(got.samples == n && got.max == whole.max && got.mean == whole.mean &&
                    got.rms == whole.rms);
        assert_true(got.p999 == whole.p999 && got.p99 == whole.p99);
        assert_true(got.share_over_1px == whole.share_over_1px);
        assert_true(fabs(got.p50 - whole.p50) <= 0x1p-11 * whole.p50);
        if (whole.p50 > 0) worst = fmax(worst, fabs(got.p50 - whole.p50) / whole.p50);
        error_samples_finish(&few), error_samples_finish(&all);
    }
    FIGURE(
        "%zu samples, the largest hundredth kept: p99, p99.9, max exact; median off by %.2g (at most %.2g)",
        n, worst, 0x1p-11);
    free(values);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_percentiles),
        cmocka_unit_test(test_samples_grow_and_pass_nans),
        cmocka_unit_test(test_few_are_kept),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
