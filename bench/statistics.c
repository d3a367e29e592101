// SPDX-License-Identifier: MIT
#include "bench/statistics.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { BOOTSTRAP_ROUNDS = 1000 };

uint64_t random_next(struct random_state *random)
{
    uint64_t z = (random->state += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

uint64_t random_below(struct random_state *random, uint64_t bound)
{
    uint64_t limit = UINT64_MAX - UINT64_MAX % bound, value;
    do value = random_next(random);
    while (value >= limit);
    return value % bound;
}

void random_shuffle(struct random_state *random, int *items, int count)
{
    for (int i = count - 1; i > 0; i--) {
        int j = (int)random_below(random, (uint64_t)i + 1), item = items[i];
        items[i] = items[j];
        items[j] = item;
    }
}

static int compare_doubles(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

double percentile(double *values, size_t count, int per_mille)
{
    if (!count) return NAN;
    qsort(values, count, sizeof *values, compare_doubles);
    size_t rank = ((size_t)per_mille * count + 999) / 1000;
    return values[rank ? rank - 1 : 0];
}

void minimum_over_repeats(const double *times, int repeats, int frames, double *out)
{
    for (int f = 0; f < frames; f++) {
        out[f] = times[f];
        for (int r = 1; r < repeats; r++)
            if (times[(size_t)r * (size_t)frames + (size_t)f] < out[f])
                out[f] = times[(size_t)r * (size_t)frames + (size_t)f];
    }
}

// Median over frames of the per-frame minimum over the repeats named in pick[].
static double median_of_minima(const double *times, const int *pick, int repeats, int frames, double *scratch)
{
    for (int f = 0; f < frames; f++) {
        double least = INFINITY;
        for (int r = 0; r < repeats; r++) {
            double time = times[(size_t)pick[r] * (size_t)frames + (size_t)f];
            if (time < least) least = time;
        }
        scratch[f] = least;
    }
    return percentile(scratch, (size_t)frames, 500);
}

// Frames of one flight are autocorrelated, so whole repeats are resampled, never frames.  The minimum over a
// resample can only lie above the minimum over all repeats, while more repeats could only lower it: the
// distance to the resamples' 97.5th percentile is therefore laid off on both sides of the estimate.
static bool bootstrap_median(const double *times, int repeats, int frames, uint64_t seed, double median,
                             double ci95[2])
{
    double *medians = malloc(BOOTSTRAP_ROUNDS * sizeof *medians);
    double *scratch = malloc((size_t)frames * sizeof *scratch);
    int *pick = malloc((size_t)repeats * sizeof *pick);
    bool enough_memory = medians && scratch && pick;
    struct random_state random = {seed};
    for (int round = 0; enough_memory && round < BOOTSTRAP_ROUNDS; round++) {
        for (int r = 0; r < repeats; r++) pick[r] = (int)random_below(&random, (uint64_t)repeats);
        medians[round] = median_of_minima(times, pick, repeats, frames, scratch);
    }
    if (enough_memory) {
        double above = percentile(medians, BOOTSTRAP_ROUNDS, 975) - median;
        ci95[0] = median - above;
        ci95[1] = median + above;
    }
    free(medians);
    free(scratch);
    free(pick);
    return enough_memory;
}

struct time_summary summarize_times(const double *times, int repeats, int frames, uint64_t seed)
{
    struct time_summary summary = {NAN, NAN, NAN, NAN, NAN, {NAN, NAN}, false};
    double *least = frames > 0 && repeats > 0 ? malloc((size_t)frames * sizeof *least) : NULL;
    if (!least) return summary;
    minimum_over_repeats(times, repeats, frames, least);
    summary.median = percentile(least, (size_t)frames, 500);
    summary.p95 = percentile(least, (size_t)frames, 950);
    summary.p99 = percentile(least, (size_t)frames, 990);
    summary.min = least[0];
    summary.max = least[frames - 1];
    free(least);
    if (repeats >= 3)
        summary.has_ci = bootstrap_median(times, repeats, frames, seed, summary.median, summary.ci95);
    return summary;
}

// Average ranks: tied values share the mean of the ranks that they take up.
static void average_ranks(const double *values, int count, double *ranks)
{
    for (int i = 0; i < count; i++) {
        int below = 0, equal = 0;
        for (int j = 0; j < count; j++) {
            below += values[j] < values[i];
            equal += values[j] == values[i];
        }
        ranks[i] = below + (equal + 1) / 2.0;
    }
}

double rank_correlation(const double *x, const double *y, int count)
{
    if (count < 3) return NAN;
    double *ranks = malloc(2 * (size_t)count * sizeof *ranks);
    if (!ranks) return NAN;
    average_ranks(x, count, ranks);
    average_ranks(y, count, ranks + count);
    double mean = (count + 1) / 2.0, xy = 0, xx = 0, yy = 0;
    for (int i = 0; i < count; i++) {
        double dx = ranks[i] - mean, dy = ranks[count + i] - mean;
        xy += dx * dy;
        xx += dx * dx;
        yy += dy * dy;
    }
    free(ranks);
    return xx > 0 && yy > 0 ? xy / sqrt(xx * yy) : (double)NAN;
}

double curve_at(const double *xs, const double *ys, int count, double x)
{
    int below = -1, above = -1; // nearest points on either side
    for (int i = 0; i < count; i++) {
        if (!(xs[i] > 0 && ys[i] > 0)) continue;
        if (xs[i] <= x && (below < 0 || xs[i] > xs[below])) below = i;
        if (xs[i] >= x && (above < 0 || xs[i] < xs[above])) above = i;
    }
    if (below < 0 || above < 0) return NAN;
    if (xs[below] == xs[above]) return ys[below] < ys[above] ? ys[below] : ys[above];
    double t = log(x / xs[below]) / log(xs[above] / xs[below]);
    return exp(log(ys[below]) * (1 - t) + log(ys[above]) * t);
}
