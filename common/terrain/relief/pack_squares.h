// Squares of what the surfaces of coarse levels differ from level 0, summed in integers without going through
// the samples once for each level.  Surfaces are linear over the triangles of any finer level's cells: a few
// sums over the samples of a triangle of one reference level serve all the levels above it.
// SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_RELIEF_PACK_SQUARES_H
#define COMMON_TERRAIN_RELIEF_PACK_SQUARES_H

#include <stdint.h>

__extension__ typedef unsigned __int128 squares_wide;

// Sums over samples (u, v) of a triangle, from its cell's south-west corner, and over the differences e there
// of the reference level's surface from level 0.  A cell has at most 2^3 samples along an axis and |e| <
// 2^28: ee < 2^62.
struct triangle_sums {
    int64_t n, u, v, uu, uv, vv, e, ue, ve;
    uint64_t ee;
};

// Samples from..to-1 of line v of a cell, where e = a + u b - cell fine[u].
struct triangle_line {
    int64_t a, b, v, from, to;
};

static inline uint64_t triangle_line_squares(const struct triangle_line *line, int64_t cell,
                                             const int32_t *fine)
{
    uint64_t squares = 0;
    for (int64_t u = line->from; u < line->to; u++) {
        int64_t e = line->a + u * line->b - cell * fine[u];
        squares += (uint64_t)(e * e);
    }
    return squares;
}

void triangle_add_line(struct triangle_sums *sums, const struct triangle_line *line, int64_t cell,
                       const int32_t *fine);

// The sum of (plane[0] + u plane[1] + v plane[2] + 2^up e)^2: of what a level `up` levels coarser differs,
// where the plane is what that differs from the reference level.
squares_wide triangle_squares(const struct triangle_sums *sums, const int64_t plane[3], int up);

#endif
