// Extrema pyramid: lowest and highest height over blocks of cells, of any level of a terrain.
// SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_EXTREMA_H
#define COMMON_TERRAIN_EXTREMA_H

#include "common/terrain/terrain.h"

#include <stdbool.h>

// Builds over `width` x `height` samples (row 0 south) the nodes of heights first_height and up; nodes below
// it are empty.  A grid of one column or row has one column or row of nodes.  False when memory runs out;
// finish it all the same.
bool extrema_init(struct terrain_extrema *extrema, const int32_t *samples, int64_t width, int64_t height,
                  int first_height);
void extrema_finish(struct terrain_extrema *extrema); // accepts a zeroed struct

// Bounds of the samples x0..x1, y0..y1, both ends included and inside the grid; at most one node looser on
// each side.
void extrema_bounds(const struct terrain_extrema *extrema, const int32_t *samples, int64_t width,
                    const int64_t from[2], const int64_t to[2], int32_t *min_q, int32_t *max_q);

// The same from what `leaf` says of the nodes of `first_height`, over `cells` cells along x and y, at
// least 1.
bool extrema_init_from(struct terrain_extrema *extrema, const int64_t cells[2], int first_height,
                       void (*leaf)(const void *user, int64_t i, int64_t j, int32_t *min_q, int32_t *max_q),
                       const void *user);

size_t extrema_bytes(const struct terrain_extrema *extrema);

#endif
