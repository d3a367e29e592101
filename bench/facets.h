// The finest surface of a planet as plain triangles, for one view: what brute draws.  No GL.
//
// Between samples heights are linear in (longitude, latitude) and placed radially, so a facet is curved.  It
// is split until what each edge leaves out is below FACETS_SAG_PX on the screen, at the nearest place that
// the triangle may have; one much longer than wide, as near the poles, is cut across its length alone while
// its width leaves out nothing: rasterisers interpolate badly within slivers.  Whether an edge is split hangs
// on the edge alone, so both triangles at it, of whatever cells, split it alike: the mesh has no T-junctions,
// its shared corners are bitwise equal, and the 180th meridian and the poles are places like others.
// SPDX-License-Identifier: MIT
#ifndef BENCH_FACETS_H
#define BENCH_FACETS_H

#include "common/view/view.h"

#include <stdbool.h>
#include <stddef.h>

// Edges leave out at most 3/4 of this, and a triangle's inside at most 4/3 of its edges: all of it, so that
// with what float32 rounds away brute and the ray caster agree in 1.6e-4 px wherever facets are drawn where
// they are.
#define FACETS_SAG_PX 1.4e-4

// The largest differences of neighbouring samples along the two sides of a band of cells, and across it: they
// bound how steep facets are.
struct facet_rises {          // starts zeroed
    double *east_m, *north_m; // a band of cells each, from the south pole
};
bool facet_rises_init(struct facet_rises *rises, const struct terrain *terrain); // false after one line
void facet_rises_finish(struct facet_rises *rises);                              // accepts a zeroed struct

struct facets {          // starts zeroed
    float (*corners)[3]; // three a triangle, relative to the eye, counter-clockwise from above
    size_t triangles, room;
    int blocks, blocks_drawn;
};

// What may be seen: blocks of 32 x 32 cells beyond the horizon are left out, and with `cull` those outside
// the frustum; where facets are split, so are such blocks of 4 x 4.  Memory grows as views ask for it; false
// after one line on stderr when there are more than most_bytes.
bool facets_make(struct facets *facets, const struct facet_rises *rises, const struct terrain *terrain,
                 const struct view *view, bool cull, double sag_px, size_t most_bytes);
void facets_finish(struct facets *facets); // accepts a zeroed struct

#endif
