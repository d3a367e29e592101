// What each pixel really sees: a double-precision ray caster over the extrema pyramid of the finest level
// (hierarchical DDA with integer cells and times compared, exact piecewise-linear hits, diagonal
// (i,j)-(i+1,j+1)).  No GL.  Same result for any number of threads.
//
// The surface is seen from above only, and nothing of it lies beyond the map's outline.  A ray sees ground
// where it first comes down through the surface; touching counts.  A ray that starts below the surface (an
// eye under the terrain, ground nearer than the near plane, a map entered through its side) would meet it
// from below: what is seen from below counts as undrawn, so the truth of such a pixel is sky.
// SPDX-License-Identifier: MIT
#ifndef BENCH_ERROR_TRUTH_H
#define BENCH_ERROR_TRUTH_H

#include "common/terrain/terrain.h"
#include "common/view/view.h"

#include <signal.h>

// How far from a pixel's centre a rasteriser may place an edge: it snaps corners to a grid of 1/256 pixel,
// each by half a step along both axes, and decides at a point interpolated between corners that moved as far.
#define TRUTH_SNAP_PX (1.4142135623730951 / 256)

struct truth_pixel {
    double relative[3]; // hit, relative to the eye, metres, z the surface's own; meaningful when depth > 0
    double depth;       // along forward; 0: sky
    float slope[2];     // dz/dx, dz/dy of the triangle hit, metres per metre, along the axes at the eye
    bool skyline; // the skyline passes within TRUTH_SNAP_PX of the centre: ground and sky are both right
};

struct truth {
    int width, height;
    struct truth_pixel *pixels; // row 0 is the bottom row
    size_t *row_first;          // ground pixels before each row; [height]: all of them
    uint64_t ground;            // pixels that see terrain
    double radius_m;            // of the view that was cast
    // Borrowed, may be NULL: once it is not 0 no further row is cast, and the picture is not to be used.
    const volatile sig_atomic_t *interrupted;
};

// How the caster reads the surface: cells of one height field.  The plane implements it over terrain_samples,
// or page by page over a terrain that is read on demand; a sphere has a caster of its own (truth_sphere.h).
// The terrain is borrowed until destroy.
struct truth_surface;
struct truth_surface *truth_surface_create(const struct terrain *terrain); // NULL after one line on stderr
void truth_surface_destroy(struct truth_surface *surface);                 // accepts NULL

bool truth_init(struct truth *truth, int width, int height); // false after one line on stderr
void truth_finish(struct truth *truth);                      // accepts a zeroed struct

// Direction of one of the rays around the centre of pixel (x, y), TRUTH_SNAP_PX away from it, depth 1 along
// forward as view_ray's.
enum { TRUTH_SNAP_RAYS = 8 };
void truth_snap_ray(const struct view *view, int x, int y, int ray, double direction[3]);

// Casts a ray through each pixel's centre, from depth near_m on.  The view is of the truth's size.
void truth_cast(struct truth *truth, const struct truth_surface *surface, const struct view *view,
                int threads);

// The two halves of it for the pixels alone whose byte in `wanted`, width * height of them, is not 0 (NULL:
// all): what their centres see; and, once they and their neighbours are known, whether the skyline passes.
// The other pixels, row_first and ground stay as they are.
void truth_cast_some(struct truth *truth, const struct truth_surface *surface, const struct view *view,
                     const uint8_t *wanted, int threads);
void truth_mark_some(struct truth *truth, const struct truth_surface *surface, const struct view *view,
                     const uint8_t *wanted, int threads);

// One ray from the eye, in the world; direction need not be unit.  False: sky.  *t: the hit is at eye + t *
// direction.
bool truth_cast_ray(const struct truth_surface *surface, const double eye_m[3], const double direction[3],
                    double *t, float slope[2]);

#endif
