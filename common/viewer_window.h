// Inside the viewer: what it holds, the frame it draws, and flying by hand in a window.
// SPDX-License-Identifier: MIT
#ifndef COMMON_VIEWER_WINDOW_H
#define COMMON_VIEWER_WINDOW_H

#include "common/renderer.h"

struct viewer {
    const struct renderer_type *type;
    struct scene *scene;
    struct gpu *gpu;
    struct renderer *renderer;
    struct gpu_target target; // of the scene's width and height
    int largest[2];           // pixels of the largest view that the renderer was made for
    double knobs[RENDERER_MAX_KNOBS];
    int frame; // frames drawn so far
    bool wireframe;
};

// Makes the renderer anew with the current knobs, for views as large as the scene's.  False after one line on
// stderr.
bool viewer_make_renderer(struct viewer *viewer);

// Draws a view into the target; false after one line on stderr.
bool viewer_draw(struct viewer *viewer, const struct view *view);

// Shows the target in the window, scaled to fit it; nothing without a window.
void viewer_show(const struct viewer *viewer);

// Writes the target as a PNG, whole or not at all; false after one line on stderr.
bool viewer_save(const struct viewer *viewer, const char *path);

// Flies by hand until the window is closed; false after one line on stderr.
bool viewer_fly(struct viewer *viewer);

#endif
