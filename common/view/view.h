// The camera.  Plain C, double precision, no GL.
//
// The eye stands on a lattice: x and y are multiples of (finest spacing) * 2^-lattice_bits and z of
// quantum * 2^-VIEW_HEIGHT_BITS (numerics.md, B2 and B14).  Every renderer, the ray caster and the error
// measures use this same eye, so the fraction of the eye within a cell of any level is exact in float32 and
// vertices that two levels or two tiles share come out bitwise equal:
//     x_relative = (float(I) - F) * g,   I = i - floor(eye / g) an integer, F = frac(eye / g)
// with g the spacing of the level.  It holds for up to 24 levels: lattice_bits + levels - 1 <= 23.
//
// "Relative to the eye" means along the axes at the eye's place: x east, y north, z up.  On the plane these
// are the world's axes.  On a sphere the lattice is finer than any place in double (steps of 2^-23 of a
// finest cell; fractions are rounded to float), z is along the eye's plumb line, and ground falls away below
// z = 0 with the distance.
//
// Pixels are counted from the bottom left.  Pixel (x, y) covers x..x+1, y..y+1 of the window; its ray goes
// through its centre, so view_project of that ray gives (x + 0.5, y + 0.5).
// SPDX-License-Identifier: MIT
#ifndef COMMON_VIEW_VIEW_H
#define COMMON_VIEW_VIEW_H

#include "common/terrain/terrain.h"

#include <stdbool.h>
#include <stdint.h>

enum { VIEW_HEIGHT_BITS = 8 };

// What a path or a user asks for.  Angles in radians: yaw 0 looks east, pi/2 north; pitch > 0 looks up;
// roll > 0 lowers the right side.
struct camera {
    double eye_m[3]; // place: x, y or longitude, latitude (metres of arc), and height
    double yaw, pitch, roll;
    double fov_vertical; // the VERTICAL angle of view (numerics.md, FOV trap)
};

struct view {
    double eye_m[3];        // world, on the lattice
    double eye_place[3];    // the same as a place
    double axes[3][3];      // of the relative coordinates, in the world: east, north, up at the eye
    double radius_m;        // from a sphere's centre to the eye; 0 on the plane
    int64_t eye_lattice[2]; // eye in units of finest spacing * 2^-lattice_bits, floor-exact
    int64_t eye_height;     // eye height in units of quantum * 2^-VIEW_HEIGHT_BITS above offset_m
    int lattice_bits;
    int finest;                         // finest level of the terrain: the level the lattice refines
    double right[3], up[3], forward[3]; // unit vectors, in the axes of relative coordinates
    double tan_half[2];                 // tangents of half the horizontal and vertical angle
    double near_m;                      // nearest visible depth; the far plane is at infinity
    int width, height;                  // pixels
    double pixels_per_tangent;          // K = height / (2 tan_half[1])
    double yaw, pitch, roll;
    float clip_from_relative[16]; // column-major; reversed depth: clip.z = near, clip.w = depth
};

// Builds a view over a terrain.  near_m <= 0: max(0.05, 0.1 x height over ground), off the map over the
// nearest ground of its outline.  Axes come from yaw, pitch and roll, never from a fixed up vector
// (numerics.md, A9 and E6).
void view_init(struct view *view, const struct terrain *terrain, const struct camera *camera, int width,
               int height, double near_m);

// The eye in the grid of a level: `base` = floor(eye / g), `fraction` = frac(eye / g), exact in float.
struct view_origin {
    int64_t base[2];
    float fraction[2];
};
struct view_origin view_level_origin(const struct view *view, int level);

// Eye height in quanta, split into an integer and a fraction in [0, 1) that is exact in float.
void view_eye_quanta(const struct view *view, int32_t *base, float *fraction);

// Whether no fragment of what is drawn inside a rectangle, given relative to the eye, can lie outside the
// map's outline, whatever the rounding of its interpolated position: the rectangle keeps away from the
// outline by 1e-4 of its farthest distance.
bool view_inside_outline(const struct view *view, const struct terrain *terrain, const double low[2],
                         const double high[2]);

// The world position of a point relative to the eye.
void view_world(const struct view *view, const double relative[3], double world_m[3]);
void view_world_direction(const struct view *view, const double relative[3],
                          double world[3]); // not from the eye

// Direction of the ray through the centre of pixel (x, y), scaled so that its depth (along forward) is 1.
void view_ray(const struct view *view, int x, int y, double direction[3]);

// Pixel position of a point relative to the eye; false when its depth is below near_m.
bool view_project(const struct view *view, const double relative[3], double pixel[2]);

// Length on the screen, in pixels, of the vertical segment between two heights at one place, given relative
// to the eye: the projected vertical error of the papers.  Points nearer than near_m are clipped to it; false
// (and 0) when the whole segment is nearer than that (numerics.md, E7).
bool view_project_vertical(const struct view *view, double x_relative, double y_relative, double z0_relative,
                           double z1_relative, double *length_px);
// The same for the segment from `from` (relative to the eye) to from + step, in any direction.
bool view_project_segment(const struct view *view, const double from[3], const double step[3],
                          double *length_px);

#endif
