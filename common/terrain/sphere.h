// Height grids that go all around a planet.
//
// Columns run east and come back to where they began, rows run from pole to pole, and both poles are rows:
// row j = +-pole lies on the pole, all its samples are equal.  Walking on over a pole leads down the meridian
// on the other side, half a turn away: sample (i, pole + k) is sample (i + columns / 2, pole - k).  So every
// int64 index names a sample ("folding").
//
// Longitude and latitude are metres of arc on the datum sphere (angle * radius), so that lengths, spacings
// and slopes have one unit on the plane and on the sphere.
// SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_SPHERE_H
#define COMMON_TERRAIN_SPHERE_H

#include "common/terrain/terrain.h"

#include <stdbool.h>

struct sphere_grid {
    int64_t first;   // index of the first column
    int64_t columns; // of a whole turn, even
    int64_t pole;    // rows -pole .. pole
};

// The grid of level 0 of a map with `columns` x `rows` samples, rows odd; and that of another level.
struct sphere_grid sphere_grid(int64_t first, int64_t columns, int64_t rows);
struct sphere_grid sphere_level(const struct sphere_grid *level0, int level);
struct terrain_extent sphere_extent(const struct sphere_grid *grid);

// Replaces an index by the one inside the extent that names the same sample.
void sphere_fold(const struct sphere_grid *grid, int64_t *i, int64_t *j);

// Copies a window of any place and size out of the samples of the extent, row 0 south.
void sphere_window(const struct sphere_grid *grid, const int32_t *samples, int64_t x0, int64_t y0, int width,
                   int height, int32_t *out);

// Makes each pole one height, the rounded mean of its row.
void sphere_level_poles(const struct sphere_grid *grid, int32_t *samples);

// Whether the poles and the turn stay whole in the next coarser level; and that level, filtered over seam and
// poles.  `coarse` has room for it.  False when memory runs out.
bool sphere_has_coarser(const struct sphere_grid *grid);
bool sphere_downsample(const struct sphere_grid *grid, const int32_t *samples, enum terrain_filter filter,
                       int32_t *coarse);

// A map whose samples are the centres of cells, `columns` x `rows` of them, row 0 south and half a cell from
// the pole, column 0 half a cell east of a grid line: its values on the grid lines, rows + 1 of them, by the
// 4-point rule (-1 9 9 -1)/16 along both axes.  NULL when memory runs out; columns must be even.
int32_t *sphere_from_pixels(const int32_t *samples, int64_t columns, int64_t rows);

// Place (longitude, latitude in metres of arc; height over the datum) <-> world (planet-centred: z to the
// north pole, x to longitude 0), and the axes at a place: rows east, north, up.  A pole has a meridian for
// each longitude, so a place there tells its east, too.
void sphere_world_from_place(double radius_m, const double place[3], double world_m[3]);
void sphere_place_from_world(double radius_m, const double world_m[3], double place[3]);
void sphere_axes(double radius_m, const double place[3], double axes[3][3]);

#endif
