// Worlds told by a small JSON file, strict keys, instead of by samples:
//
//   {"generate": "amplify", "source": "jacksboro", "levels": 4, "width": 216000, "height": 93600,
//    "spacing_m": 30, "height_scale": 4, "quantum_m": 0.0625, "seed": 1}
//
// amplify: a real map, mirrored at its borders again and again, is the coarsest of `levels` + 1 levels; each
// finer one is U of the coarser plus Gaussian noise (synthesis.h) with the spread that the map's own
// residuals have, continued to finer ones as their power of the spacing (Losasso & Hoppe 2004, section 8).
// Any window at any place is made alone.  `source` is "jacksboro", which the program carries, or an elevation
// file, sought beside the spec and in $RELIEF_DATA.  By default spacing_m is the source's / 2^levels,
// height_scale 1, quantum_m 1/16, seed 1.
//
// Of a whole planet (a source with radius_m, heightfield.h) a planet is made: {"generate": "amplify",
// "source": "earth.png", "levels": 3, "width": 43200, "height": 21601}.  The source is first brought to width
// / 2^levels columns, (height - 1) / 2^levels + 1 rows from pole to pole, by the 4-point rule; from there
// levels are those of detail.h, which go on over the seam and the poles.  width and height are the source's *
// 2^levels when they are not told; spacing_m follows from the radius.
//
// Any kind of `terrain generate` (generate.h) serves too: {"generate": "fractal", "width": 1025, "height":
// 1025, "spacing_m": 30, "relief_m": 1000, "seed": 1}; these are held in memory. SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_AMPLIFY_H
#define COMMON_TERRAIN_AMPLIFY_H

#include "common/terrain/heightfield.h"

struct relief_source;
struct amplify; // opaque

// Reads a spec: either `field` is filled or *world is made.  False after one line on stderr.
bool generate_spec_read(const char *path, struct heightfield *field, struct amplify **world);

// The world as a source, which owns it then.
bool amplify_source(struct relief_source *source, struct amplify *world);

#endif
