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

// One fine row from one row of coarse values scaled by 2^shift: even samples are the coarse ones.
static void upsample_row(const int32_t *coarse, int64_t x0, int width, int shift, int32_t *fine)
{
    int32_t even_round = shift ? 1 << (shift - 1) : 0, odd_round = 1 << (shift + 3);
    int odd = (int)(x0 & 1);
    for (int x = odd; x < width; x += 2) fine[x] = (coarse[(x + odd) / 2 + 1] + even_round) >> shift;
    for (int x = 1 - odd; x < width; x += 2) {
        const int32_t *c = coarse + (x + odd) / 2;
        fine[x] = (four_point(c[0], c[1], c[2], c[3]) + odd_round) >> (shift + 4);
    }
}

void upsample(const int32_t *coarse, int64_t x0, int64_t y0, int width, int height, int32_t *fine)
{
    enum { CHUNK = 512 }; // fine columns at a time, so that the row sums live on the stack
    int coarse_width = upsample_coarse_size(x0, width);
    int32_t sums[CHUNK / 2 + 5];
    for (int y = 0; y < height; y++) {
        int row = (int)(half(y0 + y) - half(y0));
        const int32_t *c = coarse + (size_t)row * (size_t)coarse_width;
        int32_t *out = fine + (size_t)y * (size_t)width;
        if (((y0 + y) & 1) == 0) {
            upsample_row(c + coarse_width, x0, width, 0, out);
            continue;
        }
        for (int x = 0; x < width; x += CHUNK) {
            int columns = width - x < CHUNK ? width - x : CHUNK;
            int first = (int)(half(x0 + x) - half(x0)), count = upsample_coarse_size(x0 + x, columns);
            for (int i = 0; i < count; i++) {
                const int32_t *p = c + first + i;
                sums[i] = four_point(p[0], p[coarse_width], p[2 * (ptrdiff_t)coarse_width],
                                     p[3 * (ptrdiff_t)coarse_width]);
            }
            upsample_row(sums, x0 + x, columns, 4, out + x);
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

// Taps at -3..3; their sum is 2^shift.
static const struct taps {
    int32_t weight[7];
    int shift;
} FILTERS[] = {
    [TERRAIN_FILTER_HALFBAND] = {{-1, 0, 9, 16, 9, 0, -1}, 5},
    [TERRAIN_FILTER_TENT] = {{0, 0, 1, 2, 1, 0, 0}, 2},
    [TERRAIN_FILTER_DECIMATE] = {{0, 0, 0, 1, 0, 0, 0}, 0},
};

enum { ROWS_A_BLOCK = 32, GHOSTS = 4, SLOPE_CELLS = 4 };

struct downsampling {
    const int32_t *fine;
    const struct taps *taps;
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
            int32_t sum = 0;
            for (int k = -3; k <= 3; k++) sum += d->taps->weight[k + 3] * centre[2 * i + k];
            out[i] = sum;
        }
    }
}

static void extend_columns(const struct downsampling *d)
{
    int64_t width = d->coarse_size[0], cells = slope_cells(d->size[1]);
    int32_t *south = d->rows + GHOSTS * width, *north = south + (d->size[1] - 1) * width;
    for (int64_t k = 1; k <= GHOSTS; k++)
        for (int64_t i = 0; i < width; i++) {
            south[i - k * width] = (int32_t)beyond(south[i], south[i + cells * width], cells, k);
            north[i + k * width] = (int32_t)beyond(north[i], north[i - cells * width], cells, k);
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
            int64_t sum = round;
            for (int k = -3; k <= 3; k++) sum += (int64_t)d->taps->weight[k + 3] * centre[i + k * width];
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
