// What packing does differently from layout to layout: how a level becomes the coarser one, and how a tile's
// samples become coefficients and bytes.  Everything is local, so that a region of a map packs as the whole
// map would.
// SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_RELIEF_PACK_METHOD_H
#define COMMON_TERRAIN_RELIEF_PACK_METHOD_H

#include "common/terrain/relief/layout.h"

struct pack_tile { // one tile, while it is packed
    const struct grid *grid;
    int level;
    int64_t tx, ty;
    const int32_t *step;  // one a band
    int32_t lambda_65536; // these two as coder_rate has them
    bool uneven;
    const struct patch *wanted; // what the level should be, internal units, over at least the tile
    const struct patch *bands;  // smooth: [1..3] details over at least the tile
    const struct patch *coarse; // the coarser level as decoded, over at least layout_coarse_rect
};

struct pack_method {
    int reach;   // samples on either side of 2 i that coarse sample i, or a detail of it, is made from; even
    bool smooth; // samples need coefficients of neighbouring tiles too, by layout_wavelet_inverse
    // The coarser level (bands[0]) and, when smooth, details (bands[1..3]) of a patch that begins at even
    // coordinates, as if it were a whole map.  Rectangles are set here (layout_half_rect), room is given.
    // False when memory runs out.
    bool (*reduce)(const struct patch *fine, struct patch bands[CODER_BANDS]);
    // Chooses the coefficients of a tile and, unless smooth, its decoded samples, [y * LAYOUT_SAMPLES + x].
    void (*code)(const struct pack_tile *at, struct layout_tile *tile, coder_band *k, int32_t *samples);
    // The tile's bytes, at most CODER_MAX_BYTES; 0: none are needed.  `counts` may be NULL.
    size_t (*encode)(const struct layout_tile *tile, const coder_band *k, uint8_t *out,
                     struct coder_counts *counts);
};

const struct pack_method *pack_method(enum layout layout);

#endif
