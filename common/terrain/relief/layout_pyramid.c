// Layout `pyramid`: Losasso & Hoppe 2004, section 7, as published but for the coder of the residuals, which
// is that of the other layouts and not PTC.  SPDX-License-Identifier: MIT
#include "common/terrain/relief/layout.h"
#include "common/terrain/upsample.h"

#include <stdlib.h>
#include <string.h>

enum { S = LAYOUT_SAMPLES, REACH = 5, SLOPE_CELLS = 4 };

static int32_t limit(int64_t value)
{
    return value > QUANTA_LIMIT ? QUANTA_LIMIT : value < -QUANTA_LIMIT ? -QUANTA_LIMIT : (int32_t)value;
}

// U of the decoded coarser level: all of it, the (even, even) samples as well.  Heights are limited first, so
// that the sums of a harmed file stay in 32 bits.
static void predict(const struct layout_tile *tile, int32_t *out)
{
    int32_t coarse[TILE_COARSE * TILE_COARSE];
    for (int i = 0; i < TILE_COARSE * TILE_COARSE; i++)
        coarse[i] = limit(tile->coarse[i / TILE_COARSE][i % TILE_COARSE]);
    upsample(coarse, 0, 0, S, S, out);
}

void layout_pyramid_tile(const struct layout_tile *tile, int32_t step, const int32_t *wanted, coder_band *k,
                         int32_t *samples)
{
    predict(tile, samples);
    for (int b = 0; b < CODER_BANDS; b++)
        for (int y = 0; y < tile->coder.height[b]; y++)
            for (int x = 0; x < tile->coder.width[b]; x++) {
                int at = (2 * y + (b >> 1)) * S + 2 * x + (b & 1);
                samples[at] =
                    layout_settle(samples[at], wanted ? &wanted[at] : NULL, step, &k[b][y * CODER_TILE + x]);
            }
}

// ---- D ---------------------------------------------------------------------

// Value k steps beyond the end of a line, whose slope is that of its last cells (numerics.md, E3: exact on
// planes).
static int64_t beyond(const int64_t *line, int64_t stride, int64_t size, int64_t index)
{
    int64_t end = index < 0 ? 0 : size - 1, cells = size - 1 < SLOPE_CELLS ? size - 1 : SLOPE_CELLS;
    int64_t inner = index < 0 ? cells : size - 1 - cells, away = llabs(index - end);
    return cells > 0 ? line[end * stride] + away * (line[end * stride] - line[inner * stride]) / cells
                     : line[end * stride];
}

static int64_t filter_at(const int64_t *line, int64_t stride, int64_t size, int64_t centre,
                         const struct filter_taps *taps)
{
    bool inside = centre >= taps->reach && centre + taps->reach < size;
    const int64_t *at = line + centre * stride;
    int64_t sum = taps->half[0] * at[0];
    for (int k = 1; k <= taps->reach; k++) {
        int64_t before = inside || centre - k >= 0 ? at[-k * stride] : beyond(line, stride, size, centre - k);
        int64_t after = inside || centre + k < size ? at[k * stride] : beyond(line, stride, size, centre + k);
        sum += taps->half[k] * (before + after);
    }
    return sum;
}

bool layout_pyramid_reduce(const struct patch *fine, struct patch bands[CODER_BANDS])
{
    const struct filter_taps *taps = filter_taps(TERRAIN_FILTER_OPTIMAL);
    int64_t width = rect_width(&fine->rect), height = rect_height(&fine->rect);
    bands[0].rect = layout_half_rect(&fine->rect, 0);
    int64_t across = rect_width(&bands[0].rect), along = rect_height(&bands[0].rect);
    int64_t *line = malloc((size_t)(width + across * height) * sizeof *line);
    if (!line) return false;
    int64_t *rows = line + width, round = (int64_t)1 << (2 * taps->shift - 1);
    for (int64_t y = 0; y < height; y++) {
        for (int64_t x = 0; x < width; x++) line[x] = fine->samples[y * width + x];
        for (int64_t i = 0; i < across; i++) rows[y * across + i] = filter_at(line, 1, width, 2 * i, taps);
    }
    for (int64_t j = 0; j < along; j++)
        for (int64_t i = 0; i < across; i++)
            bands[0].samples[j * across + i] =
                limit((filter_at(rows + i, across, height, 2 * j, taps) + round) >> 2 * taps->shift);
    free(line);
    return true;
}
