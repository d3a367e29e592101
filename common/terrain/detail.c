// SPDX-License-Identifier: MIT
#include "common/terrain/detail.h"

#include "common/terrain/synthesis.h"
#include "common/terrain/upsample.h"

// Windows are made tile by tile, so that the coarser windows under a tile fit a small array: a tile of 64
// needs 36 samples a side of the next level, then 22, 15, 12, 10 and from there on at most 9.
enum { TILE = 64, SCRATCH = 36 * 36 + 22 * 22 + 15 * 15 + 12 * 12 + 10 * 10 + 81 * DETAIL_MAX_FINER };

static int32_t limit(int32_t q)
{
    return q > QUANTA_LIMIT ? QUANTA_LIMIT : q < -QUANTA_LIMIT ? -QUANTA_LIMIT : q;
}

// Columns crowd towards the poles, and noise of one height would make walls of them.  Only exact operations
// and divisions: the same on any machine.
static double taper(const struct sphere_grid *grid, int64_t j)
{
    double t = (double)j / (double)grid->pole;
    return 1 - t * t;
}

static void add_noise(const struct detail *detail, int level, int64_t x0, int64_t y, int width, int32_t *row)
{
    struct sphere_grid grid = sphere_level(&detail->grid, level);
    int64_t i = x0, j = y;
    sphere_fold(&grid, &i, &j);
    double sigma = detail->sigma_q[-level] * taper(&grid, j);
    if (sigma * DETAIL_DEVIATE < 0.5) return; // all of it would be rounded away
    while (width > 0) {
        int64_t run = grid.first + grid.columns - i;
        if (run > width) run = width;
        synthesis_add_row(row, run, i, j, level, detail->seed, sigma);
        row += run;
        width -= (int)run;
        i = grid.first;
    }
}

void detail_refine(const struct detail *detail, int level, const int32_t *coarse, int64_t x0, int64_t y0,
                   int width, int height, int32_t *out)
{
    upsample(coarse, x0, y0, width, height, out);
    for (int j = 0; j < height; j++) {
        int32_t *row = out + (int64_t)j * width;
        add_noise(detail, level, x0, y0 + j, width, row);
        for (int i = 0; i < width; i++) row[i] = limit(row[i]);
    }
}

static void make_tile(const struct detail *detail, int level, int64_t x0, int64_t y0, int width, int height,
                      int32_t *out, int32_t *scratch)
{
    if (level == 0) {
        if (detail->samples)
            sphere_window(&detail->grid, detail->samples, x0, y0, width, height, out);
        else
            detail->read(detail->user, x0, y0, width, height, out);
        return;
    }
    int coarse_width = upsample_coarse_size(x0, width), coarse_height = upsample_coarse_size(y0, height);
    make_tile(detail, level + 1, (x0 >> 1) - 1, (y0 >> 1) - 1, coarse_width, coarse_height, scratch,
              scratch + coarse_width * coarse_height);
    detail_refine(detail, level, scratch, x0, y0, width, height, out);
}

void detail_window(const struct detail *detail, int level, int64_t x0, int64_t y0, int width, int height,
                   int32_t *out)
{
    int32_t tile[TILE * TILE], scratch[SCRATCH];
    for (int y = 0; y < height; y += TILE)
        for (int x = 0; x < width; x += TILE) {
            int w = width - x < TILE ? width - x : TILE, h = height - y < TILE ? height - y : TILE;
            make_tile(detail, level, x0 + x, y0 + y, w, h, tile, scratch);
            for (int j = 0; j < h; j++)
                for (int i = 0; i < w; i++) out[(int64_t)(y + j) * width + x + i] = tile[j * w + i];
        }
}

struct terrain_extent detail_under(int level, int64_t x0, int64_t y0, int width, int height)
{
    struct terrain_extent e = {x0, y0, x0 + width, y0 + height};
    for (; level < 0; level++) {
        int columns = upsample_coarse_size(e.x0, (int)(e.x1 - e.x0)),
            rows = upsample_coarse_size(e.y0, (int)(e.y1 - e.y0));
        e.x0 = (e.x0 >> 1) - 1, e.y0 = (e.y0 >> 1) - 1;
        e.x1 = e.x0 + columns, e.y1 = e.y0 + rows;
    }
    return e;
}

double detail_noise_limit(const struct detail *detail, int levels)
{
    double sum = 0;
    for (int k = 1; k <= levels; k++) sum += DETAIL_NORM * (DETAIL_DEVIATE * detail->sigma_q[k] + 1);
    return sum;
}
