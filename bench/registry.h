// The one table of renderers.  Tests and timings run through it: nothing is timed that is not verified.
// SPDX-License-Identifier: MIT
#ifndef BENCH_REGISTRY_H
#define BENCH_REGISTRY_H

#include "common/renderer.h"

extern const struct renderer_type null_renderer; // clears and draws nothing: the cost of the harness
extern const struct renderer_type
    brute_renderer; // every triangle of the finest level: truth and cost of no LOD
extern const struct renderer_type brute_sphere_renderer; // what brute is over a planet: not in the table
extern const struct renderer_type decimated_renderer;    // every 2^k-th sample: is LOD worth it?

extern const struct renderer_type *const renderer_table[];                  // ends with NULL; baselines first
const struct renderer_type *renderer_find(const char *name, size_t length); // NULL: unknown

// Whether brute and any decimated mesh of the terrain fit in half of this machine's memory.
bool baselines_fit(const struct terrain *terrain);

double baselines_bytes_present(void); // memory of this machine

#endif
