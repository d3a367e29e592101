// The drawn mesh at given places: for each place (x, y) the lowest and highest height that the captured
// triangles have there.  Places are kept in a k-d tree and triangles are streamed through it, so that a mesh
// of any size needs no memory of its own.  No GL.  Same result for any number of threads and any order of
// triangles.
//
// Places and vertices are rounded to one grid, 2^-49 of the farthest place or finer: differences are then
// exact for vertices up to 8 times as far, and so is the side of an edge that a place is on.  Edges belong
// to both of their triangles, so a mesh without gaps leaves no place uncovered.
//
// SPDX-License-Identifier: MIT
#ifndef BENCH_ERROR_PLACES_H
#define BENCH_ERROR_PLACES_H

#include <stdbool.h>
#include <stddef.h>

struct places;

// places[k] = x, y relative to the eye, metres.  Copies them.  NULL after one line on stderr.
struct places *places_create(const double (*xy)[2], size_t count, int threads);
void places_destroy(struct places *places); // accepts NULL

void places_clear(struct places *places); // no mesh seen yet
// Takes triangles (9 floats each, relative to the eye); its signature is that of a capture callback.
// Degenerate triangles (no area in x and y) and those with a NAN are passed over; edges belong to the
// triangle.
void places_feed(const float *triangles, size_t count, void *places);

// Lowest and highest drawn height at place k, relative to the eye; false when no triangle covers it.
bool places_height(const struct places *places, size_t k, double *low, double *high);

#endif
