// SPDX-License-Identifier: MIT
#include "common/terrain/tint.h"

#include "common/image.h"
#include "common/report.h"

#include <stdlib.h>

static const struct {
    double height_m, rgb[3];
} tints[] = {
    {-8000, {8, 20, 60}},    {-4000, {16, 44, 110}},  {-200, {60, 120, 180}},  {-1, {140, 190, 215}},
    {0, {70, 115, 60}},      {300, {120, 145, 80}},   {1200, {180, 160, 105}}, {2800, {140, 100, 70}},
    {4200, {190, 180, 175}}, {5500, {245, 245, 250}},
};
enum { TINTS = sizeof tints / sizeof tints[0] };

static void tint(double height_m, uint8_t rgb[3])
{
    int k = 1;
    while (k < TINTS - 1 && height_m > tints[k].height_m) k++;
    double from = tints[k - 1].height_m, t = (height_m - from) / (tints[k].height_m - from);
    t = t < 0 ? 0 : t > 1 ? 1 : t;
    for (int c = 0; c < 3; c++)
        rgb[c] = (uint8_t)(tints[k - 1].rgb[c] + t * (tints[k].rgb[c] - tints[k - 1].rgb[c]) + 0.5);
}

// The sample whose place is nearest to the middle of pixel k, of an image that covers so many intervals.
static int64_t nearest(int k, int pixels, int64_t intervals)
{
    return (int64_t)((k + 0.5) / pixels * (double)intervals + 0.5);
}

bool tint_save(const struct heightfield *field, const char *path, int width, int height)
{
    uint8_t *pixels = malloc((size_t)width * (size_t)height * 3);
    if (!pixels) return fail("%s: out of memory", path);
    int64_t across = field->radius_m > 0 ? field->width : field->width - 1; // a planet's last joins its first
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            int64_t row = nearest(y, height, field->height - 1);
            int32_t q = field->samples[row * field->width + nearest(x, width, across) % field->width];
            tint(q == HEIGHTFIELD_VOID ? 0 : field->offset_m + field->quantum_m * q,
                 pixels + 3 * ((size_t)y * (size_t)width + (size_t)x));
        }
    bool good = image_write_png(path, width, height, 3, pixels);
    free(pixels);
    return good;
}
