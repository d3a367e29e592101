// Synthesised levels that are made when they are asked for, window by window: what the levels of a whole
// planet are, which memory would not hold.  A sample is that of synthesis.h and so the same from any window:
// U of the coarser level plus noise of its absolute place.
// SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_DETAIL_H
#define COMMON_TERRAIN_DETAIL_H

#include "common/terrain/sphere.h"

enum { DETAIL_MAX_FINER = 18 };

struct detail {
    struct sphere_grid grid; // of level 0
    const int32_t *samples;  // of level 0, borrowed; NULL: they are read
    void (*read)(void *user, int64_t x0, int64_t y0, int width, int height, int32_t *out);
    void *user;
    uint64_t seed;
    double
        sigma_q[DETAIL_MAX_FINER + 1]; // [-level]: of the noise on the equator; it tapers to 0 at the poles
};

// Any window of a level below 0.  Allocates nothing; thread-safe.
void detail_window(const struct detail *detail, int level, int64_t x0, int64_t y0, int width, int height,
                   int32_t *out);

// The step from a level to the next finer one: U of `coarse` (as upsample() takes it) plus the noise of
// `level`.
void detail_refine(const struct detail *detail, int level, const int32_t *coarse, int64_t x0, int64_t y0,
                   int width, int height, int32_t *out);

// The samples of level 0 that a window is made of.
struct terrain_extent detail_under(int level, int64_t x0, int64_t y0, int width, int height);

// How far the finest of `levels` synthesised levels may leave the range of the stored samples about it, as
// quanta for noise (the largest deviate there is) and as a share of the range for U (numerics.md, B11).
double detail_noise_limit(const struct detail *detail, int levels);
enum { DETAIL_REACH = 3 };      // stored samples to either side that U^L reads
#define DETAIL_NORM 1.565       // of U^L (numerics.md, B10)
#define DETAIL_OVERSHOOT 0.2825 // (DETAIL_NORM - 1) / 2
#define DETAIL_DEVIATE 8.3      // the largest deviate there is (synthesis.h)

#endif
