// Pictures draped over the map from edge to edge, of any size, and the light map made from the terrain
// (Brodersen 2005, section 5, "Texture handling").  No GL.
//
// A picture has its own pyramid: level 0 is the picture, each next one half the size, until one pixel is
// left.  Rows run from north to south.
//
// It is cut along map blocks: what a block shows at a level is the rectangle of pixels that covers it, with
// as many more on each side that filters read the same across the border of two blocks, on the rectangle
// itself and on its GEOMIPMAP_MIPMAPS mipmaps. SPDX-License-Identifier: MIT
#ifndef GEOMIPMAP_GEOMIPMAP_PICTURE_H
#define GEOMIPMAP_GEOMIPMAP_PICTURE_H

#include "common/terrain/terrain.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { GEOMIPMAP_PICTURE_LEVELS = 24, GEOMIPMAP_MIPMAPS = 3 };

struct geomipmap_picture {
    int channels; // bytes of a pixel
    int levels;
    struct geomipmap_picture_level {
        int width, height;
        const uint8_t *pixels;
    } level[GEOMIPMAP_PICTURE_LEVELS];
    uint8_t *own; // levels that were made
};

// Makes the pyramid above `pixels`, which are borrowed until finish.  False after one line on stderr.
bool geomipmap_picture_init(struct geomipmap_picture *picture, int width, int height, int channels,
                            const uint8_t *pixels);
void geomipmap_picture_finish(struct geomipmap_picture *picture); // accepts a zeroed picture

struct geomipmap_rect { // pixels x .. x + width - 1 of a level, y from the north
    int x, y, width, height;
};

// The pixels of a level that the part of the map from (west, north) to (east, south) needs; places are
// shares of the picture, 0 .. 1 from the north-west corner.
struct geomipmap_rect geomipmap_picture_rect(const struct geomipmap_picture *picture, int level,
                                             const double part[4]);

// Bytes of a texture of these pixels and their mipmaps.
size_t geomipmap_rect_bytes(const struct geomipmap_picture *picture, struct geomipmap_rect rect);

// The finest level whose pixels are at least `spacing` wide, in shares of the picture's width.
int geomipmap_picture_level_for(const struct geomipmap_picture *picture, double spacing);

// Light on the terrain: one byte a sample of `*width` x `*height`, 255 times the cosine between the ground's
// normal and the sun, 0 where it is turned away.  To be freed; NULL after one line on stderr.
uint8_t *geomipmap_light_map(const struct terrain *terrain, int level, const double to_sun[3], int *width,
                             int *height);

#endif
