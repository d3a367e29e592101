// SPDX-License-Identifier: MIT
#include "common/gl/planet_image.h"

#include <math.h>
#include <stdlib.h>

// Sum of a channel from column 0 to a place, anywhere around; sums[i]: of the columns before i.
static double sum_to(const double (*sums)[4], int width, double place, int channel)
{
    double turns = floor(place / width), inside = place - turns * width,
           whole = fmin(floor(inside), width - 1);
    const double(*at)[4] = sums + (int)whole;
    return turns * sums[width][channel] + at[0][channel] +
           (inside - whole) * (at[1][channel] - at[0][channel]);
}

bool planet_image_round(const uint8_t *pixels, int width, int height, uint8_t *round)
{
    double(*sums)[4] = calloc((size_t)width + 1, sizeof *sums);
    for (int j = 0; sums && j < height; j++) {
        const uint8_t *row = pixels + 4 * (size_t)j * (size_t)width;
        uint8_t *out = round + 4 * (size_t)j * (size_t)width;
        double columns = fmin(1 / sin((j + 0.5) * M_PI / height), width);
        for (int i = 0; i < width; i++)
            for (int k = 0; k < 4; k++) sums[i + 1][k] = sums[i][k] + row[4 * i + k];
        for (int i = 0; i < width; i++)
            for (int k = 0; k < 4; k++)
                out[4 * i + k] =
                    (uint8_t)((sum_to((const double(*)[4])sums, width, i + 0.5 + 0.5 * columns, k) -
                               sum_to((const double(*)[4])sums, width, i + 0.5 - 0.5 * columns, k)) /
                                  columns +
                              0.5);
    }
    free(sums);
    return sums != NULL;
}

bool planet_image_halve(const uint8_t *pixels, int *width, int *height, uint8_t *half)
{
    int w = *width, h = *height;
    if (w % 2 || h % 2) return false;
    for (int j = 0; j < h / 2; j++)
        for (int i = 0; i < w / 2; i++)
            for (int k = 0; k < 4; k++) {
                const uint8_t *at = pixels + 4 * ((size_t)(2 * j) * (size_t)w + (size_t)(2 * i)) + k;
                half[4 * ((size_t)j * (size_t)(w / 2) + (size_t)i) + (size_t)k] =
                    (uint8_t)((at[0] + at[4] + at[4 * w] + at[4 * w + 4] + 2) / 4);
            }
    *width = w / 2, *height = h / 2;
    return true;
}
