// Synthesised levels that are made when they are asked for, window by window: what the levels of a whole
// planet are, which memory would not hold.  A sample is that of synthesis.h and so the same from any window:
// U of the coarser level plus noise of its absolute place.
//
// Columns crowd towards the poles, and detail shall be as rough along the parallel as along the meridian
// (Clasen & Hege 2006, section 4.3, of kernels).  So a row of a synthesised level has posts 2^e columns
// apart, between half the distance of rows and all of it: every column up to 60 degrees, every other one up
// to 75.5, and so on as long as they come out even over half a turn.  Posts are made of the coarser level's
// samples so far apart, of the stored level's, too; samples between posts are linear between them, rounded.
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
    double sigma_q[DETAIL_MAX_FINER + 1]; // [-level]: of the noise
};

// Any window of a level below 0.  Allocates nothing; thread-safe.
void detail_window(const struct detail *detail, int level, int64_t x0, int64_t y0, int width, int height,
                   int32_t *out);

// e: posts of a row of a level, or those of level 0 that they are made of, are 2^e columns apart, counted
// from the grid's first column.
int detail_exponent(const struct detail *detail, int level, int64_t row);

// Samples of a level below 0 (or of level 0 as they are read there) that are 2^exponent columns apart, which
// divides a turn, from the post-th on, counted from the grid's first column; and the heights there, quanta,
// which between posts are not rounded.
void detail_posts(const struct detail *detail, int level, int exponent, int64_t post, int64_t y0, int width,
                  int height, int32_t *out);
void detail_heights(const struct detail *detail, int level, int exponent, int64_t post, int64_t y0, int width,
                    int height, float *out);

// The surface of a synthesised level is that of its posts.  The cells of row j, between rows j and j + 1, are
// as wide as the posts of the row nearer to the equator are apart, 2^e columns, and bilinear from e = 1 on
// (terrain.h); a corner between two posts of
// the other row, which may be `wider` (0: south, 1: north), is their mean.  The corners of cell `post`,
// [north][east], quanta, from samples 2^e columns apart: DETAIL_CELL a row, from the one before it on.
enum { DETAIL_CELL = 4 };
int detail_cell_exponent(const struct detail *detail, int level, int64_t j);
void detail_corners(int64_t post, const bool wider[2], const int32_t *around, int stride,
                    double corners[2][2]);

// The step from a level to the next finer one where all rows have posts 2^exponent columns apart, those of
// `coarse`, too: U of `coarse` (as upsample() takes it) plus the noise of `level`.
void detail_refine(const struct detail *detail, int level, int exponent, const int32_t *coarse, int64_t post,
                   int64_t y0, int width, int height, int32_t *out);

// The samples of level 0 that a window is made of; and how many columns to either side more than elsewhere
// those of some rows of level 0 take.
struct terrain_extent detail_under(const struct detail *detail, int level, int64_t x0, int64_t y0, int width,
                                   int height);
int64_t detail_aside(const struct detail *detail, int64_t south, int64_t north);

// How far the finest of `levels` synthesised levels may leave the range of the stored samples about it, as
// quanta for noise (the largest deviate there is) and as a share of the range for U (numerics.md, B11).
double detail_noise_limit(const struct detail *detail, int levels, double norm);
enum { DETAIL_REACH = 3 }; // stored samples to either side that U^L reads
#define DETAIL_NORM 1.565  // of U^L (numerics.md, B10)
// About rows where posts get farther apart: B10's 1.2512 along each axis, and 17/16 for a step that reads
// samples between posts, three times.  The most found is 1.72 (test_detail).
#define DETAIL_NORM_MIXED 1.9
#define DETAIL_OVERSHOOT(norm) (((norm)-1) / 2)
#define DETAIL_DEVIATE 8.3 // the largest deviate there is (synthesis.h)

#endif
