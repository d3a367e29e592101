// The levels of a colour image that goes all around a planet, each pixel a mean over ground about as wide as
// it is high: towards the poles columns crowd, and a mean of as many as parallels are shorter keeps kernels
// round (Clasen & Hege 2006, section 4.3).  So the level that suits a pixel's size on the ground suits it
// everywhere, and one lookup is enough.  PURE. SPDX-License-Identifier: MIT
#ifndef COMMON_GL_PLANET_IMAGE_H
#define COMMON_GL_PLANET_IMAGE_H

#include <stdbool.h>
#include <stdint.h>

// One level: RGBA, the north row first, of as many bytes as `pixels`, which are means of squares of the
// image's.
bool planet_image_round(const uint8_t *pixels, int width, int height, uint8_t *round); // false: no memory

// The next level, of half the size, from means of squares: false where width or height are odd.  `half` may
// be `pixels`.
bool planet_image_halve(const uint8_t *pixels, int *width, int *height, uint8_t *half);

#endif
