// Rings about the viewer (Clasen & Hege 2006, sections 3 and 4.5): which of them are drawn, and where a
// vertex is.  PURE.
//
// Ring r stands at the angle pi 2^(-r / rings_a_level) from the viewer's nadir, seen from the planet's
// centre; each has the same number of vertices, so triangles have one shape and about one size on the screen.
// The geometry never changes.  Vertices are known by sine east = cos(azimuth) sin(angle), north =
// sin(azimuth) sin(angle) and c = 1 - cos(angle) = 2 sin^2(angle / 2), which keeps its digits (numerics.md,
// D1). SPDX-License-Identifier: MIT
#ifndef CLIPMAP_SPHERE_RINGS_H
#define CLIPMAP_SPHERE_RINGS_H

#include "common/view/frustum.h"

#include <stdbool.h>

enum { SPHERE_OCTAVES = 34, SPHERE_SECTORS = 32 }; // 34 octaves reach from half a turn to 1 mm on Earth

struct sphere_rings {
    int azimuths;  // vertices of a ring, a multiple of SPHERE_SECTORS
    int an_octave; // a multiple of 16
    int count;     // the last stands for the nadir itself
    int halvings;  // how often a sector's azimuths can be halved
};

// Rings with about twice `n` azimuths, as many rings an octave as make triangles as long as wide.
struct sphere_rings sphere_rings_make(int n);
double sphere_ring_angle(const struct sphere_rings *rings, int ring);
// A vertex of a ring, in double rounded once: east, north, c, and the ring's number.
void sphere_ring_vertex(const struct sphere_rings *rings, int ring, int azimuth, float vertex[4]);

// Angle from a place at height_m over the sphere of radius_m to its horizon, exact to float rounding at any
// height; 0 below it (numerics.md, SC11 and D7).
double sphere_horizon(double height_m, double radius_m);

// Rings outer..inner hold all that can be seen (section 4.5, corrected: SC8, SC9, SC11): the horizon's, peaks
// beyond it included, and those whose triangles are a pixel wide right below.  Within the innermost, the disc
// is filled with triangles of about that size: octave k of it takes every 2^k-th azimuth and ring.
struct sphere_ring_range {
    int outer, inner; // outer <= inner < count
};
struct sphere_ring_range sphere_ring_visible(const struct sphere_rings *rings, const struct terrain *terrain,
                                             const struct view *view, double over_ground_m);

// A block of rings, ring[0] the outer one, and azimuths, less than half a turn, over heights low_m..high_m
// above the datum.  turn: angle of azimuth 0 from east.
struct sphere_block {
    double radius_m[2], above_m[2]; // of the lowest and the highest ground: from the centre, over the eye
    double sine[2], fall[2];        // of the rings' angles; fall: 1 - cosine
    double side[2][2];              // the azimuths' directions
};
void sphere_block_make(struct sphere_block *block, const struct sphere_rings *rings, const struct view *view,
                       double turn, const int ring[2], const int azimuth[2], double low_m, double high_m);
// How far a block reaches from the eye in a direction (its length times that), and 1e-6 of its distance more.
double sphere_block_reach(const struct sphere_block *block, const double direction[3]);

// The azimuth's parallel transport (numerics.md, D5): the pattern's turn from east at a new view, given that
// at the last one.
double sphere_transport(const struct view *last, double turn, const struct view *now);

// Where a vertex samples the map, in float32 step by step as the vertex program does it: longitude and
// latitude relative to the viewer's, radians.
enum sphere_form {
    SPHERE_STABLE,    // half angles of differences (numerics.md, D2)
    SPHERE_CORRECTED, // Equations 3 and 4 with their signs right, in float32
    SPHERE_PUBLISHED, // as printed: Equations 3 and 4, blended with 11 and 14 near the viewer
};
void sphere_angles(enum sphere_form form, double latitude, const float vertex[3], float angles[2]);

#endif
