// SPDX-License-Identifier: MIT
#include "pgm/pgm_picture.h"

#include <stdlib.h>

enum { SIDE_LEAST = 8 }; // pixels: coarser levels are not worth having

static int64_t within(int64_t index, int count)
{
    return index < 0 ? 0 : index < count ? index : count - 1;
}

static const uint8_t *pixel_at(const struct pgm_picture *picture, int level, int64_t i, int64_t j)
{
    int width = picture->width[level], height = picture->height[level];
    int64_t row = within(j, height);
    if (level == 0) row = height - 1 - row; // the image begins in the north
    const uint8_t *pixels = level == 0 ? picture->image->pixels : picture->pixels[level];
    return pixels + 4 * (row * width + within(i, width));
}

static bool halve(struct pgm_picture *picture, int level)
{
    int width = (picture->width[level - 1] + 1) / 2, height = (picture->height[level - 1] + 1) / 2;
    picture->width[level] = width;
    picture->height[level] = height;
    uint8_t *out = picture->pixels[level] = malloc(4 * (size_t)width * (size_t)height);
    if (!out) return false;
    for (int64_t j = 0; j < height; j++)
        for (int64_t i = 0; i < width; i++)
            for (int channel = 0; channel < 4; channel++) {
                int sum = 2; // to the nearest
                for (int part = 0; part < 4; part++)
                    sum += pixel_at(picture, level - 1, 2 * i + part % 2, 2 * j + part / 2)[channel];
                *out++ = (uint8_t)(sum / 4);
            }
    return true;
}

bool pgm_picture_init(struct pgm_picture *picture, const struct scene_colour *image, int most)
{
    *picture = (struct pgm_picture){.image = image, .levels = 1};
    picture->width[0] = image->width;
    picture->height[0] = image->height;
    for (int last = 0; picture->levels < most; last++, picture->levels++) {
        if (picture->width[last] <= SIDE_LEAST && picture->height[last] <= SIDE_LEAST) break;
        if (!halve(picture, last + 1)) return false;
    }
    return true;
}

void pgm_picture_finish(struct pgm_picture *picture)
{
    for (int level = 0; level < picture->levels; level++) free(picture->pixels[level]);
    *picture = (struct pgm_picture){0};
}

uint32_t pgm_picture_word(const struct pgm_picture *picture, int level, int64_t i, int64_t j)
{
    const uint8_t *pixel = pixel_at(picture, level, i, j);
    return (uint32_t)pixel[0] | (uint32_t)pixel[1] << 8 | (uint32_t)pixel[2] << 16 | (uint32_t)pixel[3] << 24;
}
