// Which part of each level is kept, drawn and morphed for a viewer (Losasso & Hoppe 2004, sections 3 to 6.2).
// PURE.
//
// Levels are counted from the finest drawn: level k has spacing g_k = g_0 2^k.  A box is a rectangle of
// samples of one level, both ends included.  Three boxes a level:
//   clip region    the samples in memory; it follows the viewer, keeps up to CLIPMAP_MARGIN lines that he has
//                  left, lies within the coarser clip region less one cell, and falls behind when the budget
//                  of samples is spent
//   active region  n x n samples about the viewer, within the map, cropped to the clip region and to the
//                  coarser active region less two cells; its open sides lie on even samples
//   render region  active region less the active region of the next finer level (the hole)
// The coarsest level holds the whole map and does not follow the viewer, so that the map is always covered.
//
// Without a budget the active region is a function of the view alone: two visits to one view draw the same
// picture.  What damps jitter is the clip region's margin (numerics.md, B7): no sample is read again while
// the viewer swings about a snapping line.
//
// A side of an active region is *open* when it borders on the coarser level, and closed when it lies on the
// map's edge.  Only open sides morph and are stitched. SPDX-License-Identifier: MIT
#ifndef CLIPMAP_CLIPMAP_LEVELS_H
#define CLIPMAP_CLIPMAP_LEVELS_H

#include "common/view/view.h"

#include <stdbool.h>
#include <stdint.h>

enum { CLIPMAP_MAX_LEVELS = 40, CLIPMAP_MARGIN = 2 };

// The morph parameter: the half extent about the viewer, as printed in section 6.2, or the corrected form
// (numerics.md, CM1 to CM3), which is the viewer form where a side is where the viewer puts it and the
// distance to the actual perimeter where the side was cropped.
enum clipmap_alpha { CLIPMAP_ALPHA_PUBLISHED, CLIPMAP_ALPHA_STABLE };

// A size for each level (section 9).  A level gets a share of n, at least half of it and 0.7 of the next
// finer level's:
//   error  so that all levels err alike where they begin: level k as e / g of level k + 1, e its rms error
//   mean   so that pixels err least on their mean for so many samples.  Level k reaches out to R_k = n_k g_k
//   / 2;
//          ground at a distance d covers pixels in proportion to 1 / d^2, and its error measures e / d on the
//          screen, so the mean is the sum of (e_{k+1} - e_k) / R_k^2, and least where n_k is as
//          ((e_{k+1} - e_k) / g_k^2)^(1/4): 0.84 of the next finer level's where e grows as g
enum clipmap_sizes { CLIPMAP_SIZES_EQUAL, CLIPMAP_SIZES_ERROR, CLIPMAP_SIZES_MEAN };

enum clipmap_side { CLIPMAP_WEST, CLIPMAP_SOUTH, CLIPMAP_EAST, CLIPMAP_NORTH, CLIPMAP_SIDES };

struct clipmap_box {
    int64_t lo[2], hi[2]; // x, y; empty when hi < lo
};
extern const struct clipmap_box clipmap_empty;
bool clipmap_box_is_empty(const struct clipmap_box *box);
bool clipmap_box_holds(const struct clipmap_box *outer,
                       const struct clipmap_box *inner); // true for an empty inner
bool clipmap_box_equal(const struct clipmap_box *a, const struct clipmap_box *b);
uint64_t clipmap_box_samples(const struct clipmap_box *box);
struct clipmap_box clipmap_box_common(const struct clipmap_box *a, const struct clipmap_box *b);

int64_t clipmap_floor_div(int64_t a, int64_t b); // b > 0; rounds towards minus infinity (numerics.md, B5)
int clipmap_slot(int64_t index, int size);       // toroidal slot, 0 .. size - 1, of any index

struct clipmap_rules { // what a user chooses
    int n;             // samples on a side of an active region, odd, at least 11
    double transition; // width of the morph, as a share of n
    enum clipmap_alpha alpha;
    bool fade;       // fade a level before height switches it off (CM6)
    double throttle; // share of the levels' samples that is drawn, 0 .. 1: complexity throttling, section 1
    int ahead;       // lines that a refill reads beyond what is wanted, the way the viewer moves: section 5
};

struct clipmap_shape { // what stays the same in flight
    struct clipmap_rules rules;
    int available;                 // levels that the terrain has
    int levels;                    // of them in use; the last holds the whole map
    int size;                      // samples on a side of the toroidal store of a level
    int kept[CLIPMAP_MAX_LEVELS];  // samples on a side of the square about the viewer in memory
    int drawn[CLIPMAP_MAX_LEVELS]; // and drawn: throttled, at least 11 (CM3); both odd
    int finest; // that is drawn: 0, unless 11 x 11 samples of every level are more than the throttle's share
    struct clipmap_box map[CLIPMAP_MAX_LEVELS]; // the map, rounded outward to even samples
    double spacing_m[CLIPMAP_MAX_LEVELS];       // larger of x and y
};

