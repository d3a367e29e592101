// SPDX-License-Identifier: MIT
#include "geomipmap/geomipmap_picture.h"

#include "common/report.h"

#include <math.h>
#include <stdlib.h>

static int half(int size)
{
    return size > 1 ? size / 2 : 1;
}

// Means of 2 x 2 pixels; the last row or column of an odd size is left out, as by mipmaps.
static void halve(const struct geomipmap_picture_level *from, int channels, uint8_t *out)
{
    int width = half(from->width), height = half(from->height);
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            int x1 = 2 * x + 1 < from->width ? 2 * x + 1 : 2 * x;
            int y1 = 2 * y + 1 < from->height ? 2 * y + 1 : 2 * y;
            const uint8_t *rows[2] = {from->pixels + (size_t)2 * y * from->width * channels,
                                      from->pixels + (size_t)y1 * from->width * channels};
            for (int c = 0; c < channels; c++) {
                int sum = rows[0][2 * x * channels + c] + rows[0][x1 * channels + c] +
                          rows[1][2 * x * channels + c] + rows[1][x1 * channels + c];
                *out++ = (uint8_t)((sum + 2) / 4);
            }
        }
}

bool geomipmap_picture_init(struct geomipmap_picture *picture, int width, int height, int channels,
                            const uint8_t *pixels)
{
    *picture = (struct geomipmap_picture){.channels = channels, .levels = 1};
    picture->level[0] = (struct geomipmap_picture_level){width, height, pixels};
    size_t bytes = 0;
    for (int w = width, h = height; w > 1 || h > 1;) {
        w = half(w), h = half(h);
        bytes += (size_t)w * (size_t)h * (size_t)channels;
    }
    picture->own = malloc(bytes ? bytes : 1);
    if (!picture->own) return fail("geomipmap: no memory for the smaller sizes of a picture");
    uint8_t *next = picture->own;
    while (picture->level[picture->levels - 1].width > 1 || picture->level[picture->levels - 1].height > 1) {
        const struct geomipmap_picture_level *from = &picture->level[picture->levels - 1];
        halve(from, channels, next);
        picture->level[picture->levels++] =
            (struct geomipmap_picture_level){half(from->width), half(from->height), next};
        next += (size_t)half(from->width) * (size_t)half(from->height) * (size_t)channels;
    }
    return true;
}

void geomipmap_picture_finish(struct geomipmap_picture *picture)
{
    free(picture->own);
    *picture = (struct geomipmap_picture){0};
}

enum { MIP = 1 << GEOMIPMAP_MIPMAPS }; // pixels along a pixel of the last mipmap

// Edges of a rectangle stand between pixels of the last mipmap, so that two rectangles have the same ones; a
// filter reads half of one beyond its place.
static int edge_before(double pixel, int size)
{
    double edge = floor((pixel - MIP / 2) / MIP) * MIP;
    return edge < 0 ? 0 : edge > size - 1 ? (size - 1) / MIP * MIP : (int)edge;
}

static int edge_behind(double pixel, int size)
{
    double edge = ceil((pixel + MIP / 2) / MIP) * MIP;
    return edge < 1 ? size < MIP ? size : MIP : edge > size ? size : (int)edge;
}

struct geomipmap_rect geomipmap_picture_rect(const struct geomipmap_picture *picture, int level,
                                             const double part[4])
{
    const struct geomipmap_picture_level *l = &picture->level[level];
    int x0 = edge_before(part[0] * l->width, l->width), y0 = edge_before(part[1] * l->height, l->height);
    int x1 = edge_behind(part[2] * l->width, l->width), y1 = edge_behind(part[3] * l->height, l->height);
    return (struct geomipmap_rect){x0, y0, x1 - x0, y1 - y0};
}

size_t geomipmap_rect_bytes(const struct geomipmap_picture *picture, struct geomipmap_rect rect)
{
    size_t pixels = (size_t)rect.width * (size_t)rect.height;
    for (int n = 0, w = rect.width, h = rect.height; n < GEOMIPMAP_MIPMAPS && (w > 1 || h > 1); n++) {
        w = half(w), h = half(h);
        pixels += (size_t)w * (size_t)h;
    }
    return pixels * (size_t)picture->channels;
}

int geomipmap_picture_level_for(const struct geomipmap_picture *picture, double spacing)
{
    int level = 0;
    while (level + 1 < picture->levels && 1.0 / picture->level[level].width < spacing) level++;
    return level;
}

// ---- light --------------------------------------------------------------------------------------

// Spacings between the neighbours of a sample, one of which is the sample itself at the edge of the map.
static int span(int sample, int count)
{
    return sample == 0 || sample == count - 1 ? 1 : 2;
}

// One row of the light map from three rows of heights, each with one sample more on both sides: at the edge
// of the map that one repeats the last.  spacing_q: between samples; south and north stand span_y of them
// apart.
static void light_row(const int32_t *south, const int32_t *row, const int32_t *north, int width,
                      const double spacing_q[2], int span_y, const double to_sun[3], uint8_t *out)
{
    for (int i = 0; i < width; i++) {
        double slope_x = ((double)row[i + 2] - row[i]) / (span(i, width) * spacing_q[0]);
        double slope_y = ((double)north[i + 1] - south[i + 1]) / (span_y * spacing_q[1]);
        double cosine = (to_sun[2] - slope_x * to_sun[0] - slope_y * to_sun[1]) /
                        sqrt(1 + slope_x * slope_x + slope_y * slope_y);
        out[i] = (uint8_t)lround(255 * fmin(fmax(cosine, 0), 1));
    }
}

uint8_t *geomipmap_light_map(const struct terrain *terrain, int n, const double to_sun[3], int *width,
                             int *height)
{
    double quantum_m = terrain_info(terrain)->quantum_m;
    struct terrain_level level = terrain_level(terrain, n);
    *width = (int)(level.extent.x1 - level.extent.x0);
    *height = (int)(level.extent.y1 - level.extent.y0);
    size_t count = (size_t)*width * (size_t)*height, stride = (size_t)*width + 2;
    uint8_t *light = malloc(count);
    int32_t *rows = malloc(3 * stride * sizeof *rows);
    if (!light || !rows) {
        free(light);
        free(rows);
        fail("geomipmap: no memory for a light map of %d x %d", *width, *height);
        return NULL;
    }
    const double spacing_q[2] = {level.spacing_m[0] / quantum_m, level.spacing_m[1] / quantum_m};
    for (int j = 0; j < *height; j++) {
        terrain_window(terrain, n, level.extent.x0 - 1, level.extent.y0 + j - 1, (int)stride, 3, rows,
                       TERRAIN_WAIT);
        light_row(rows, rows + stride, rows + 2 * stride, *width, spacing_q, span(j, *height), to_sun,
                  light + (size_t)(*height - 1 - j) * (size_t)*width);
    }
    free(rows);
    return light;
}
