// The ray caster on a sphere.  Heights are linear in (longitude, latitude) over each triangle of the finest
// level and placed radially, so facets are curved.  A ray is cut where its latitude turns and at the map's
// seam; each piece goes down a quadtree of highest heights, over meridian half planes and cones of latitude,
// to the cells of the finest level, and is bisected inside a triangle.  Synthesised levels are made where
// rays come near them, tile by tile, the same samples as from terrain_window.
//
// Of a terrain that is read on demand, 64 x 64 cells of level 0 are read where a ray passes under the highest
// of what the file tells of the tiles there; each thread keeps 10 MiB of them.  Nodes and their order are the
// same, and so are the results, bit for bit.
//
// Poles are rows of cells like any other: their northern or southern corners are one point.  Where columns
// crowd, cells of synthesised levels are as wide as posts are apart (detail.h), and so are the nodes over
// them, which stay about as wide as high in the world from the root to the cells.
// SPDX-License-Identifier: MIT
#ifndef BENCH_ERROR_TRUTH_SPHERE_H
#define BENCH_ERROR_TRUTH_SPHERE_H

#include "common/terrain/terrain.h"

#include <stdbool.h>

struct truth_sphere;
struct truth_sphere *truth_sphere_create(const struct terrain *terrain); // NULL after one line on stderr
void truth_sphere_destroy(struct truth_sphere *sphere);                  // accepts NULL

// Tiles of synthesised levels that one thread has made, and pages that it has read; any number of them
// changes no result.
struct truth_tiles;
// Those that another call is done with, or new ones; the sphere keeps them until it is destroyed.
// Thread-safe.
struct truth_tiles *truth_tiles_take(const struct truth_sphere *sphere); // NULL when memory runs out
void truth_tiles_give(const struct truth_sphere *sphere, struct truth_tiles *tiles); // accepts NULL

struct truth_sphere_hit {
    double t, height_m; // over the datum
    double normal[3];   // world, outward, not unit
};

// The first place from t0 on where origin + t * direction (world, planet-centred) comes down through the
// surface.  False: sky, or it begins below.
bool truth_sphere_cast(const struct truth_sphere *sphere, struct truth_tiles *tiles, const double origin_m[3],
                       const double direction[3], double t0, struct truth_sphere_hit *hit);

#endif
