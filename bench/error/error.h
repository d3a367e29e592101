// How far a drawn frame is from the truth, pixel by pixel, and what it failed to cover.  No GL.
//
// Definitions: reports/README.md (they are fixed).  In short:
//
// error_px: the larger of (a) the drawn point against the truth at the same place and (b) the truth's hit
// against the drawn mesh at the same place, each the vertical difference projected to the screen.  Misses
// and spills enter with their distance in pixels to the other picture's skyline in their column.
//
// plane_px: distance of the drawn point from the plane of the truth's triangle in the same pixel,
// K |n.(p - q)| / w.
//
// Holes: undrawn ground whose undrawn region (8-connected) touches no sky of the truth, and every undrawn
// pixel more than 8 px under the truth's skyline in its column.  Misses: the other undrawn ground.
// Spills: drawn where the truth has sky.  A pixel whose nearest drawn fragment faces away counts as
// undrawn.
//
// Cases that the definitions leave open:
//
// Heights of the truth are rounded to float32, the format of the position target, before they are compared:
// a drawn point that could not be nearer has error 0 exactly.
//
// A drawn point beyond the map's outline by rounding (1e-6 of its distance) is compared at the outline's
// nearest place; one farther out has no (a).
//
// Where no triangle is drawn at the truth's hit there is no (b); plane_px stands in, so that ground seen
// through a missing piece of the mesh does not pass for right.
//
// Where the truth's skyline passes within a pixel's centre by less than the sub-pixel grid (TRUTH_SNAP_PX),
// ground and sky are both right: a pixel drawn as the other of the two is no miss and no spill, and no
// sample.
//
// A pixel drawn from below is not drawn: ground seen through a crack.  Where the sub-pixel grid broke a ridge
// line open, the captured triangles tell (bench/error/ridges.h), and its pixels come in here as drawn.
//
// A column may hold several skylines (a needle above a valley, a map seen from outside, a rolled camera): a
// pixel is measured to the nearest pixel of sky, and to the other picture's nearest ground, which in a
// column with one skyline are those at the skyline.  The picture's border is not sky, but a skyline may lie
// just beyond its upper row, and where a column of the other picture has no ground its skyline lies just
// below the lowest row (a view that hangs upside down: the other way round).
//
// SPDX-License-Identifier: MIT
#ifndef BENCH_ERROR_ERROR_H
#define BENCH_ERROR_ERROR_H

#include "bench/error/places.h"
#include "bench/error/truth.h"

#include <stdint.h>

enum pixel_kind { PIXEL_SKY, PIXEL_GROUND, PIXEL_HOLE, PIXEL_MISS, PIXEL_SPILL };

struct frame_error {
    int width, height;
    float *error_px;                        // NAN: not a sample (sky in both, a hole, or unmeasured)
    float *plane_px;                        // NAN where either picture has no ground
    uint8_t *kind;                          // enum pixel_kind
    uint64_t ground, holes, misses, spills; // ground: in both pictures
    uint64_t unmeasured; // ground pixels where neither (a) nor (b) could be projected (nearer than near)
    uint64_t order_mismatches; // ground in both, but the drawn depth differs from the truth's by more than
                               // 1e-3 relative while plane_px is above 0.5: another surface is in front
    uint64_t uncovered;        // ground pixels where no triangle is drawn at the truth's hit
    uint64_t beyond_window;    // samples whose error is more than the window's diagonal (numerics.md, E7)
    int32_t *scratch;          // of frame_error_measure
};

bool frame_error_init(struct frame_error *error, int width, int height); // false after one line on stderr
void frame_error_finish(struct frame_error *error);                      // accepts a zeroed struct

// positions: width * height RGBA, as PASS_POSITION writes them.  hits: places index over the truth's ground
// pixels in pixel order (truth_places), fed with this frame's captured triangles.
void frame_error_measure(struct frame_error *error, const struct terrain *terrain, const struct view *view,
                         const struct truth *truth, const float *positions, const struct places *hits,
                         int threads);

// The same holes and misses, and nothing else, for a small part of the rays: those through undrawn pixels,
// and those that tell holes from misses around undrawn ground.  Casts them into `truth`, of the picture's
// size.  Of `kind` drawn pixels are PIXEL_GROUND where no ray was needed, and `ground` counts these, too.
void frame_error_holes(struct frame_error *error, struct truth *truth, const struct truth_surface *surface,
                       const struct view *view, const float *positions, int threads);

// Whether a drawn point belongs to another surface than the truth's hit in its pixel: the order mismatch.
bool frame_error_other_surface(double plane_px, double drawn_depth, double truth_depth);

// Order mismatches of the picture last measured that the rasteriser's sub-pixel grid does not explain: along
// a ridge line a pixel's centre may lie between the line and the line as snapped, so one counts only if no
// ray at TRUTH_SNAP_PX from the centre meets what was drawn.
uint64_t frame_error_order_beyond_grid(const struct frame_error *error, const struct truth *truth,
                                       const struct truth_surface *surface, const struct view *view,
                                       const float *positions);

// Index over the truth's hits: one place for each ground pixel, in pixel order.  NULL after one line on
// stderr.
struct places *truth_places(const struct truth *truth, int threads);

// Heat map of error_px as RGB, bottom row first: log scale 0.01 .. 10 px from pale yellow to dark red
// (ColorBrewer's YlOrRd: even steps of lightness, safe for colour-blind readers), sky grey, hole magenta,
// miss cyan, spill blue, unmeasured ground dark grey.  The scale's colours are what the report's legend shows
// (frame_error_colour).
void frame_error_picture(const struct frame_error *error, uint8_t *rgb);
void frame_error_colour(double error_px, uint8_t rgb[3]);

#endif
