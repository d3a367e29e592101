// A flight: the camera as a function of the frame number, never of the clock.
// SPDX-License-Identifier: MIT
#ifndef COMMON_VIEW_PATH_H
#define COMMON_VIEW_PATH_H

#include "common/terrain/terrain.h"
#include "common/view/view.h"

#include <stdbool.h>

struct path;

// A key frame.  On a sphere x_m and y_m are longitude and latitude in metres of arc, and what is said of the
// spline below is said in path_sphere.h.  `height_m` is above the ground at (x, y) when above_ground, else
// above the datum.
struct path_key {
    double x_m, y_m, height_m;
    bool above_ground;
    double yaw, pitch, roll; // radians; yaw is unwrapped between keys along the shorter arc
};

// Centripetal Catmull-Rom through the keys, arc length made even, heights lifted where they would come closer
// to the ground than `clearance_m`.  Repeated keys, one key and segments of no length are fine (numerics.md,
// E6).  `frames`: how many frames the path has by itself.  NULL after one line on stderr when there are no
// keys.  On a sphere the terrain is borrowed until destroy.
struct path *path_from_keys(const struct terrain *terrain, const struct path_key *keys, int count, int frames,
                            double clearance_m, double fov_vertical);

// A path that suits any terrain: stays above ground, sees near and far, turns, climbs and dives.
// Deterministic in the terrain.
struct path *path_for_terrain(const struct terrain *terrain, int frames, double fov_vertical);

// One camera a row, as measured: used as they are, linear between rows when resampled.
struct path *path_from_cameras(const struct camera *cameras, int count);

void path_destroy(struct path *path);

int path_frames(const struct path *path);

// Camera of frame `frame` when the whole path is resampled to `frames` frames at equal steps (frames ==
// path_frames: the path's own).  frames == 1: the first.
struct camera path_camera(const struct path *path, int frame, int frames);

#endif
