// SPDX-License-Identifier: MIT
#include "common/terrain/relief/pack_method.h"

#include "common/integer.h"

#include <string.h>

static size_t encode_bands(const struct layout_tile *tile, const coder_band *k, uint8_t *out,
                           struct coder_counts *counts)
{
    return coder_encode(&tile->coder, k, out, counts);
}

// ---- wavelet ---------------------------------------------------------------

static void code_wavelet(const struct pack_tile *at, struct layout_tile *tile, coder_band *k,
                         int32_t *samples)
{
    (void)samples;
    coder_band values[CODER_BANDS];
    int64_t x0 = at->tx * CODER_TILE, y0 = at->ty * CODER_TILE;
    layout_tile_init(tile, LAYOUT_WAVELET, at->grid, at->level, at->tx, at->ty, at->coarse, at->step);
    for (int b = BAND_HL; b <= BAND_HH; b++)
        for (int y = 0; y < tile->coder.height[b]; y++)
            memcpy(values[b] + y * CODER_TILE, patch_at(&at->bands[b], x0, y0 + y),
                   (size_t)tile->coder.width[b] * sizeof(int32_t));
    struct coder_rate rate = {(const coder_band *)values, at->step, at->lambda_65536, at->uneven};
    coder_quantise(&tile->coder, &rate, k);
}

// ---- bounded ---------------------------------------------------------------

static bool reduce_bounded(const struct patch *fine, struct patch bands[CODER_BANDS])
{
    const struct rect *from = &fine->rect;
    struct rect *to = &bands[0].rect;
    *to = layout_half_rect(from, 0);
    for (int64_t y = to->y0; y < to->y1; y++) {
        const int32_t *row = patch_at(fine, from->x0, 2 * y);
        int32_t *out = patch_at(&bands[0], to->x0, y);
        for (int64_t x = 0; x < rect_width(to); x++) out[x] = row[2 * x];
    }
    return true;
}

enum { S = LAYOUT_SAMPLES };

static void gather(const struct pack_tile *at, int32_t wanted[S * S])
{
    const int64_t *size = at->grid->size[at->level];
    int64_t x0 = at->tx * S, y0 = at->ty * S, columns = smaller(S, size[0] - x0),
            rows = smaller(S, size[1] - y0);
    memset(wanted, 0, S * S * sizeof *wanted);
    for (int64_t y = 0; y < rows; y++)
        memcpy(wanted + y * S, patch_at(at->wanted, x0, y0 + y), (size_t)columns * sizeof *wanted);
}

static void code_bounded(const struct pack_tile *at, struct layout_tile *tile, coder_band *k,
                         int32_t *samples)
{
    int32_t wanted[S * S];
    layout_tile_init(tile, LAYOUT_BOUNDED, at->grid, at->level, at->tx, at->ty, at->coarse, at->step);
    gather(at, wanted);
    layout_bounded_tile(tile, at->step[BAND_HL], wanted, k, samples);
}

// ---- pyramid ---------------------------------------------------------------

static void code_pyramid(const struct pack_tile *at, struct layout_tile *tile, coder_band *k,
                         int32_t *samples)
{
    int32_t wanted[S * S];
    layout_tile_init(tile, LAYOUT_PYRAMID, at->grid, at->level, at->tx, at->ty, at->coarse, at->step);
    gather(at, wanted);
    layout_pyramid_tile(tile, at->step[BAND_HL], wanted, k, samples);
}

// ---- mars, raw: a tile's k are its samples ---------------------------------

static void code_raw(const struct pack_tile *at, struct layout_tile *tile, coder_band *k, int32_t *samples)
{
    layout_tile_init(tile, LAYOUT_RAW, at->grid, at->level, at->tx, at->ty, at->coarse, at->step);
    gather(at, samples);
    memcpy(k, samples, S * S * sizeof *samples);
}

static size_t encode_raw(const struct layout_tile *tile, const coder_band *k, uint8_t *out,
                         struct coder_counts *counts)
{
    (void)counts;
    return layout_raw_encode(tile, k, out);
}

static void code_mars(const struct pack_tile *at, struct layout_tile *tile, coder_band *k, int32_t *samples)
{
    uint8_t bytes[CODER_MAX_BYTES];
    code_raw(at, tile, k, samples);
    size_t size = layout_mars_encode(tile, (const coder_band *)k, bytes);
    layout_tile_decode(LAYOUT_MARS, tile, bytes, size, (coder_band *)samples);
}

static size_t encode_mars(const struct layout_tile *tile, const coder_band *k, uint8_t *out,
                          struct coder_counts *counts)
{
    (void)counts;
    return layout_mars_encode(tile, k, out);
}

// ---- the table -------------------------------------------------------------

const struct pack_method *pack_method(enum layout layout)
{
    static const struct pack_method METHODS[] = {
        [LAYOUT_WAVELET] = {LAYOUT_REACH, true, layout_wavelet_forward, code_wavelet, encode_bands},
        [LAYOUT_BOUNDED] = {0, false, reduce_bounded, code_bounded, encode_bands},
        [LAYOUT_PYRAMID] = {LAYOUT_REACH, false, layout_pyramid_reduce, code_pyramid, encode_bands},
        [LAYOUT_MARS] = {0, false, reduce_bounded, code_mars, encode_mars},
        [LAYOUT_RAW] = {0, false, reduce_bounded, code_raw, encode_raw},
    };
    return &METHODS[layout];
}
