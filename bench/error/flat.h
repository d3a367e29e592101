// "The same place" on plane and sphere, for measures that compare heights at a place.  On the plane a place
// is (x, y) relative to the eye.  On a sphere it is where the line from the planet's centre meets the plane
// that touches the sphere of the eye at the eye: the central projection, which keeps triangles triangles.  It
// serves all that is less than a quarter turn from the eye's nadir, which is all that can be seen.  radius_m:
// the view's, from the planet's centre to the eye; 0 on the plane. SPDX-License-Identifier: MIT
#ifndef BENCH_ERROR_FLAT_H
#define BENCH_ERROR_FLAT_H

#include "bench/error/places.h"

// A point relative to the eye, flattened: its place and its height in the projection; NAN where there is
// none.
void flat_from_relative(double radius_m, const double relative[3], double flat[3]);
// Height over the eye's of a flattened point, metres along the plumb line there.
double flat_rise(double radius_m, const double flat[3]);
// The unit vector up at a place, and the point there whose height over the eye's is rise_m; relative to the
// eye.
void flat_up(double radius_m, const double place[2], double up[3]);
void flat_point(double radius_m, const double place[2], double rise_m, double relative[3]);

// places_feed for triangles relative to the eye.
void flat_feed(double radius_m, const float *triangles, size_t count, struct places *places);
// The same as gpu_capture_begin calls it; user: a struct flat_feeding.
struct flat_feeding {
    double radius_m;
    struct places *places;
};
void flat_receive(const float *triangles, size_t count, void *user);

#endif
