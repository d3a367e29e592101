// roofline_ms: what the triangles that a renderer drew would cost if they lay ready in one static buffer.
//
// The captured triangles of a frame, less degenerate ones and those outside the frustum, are welded, ordered
// in compact groups of at most 512 triangles (as many as a tile of 16 x 16 quads), numbered group by group,
// and drawn with a plain matrix vertex program and the common fragments.  Never the renderer's own buffers or
// program. SPDX-License-Identifier: MIT
#ifndef BENCH_ROOFLINE_H
#define BENCH_ROOFLINE_H

#include "common/gl/gpu.h"
#include "common/view/frustum.h"

struct roofline;

// NULL after one line on stderr.
struct roofline *roofline_create(struct gpu *gpu, enum terrain_datum datum,
                                 const struct scene_effects *effects);
void roofline_destroy(struct roofline *roofline);

void roofline_begin(struct roofline *roofline, const struct view *view); // forgets the last frame's triangles
void roofline_feed(const float *triangles, size_t count, void *roofline); // a gpu_capture_fn
uint64_t roofline_visible(const struct roofline *roofline); // triangles kept: the visible triangles
bool roofline_build(struct roofline *roofline);             // welds, orders and uploads; not timed
void roofline_draw(struct roofline *roofline);              // the draw to be timed

#endif
