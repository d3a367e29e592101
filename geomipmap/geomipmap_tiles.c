// SPDX-License-Identifier: MIT
#include "geomipmap/geomipmap_tiles.h"

#include "common/parallel.h"
#include "common/report.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>

enum { MAX_TILES = 1 << 26 };

static int64_t tiles_along(int64_t samples, int cells)
{
    return samples <= 2 ? 1 : (samples - 1 + cells - 1) / cells;
}

static struct geomipmap_range join(struct geomipmap_range a, struct geomipmap_range b)
{
    return (struct geomipmap_range){a.low < b.low ? a.low : b.low, a.high > b.high ? a.high : b.high};
}

// ---- measuring
// ------------------------------------------------------------------------------------------------------

struct job { // one row of tiles a block of work
    struct geomipmap_tiles *tiles;
    const struct geomipmap_plan *plan;
    enum geomipmap_delta delta;
    atomic_bool failed;
};

struct strip { // heights of GEOMIPMAP_LANES tiles side by side
    int32_t *window;
    double *lanes;
    int width, row; // samples in a row of the window and of a tile
};

static struct geomipmap_range strip_lane(const struct strip *strip, int lane)
{
    int first = lane * (strip->row - 1);
    struct geomipmap_range range = {INT32_MAX, INT32_MIN};
    for (int j = 0; j < strip->row; j++) {
        const int32_t *line = strip->window + (size_t)j * strip->width + first;
        for (int i = 0; i < strip->row; i++) range = join(range, (struct geomipmap_range){line[i], line[i]});
    }
    for (int j = 0; j < strip->row; j++) {
        const int32_t *line = strip->window + (size_t)j * strip->width + first;
        double *out = strip->lanes + (size_t)j * strip->row * GEOMIPMAP_LANES + lane;
        for (int i = 0; i < strip->row; i++) out[i * GEOMIPMAP_LANES] = (double)line[i] - range.low;
    }
    return range;
}

static void measure_strip(struct job *job, const struct strip *strip, int row, int column)
{
    struct geomipmap_tiles *tiles = job->tiles;
    int cells = 1 << tiles->bits, count = tiles->tiles.columns - column;
    float error[GEOMIPMAP_LANES][GEOMIPMAP_MAX_LEVELS];
    double height[GEOMIPMAP_LANES];
    struct geomipmap_range range[GEOMIPMAP_LANES];
    terrain_window(tiles->terrain, tiles->finest, tiles->x0 + (int64_t)column * cells,
                   tiles->y0 + (int64_t)row * cells, strip->width, strip->row, strip->window, TERRAIN_WAIT);
    for (int lane = 0; lane < GEOMIPMAP_LANES; lane++) {
        range[lane] = strip_lane(strip, lane);
        height[lane] = (double)range[lane].high - range[lane].low;
    }
    geomipmap_plan_measure(job->plan, job->delta, strip->lanes, height, error);
    for (int lane = 0; lane < GEOMIPMAP_LANES && lane < count; lane++) {
        size_t tile = (size_t)row * tiles->tiles.columns + column + lane;
        tiles->tiles.range[tile] = range[lane];
        for (int level = 0; level < tiles->levels; level++)
            tiles->error[tile * tiles->levels + level] = error[lane][level];
    }
}

static void measure_row(int row, void *user)
{
    struct job *job = user;
    int cells = 1 << job->tiles->bits;
    struct strip strip = {.width = GEOMIPMAP_LANES * cells + 1, .row = cells + 1};
    strip.window = malloc((size_t)strip.width * strip.row * sizeof *strip.window);
    strip.lanes = malloc((size_t)strip.row * strip.row * GEOMIPMAP_LANES * sizeof *strip.lanes);
    if (strip.window && strip.lanes)
        for (int column = 0; column < job->tiles->tiles.columns; column += GEOMIPMAP_LANES)
            measure_strip(job, &strip, row, column);
    else
        atomic_store(&job->failed, true);
    free(strip.window);
    free(strip.lanes);
}

static void join_blocks(struct geomipmap_tiles *tiles)
{
    struct geomipmap_range nothing = {INT32_MAX, INT32_MIN};
    size_t blocks = (size_t)tiles->blocks.columns * tiles->blocks.rows;
    for (size_t block = 0; block < blocks; block++) tiles->blocks.range[block] = nothing;
    tiles->range = nothing;
    for (int row = 0; row < tiles->tiles.rows; row++)
        for (int column = 0; column < tiles->tiles.columns; column++) {
            struct geomipmap_range range = tiles->tiles.range[(size_t)row * tiles->tiles.columns + column];
            struct geomipmap_range *block =
                &tiles->blocks.range[(size_t)(row >> GEOMIPMAP_BLOCK_BITS) * tiles->blocks.columns +
                                     (column >> GEOMIPMAP_BLOCK_BITS)];
            *block = join(*block, range);
            tiles->range = join(tiles->range, range);
            if ((int64_t)range.high - range.low > UINT16_MAX) tiles->wide = true;
        }
}

