// The sampling camera: where each row of the persistent grid stands on the ground and how fine it reads.
// After Livny, Sokolovsky, Grinshpoun and El-Sana, "A GPU persistent grid mapping for terrain rendering",
// The Visual Computer 24(2), 2008, sections 3.1 to 3.5, with its equations put right; the published forms
// stay selectable.  PURE: no GL.
//
// The sampling camera stands at the eye without roll, looks down by `depression` (Equation 2) and maps the
// grid onto a sampling plane h below the eye.  A ray at height y of its image plane (focal lengths) has
//     b = sin A - y cos A   (fall)        a = cos A + y sin A   (advance)        t = h / b
// and meets the plane at forward distance q = t a, where a step of 1 across the image plane is t wide.  Rows
// run from the far end of the visible ground to its near end, strictly nearer one by one; row j is a straight
// line across the view.  A vertex is      e_f q_j + e_r X w_j      relative to the eye, X in [-1, 1].
//
// A vertex is displaced straight up or down, so terrain is covered exactly where the rows' trapezoid covers
// the ground under the visible part of the slab between the lowest and the highest terrain: that, not the
// plane, sets its ends and width.
// SPDX-License-Identifier: MIT
#ifndef PGM_PGM_SAMPLER_H
#define PGM_PGM_SAMPLER_H

#include "common/view/view.h"

#include <stdbool.h>

enum { PGM_ROWS_MAX = 1023, PGM_LEVELS_MAX = 40 };

// How the sampling camera follows the viewing camera (Equation 2).
enum pgm_camera {
    PGM_CAMERA_PUBLISHED, // |view angle|, no roll, an "infinitesimal" epsilon: looking up or rolled sends
                          // rays to the sky
    PGM_CAMERA_STABLE,    // signed depression, roll enclosed, epsilon that ends at the farthest terrain
};

// Where the rows end near the viewer (section 3.2, Equation 3).
enum pgm_extension {
    PGM_EXTENSION_NONE,      // at the sampling camera's lower edge
    PGM_EXTENSION_PUBLISHED, // Equation 3 as printed: wrong where terrain rises above the eye
    PGM_EXTENSION_STABLE,    // Equation 3 in a form that holds for any height
    PGM_EXTENSION_TIGHT,     // where the viewing camera's visible ground ends: no row wasted below the screen
};

// How rows are spread between the ends.
enum pgm_law {
    PGM_LAW_UNIFORM,  // even on the sampling camera's image plane: the paper's
    PGM_LAW_HALF_LOG, // half of them even in log distance (numerics.md, A5)
    PGM_LAW_LOG,      // all of them
    PGM_LAW_FOCUS,    // half-log, drawn together about a point of the window, as the columns are (Figure 20)
    PGM_LAW_TARGET,   // by the error that the terrain's levels make at each distance, as many as it takes
};
enum pgm_plane { PGM_PLANE_LOWEST, PGM_PLANE_GROUND }; // sampling plane: lowest terrain, or ground at the eye
// How far a row's ray sinks over one focal length ahead: b.
enum pgm_fall {
    PGM_FALL_PUBLISHED, // sin A - y cos A in float32: cancels at the horizon
    PGM_FALL_STABLE,    // a sum of positive terms from the far end
};
enum pgm_lod { PGM_LOD_PUBLISHED, PGM_LOD_CEIL, PGM_LOD_FLOOR }; // Equations 6 and 7
enum pgm_spread {
    PGM_SPREAD_FAR,
    PGM_SPREAD_MEAN,
    PGM_SPREAD_NEAR
}; // which neighbour's distance picks the level

struct pgm_settings {
    int rows, columns; // quads of the grid, at least 1
    int extra_rows;    // of them, beyond the lower edge of the window: the paper's extra strips; 0: stretched
    enum pgm_camera camera;
    enum pgm_extension extension;
    enum pgm_law law;
    enum pgm_plane plane;
    enum pgm_fall fall;
    enum pgm_lod lod;
    enum pgm_spread spread;
    bool widening; // false: the width of the sampling camera's own frustum (the paper's), which narrows as it
                   // tilts
    double lod_bias;    // levels added to log2(distance / spacing)
    double focus[2];    // PGM_LAW_FOCUS: across and up the window, -1 .. 1
    double focus_width; // and how far it reaches, in halves of the window; small is strong
    double target_px;   // PGM_LAW_TARGET
    bool shrink;        // fewer rows where sky fills the window
    bool strips;        // ground below the lower edge gets rows of its own, instead of stretching the others
    double share;       // of the grid that may be used, in (0, 1]
};

// What the sampler asks of a terrain.
struct pgm_world {
    double outline_m[4];            // of the map
    double lowest_m, highest_m;     // of every level that may be drawn
    double ground_m;                // under the eye (or at the map's edge); for PGM_PLANE_GROUND
    double spacing_m;               // of the finest level
    int levels;                     // how many, finest included
    double error_m[PGM_LEVELS_MAX]; // p99.9 of a mesh as fine as each level; for PGM_LAW_TARGET
    double (*highest_in)(const void *user,
                         const double rect_m[4]); // highest drawn terrain in x_min, y_min, x_max, y_max
    const void *user;
};

struct pgm_sampler {
    double forward[2], right[2]; // e_f and e_r, unit, world
    double tan_half[2];          // of the view's angles, roll enclosed
    double depression;           // A of the sampling camera, radians below the horizon
    double height_m;             // h: eye over the sampling plane, > 0
    double far_m, near_m;        // forward distance of the first and the last row
    double edge_m;               // where the window's lower edge meets the plane, no nearer than near_m
    double width[3];             // half width at forward distance q: max(width[0] + width[1] q, width[2])
    double reach_m;              // D_far: how far ahead the map goes
    double screen_m;             // nearest forward distance at which the viewing camera sees the plane
    double extension; // gamma: how far the near row looks below the sampling camera's lower edge, radians
    bool below_base;  // the eye is not above the lowest terrain
    bool empty;       // nothing of the terrain can be seen: no rows
};

void pgm_sampler_aim(struct pgm_sampler *sampler, const struct view *view, const struct pgm_world *world,
                     const struct pgm_settings *settings);

// Half width of the grid at forward distance q.
double pgm_sampler_half_width(const struct pgm_sampler *sampler, double forward_m);

// Highest drawn terrain under the rows between two forward distances, relative to the eye.
double pgm_sampler_highest(const struct pgm_sampler *sampler, const struct view *view,
                           const struct pgm_world *world, double from, double to);

// Equation 3: the angle by which the viewport is extended, radians.  height: eye over the plane; distance:
// where the lower edge meets it (<= 0: at or past nadir); highest: highest terrain of the missed area over
// the plane.
double pgm_extension_published(double height, double distance, double highest);
double pgm_extension_stable(double height, double distance, double highest);

#endif
