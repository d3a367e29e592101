// The truth and the error of a renderer's pictures, one view at a time, for tables that print errors.
// SPDX-License-Identifier: MIT
#ifndef BENCH_PAPERS_METER_H
#define BENCH_PAPERS_METER_H

#include "bench/error/error.h"
#include "bench/papers/papers.h"

struct papers_meter { // borrows papers and scene
    const struct papers *papers;
    const struct scene *scene;
    struct truth_surface *surface;
    struct truth truth;       // of the view last cast
    struct frame_error error; // of the view last measured
    struct gpu_target target;
    float *positions; // as gpu_target_read leaves them
};

// Of scene->width x scene->height pixels.  Finish it whether it succeeds or not; false after one line on
// stderr.
bool papers_meter_init(struct papers_meter *meter, const struct papers *papers, const struct scene *scene);
void papers_meter_finish(struct papers_meter *meter);
// Updates the renderer and draws a view, between its begin_frame and the next; hands what is drawn to places.
bool papers_meter_draw(struct papers_meter *meter, struct renderer *renderer, const struct view *view,
                       struct places *places);
// meter->error of what was drawn, against the truth that was cast; hits: its places, as drawn.
void papers_meter_measure(struct papers_meter *meter, const struct view *view, struct places *hits);

#endif
