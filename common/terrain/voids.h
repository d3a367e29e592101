// Missing samples: counted, and filled from their neighbours (numerics.md, E1).
// SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_VOIDS_H
#define COMMON_TERRAIN_VOIDS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// Samples equal to INT32_MIN.
uint64_t voids_count(const int32_t *samples, size_t count);

// Fills every void with a smooth surface through the heights around it: means of valid samples over ever
// larger blocks, then relaxed towards the harmonic surface at each size.  Every step is a weighted mean, so
// filled heights stay within those of the valid samples.  Deterministic.  At least one sample must be valid.
// False when memory runs out.
bool voids_fill(int32_t *samples, int64_t width, int64_t height);

#endif