// ---- the whole
// ------------------------------------------------------------------------------------------------------

static bool allocate(struct geomipmap_tiles *tiles, int64_t columns, int64_t rows)
{
    if (columns > MAX_TILES || rows > MAX_TILES || columns * rows > MAX_TILES)
        return fail("geomipmap: %lld x %lld tiles of %d x %d samples; %d tiles are accepted",
                    (long long)columns, (long long)rows, (1 << tiles->bits) + 1, (1 << tiles->bits) + 1,
                    MAX_TILES);
    tiles->tiles = (struct geomipmap_grid){.columns = (int)columns, .rows = (int)rows};
    tiles->blocks =
        (struct geomipmap_grid){.columns = (int)((columns + GEOMIPMAP_BLOCK - 1) >> GEOMIPMAP_BLOCK_BITS),
                                .rows = (int)((rows + GEOMIPMAP_BLOCK - 1) >> GEOMIPMAP_BLOCK_BITS)};
    size_t count = (size_t)(columns * rows), blocks = (size_t)tiles->blocks.columns * tiles->blocks.rows;
    tiles->tiles.range = malloc(count * sizeof *tiles->tiles.range);
    tiles->blocks.range = malloc(blocks * sizeof *tiles->blocks.range);
    tiles->error = malloc(count * (size_t)tiles->levels * sizeof *tiles->error);
    if (tiles->tiles.range && tiles->blocks.range && tiles->error) return true;
    return fail("geomipmap: no memory for the errors of %zu tiles", count);
}

bool geomipmap_tiles_init(struct geomipmap_tiles *tiles, const struct terrain *terrain, int bits,
                          enum geomipmap_delta delta, int threads)
{
    const struct terrain_info *info = terrain_info(terrain);
    struct terrain_level level = terrain_level(terrain, info->finest);
    *tiles = (struct geomipmap_tiles){
        .terrain = terrain,
        .bits = bits,
        .levels = bits,
        .finest = info->finest,
        .x0 = level.extent.x0,
        .y0 = level.extent.y0,
        .spacing_m = {level.spacing_m[0], level.spacing_m[1]},
        .quantum_m = info->quantum_m,
        .offset_m = info->offset_m,
    };
    struct geomipmap_plan plan = {0};
    struct job job = {.tiles = tiles, .plan = &plan, .delta = delta};
    bool good = geomipmap_plan_init(&plan, bits) &&
                allocate(tiles, tiles_along(level.extent.x1 - level.extent.x0, 1 << bits),
                         tiles_along(level.extent.y1 - level.extent.y0, 1 << bits));
    if (good) {
        parallel_blocks(tiles->tiles.rows, threads, measure_row, &job);
        if (atomic_load(&job.failed)) good = fail("geomipmap: no memory to measure a row of tiles");
    }
    geomipmap_plan_finish(&plan);
    if (good)
        join_blocks(tiles);
    else
        geomipmap_tiles_finish(tiles);
    return good;
}

void geomipmap_tiles_finish(struct geomipmap_tiles *tiles)
{
    free(tiles->tiles.range);
    free(tiles->blocks.range);
    free(tiles->error);
    *tiles = (struct geomipmap_tiles){0};
}

void geomipmap_tiles_read(const struct geomipmap_tiles *tiles, int tile, int32_t *heights)
{
    int cells = 1 << tiles->bits, column = tile % tiles->tiles.columns, row = tile / tiles->tiles.columns;
    terrain_window(tiles->terrain, tiles->finest, tiles->x0 + (int64_t)column * cells,
                   tiles->y0 + (int64_t)row * cells, cells + 1, cells + 1, heights, TERRAIN_WAIT);
}

size_t geomipmap_tiles_bytes(const struct geomipmap_tiles *tiles)
{
    size_t count = (size_t)tiles->tiles.columns * tiles->tiles.rows;
    size_t blocks = (size_t)tiles->blocks.columns * tiles->blocks.rows;
    return (count + blocks) * sizeof(struct geomipmap_range) +
           count * (size_t)tiles->levels * sizeof *tiles->error;
}
