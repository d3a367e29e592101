// The heights about a viewer over a sphere, level by level (Clasen & Hege 2006, sections 4.1 and 4.3).  PURE.
//
// Level l keeps a window of the terrain's level l about the viewer's nadir in size x size toroidal texels, as
// far as the rings reach that draw it.  Towards the poles columns crowd, and a ring spans more of them: a
// texel then stands for 2^p columns, filtered over as many, so that its kernel is about as wide as it is high
// on the ground.  p and the window change in steps, so that a small move reads little.  Where rings reach
// over a pole the window holds the whole turn. SPDX-License-Identifier: MIT
#ifndef CLIPMAP_SPHERE_LEVELS_H
#define CLIPMAP_SPHERE_LEVELS_H

#include "clipmap/clipmap_levels.h"

enum { SPHERE_MAX_LEVELS = 32, SPHERE_TEXEL_SHARE = 8 };

struct sphere_shape {
    int azimuths;
    int finest, coarsest; // levels of the terrain
    int size;             // texels on a side
    double radius_m;
    double spacing_m[2];    // of level 0
    int64_t columns, first; // of level 0
    int64_t pole;
};

void sphere_shape_init(struct sphere_shape *shape, const struct terrain *terrain, int azimuths);

// The level, a real number, whose rows are as far apart as an azimuths-th of SPHERE_TEXEL_SHARE times a
// ring's angle: level l is sampled from there to level l + 1.
double sphere_level_at(const struct sphere_shape *shape, double angle);

struct sphere_window {
    int decimation;         // p
    bool around;            // holds the whole turn: columns 0 .. period - 1, taken modulo the period
    int period;             // of its texels along x: size, or the texels of a turn
    struct clipmap_box box; // texels: x in 2^p columns, y in rows of the level; any int64
};
// What level l wants to hold for a viewer at a place (longitude, latitude in metres of arc).
struct sphere_window sphere_window_wanted(const struct sphere_shape *shape, int level,
                                          const double place_m[2]);

// The viewer's texel and fraction in a window's grid.
void sphere_window_origin(const struct sphere_shape *shape, int level, const struct sphere_window *window,
                          const double place_m[2], int64_t texel[2], float fraction[2]);

struct sphere_store { // one level in memory
    struct sphere_window held;
};

// Takes a rectangle of slots, row by row northwards.
typedef void sphere_write_fn(void *user, int slot_x, int slot_y, int width, int height,
                             const float *heights_q);

// Reads what of `wanted` is missing, no more than `budget` texels, and forgets what it does not hold. Returns
// how many were read; *whole: nothing is missing now.  scratch: size * size floats and as many int32.
uint64_t sphere_store_move(struct sphere_store *store, const struct sphere_shape *shape,
                           const struct terrain *terrain, int level, const struct sphere_window *wanted,
                           uint64_t budget, float *heights, int32_t *columns, sphere_write_fn *write,
                           void *user, bool *whole);

// Bounds, in quanta, of the heights that a window's texels give within an angle of a viewer.
void sphere_cap_bounds(const struct sphere_shape *shape, const struct terrain *terrain, int level,
                       const struct sphere_window *window, const double place_m[2], double angle,
                       int32_t *low_q, int32_t *high_q);

// The height of one texel: a sample, or the mean over the columns it stands for.
void sphere_read_texels(const struct sphere_shape *shape, const struct terrain *terrain, int level,
                        int decimation, const struct clipmap_box *box, float *heights, int32_t *columns);

#endif