// available: levels that the terrain has, at least 1.  finest: extent of its finest level.
void clipmap_shape_init(struct clipmap_shape *shape, const struct clipmap_rules *rules, int available,
                        const struct terrain_extent *finest, double finest_spacing_m);

// error_m[k]: rms error of level k < shape->available.  Smaller levels may need one more to hold the whole
// map.
void clipmap_shape_by_error(struct clipmap_shape *shape, enum clipmap_sizes sizes, const double *error_m);

// A region fitted to the frustum (clipmap_fit.h): the part `seen`, with sides on even samples, of a square of
// n x n samples about the viewer, n odd.
struct clipmap_fit {
    int n;
    struct clipmap_box seen;
};

// n x n samples, the viewer within one cell of the centre, all four sides on even samples (section 5,
// constraint 3).
struct clipmap_box clipmap_square(int n, const struct view_origin *eye);

// s of section 4: what the spacing of a level measures on the screen, in pixels, at the average depth 0.4 n g
// of its ring, for a level view.  3 at n = 255, 640 pixels and 90 degrees; 359 at 1 degree, where the method
// is out of its range (numerics.md, B17).
double clipmap_spacing_px(int n, int width_px, double tan_half_horizontal);

// The samples that level k wants in memory: section 4.  Empty when the viewer is higher than 0.4 n g above
// ground, or away from the map.  fits: one a level; NULL: squares about the viewer.
struct clipmap_box clipmap_desired(const struct clipmap_shape *shape, int k, const struct view_origin *eye,
                                   double height_m, const struct clipmap_fit *fits);

// What the memory of level k should hold next: `desired` and as much of `clip` as fits in size x size
// samples, all within the coarser clip region less one cell (section 5, constraint 1; at the map's edge there
// is no coarser sample to spare).  What of `clip` is outside of it is to be forgotten.  heading: signs of the
// viewer's motion in x and y; a side that has to move that way moves by rules.ahead lines more, so that it
// moves less often.  coarser_clip is not looked at for the coarsest level.
struct clipmap_box clipmap_target(const struct clipmap_shape *shape, int k, const struct clipmap_box *clip,
                                  const struct clipmap_box *coarser_clip, const struct clipmap_box *desired,
                                  const int heading[2]);

// The largest box on the way from `kept`, a part of `target`, to `target` that reads at most `budget`
// samples: all sides move outwards, each by the same share of its way.  An empty `kept` starts in the middle.
// A budget of 4 lines moves at least one side.
struct clipmap_box clipmap_grown(const struct clipmap_box *kept, const struct clipmap_box *target,
                                 uint64_t budget);

// Whether what a box is made of is there; asks for it if not.
typedef bool clipmap_there_fn(void *user, const struct clipmap_box *box);

// Of a budget for clipmap_grown, as much as is there: asked for in steps outwards, and so from near to far.
uint64_t clipmap_budget_there(const struct clipmap_box *kept, const struct clipmap_box *target,
                              uint64_t budget, clipmap_there_fn *there, void *user);

// The samples of `now` that are not in `before`: up to 4 boxes that do not overlap ("L-shaped", section 5).
int clipmap_exposed(const struct clipmap_box *before, const struct clipmap_box *now,
                    struct clipmap_box exposed[4]);

// Cuts a box, no larger than size x size, where its slots wrap: up to 4 boxes, each a plain rectangle of
// slots.
int clipmap_unwrap(const struct clipmap_box *box, int size, struct clipmap_box pieces[4]);

struct clipmap_region {
    struct clipmap_box active; // empty: the level is not drawn
    struct clipmap_box hole;   // the finer active region in samples of this level; empty: none
    bool open[CLIPMAP_SIDES];
    // Morph, for vertex at `cell` = index - floor(eye / g):  d = min(cell - low, high - cell) over x and y;
    // alpha = max(fade, clamp((width - d) / width, 0, 1)), and 1 where d <= 0 (stable form).
    float low[2], high[2], width, fade;
};

// Crops coarse to fine (section 6.1) and sets the morph.  eyes[k]: the eye in the grid of level k.  fits: as
// for clipmap_desired.  clips[k]: samples in memory; NULL: all there is.
void clipmap_regions(const struct clipmap_shape *shape, const struct view_origin *eyes, double height_m,
                     const struct clipmap_fit *fits, const struct clipmap_box *clips,
                     struct clipmap_region *regions);

// The morph in float32, step by step as the vertex program does it.
float clipmap_alpha_at(const struct clipmap_region *region, enum clipmap_alpha form, int cell_x, int cell_y);
float clipmap_morphed(float z, float z_c, float alpha);

#endif
