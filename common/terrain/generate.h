// Made terrain: shapes with known answers and a seeded fractal, the scenes that carry the hard cases
// (numerics.md, section 6). SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_GENERATE_H
#define COMMON_TERRAIN_GENERATE_H

#include "common/terrain/heightfield.h"

#include <stdbool.h>
#include <stdint.h>

#define GENERATE_KINDS "fractal|flat|ramp|ridge|needle|checker|cliff|wall|plateau|crater|voids"

struct generate_options {
    const char *kind;  // one of GENERATE_KINDS
    int width, height; // samples
    double spacing_m;
    double relief_m; // height of the shape; 0: the kind's own
    uint64_t seed;
};

// The height that a kind has when none is asked for, in metres.
double generate_default_relief(const struct generate_options *options);

// Fills the heightfield; heights are exact multiples of the quantum where 16 bits allow.  False after one
// line on stderr.
bool generate(struct heightfield *field, const struct generate_options *options);

#endif
