// Heights of all levels in one integer texture, each level in a slot of its own, so that one draw may read
// any level.  Livny et al. 2008, section 4 (the texture atlas).  Whole levels are resident.
// SPDX-License-Identifier: MIT
#ifndef PGM_PGM_ATLAS_H
#define PGM_PGM_ATLAS_H

#include "common/gl/gpu.h"
#include "pgm/pgm_sampler.h"

#include <stdbool.h>
#include <stddef.h>

struct pgm_slot {
    struct terrain_extent extent; // the samples it holds
    int x, y;                     // texel of sample (extent.x0, extent.y0)
};

struct pgm_atlas {
    GLuint texture;
    int width, height; // texels
    int finest;        // level of slot 0; slot k holds level finest + k
    int levels;
    int base_q;  // height in quanta = texel + base_q
    bool narrow; // 16-bit texels, else 32-bit
    struct pgm_slot slots[PGM_LEVELS_MAX];
};

// Places the levels: the finest in the corner, the others in a column or a row beside it.  PURE.
void pgm_atlas_layout(struct pgm_atlas *atlas, const struct terrain *terrain);

// Lays out, allocates and fills the texture.  False after one line on stderr.
bool pgm_atlas_init(struct pgm_atlas *atlas, struct gpu *gpu, const struct terrain *terrain);
void pgm_atlas_finish(struct pgm_atlas *atlas); // accepts a zeroed struct

size_t pgm_atlas_bytes(const struct pgm_atlas *atlas);

#endif
