// SPDX-License-Identifier: MIT
#include "common/terrain/upsample.h"

#include "common/parallel.h"

#include <stdlib.h>
#include <string.h>

// Floor division by two of any int64: an arithmetic shift, which gcc and clang define.
static int64_t half(int64_t index)
{
    return index >> 1;
}

int upsample_coarse_size(int64_t x0, int size)
{
    return size < 1 ? 0 : (int)(half(x0 + size - 1) - half(x0)) + 4;
}

// The four-point sum, 16 times the value between b and c.
static inline int32_t four_point(int32_t a, int32_t b, int32_t c, int32_t d)
{
    return 9 * (b + c) - a - d;
}

// PAIRS: pairs of an even and an odd sample of a fine row at a time, so that the sums live on the stack.
// LANES: of these in an inner loop, a fixed number, so that -O2 vectorises it.
enum { PAIRS = 256, LANES = 32 };

static inline void sum_some(const int32_t *restrict coarse, ptrdiff_t stride, int count,
                            int32_t *restrict sums)
{
    for (int i = 0; i < count; i++)
        sums[i] = four_point(coarse[i], coarse[stride + i], coarse[2 * stride + i], coarse[3 * stride + i]);
}

// The four-point sums down `count` columns.  The last lanes may do again what those before did.
static void sum_columns(const int32_t *coarse, ptrdiff_t stride, int count, int32_t *sums)
{
    if (count < LANES) sum_some(coarse, stride, count, sums);
    for (int i = 0; i < count && count >= LANES; i += LANES) {
        int at = i + LANES <= count ? i : count - LANES;
        sum_some(coarse + at, stride, LANES, sums + at);
    }
}

static inline void pair_some(const int32_t *restrict coarse, int count, int shift, int32_t *restrict fine)
{
    int32_t even_round = shift ? 1 << (shift - 1) : 0, odd_round = 1 << (shift + 3);
    for (int k = 0; k < count; k++) {
        const int32_t *c = coarse + k;
        fine[2 * k] = (c[1] + even_round) >> shift;
        fine[2 * k + 1] = (four_point(c[0], c[1], c[2], c[3]) + odd_round) >> (shift + 4);
    }
}

// Pairs of a fine row from count + 3 coarse values scaled by 2^shift: even samples are the coarse ones.
static void pair_row(const int32_t *coarse, int count, int shift, int32_t *fine)
{
    if (count < LANES) pair_some(coarse, count, shift, fine);
    for (int k = 0; k < count && count >= LANES; k += LANES) {
        int at = k + LANES <= count ? k : count - LANES;
        pair_some(coarse + at, LANES, shift, fine + 2 * (ptrdiff_t)at);
    }
}

void upsample(const int32_t *coarse, int64_t x0, int64_t y0, int width, int height, int32_t *fine)
{
    ptrdiff_t stride = upsample_coarse_size(x0, width);
    int odd = (int)(x0 & 1), all = (width + odd + 1) / 2;
    int32_t sums[PAIRS + 3], pairs[2 * PAIRS];
    for (int y = 0; y < height; y++) {
        const int32_t *rows = coarse + (ptrdiff_t)(half(y0 + y) - half(y0)) * stride;
        int32_t *out = fine + (ptrdiff_t)y * width;
        bool between = ((y0 + y) & 1) != 0; // else the fine row stands on the second of the four
        for (int k = 0; k < all; k += PAIRS) {
            int count = all - k < PAIRS ? all - k : PAIRS;
            if (between) sum_columns(rows + k, stride, count + 3, sums);
            pair_row(between ? sums : rows + stride + k, count, between ? 4 : 0, pairs);
            int from = k == 0 ? odd : 0, first = 2 * k + from - odd; // the pairs begin on an even sample
            int end = 2 * (k + count) - odd < width ? 2 * (k + count) - odd : width;
            memcpy(out + first, pairs + from, (size_t)(end - first) * sizeof *out);
        }
    }
}

int64_t downsample_first(int64_t first)
{
    return half(first);
}

int64_t downsample_size(int64_t first, int64_t size)
{
    return half(first + size) - half(first) +
           1; // last = ceil((first + size - 1) / 2) = floor((first + size) / 2)
}

static const struct filter_taps FILTERS[] = {
    [TERRAIN_FILTER_LINEAR] = {{6, 2, -1}, 2, 3},
    [TERRAIN_FILTER_HALFBAND] = {{16, 9, 0, -1}, 3, 5},
    [TERRAIN_FILTER_TENT] = {{2, 1}, 1, 2},
    [TERRAIN_FILTER_DECIMATE] = {{1}, 0, 0},
    // filter_solve of bigtujunga, everest and jacksboro: .6479 .3050 -.1107 -.0738 .0619 -.0063
    [TERRAIN_FILTER_OPTIMAL] = {{166, 78, -28, -19, 16, -2}, 5, 8},
};

const struct filter_taps *filter_taps(enum terrain_filter filter)
{
    return &FILTERS[filter];
}

enum { ROWS_A_BLOCK = 32, GHOSTS = 6, SLOPE_CELLS = 4 };

struct downsampling {
    const int32_t *fine;
    const struct filter_taps *taps;
    int64_t first[2], size[2], coarse_first[2], coarse_size[2];
    int32_t *rows;     // fine rows filtered along x, scaled by 2^shift; GHOSTS more rows on either side
    int32_t *extended; // for each block one fine row with GHOSTS more samples on either side
    int32_t *coarse;
};

