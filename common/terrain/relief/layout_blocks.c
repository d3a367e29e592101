// Layouts whose tiles hold samples: `raw`, plain ones, and `mars`, a block coder of others (codec_mars.h);
// and what tells the layouts apart.  SPDX-License-Identifier: MIT
#include "common/terrain/relief/codec_mars.h"
#include "common/terrain/relief/layout.h"

#include <string.h>

enum { S = LAYOUT_SAMPLES, RAW_HEAD = 5 }; // bytes a sample, and the lowest sample

const char *const LAYOUT_NAMES[LAYOUTS] = {"wavelet", "bounded", "pyramid", "mars", "raw"};

static int columns_of(const struct layout_tile *tile)
{
    return tile->coder.width[0] + tile->coder.width[BAND_HL];
}

static int rows_of(const struct layout_tile *tile)
{
    return tile->coder.height[0] + tile->coder.height[BAND_LH];
}

static const struct mars_form AS_PUBLISHED;

// ---- raw -------------------------------------------------------------------

size_t layout_raw_encode(const struct layout_tile *tile, const coder_band *k, uint8_t *out)
{
    const int32_t *samples = (const int32_t *)k;
    int columns = columns_of(tile), rows = rows_of(tile);
    int32_t low = INT32_MAX, high = INT32_MIN;
    for (int y = 0; y < rows; y++)
        for (int x = 0; x < columns; x++) {
            int32_t q = samples[y * S + x];
            low = q < low ? q : low;
            high = q > high ? q : high;
        }
    int bytes = (int64_t)high - low > UINT16_MAX ? 4 : 2;
    uint8_t *to = out;
    *to++ = (uint8_t)bytes;
    for (int byte = 0; byte < 4; byte++) *to++ = (uint8_t)((uint32_t)low >> 8 * byte);
    for (int y = 0; y < rows; y++)
        for (int x = 0; x < columns; x++) {
            uint32_t above = (uint32_t)samples[y * S + x] - (uint32_t)low;
            for (int byte = 0; byte < bytes; byte++) *to++ = (uint8_t)(above >> 8 * byte);
        }
    return (size_t)(to - out);
}

static bool raw_decode(const struct layout_tile *tile, const uint8_t *data, size_t size, int32_t *samples)
{
    int columns = columns_of(tile), rows = rows_of(tile);
    if (size < RAW_HEAD || (data[0] != 2 && data[0] != 4)) return false;
    int bytes = data[0];
    if (size != RAW_HEAD + (size_t)bytes * (size_t)columns * (size_t)rows) return false;
    uint32_t low = 0;
    for (int byte = 0; byte < 4; byte++) low |= (uint32_t)data[1 + byte] << 8 * byte;
    data += RAW_HEAD;
    for (int y = 0; y < rows; y++)
        for (int x = 0; x < columns; x++) {
            uint32_t above = 0;
            for (int byte = 0; byte < bytes; byte++) above |= (uint32_t)*data++ << 8 * byte;
            samples[y * S + x] = (int32_t)(low + above);
        }
    return true;
}

// ---- mars ------------------------------------------------------------------

size_t layout_mars_encode(const struct layout_tile *tile, const coder_band *k, uint8_t *out)
{
    int32_t packed[S * S];
    int columns = columns_of(tile), rows = rows_of(tile);
    for (int y = 0; y < rows; y++)
        memcpy(packed + y * columns, (const int32_t *)k + y * S, (size_t)columns * sizeof *packed);
    return mars_encode(packed, columns, rows, &AS_PUBLISHED, out, CODER_MAX_BYTES);
}

static bool block_decode(const struct layout_tile *tile, const uint8_t *data, size_t size, int32_t *samples)
{
    int32_t packed[S * S];
    int columns = columns_of(tile), rows = rows_of(tile);
    if (!mars_decode(data, size, columns, rows, &AS_PUBLISHED, packed)) return false;
    for (int y = 0; y < rows; y++)
        memcpy(samples + y * S, packed + y * columns, (size_t)columns * sizeof *packed);
    return true;
}

// ---- any layout ------------------------------------------------------------

bool layout_tile_decode(enum layout layout, const struct layout_tile *tile, const uint8_t *data, size_t size,
                        coder_band *k)
{
    if (layout == LAYOUT_RAW) return raw_decode(tile, data, size, (int32_t *)k);
    if (layout == LAYOUT_MARS) return block_decode(tile, data, size, (int32_t *)k);
    return coder_decode(&tile->coder, data, size, k);
}

void layout_tile_samples(enum layout layout, const struct layout_tile *tile, int32_t step, coder_band *k,
                         int32_t *samples)
{
    if (layout == LAYOUT_BOUNDED)
        layout_bounded_tile(tile, step, NULL, k, samples);
    else if (layout == LAYOUT_PYRAMID)
        layout_pyramid_tile(tile, step, NULL, k, samples);
    else
        memcpy(samples, k, S * S * sizeof *samples);
}
