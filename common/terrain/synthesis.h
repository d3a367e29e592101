// Detail finer than the stored terrain (Losasso & Hoppe 2004, section 8): U of the coarser level plus
// Gaussian noise whose variance is that of the residuals of real levels.  A value depends on the absolute (i,
// j, level) and the seed alone (numerics.md, B13), so any window at any time gives the same sample.
// SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_SYNTHESIS_H
#define COMMON_TERRAIN_SYNTHESIS_H

#include <stdint.h>

// Standard normal deviate at absolute sample (i, j) of `level`; a hash, so it does not repeat.  Made of
// integers and exact double arithmetic only: the same bits on any machine.  Mean 0, variance 1, excess
// kurtosis -0.03, |value| < 8.3.
double synthesis_normal(int64_t i, int64_t j, int level, uint64_t seed);

// Adds noise of standard deviation sigma_q (quanta, rounded to the nearest integer) to `count` samples that
// start at (i0, j) of `level` and run east.
void synthesis_add_row(int32_t *samples, int64_t count, int64_t i0, int64_t j, int level, uint64_t seed,
                       double sigma_q);

// The same, value by value: deviate i of a row, and a height rounded as they are.
struct synthesis_row {
    uint64_t key;
    double sigma_q;
};
struct synthesis_row synthesis_row(int64_t j, int level, uint64_t seed, double sigma_q);
double synthesis_deviate(const struct synthesis_row *row, int64_t i);
int32_t synthesis_rounded(double q);

// As published: one table of 50 x 50 deviates for every level, indexed by the coordinates modulo 50 (rounding
// towards minus infinity, so that the origin is no seam).  It repeats every 50 samples, and samples of
// different levels at equal indices get equal deviates: numerics.md, B13, fails it.
enum { SYNTHESIS_TABLE = 50 };
struct synthesis_table {
    double deviates[SYNTHESIS_TABLE][SYNTHESIS_TABLE]; // [j][i]
};
void synthesis_fill_table(struct synthesis_table *table, uint64_t seed);
void synthesis_add_table_row(int32_t *samples, int64_t count, int64_t i0, int64_t j,
                             const struct synthesis_table *table, double sigma_q);

#endif