static int32_t limit(int64_t q)
{
    return q > QUANTA_LIMIT ? QUANTA_LIMIT : q < -QUANTA_LIMIT ? -QUANTA_LIMIT : (int32_t)q;
}

// Value k steps beyond `end`, where `inner` lies `cells` cells inside.  Exact on planes, so that filters are
// exact on planes up to the border.  The slope is that of several cells: with the last cell's alone, borders
// run away level by level.
static int64_t beyond(int64_t end, int64_t inner, int64_t cells, int64_t k)
{
    return cells > 0 ? end + k * (end - inner) / cells : end;
}

static int64_t slope_cells(int64_t size)
{
    return size - 1 < SLOPE_CELLS ? size - 1 : SLOPE_CELLS;
}

static void filter_rows(int block, void *user)
{
    const struct downsampling *d = user;
    int64_t size = d->size[0], cells = slope_cells(size), end = (int64_t)(block + 1) * ROWS_A_BLOCK;
    int32_t *extended = d->extended + block * (size + 2 * GHOSTS);
    for (int64_t y = (int64_t)block * ROWS_A_BLOCK; y < end && y < d->size[1]; y++) {
        const int32_t *row = d->fine + y * size;
        memcpy(extended + GHOSTS, row, (size_t)size * sizeof *row);
        for (int k = 1; k <= GHOSTS; k++) {
            extended[GHOSTS - k] = limit(beyond(row[0], row[cells], cells, k));
            extended[GHOSTS + size - 1 + k] = limit(beyond(row[size - 1], row[size - 1 - cells], cells, k));
        }
        int32_t *out = d->rows + (y + GHOSTS) * d->coarse_size[0];
        const int32_t *centre = extended + GHOSTS + (2 * d->coarse_first[0] - d->first[0]);
        for (int64_t i = 0; i < d->coarse_size[0]; i++) {
            const int32_t *at = centre + 2 * i;
            int32_t sum = d->taps->half[0] * at[0];
            for (int k = 1; k <= d->taps->reach; k++) sum += d->taps->half[k] * (at[-k] + at[k]);
            out[i] = sum;
        }
    }
}

static int32_t in_32_bits(int64_t value)
{
    return value > INT32_MAX ? INT32_MAX : value < INT32_MIN ? INT32_MIN : (int32_t)value;
}

static void extend_columns(const struct downsampling *d)
{
    int64_t width = d->coarse_size[0], cells = slope_cells(d->size[1]);
    int32_t *south = d->rows + GHOSTS * width, *north = south + (d->size[1] - 1) * width;
    for (int64_t k = 1; k <= GHOSTS; k++)
        for (int64_t i = 0; i < width; i++) {
            south[i - k * width] = in_32_bits(beyond(south[i], south[i + cells * width], cells, k));
            north[i + k * width] = in_32_bits(beyond(north[i], north[i - cells * width], cells, k));
        }
}

static void filter_columns(int block, void *user)
{
    const struct downsampling *d = user;
    int64_t width = d->coarse_size[0], end = (int64_t)(block + 1) * ROWS_A_BLOCK;
    int shift = 2 * d->taps->shift;
    int64_t round = shift ? (int64_t)1 << (shift - 1) : 0;
    for (int64_t j = (int64_t)block * ROWS_A_BLOCK; j < end && j < d->coarse_size[1]; j++) {
        const int32_t *centre = d->rows + (GHOSTS + 2 * (d->coarse_first[1] + j) - d->first[1]) * width;
        for (int64_t i = 0; i < width; i++) {
            const int32_t *at = centre + i;
            int64_t sum = round + (int64_t)d->taps->half[0] * at[0];
            for (int k = 1; k <= d->taps->reach; k++)
                sum += d->taps->half[k] * ((int64_t)at[-k * width] + at[k * width]);
            d->coarse[j * width + i] = limit(sum >> shift);
        }
    }
}

bool downsample(const int32_t *fine, const int64_t first[2], const int64_t size[2],
                enum terrain_filter filter, int32_t *coarse)
{
    struct downsampling d = {.fine = fine, .taps = &FILTERS[filter], .coarse = coarse};
    for (int axis = 0; axis < 2; axis++) {
        d.first[axis] = first[axis];
        d.size[axis] = size[axis];
        d.coarse_first[axis] = downsample_first(first[axis]);
        d.coarse_size[axis] = downsample_size(first[axis], size[axis]);
    }
    int blocks = (int)((d.size[1] + ROWS_A_BLOCK - 1) / ROWS_A_BLOCK);
    int coarse_blocks = (int)((d.coarse_size[1] + ROWS_A_BLOCK - 1) / ROWS_A_BLOCK);
    d.rows = malloc((size_t)(d.coarse_size[0] * (d.size[1] + 2 * GHOSTS)) * sizeof *d.rows);
    d.extended = malloc((size_t)(blocks * (d.size[0] + 2 * GHOSTS)) * sizeof *d.extended);
    bool good = d.rows && d.extended;
    if (good) {
        parallel_blocks(blocks, 0, filter_rows, &d);
        extend_columns(&d);
        parallel_blocks(coarse_blocks, 0, filter_columns, &d);
    }
    free(d.rows);
    free(d.extended);
    return good;
}
