// SPDX-License-Identifier: MIT
#include "geomipmap/geomipmap_tiles.h"

#include "common/parallel.h"
#include "common/report.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>

enum { MAX_TILES = 1 << 26 }; // of height 0

static int64_t tiles_along(int64_t samples, int cells)
{
    return samples <= 2 ? 1 : (samples - 1 + cells - 1) / cells;
}

static size_t grid_size(const struct geomipmap_grid *grid)
{
    return (size_t)grid->columns * (size_t)grid->rows;
}

static struct geomipmap_range join(struct geomipmap_range a, struct geomipmap_range b)
{
    return (struct geomipmap_range){a.low < b.low ? a.low : b.low, a.high > b.high ? a.high : b.high};
}

// ---- measuring ----------------------------------------------------------------------------------

struct job { // one row of tiles of one height a block of work
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
    struct geomipmap_grid *grid = &tiles->grid[job->plan->height];
    int cells = strip->row - 1, count = grid->columns - column;
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
        size_t tile = (size_t)row * (size_t)grid->columns + (size_t)(column + lane);
        grid->range[tile] = range[lane];
        for (int level = 0; level < tiles->levels; level++)
            grid->error[tile * (size_t)tiles->levels + (size_t)level] = error[lane][level];
    }
}

static void measure_row(int row, void *user)
{
    struct job *job = user;
    int cells = 1 << (job->plan->bits + job->plan->height);
    struct strip strip = {.width = GEOMIPMAP_LANES * cells + 1, .row = cells + 1};
    size_t samples = (size_t)strip.row * (size_t)strip.row;
    strip.window = malloc((size_t)strip.width * (size_t)strip.row * sizeof *strip.window);
    strip.lanes = malloc(samples * GEOMIPMAP_LANES * sizeof *strip.lanes);
    if (strip.window && strip.lanes)
        for (int column = 0; column < job->tiles->grid[job->plan->height].columns; column += GEOMIPMAP_LANES)
            measure_strip(job, &strip, row, column);
    else
        atomic_store(&job->failed, true);
    free(strip.window);
    free(strip.lanes);
}

static bool measure_height(struct geomipmap_tiles *tiles, int height, enum geomipmap_delta delta, int threads)
{
    struct geomipmap_plan plan;
    if (!geomipmap_plan_init(&plan, tiles->bits, height)) return false;
    struct job job = {.tiles = tiles, .plan = &plan, .delta = delta};
    parallel_blocks(tiles->grid[height].rows, threads, measure_row, &job);
    geomipmap_plan_finish(&plan);
    const struct geomipmap_grid *grid = &tiles->grid[height];
    for (size_t tile = 0; tile < grid_size(grid); tile++)
        if ((int64_t)grid->range[tile].high - grid->range[tile].low > UINT16_MAX) tiles->wide = true;
    return !atomic_load(&job.failed) || fail("geomipmap: no memory to measure a row of tiles");
}

// Ranges of tiles that are only culled, from those one height below.
static void join_height(struct geomipmap_tiles *tiles, int height)
{
    const struct geomipmap_grid *below = &tiles->grid[height - 1];
    struct geomipmap_grid *grid = &tiles->grid[height];
    for (size_t tile = 0; tile < grid_size(grid); tile++)
        grid->range[tile] = (struct geomipmap_range){INT32_MAX, INT32_MIN};
    for (int row = 0; row < below->rows; row++)
        for (int column = 0; column < below->columns; column++) {
            struct geomipmap_range *joined = &grid->range[(row / 2) * grid->columns + column / 2];
            *joined = join(*joined, below->range[row * below->columns + column]);
        }
}

// ---- the whole ----------------------------------------------------------------------------------

static bool allocate(struct geomipmap_tiles *tiles, int64_t columns, int64_t rows)
{
    if (columns > MAX_TILES || rows > MAX_TILES || columns * rows > MAX_TILES)
        return fail("geomipmap: %lld x %lld tiles of %d x %d samples; %d tiles are accepted",
                    (long long)columns, (long long)rows, (1 << tiles->bits) + 1, (1 << tiles->bits) + 1,
                    MAX_TILES);
    for (int height = 0; height <= tiles->top; height++) {
        struct geomipmap_grid *grid = &tiles->grid[height];
        grid->columns = (int)((columns + (1 << height) - 1) >> height);
        grid->rows = (int)((rows + (1 << height) - 1) >> height);
        grid->first = tiles->drawable;
        size_t count = grid_size(grid);
        grid->range = malloc(count * sizeof *grid->range);
        if (!grid->range) return fail("geomipmap: no memory for %zu tiles", count);
        if (height > tiles->merge) continue;
        tiles->drawable += (int)count;
        grid->error = malloc(count * (size_t)tiles->levels * sizeof *grid->error);
        if (!grid->error) return fail("geomipmap: no memory for the errors of %zu tiles", count);
    }
    return true;
}

