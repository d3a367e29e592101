// The view frustum, and boxes against it: n/p-vertex test with plane masking.
// Everything is relative to the eye, in double.
// SPDX-License-Identifier: MIT
#ifndef COMMON_VIEW_FRUSTUM_H
#define COMMON_VIEW_FRUSTUM_H

#include "common/view/view.h"

enum { FRUSTUM_PLANES = 5, FRUSTUM_ALL = (1 << FRUSTUM_PLANES) - 1 }; // left, right, bottom, top, near

enum frustum_side { FRUSTUM_OUTSIDE, FRUSTUM_CROSSING, FRUSTUM_INSIDE };

struct frustum {
    double normal[FRUSTUM_PLANES][3]; // inward
    double offset[FRUSTUM_PLANES];    // inside: dot(normal, p) + offset >= 0
};

void frustum_init(struct frustum *frustum, const struct view *view);

// Tests a box; *mask holds the planes still worth testing and loses those that the box lies wholly inside of.
// Conservative: never OUTSIDE for a box that holds a visible point, with a guard of 1e-6 of the box's
// distance.
enum frustum_side frustum_test_box(const struct frustum *frustum, const double low[3], const double high[3],
                                   unsigned *mask);

// The part of a box inside the frustum's four side planes and in front of near, as its bounding rectangle in
// x and y (numerics.md, B15: faces clipped by planes, apex added when it is inside the box).  False when
// empty. `min_depth` (may be NULL) receives the least depth along forward of that part, at least near_m.
bool frustum_clip_box(const struct view *view, const double low[3], const double high[3], double rect[4],
                      double *min_depth);

#endif
