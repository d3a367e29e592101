// What stands behind struct terrain: a pyramid in memory, or a file read on demand.
// SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_TERRAIN_PARTS_H
#define COMMON_TERRAIN_TERRAIN_PARTS_H

#include "common/terrain/detail.h"
#include "common/terrain/pyramid.h"
#include "common/terrain/terrain.h"

struct terrain {
    struct terrain_info info;
    struct pyramid pyramid;    // unused when the terrain is read on demand
    struct detail detail;      // sphere: its grid, and the levels that are not in memory
    double without_noise_q[2]; // lowest and highest that U may make of level 0, in finer levels
    struct paged *paged;       // NULL: in memory
};

#endif
