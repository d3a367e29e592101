// Regions fitted to the view frustum (Losasso & Hoppe 2004, section 4: "adapt the location and size of
// clipmap regions to the view frustum").  PURE.
//
// A narrow angle of view needs a square about the viewer of n / tan(angle / 2) samples for the triangle size
// of 90 degrees.  Of that square a level keeps and draws the rectangle round what the frustum sees, and,
// where this still has more than n samples on a side, of the largest smaller square for which it has not. The
// price: the regions follow the turning of the view as well as its motion, and are refilled for it.
// SPDX-License-Identifier: MIT
#ifndef CLIPMAP_CLIPMAP_FIT_H
#define CLIPMAP_CLIPMAP_FIT_H

#include "clipmap/clipmap_levels.h"
#include "common/terrain/terrain.h"

// fits and eyes: one a level.  90 degrees across and wider, and where no ground is seen: the squares of the
// shape.
void clipmap_fit(const struct clipmap_shape *shape, const struct terrain *terrain, const struct view *view,
                 const struct view_origin *eyes, struct clipmap_fit *fits);

#endif
