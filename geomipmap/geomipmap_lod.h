// How wrong a tile is at each level, and how wrong it may be (Brodersen 2005, section 4; numerics.md, G2
// and C1-C3).  No GL.
//
// A tile draws every 2^height-th sample of the finest level at its level 0 (height 0: every one), every
// 2^(height + l)-th at level l.
//
// The error of a level is the largest vertical distance between the triangles it draws and the finest
// surface, anywhere in the tile.
//   published: delta_l, over the vertices of the finest level under the level's own triangles.
//   stable:    delta'_l, also over every triangulation of the border that a finer neighbour can ask for.
//              Added vertices are exact, but the fan they make is another triangulation, up to twice as
//              wrong (G2).
// Both surfaces are linear between the points where an edge of one meets an edge of the other, so the
// largest distance stands at one of those points.  Which points these are depends on the tile's size alone:
// they follow from triangles and edges that are listed once, and are weights of four vertices each, which
// eight tiles sum up at a time.
//
// The metric `mean` asks another question: which levels give the least mean error for a number of triangles?
// A tile with the area A on the ground whose step is s draws 2 A / s^2 triangles.  At depth w it covers about
// K^2 A f / w^2 pixels, f its foreshortening, and an error of e(s) metres, the mean distance of both
// surfaces, shows as K e / w pixels.  So with a multiplier m the sum over all tiles of
//     K^3 A f e(s) / w^3  +  m 2 A / s^2
// is to be least.  The area falls out.  Halving the step from s adds 6 A / s^2 triangles and is worth them
// where  s^2 (e(s) - e(s / 2)) > 6 m w^3 / (K^3 f).  That is what is compared here: each tile and level keeps
// its saving s^2 (e(s) - e(s / 2)), and the right side grows with a power of depth.  f is 1 where the ground
// faces the eye and height / w where it is flat, so the power is 3 to 4; 3.5 is used, with the depth where a
// sample is a pixel wide as its unit.  In pixels, with S the step on the screen:
//     saving_px S^2 <= tau^3 (w / (K spacing))^0.5
// Levels are chosen by what they cost alone: no error is promised anywhere.
// SPDX-License-Identifier: MIT
#ifndef GEOMIPMAP_GEOMIPMAP_LOD_H
#define GEOMIPMAP_GEOMIPMAP_LOD_H

#include "common/view/view.h"
#include "geomipmap/geomipmap_mesh.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum geomipmap_delta {
    GEOMIPMAP_PUBLISHED,
    GEOMIPMAP_STABLE,
    GEOMIPMAP_SAVING, // of the metric `mean`, with the step in samples of the finest level
};

struct geomipmap_drawn { // triangles and their edges, each once, as numbers of samples packed into one number
    uint64_t *triangles, *edges;
    size_t triangle_count, edge_count;
};

struct geomipmap_plan {
    int bits;   // the tile has 2^bits cells a side
    int height; // each of them 2^height cells of the finest level wide
    struct geomipmap_drawn plain[GEOMIPMAP_MAX_LEVELS];  // of a level's own
    struct geomipmap_drawn border[GEOMIPMAP_MAX_LEVELS]; // those that only a finer neighbour brings
};

// Lists what is drawn of tiles of 2^bits cells, from every 2^height-th sample.  bits + height is at most
// GEOMIPMAP_MAX_EXTENT.  False after one line on stderr.
enum { GEOMIPMAP_MAX_EXTENT = 7 };
bool geomipmap_plan_init(struct geomipmap_plan *plan, int bits, int height);
void geomipmap_plan_finish(struct geomipmap_plan *plan); // accepts a zeroed plan
size_t geomipmap_plan_bytes(const struct geomipmap_plan *plan);

// Tiles are measured this many at a time; their heights stand side by side, heights[sample * LANES + lane],
// in quanta above each tile's lowest sample: all (2^(bits + height) + 1)^2 samples of the finest level.
enum { GEOMIPMAP_LANES = 8 };

// Where tiles are drawn with the filtered levels of the pyramid, a vertex may stand off its sample.  What a
// tile's level draws inside comes from one level of the pyramid, but a border from the finer one of two
// tiles, and a corner from the finest of all tiles around it: the error is the largest over every choice.
struct geomipmap_heights {
    const double *finest; // as above; NAN outside the map, where no error counts
    // By level of the tile, one after the other: the (2^(bits - level) + 1)^2 heights that it draws, side by
    // side likewise, geomipmap_level_first() before the first of a level.  NULL: the finest samples.
    const double *drawn;
    // Lowest and highest of the south-west, south-east, north-west and north-east corner over all levels
    // finer than the tile's own, which only corners may have; side by side likewise.
    const double *corner_low, *corner_high;
    double *low, *high; // for work, as large as `finest`; only with `drawn`
};
size_t geomipmap_level_first(int bits, int level); // in vertices; level bits: all

// Error of each lane's tile at each level, in quanta, rounded up; exactly 0 where the surfaces are the same
// because the tile is flat or draws every sample.  range[lane]: height of the tile's highest sample.
// GEOMIPMAP_SAVING: the saving of each level instead, in quanta times samples squared, not rounded; that of
// level 0 is nowhere needed and counts from no error at all where tiles are drawn with filtered levels.
void geomipmap_plan_measure(const struct geomipmap_plan *plan, enum geomipmap_delta delta,
                            const struct geomipmap_heights *heights, const double range[GEOMIPMAP_LANES],
                            float error[GEOMIPMAP_LANES][GEOMIPMAP_MAX_LEVELS]);

// ---- what is allowed ----------------------------------------------------------------------------

enum geomipmap_metric {
    GEOMIPMAP_PAPER, // K d / D, D the Euclidean distance to the tile's box: too small off the axis
    GEOMIPMAP_DEPTH, // K d / w, w the least depth of the tile's visible part
    GEOMIPMAP_SAFE,  // holds for every vertical segment of length d that has a visible end in the tile
    GEOMIPMAP_MEAN,  // the least mean error for a number of triangles; of savings, not of errors
};

// What of a view the metric needs; the same for all tiles.
struct geomipmap_judge {
    enum geomipmap_metric metric;
    double tau_px;
    double pixels_per_tangent;
    double spacing_m; // mean: of the finest level
    double near_m;
    double vertical_px;   // safe: most pixels that a vertical metre takes at depth 1, over the window
    double vertical_sink; // safe: depth that a vertical metre can lose
};
void geomipmap_judge_init(struct geomipmap_judge *judge, enum geomipmap_metric metric, double tau_px,
                          const struct view *view, double spacing_m);

// Largest vertical error in metres that keeps the metric within tau, for a tile whose visible part is at
// least `depth_m` deep and whose box is `distance_m` from the eye.  Of `mean`: largest saving, in metres
// times samples squared, that is not worth its triangles.
double geomipmap_allowed(const struct geomipmap_judge *judge, double depth_m, double distance_m);

// The coarsest of `levels` levels whose error is at most `allowed`, both in the same unit; 0 when none is.
// Levels above `kept`, the one drawn before, must keep their error within `coarser` instead, which is at
// most `allowed`.
int geomipmap_choose(const float *error, int levels, double allowed, int kept, double coarser);

#endif
