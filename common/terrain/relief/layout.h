// How a level follows from the next coarser one and its tiles of coefficients, in integers: the two layouts
// of a .relief file.  Levels are nested: a level of w samples stands on the even samples of the finer one, so
// the coarser level has (w + 1) / 2.
//
//   bounded  Closed loop: odd samples are predicted by U (the 4-point scheme, Losasso & Hoppe 2004, section
//   5)
//            from decoded ones, along x, along y, and for (odd, odd) by the mean of both; steps of 2 E + 1
//            keep every sample of every level within E.  Beyond a tile odd samples count as predicted, so a
//            tile needs only coarse samples.
//   wavelet  Critically sampled Deslauriers-Dubuc (4, 4) lifting, whose predict step is U: first along x,
//   then
//            along y, each step rounded once.  A coarse level is the finer one filtered, and tiles need
//            neighbours.
//
// Values are internal units, quanta * 2^fraction_bits.  Sums wrap instead of overflowing: a harmed file gives
// wrong heights, never undefined behaviour.
// SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_RELIEF_LAYOUT_H
#define COMMON_TERRAIN_RELIEF_LAYOUT_H

#include "common/integer.h"
#include "common/terrain/relief/coder.h"

#include <stdbool.h>
#include <stdint.h>

enum layout { LAYOUT_WAVELET, LAYOUT_BOUNDED, LAYOUT_PYRAMID, LAYOUT_MARS, LAYOUT_RAW, LAYOUTS };
extern const char *const LAYOUT_NAMES[LAYOUTS];

// Bands of a tile: (odd, even), (even, odd), (odd, odd) samples in (x, y).
enum { BAND_HL = 1, BAND_LH = 2, BAND_HH = 3 };

enum { LAYOUT_LEVELS = 40, LAYOUT_BASE = 8, LAYOUT_SAMPLES = 2 * CODER_TILE };

struct rect { // x0 <= x < x1, y0 <= y < y1
    int64_t x0, y0, x1, y1;
};

struct patch { // samples of a rectangle, row by row
    struct rect rect;
    int32_t *samples;
};

static inline int64_t rect_width(const struct rect *r)
{
    return r->x1 - r->x0;
}
static inline int64_t rect_height(const struct rect *r)
{
    return r->y1 - r->y0;
}
static inline struct rect rect_hull(const struct rect *a, const struct rect *b)
{
    return (struct rect){smaller(a->x0, b->x0), smaller(a->y0, b->y0), larger(a->x1, b->x1),
                         larger(a->y1, b->y1)};
}
static inline struct rect rect_clipped(const struct rect *r, const int64_t size[2])
{
    return (struct rect){larger(r->x0, 0), larger(r->y0, 0), smaller(r->x1, size[0]),
                         smaller(r->y1, size[1])};
}
static inline struct rect rect_blocks(const struct rect *samples, int shift) // of 2^shift that it touches
{
    int64_t last = ((int64_t)1 << shift) - 1;
    return (struct rect){samples->x0 >> shift, samples->y0 >> shift, (samples->x1 + last) >> shift,
                         (samples->y1 + last) >> shift};
}
static inline int32_t *patch_at(const struct patch *patch, int64_t x, int64_t y)
{
    return patch->samples + (y - patch->rect.y0) * rect_width(&patch->rect) + (x - patch->rect.x0);
}

struct grid {                          // the levels of a file
    int count;                         // the last one is the base
    int64_t size[LAYOUT_LEVELS][2];    // samples
    int64_t tiles[LAYOUT_LEVELS][2];   // of levels 0..count-2
    int64_t first_tile[LAYOUT_LEVELS]; // number of the level's first tile; coarse levels come first
    int64_t tile_count;
};
void grid_init(struct grid *grid, int64_t width, int64_t height);

// Number of samples of a band along an axis: band 0 is the coarser level itself.
int64_t grid_band_size(const struct grid *grid, int level, int band, int axis);

