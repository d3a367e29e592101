// The levels of a terrain in memory: filtered coarser ones, synthesised finer ones, and what each differs
// from the finest. Losasso & Hoppe 2004, sections 5, 7 and 8. SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_PYRAMID_H
#define COMMON_TERRAIN_PYRAMID_H

#include "common/terrain/sphere.h"
#include "common/terrain/terrain.h"

#include <stdbool.h>

enum { PYRAMID_MAX_FINER = 8, PYRAMID_MAX_COARSER = 48 };

struct pyramid_level {
    struct terrain_extent extent;
    int32_t *samples; // row 0 south, extent.x1 - extent.x0 samples a row
    int32_t min_q, max_q;
    double rms_error_q, max_error_q;
    double sigma_q; // of the noise; 0 for levels that are not synthesised
    struct terrain_extrema
        extrema; // on the plane the finest level: over single cells; all others: over 8 x 8 cells and up
};

struct pyramid {
    int finest, coarsest;             // in memory: on a sphere, finer levels are made on demand (detail.h)
    const struct sphere_grid *sphere; // borrowed; NULL: the plane
    double noise_log2,
        noise_slope; // log2 of the noise at level 0, quanta, and its gain a level; -INFINITY: none
    struct pyramid_level all[PYRAMID_MAX_FINER + 1 + PYRAMID_MAX_COARSER]; // use pyramid_level()
};

// Takes ownership of level 0's samples (from malloc), also when it fails (false: memory ran out).
// options->min_size and synthesize_levels as in terrain.h.  The pyramid starts zeroed; finish it whatever was
// returned.
bool pyramid_init(struct pyramid *pyramid, int32_t *samples, const struct terrain_extent *extent,
                  const struct terrain_options *options);
// The same for the grid of a whole planet, whose levels go around it; the grid is borrowed.  No finer levels
// are made, but their noise is chosen, and the error of a level is that against level 0.
bool pyramid_init_sphere(struct pyramid *pyramid, int32_t *samples, const struct sphere_grid *sphere,
                         const struct terrain_options *options);
double pyramid_noise_q(const struct pyramid *pyramid, int level); // standard deviation, quanta
// How the spread of the residuals of levels 0..count-1, all positive, goes on: the power of the spacing that
// fits them best, as log2 at level 0 and its gain a level; -INFINITY for count = 0.
enum { PYRAMID_FIT_LEVELS = 5, PYRAMID_FIT_SIZE = 24 }; // levels that are looked at, and their least side
void pyramid_fit_noise(const double *rms_q, int count, double *noise_log2, double *noise_slope);
void pyramid_finish(struct pyramid *pyramid);

static inline const struct pyramid_level *pyramid_level(const struct pyramid *pyramid, int level)
{
    return &pyramid->all[level + PYRAMID_MAX_FINER];
}

static inline int64_t pyramid_width(const struct pyramid_level *level)
{
    return level->extent.x1 - level->extent.x0;
}
static inline int64_t pyramid_height(const struct pyramid_level *level)
{
    return level->extent.y1 - level->extent.y0;
}

size_t pyramid_bytes(const struct pyramid *pyramid);

#endif
