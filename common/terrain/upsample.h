// The filters between levels, in integers: U (4-point interpolatory, Kobbelt 1996) and D.
// Losasso & Hoppe 2004, sections 5 and 7; the integer forms are those of numerics.md, section 5.
// SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_UPSAMPLE_H
#define COMMON_TERRAIN_UPSAMPLE_H

#include "common/terrain/terrain.h"

#include <stdbool.h>
#include <stdint.h>

// Largest height in quanta that a level holds: float32 holds it, and the sums of U fit int32.
enum { QUANTA_LIMIT = (1 << 22) - 1 };

// Coarse samples along one axis that predict `size` finer ones from index x0.
int upsample_coarse_size(int64_t x0, int size);
// Predicts the window (x0, y0, width, height) of the finer level from `coarse`, a window of the coarser level
// that starts at (floor(x0/2) - 1, floor(y0/2) - 1) and holds upsample_coarse_size(x0, width) x
// upsample_coarse_size(y0, height) samples. Exact for |q| <= QUANTA_LIMIT; the result may overshoot by 28.1 %
// of the range (numerics.md, B11).
void upsample(const int32_t *coarse, int64_t x0, int64_t y0, int width, int height, int32_t *fine);

// Taps of a filter along one axis, half of a symmetric line: half[k] at -k and k; they sum to 2^shift.
struct filter_taps {
    int32_t half[6];
    int reach; // half[reach] is the last tap that is not 0
    int shift;
};
const struct filter_taps *filter_taps(enum terrain_filter filter);

// One coarser level of a whole grid.  `first` and `coarse_first` are indices of the south-west samples;
// ghosts beyond the border continue the line through the last sample and the fourth before it (numerics.md,
// E3).  The caller gives room for downsample_size(first, size) per axis.  Sums are exact and rounded once,
// then limited to QUANTA_LIMIT. False when memory runs out.
int64_t downsample_first(int64_t first);              // floor(first / 2)
int64_t downsample_size(int64_t first, int64_t size); // covers the map, rounded outward
bool downsample(const int32_t *fine, const int64_t first[2], const int64_t size[2],
                enum terrain_filter filter, int32_t *coarse);

#endif
