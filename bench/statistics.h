// Statistics of frame times.  PURE.
// SPDX-License-Identifier: MIT
#ifndef BENCH_STATISTICS_H
#define BENCH_STATISTICS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// Seeded generator (splitmix64), so that orders and bootstraps repeat.
struct random_state {
    uint64_t state;
};
uint64_t random_next(struct random_state *random);
uint64_t random_below(struct random_state *random, uint64_t bound); // unbiased
void random_shuffle(struct random_state *random, int *items, int count);

// Nearest-rank percentile with integers: element (per_mille * N + 999) / 1000 of the sorted values, counted
// from 1. Sorts values in place.
double percentile(double *values, size_t count, int per_mille);

struct time_summary { // results.json: frame_ms{...}
    double median, p95, p99, min, max;
    double ci95[2];
    bool has_ci; // false with fewer than 3 repeats
};
// times[repeat * frames + frame], milliseconds: per-frame minimum over repeats, then percentiles over frames,
// with a bootstrap over whole repeats for the median's interval, as far below the estimate as above it.
struct time_summary summarize_times(const double *times, int repeats, int frames, uint64_t seed);

// Per-frame minimum over repeats into out[frames].
void minimum_over_repeats(const double *times, int repeats, int frames, double *out);

// Spearman's rank correlation with average ranks for ties; NAN with fewer than 3 pairs.
double rank_correlation(const double *x, const double *y, int count);

// y at x by log-log interpolation between the two neighbouring points of a curve (xs, ys > 0, any order); NAN
// outside.
double curve_at(const double *xs, const double *ys, int count, double x);

#endif