// Where a band of a patch that begins at even coordinates stands.
struct rect layout_half_rect(const struct rect *fine, int band);

// ---- one tile --------------------------------------------------------------

enum { TILE_COARSE = CODER_TILE + 3 }; // coarse samples along an axis that a tile sees: from -1 to TILE + 1

struct layout_tile {
    struct coder_tile coder;
    int32_t coarse[TILE_COARSE]
                  [TILE_COARSE]; // [y + 1][x + 1] from the tile's corner, continued beyond the map
    uint16_t activity[CODER_BANDS][CODER_TILE * CODER_TILE];
};

// Rectangle of coarse samples that tile (tx, ty) reads, within the coarser level.
struct rect layout_coarse_rect(const struct grid *grid, int level, int64_t tx0, int64_t ty0, int64_t tx1,
                               int64_t ty1);

// Prepares a tile of `level` from a patch of the coarser level; `step` is that of each band.
void layout_tile_init(struct layout_tile *tile, enum layout layout, const struct grid *grid, int level,
                      int64_t tx, int64_t ty, const struct patch *coarse, const int32_t step[CODER_BANDS]);

// bounded: the tile's samples, [y * LAYOUT_SAMPLES + x], from its coefficients; with `wanted` (NULL:
// decoding) the coefficients are first chosen so that samples come within step / 2 of it.
void layout_bounded_tile(const struct layout_tile *tile, int32_t step, const int32_t *wanted, coder_band *k,
                         int32_t *samples);

// pyramid: likewise, all samples predicted by U of the coarser level.
void layout_pyramid_tile(const struct layout_tile *tile, int32_t step, const int32_t *wanted, coder_band *k,
                         int32_t *samples);
// The coarser level, bands[0], by the optimal filter D of 11 taps (filter_fit.h).
bool layout_pyramid_reduce(const struct patch *fine, struct patch bands[CODER_BANDS]);

// Coefficient that brings `predicted` to within step / 2 of `*wanted` (NULL: *k is known), and the sample.
int32_t layout_settle(int32_t predicted, const int32_t *wanted, int32_t step, int32_t *k);

// mars, raw: a tile's k are its samples, [y * LAYOUT_SAMPLES + x] over all bands.  Bytes, at most
// CODER_MAX_BYTES.
size_t layout_raw_encode(const struct layout_tile *tile, const coder_band *k, uint8_t *out);
size_t layout_mars_encode(const struct layout_tile *tile, const coder_band *k, uint8_t *out);

// k from a tile's bytes in any layout; false when they are harmed.
bool layout_tile_decode(enum layout layout, const struct layout_tile *tile, const uint8_t *data, size_t size,
                        coder_band *k);
// A tile's samples from its k, in any layout but wavelet.
void layout_tile_samples(enum layout layout, const struct layout_tile *tile, int32_t step, coder_band *k,
                         int32_t *samples);

// ---- wavelet ---------------------------------------------------------------

// Filters a patch that begins at even coordinates as if it were a whole level: bands[0] receives the coarser
// level, bands[1..3] the details.  The caller gives each band room for layout_half_rect; their rectangles are
// set here.  Coefficients of a larger map are right where nothing within LAYOUT_REACH samples of 2 i was cut
// off. False when memory runs out.
enum { LAYOUT_REACH = 6 };
bool layout_wavelet_forward(const struct patch *fine, struct patch bands[CODER_BANDS]);

// Rectangle of each band that the samples `wanted` of `level` need.
struct rect layout_wavelet_band_rect(const struct grid *grid, int level, const struct rect *wanted, int band);

// Samples of a rectangle from patches of the bands that hold at least what layout_wavelet_band_rect says.
// False when memory runs out.
bool layout_wavelet_inverse(const struct grid *grid, int level, const struct patch bands[CODER_BANDS],
                            const struct patch *wanted);

// L2 norm of what one unit of a coefficient of `band` adds to level 0.
double layout_wavelet_norm(int level, int band);

#endif
