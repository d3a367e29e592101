// The optimal filter D of Losasso & Hoppe 2004, section 7, footnote: of 11 x 11 taps, such that U(D(T)) is
// the best approximation of T in L2.  Solved as the paper says, by a linear system on given terrain, under
// the constraint that there are 11 taps: cutting off the inverse of U'U instead is worse than taking every
// other sample.  The filter is a tensor product of one symmetric line of taps that sum to 1, so six unknowns
// are fitted on rows and columns together.  SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_RELIEF_FILTER_FIT_H
#define COMMON_TERRAIN_RELIEF_FILTER_FIT_H

#include <stdbool.h>
#include <stdint.h>

enum { FILTER_HALF = 6 }; // taps at 0..5; those at -5..-1 mirror them

struct filter_sums { // normal equations; starts zeroed
    double square[FILTER_HALF][FILTER_HALF], right[FILTER_HALF];
};

// Adds a map without voids; rows and columns shorter than 32 samples tell nothing.
void filter_sums_add(struct filter_sums *sums, const int32_t *samples, int64_t width, int64_t height);
// False when nothing was added that decides them.
bool filter_solve(const struct filter_sums *sums, double half[FILTER_HALF]);

// rms of U(D(T)) - T in quanta, away from the border, in double; negative when memory runs out or the map has
// fewer than 32 samples along an axis.
double filter_rms_q(const int32_t *samples, int64_t width, int64_t height, const double half[FILTER_HALF]);

#endif
