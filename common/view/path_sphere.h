// A flight over a sphere: over poles and the 180th meridian as over any other place, from a walk to space.
// Private to common/view.
//
// Between keys the direction from the planet's centre, the logarithm of the height over ground and the
// orientation (a quaternion in the world) are cubic, with tangents that are limited so that a short segment
// beside a long one does not swing, and a segment is gone along the faster the higher it is.  The ground
// under the eye is that of a level whose spacing is the height over ground, so that a flight does not shake
// with what it hardly sees.  Steps are even in what the eye sees move: metres over height over ground, plus
// the angle turned. SPDX-License-Identifier: MIT
#ifndef COMMON_VIEW_PATH_SPHERE_H
#define COMMON_VIEW_PATH_SPHERE_H

#include "common/view/path.h"

struct path_sphere;

// `count` >= 1 keys; NULL after one line on stderr.  The terrain is borrowed until destroy.
struct path_sphere *path_sphere_from_keys(const struct terrain *terrain, const struct path_key *keys,
                                          int count, double clearance_m, double fov_vertical);
struct camera path_sphere_camera(const struct path_sphere *path, int frame, int frames);
void path_sphere_destroy(struct path_sphere *path); // accepts NULL

// A flight that suits any planet: a walk, a climb over a pole to three radii, down again over the other pole
// and the 180th meridian.
int path_sphere_tour(const struct terrain *terrain, struct path_key keys[], int room);

#endif
