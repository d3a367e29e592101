// SPDX-License-Identifier: MIT
#include "bench/error/samples.h"

#include "common/report.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

// A float that is not negative keeps its order as an integer: 8 bits of exponent and 10 of the mantissa
// number a bin.
enum { BIN_SHIFT = 13, BINS = 1 << (31 - BIN_SHIFT) };

static uint32_t bin_of(float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return (bits & 0x7fffffff) >> BIN_SHIFT; // -0 is 0
}

static float middle_of(uint32_t bin)
{
    uint32_t bits = bin ? bin << BIN_SHIFT | 1 << (BIN_SHIFT - 1) : 0;
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

// Samples that the ranks from p99 up may lie among when `most` have come: most - ceil(0.99 most) + 1.
static size_t largest_needed(uint64_t most)
{
    size_t hundredth = (size_t)(most / 100) + 1;
    return hundredth > SAMPLES_KEPT ? hundredth : SAMPLES_KEPT;
}

double error_samples_bytes(double most)
{
    double largest = fmax(most / 100, SAMPLES_KEPT);
    return fmin(most, 2 * largest) * sizeof(float) + BINS * sizeof(uint64_t);
}

// The value that would stand at `rank` (from 0) if the first `count` values were sorted; no larger one is
// left before it, no smaller one after it.
static float select_value(float *values, size_t count, size_t rank)
{
    ptrdiff_t first = 0, last = (ptrdiff_t)count - 1, wanted = (ptrdiff_t)rank;
    while (first < last) {
        float pivot = values[first + (last - first) / 2];
        ptrdiff_t i = first, j = last;
        while (i <= j) {
            while (values[i] < pivot) i++;
            while (values[j] > pivot) j--;
            if (i > j) break;
            float swap = values[i];
            values[i++] = values[j];
            values[j--] = swap;
        }
        if (wanted <= j) // first..j are at most the pivot, i..last at least, those between equal it
            last = j;
        else if (wanted >= i)
            first = i;
        else
            break;
    }
    return values[rank];
}

static bool grow(struct error_samples *samples)
{
    size_t capacity = samples->capacity ? 2 * samples->capacity : SAMPLES_KEPT;
    float *grown = realloc(samples->kept, capacity * sizeof *grown);
    if (!grown) return fail("no memory for %zu error samples", capacity);
    samples->kept = grown;
    samples->capacity = capacity;
    return true;
}

// Leaves the largest ones.  The first time, what is dropped goes on to count in the histogram.
static bool drop_small(struct error_samples *samples, size_t largest)
{
    if (!samples->histogram) {
        samples->histogram = calloc(BINS, sizeof *samples->histogram);
        if (!samples->histogram) return fail("no memory for a histogram of error samples");
        for (size_t k = 0; k < samples->kept_count; k++) samples->histogram[bin_of(samples->kept[k])]++;
    }
    size_t dropped = samples->kept_count - largest;
    select_value(samples->kept, samples->kept_count, dropped);
    memmove(samples->kept, samples->kept + dropped, largest * sizeof *samples->kept);
    samples->kept_count = largest;
    return true;
}

static bool make_room(struct error_samples *samples)
{
    if (samples->kept_count < samples->capacity) return true;
    size_t largest = largest_needed(samples->most);
    if (samples->most && samples->capacity >= 2 * largest) return drop_small(samples, largest);
    return grow(samples);
}

bool error_samples_add(struct error_samples *samples, const float *values, size_t count)
{
    for (size_t k = 0; k < count; k++) {
        if (isnan(values[k])) continue;
        if (!make_room(samples)) return false;
        double value = (double)values[k];
        samples->sum += value;
        samples->squares += value * value;
        samples->over_1px += value > 1;
        samples->count++;
        samples->kept[samples->kept_count++] = values[k];
        if (samples->histogram) samples->histogram[bin_of(values[k])]++;
    }
    return true;
}

static double median_of_histogram(const struct error_samples *samples, uint64_t rank)
{
    uint64_t below = 0;
    uint32_t bin = 0;
    while (below + samples->histogram[bin] <= rank) below += samples->histogram[bin++];
    return (double)middle_of(bin);
}

struct error_summary error_samples_summary(struct error_samples *samples)
{
    struct error_summary summary = {.samples = samples->count};
    if (samples->count == 0) return summary;
    double count = (double)samples->count;
    summary.mean = samples->sum / count;
    summary.rms = sqrt(samples->squares / count);
    summary.share_over_1px = (double)samples->over_1px / count;
    uint64_t dropped = samples->count - samples->kept_count;
    const int per_mille[] = {1000, 999, 990, 500};
    double *out[] = {&summary.max, &summary.p999, &summary.p99, &summary.p50};
    size_t among = samples->kept_count;
    for (int k = 0; k < 4; k++) { // from the top down: each has sorted out those that the next looks among
        uint64_t rank = (per_mille[k] * samples->count + 999) / 1000 - 1;
        if (rank < dropped) {
            *out[k] = median_of_histogram(samples, rank);
            continue;
        }
        *out[k] = (double)select_value(samples->kept, among, (size_t)(rank - dropped));
        among = (size_t)(rank - dropped) + 1;
    }
    return summary;
}

void error_samples_finish(struct error_samples *samples)
{
    free(samples->kept);
    free(samples->histogram);
    *samples = (struct error_samples){0};
}