bool geomipmap_tiles_init(struct geomipmap_tiles *tiles, const struct terrain *terrain, int bits, int merge,
                          enum geomipmap_delta delta, int threads)
{
    const struct terrain_info *info = terrain_info(terrain);
    struct terrain_level level = terrain_level(terrain, info->finest);
    *tiles = (struct geomipmap_tiles){
        .terrain = terrain,
        .bits = bits,
        .levels = bits,
        .merge = merge,
        // Merged tiles are few enough to be their own map blocks.
        .top = merge > 0 ? merge : GEOMIPMAP_BLOCK_HEIGHT,
        .finest = info->finest,
        .x0 = level.extent.x0,
        .y0 = level.extent.y0,
        .spacing_m = {level.spacing_m[0], level.spacing_m[1]},
        .quantum_m = info->quantum_m,
        .offset_m = info->offset_m,
    };
    bool good = allocate(tiles, tiles_along(level.extent.x1 - level.extent.x0, 1 << bits),
                         tiles_along(level.extent.y1 - level.extent.y0, 1 << bits));
    for (int height = 0; height <= tiles->top && good; height++) {
        if (height <= merge)
            good = measure_height(tiles, height, delta, threads);
        else
            join_height(tiles, height);
    }
    if (!good) geomipmap_tiles_finish(tiles);
    return good;
}

void geomipmap_tiles_finish(struct geomipmap_tiles *tiles)
{
    for (int height = 0; height < GEOMIPMAP_MAX_HEIGHTS; height++) {
        free(tiles->grid[height].range);
        free(tiles->grid[height].error);
    }
    *tiles = (struct geomipmap_tiles){0};
}

struct geomipmap_place geomipmap_tiles_place(const struct geomipmap_tiles *tiles, int tile)
{
    int height = 0;
    while (height < tiles->merge && tile >= tiles->grid[height + 1].first) height++;
    const struct geomipmap_grid *grid = &tiles->grid[height];
    int index = tile - grid->first;
    return (struct geomipmap_place){height, index % grid->columns, index / grid->columns};
}

static size_t index_of(const struct geomipmap_tiles *tiles, struct geomipmap_place place)
{
    return (size_t)place.row * (size_t)tiles->grid[place.height].columns + (size_t)place.column;
}

struct geomipmap_range geomipmap_tiles_range(const struct geomipmap_tiles *tiles,
                                             struct geomipmap_place place)
{
    return tiles->grid[place.height].range[index_of(tiles, place)];
}

const float *geomipmap_tiles_error(const struct geomipmap_tiles *tiles, struct geomipmap_place place)
{
    return tiles->grid[place.height].error + index_of(tiles, place) * (size_t)tiles->levels;
}

void geomipmap_tiles_read(const struct geomipmap_tiles *tiles, struct geomipmap_place place, int32_t *heights)
{
    int32_t line[(1 << GEOMIPMAP_MAX_EXTENT) + 1];
    int cells = 1 << tiles->bits, step = 1 << place.height;
    int64_t x = tiles->x0 + (int64_t)place.column * cells * step;
    int64_t y = tiles->y0 + (int64_t)place.row * cells * step;
    for (int j = 0; j <= cells; j++) {
        terrain_window(tiles->terrain, tiles->finest, x, y + (int64_t)j * step, cells * step + 1, 1, line,
                       TERRAIN_WAIT);
        for (int i = 0; i <= cells; i++) *heights++ = line[i * step];
    }
}

size_t geomipmap_tiles_bytes(const struct geomipmap_tiles *tiles)
{
    size_t bytes = 0;
    for (int height = 0; height <= tiles->top; height++) {
        size_t count = grid_size(&tiles->grid[height]);
        bytes += count * sizeof(struct geomipmap_range);
        if (height <= tiles->merge) bytes += count * (size_t)tiles->levels * sizeof(float);
    }
    return bytes;
}
