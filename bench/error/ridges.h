// Ridge lines that the rasteriser's sub-pixel grid broke open.  No GL.
//
// Corners are snapped to a grid of 1/256 pixel.  At the rim of a fold, where a slope is seen nearly edge-on,
// its depth runs over a hundred metres within that step, and the far slope, which faces away, may win a pixel
// that belongs to the near one.  Ground seen from below is a hole, and this is none: a pixel drawn from below
// counts as drawn where a triangle that faces the eye, within TRUTH_SNAP_PX of its centre, is no farther
// there than what was drawn.  A crack shows the surface behind it and has no such triangle before it, unless
// it is narrower than the grid, which no picture can tell. SPDX-License-Identifier: MIT
#ifndef BENCH_ERROR_RIDGES_H
#define BENCH_ERROR_RIDGES_H

#include "common/view/view.h"

#include <stddef.h>

enum { RIDGES_CELL_PX = 16 };

struct ridges { // starts zeroed
    const struct view *view;
    float *positions; // width * height RGBA, as PASS_POSITION writes them
    size_t *pixels;   // drawn from below and not yet explained; owned
    size_t count, capacity;
    unsigned char *cells; // of RIDGES_CELL_PX pixels squared: whether one of them is there; owned
    int columns, rows;
};

// Finds the pixels drawn from below.  Both are borrowed until the last feed.  False after one line on stderr.
bool ridges_begin(struct ridges *ridges, const struct view *view, float *positions);
// Captured triangles of the frame: 9 floats each, relative to the eye.  Turns the w of explained pixels to
// +1.
void ridges_feed(struct ridges *ridges, const float *triangles, size_t count);
void ridges_finish(struct ridges *ridges);

#endif
