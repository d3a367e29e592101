// The scene's colour image as a pyramid: each level half as large as the one before, a pixel the mean of four
// (Livny et al. 2008, section 3.4).  PURE: no GL.
//
// Pixel (i, j) of level k, i east and j north, covers the pixels 2i, 2i + 1 by 2j, 2j + 1 of level k - 1, so
// its centre lies at (i + 1/2) 2^k pixels of level 0 from the image's south-west corner, at every level and
// for any size: where a size is odd, the last pixel stands for its neighbour beyond the rim too.
// SPDX-License-Identifier: MIT
#ifndef PGM_PGM_PICTURE_H
#define PGM_PGM_PICTURE_H

#include "common/scene/scene.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { PGM_PICTURE_LEVELS_MAX = 32 };

struct pgm_picture {
    const struct scene_colour *image; // borrowed: level 0
    int levels;
    int width[PGM_PICTURE_LEVELS_MAX], height[PGM_PICTURE_LEVELS_MAX];
    uint8_t *pixels[PGM_PICTURE_LEVELS_MAX]; // RGBA, the south row first; level 0: NULL
};

// Levels until one has no side longer than 8 pixels, or until there are `most` of them.  False when out of
// memory; the picture may be finished all the same.
bool pgm_picture_init(struct pgm_picture *picture, const struct scene_colour *image, int most);
void pgm_picture_finish(struct pgm_picture *picture); // accepts a zeroed struct

// A pixel as a word, red in the lowest byte; beyond the rim the nearest one.
uint32_t pgm_picture_word(const struct pgm_picture *picture, int level, int64_t i, int64_t j);

#endif
