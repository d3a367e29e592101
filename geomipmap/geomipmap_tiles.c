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

// ---- reading ------------------------------------------------------------------------------------

static int64_t clamp(int64_t value, int64_t low, int64_t end)
{
    return value < low ? low : value >= end ? end - 1 : value;
}

// Every stride-th sample of a level from (x, y).
static void read_stride(const struct terrain *terrain, int level, const int64_t first[2], int stride,
                        int width, int height, int32_t *out)
{
    size_t across;
    const int32_t *samples = terrain_samples(terrain, level, &across);
    struct terrain_extent e = terrain_level(terrain, level).extent;
    for (int j = 0; j < height; j++) {
        int64_t y = first[1] + (int64_t)j * stride;
        const int32_t *row = samples ? samples + (size_t)(clamp(y, e.y0, e.y1) - e.y0) * across : NULL;
        for (int i = 0; i < width; i++) {
            int64_t x = first[0] + (int64_t)i * stride;
            if (row)
                *out++ = row[clamp(x, e.x0, e.x1) - e.x0];
            else
                terrain_window(terrain, level, x, y, 1, 1, out++, TERRAIN_WAIT);
        }
    }
}

// Above the finest level.
static int level_of_step(const struct geomipmap_tiles *tiles, int step)
{
    int coarsest = terrain_info(tiles->terrain)->coarsest - tiles->finest;
    return !tiles->filtered ? 0 : step < coarsest ? step : coarsest;
}

// What is drawn of every 2^step-th sample from sample (x, y) of the tiles on: of the level with that step
// where tiles are filtered.  The coarsest levels may be missing; then the coarsest there is stands in.
static void read_step(const struct geomipmap_tiles *tiles, struct terrain_reader *reader, int step, int64_t x,
                      int64_t y, int width, int height, int32_t *out)
{
    int up = level_of_step(tiles, step), level = tiles->finest + up;
    const int64_t first[2] = {(tiles->x0 + x) >> up, (tiles->y0 + y) >> up};
    if (step != up)
        read_stride(tiles->terrain, level, first, 1 << (step - up), width, height, out);
    else if (!reader || !terrain_reader_window(reader, level, first[0], first[1], width, height, out))
        terrain_window(tiles->terrain, level, first[0], first[1], width, height, out, TERRAIN_WAIT);
}

// ---- measuring ----------------------------------------------------------------------------------

struct job { // one row of the largest tiles, with all smaller ones in it, a block of work: samples are read
             // once
    struct geomipmap_tiles *tiles;
    struct geomipmap_plan plans[GEOMIPMAP_MAX_HEIGHTS]; // by height, those that may be drawn
    enum geomipmap_delta delta;
    atomic_bool failed;
};

struct strip { // heights of GEOMIPMAP_LANES tiles side by side
    int bits, height;
    int32_t *window;                      // of the finest level
    int32_t *level[GEOMIPMAP_MAX_LEVELS]; // of filtered tiles: what each of their levels draws
    double *lanes, *drawn, *low, *high;   // struct geomipmap_heights
    double corner_low[4 * GEOMIPMAP_LANES], corner_high[4 * GEOMIPMAP_LANES]; // likewise, quanta
    int64_t x, y; // its corner among the tiles' samples
};

static bool strip_init(struct strip *strip, const struct geomipmap_plan *plan, bool filtered)
{
    *strip = (struct strip){.bits = plan->bits, .height = plan->height};
    size_t cells = (size_t)1 << (plan->bits + plan->height), row = cells + 1;
    size_t width = GEOMIPMAP_LANES * cells + 1, lanes = row * row * GEOMIPMAP_LANES, vertices = 0;
    size_t levels = geomipmap_level_first(plan->bits, plan->bits) * GEOMIPMAP_LANES;
    strip->window = malloc((width * row + (filtered ? levels : 0)) * sizeof *strip->window);
    strip->lanes = malloc((lanes + (filtered ? levels + 2 * lanes : 0)) * sizeof *strip->lanes);
    if (!strip->window || !strip->lanes) return false;
    for (int level = 0; level < plan->bits && filtered; level++) {
        size_t across = (size_t)1 << (plan->bits - level);
        strip->level[level] = strip->window + width * row + vertices;
        vertices += (GEOMIPMAP_LANES * across + 1) * (across + 1);
    }
    strip->drawn = strip->lanes + lanes;
    strip->low = strip->drawn + levels;
    strip->high = strip->low + lanes;
    return true;
}

static void strip_finish(struct strip *strip)
{
    free(strip->window);
    free(strip->lanes);
}

// Samples that stand at the corners of the tiles, from the finest level up to those that the tiles draw.
static void read_corners(struct strip *strip, const struct geomipmap_tiles *tiles)
{
    int cells = 1 << (strip->bits + strip->height);
    for (int n = 0; n < 4 * GEOMIPMAP_LANES; n++)
        strip->corner_low[n] = INFINITY, strip->corner_high[n] = -INFINITY;
    for (int step = 0; step < strip->height; step++)
        for (int n = 0; n < 4 * GEOMIPMAP_LANES; n++) {
            int lane = n % GEOMIPMAP_LANES, east = n / GEOMIPMAP_LANES % 2, north = n / GEOMIPMAP_LANES / 2;
            int32_t q;
            read_step(tiles, NULL, step, strip->x + (int64_t)(lane + east) * cells, strip->y + north * cells,
                      1, 1, &q);
            strip->corner_low[n] = fmin(strip->corner_low[n], q);
            strip->corner_high[n] = fmax(strip->corner_high[n], q);
        }
}

static void strip_read(struct strip *strip, const struct geomipmap_tiles *tiles, int row, int column)
{
    int cells = 1 << (strip->bits + strip->height);
    strip->x = (int64_t)column * cells;
    strip->y = (int64_t)row * cells;
    terrain_window(tiles->terrain, tiles->finest, tiles->x0 + strip->x, tiles->y0 + strip->y,
                   GEOMIPMAP_LANES * cells + 1, cells + 1, strip->window, TERRAIN_WAIT);
    for (int level = 0; level < strip->bits && tiles->filtered; level++) {
        int across = 1 << (strip->bits - level);
        read_step(tiles, NULL, strip->height + level, strip->x, strip->y, GEOMIPMAP_LANES * across + 1,
                  across + 1, strip->level[level]);
    }
    if (tiles->filtered) read_corners(strip, tiles);
}

// Takes the corners into the range of a lane, and counts them from its lowest.
static void set_base(struct strip *strip, int lane, struct geomipmap_range *range)
{
    for (int n = lane; n < 4 * GEOMIPMAP_LANES && strip->height > 0; n += GEOMIPMAP_LANES)
        *range = join(
            *range, (struct geomipmap_range){(int32_t)strip->corner_low[n], (int32_t)strip->corner_high[n]});
    for (int n = lane; n < 4 * GEOMIPMAP_LANES; n += GEOMIPMAP_LANES)
        strip->corner_low[n] -= range->low, strip->corner_high[n] -= range->low;
}

// `row` x `row` samples of one lane's tile in a window.
static struct geomipmap_range lane_range(const int32_t *window, int row, int lane)
{
    struct geomipmap_range range = {INT32_MAX, INT32_MIN};
    int cells = row - 1, width = GEOMIPMAP_LANES * cells + 1;
    for (int j = 0; j < row; j++) {
        const int32_t *line = window + (size_t)j * (size_t)width + lane * cells;
        for (int i = 0; i < row; i++) range = join(range, (struct geomipmap_range){line[i], line[i]});
    }
    return range;
}

static void fill_lane(const int32_t *window, int row, int lane, int32_t base, double *lanes)
{
    int cells = row - 1, width = GEOMIPMAP_LANES * cells + 1;
    for (int j = 0; j < row; j++) {
        const int32_t *line = window + (size_t)j * (size_t)width + lane * cells;
        double *out = lanes + (size_t)j * (size_t)row * GEOMIPMAP_LANES + lane;
        for (int i = 0; i < row; i++) out[i * GEOMIPMAP_LANES] = (double)line[i] - base;
    }
}

// Samples outside the map are no ground.
static void leave_out_beyond(const struct strip *strip, const struct geomipmap_tiles *tiles, int lane)
{
    struct terrain_extent e = terrain_level(tiles->terrain, tiles->finest).extent;
    int cells = 1 << (strip->bits + strip->height), row = cells + 1;
    int64_t x = tiles->x0 + strip->x + (int64_t)lane * cells, y = tiles->y0 + strip->y;
    if (x >= e.x0 && y >= e.y0 && x + cells < e.x1 && y + cells < e.y1) return;
    for (int j = 0; j < row; j++)
        for (int i = 0; i < row; i++)
            if (x + i < e.x0 || x + i >= e.x1 || y + j < e.y0 || y + j >= e.y1)
                strip->lanes[((size_t)j * (size_t)row + (size_t)i) * GEOMIPMAP_LANES + (size_t)lane] = NAN;
}

static struct geomipmap_range strip_lane(struct strip *strip, const struct geomipmap_tiles *tiles, int lane)
{
    int row = (1 << (strip->bits + strip->height)) + 1;
    struct geomipmap_range range = lane_range(strip->window, row, lane);
    for (int level = 0; level < strip->bits && tiles->filtered; level++)
        range = join(range, lane_range(strip->level[level], (1 << (strip->bits - level)) + 1, lane));
    if (tiles->filtered) set_base(strip, lane, &range);
    fill_lane(strip->window, row, lane, range.low, strip->lanes);
    for (int level = 0; level < strip->bits && tiles->filtered; level++)
        fill_lane(strip->level[level], (1 << (strip->bits - level)) + 1, lane, range.low,
                  strip->drawn + geomipmap_level_first(strip->bits, level) * GEOMIPMAP_LANES);
    if (tiles->filtered) leave_out_beyond(strip, tiles, lane);
    return range;
}

static void measure_strip(const struct job *job, int height, struct strip *strip, int row, int column)
{
    struct geomipmap_tiles *tiles = job->tiles;
    struct geomipmap_grid *grid = &tiles->grid[height];
    int count = grid->columns - column;
    float error[GEOMIPMAP_LANES][GEOMIPMAP_MAX_LEVELS];
    double spans[GEOMIPMAP_LANES];
    struct geomipmap_range range[GEOMIPMAP_LANES];
    const struct geomipmap_heights heights = {strip->lanes,      tiles->filtered ? strip->drawn : NULL,
                                              strip->corner_low, strip->corner_high,
                                              strip->low,        strip->high};
    strip_read(strip, tiles, row, column);
    for (int lane = 0; lane < GEOMIPMAP_LANES; lane++) {
        range[lane] = strip_lane(strip, tiles, lane);
        spans[lane] = (double)range[lane].high - range[lane].low;
    }
    geomipmap_plan_measure(&job->plans[height], job->delta, &heights, spans, error);
    for (int lane = 0; lane < GEOMIPMAP_LANES && lane < count; lane++) {
        size_t tile = (size_t)row * (size_t)grid->columns + (size_t)(column + lane);
        grid->range[tile] = range[lane];
        for (int level = 0; level < tiles->levels; level++)
            grid->error[tile * (size_t)tiles->levels + (size_t)level] = error[lane][level];
    }
}

static bool measure_rows(const struct job *job, int height, int first, int end)
{
    const struct geomipmap_grid *grid = &job->tiles->grid[height];
    struct strip strip;
    bool good = strip_init(&strip, &job->plans[height], job->tiles->filtered);
    for (int row = first; good && row < end && row < grid->rows; row++)
        for (int column = 0; column < grid->columns; column += GEOMIPMAP_LANES)
            measure_strip(job, height, &strip, row, column);
    strip_finish(&strip);
    return good;
}

static void measure_band(int band, void *user)
{
    struct job *job = user;
    int merge = job->tiles->merge;
    for (int height = 0; height <= merge; height++)
        if (!measure_rows(job, height, band << (merge - height), (band + 1) << (merge - height)))
            atomic_store(&job->failed, true);
}

static bool measure(struct geomipmap_tiles *tiles, enum geomipmap_delta delta, int threads)
{
    struct job job = {.tiles = tiles, .delta = delta};
    bool good = true;
    for (int height = 0; height <= tiles->merge && good; height++)
        good = geomipmap_plan_init(&job.plans[height], tiles->bits, height);
    if (good) parallel_blocks(tiles->grid[tiles->merge].rows, threads, measure_band, &job);
    for (int height = 0; height <= tiles->merge; height++) {
        const struct geomipmap_grid *grid = &tiles->grid[height];
        geomipmap_plan_finish(&job.plans[height]);
        for (size_t tile = 0; tile < grid_size(grid) && good; tile++)
            if ((int64_t)grid->range[tile].high - grid->range[tile].low > UINT16_MAX) tiles->wide = true;
    }
    return good && (!atomic_load(&job.failed) || fail("geomipmap: no memory to measure a row of tiles"));
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
                          enum geomipmap_delta delta, bool filtered, int threads)
{
    const struct terrain_info *info = terrain_info(terrain);
    struct terrain_level level = terrain_level(terrain, info->finest);
    int coarsest = filtered ? merge + bits - 1 : 0; // step whose level must have its samples at vertices
    *tiles = (struct geomipmap_tiles){
        .terrain = terrain,
        .bits = bits,
        .levels = bits,
        .merge = merge,
        // Merged tiles are few enough to be their own map blocks.
        .top = merge > 0 ? merge : GEOMIPMAP_BLOCK_HEIGHT,
        .finest = info->finest,
        .filtered = filtered,
        .x0 = level.extent.x0 >> coarsest << coarsest,
        .y0 = level.extent.y0 >> coarsest << coarsest,
        .spacing_m = {level.spacing_m[0], level.spacing_m[1]},
        .quantum_m = info->quantum_m,
        .offset_m = info->offset_m,
    };
    bool good = allocate(tiles, tiles_along(level.extent.x1 - tiles->x0, 1 << bits),
                         tiles_along(level.extent.y1 - tiles->y0, 1 << bits));
    good = good && measure(tiles, delta, threads);
    for (int height = merge + 1; height <= tiles->top && good; height++) join_height(tiles, height);
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

// Row or column of one side, the vertices that its step draws, both ends left out.
static void read_side(const struct geomipmap_tiles *tiles, struct terrain_reader *reader, int step, int64_t x,
                      int64_t y, bool across, int count, int32_t *heights, int next)
{
    int32_t line[(1 << GEOMIPMAP_MAX_BITS) + 1];
    read_step(tiles, reader, step, x, y, across ? count + 1 : 1, across ? 1 : count + 1, line);
    for (int i = 1; i < count; i++) heights[(size_t)i * (size_t)next] = line[i];
}

static void read_form(const struct geomipmap_tiles *tiles, struct terrain_reader *reader,
                      struct geomipmap_place place, const struct geomipmap_form *form, int32_t *heights)
{
    int32_t inside[((1 << GEOMIPMAP_MAX_BITS) + 1) * ((1 << GEOMIPMAP_MAX_BITS) + 1)];
    int cells = 1 << tiles->bits, row = cells + 1, size = cells << place.height;
    int64_t x = (int64_t)place.column * size, y = (int64_t)place.row * size;
    int step = 1 << (form->inside - place.height), count = cells / step;
    read_step(tiles, reader, form->inside, x, y, count + 1, count + 1, inside);
    for (int j = 1; j < count; j++)
        for (int i = 1; i < count; i++) heights[j * step * row + i * step] = inside[j * (count + 1) + i];
    for (int side = 0; side < GEOMIPMAP_SIDES; side++) {
        bool across = side == GEOMIPMAP_SOUTH || side == GEOMIPMAP_NORTH,
             far = side == GEOMIPMAP_EAST || side == GEOMIPMAP_NORTH;
        int fine = form->side[side] - place.height, next = (across ? 1 : row) << fine;
        int32_t *first = heights + (far ? across ? cells * row : cells : 0);
        read_side(tiles, reader, form->side[side], x + (far && !across ? size : 0),
                  y + (far && across ? size : 0), across, cells >> fine, first, next);
    }
    for (int corner = 0; corner < GEOMIPMAP_SIDES; corner++) {
        bool east = corner < 2, north = corner == 1 || corner == 2;
        read_step(tiles, reader, form->corner[corner], x + (east ? size : 0), y + (north ? size : 0), 1, 1,
                  heights + (east ? cells : 0) + (north ? cells * row : 0));
    }
}

bool geomipmap_tiles_ready(const struct geomipmap_tiles *tiles, struct terrain_reader *reader,
                           struct geomipmap_place place, int level)
{
    int step = place.height + level, up = level_of_step(tiles, step), cells = 1 << (tiles->bits - level);
    if (!reader || step != up) return true;
    return terrain_reader_window(reader, tiles->finest + up,
                                 (tiles->x0 >> up) + (int64_t)place.column * cells,
                                 (tiles->y0 >> up) + (int64_t)place.row * cells, cells + 1, cells + 1, NULL);
}

void geomipmap_tiles_read(const struct geomipmap_tiles *tiles, struct terrain_reader *reader,
                          struct geomipmap_place place, const struct geomipmap_form *form, int32_t *heights)
{
    int cells = 1 << tiles->bits, size = cells << place.height;
    if (form)
        read_form(tiles, reader, place, form, heights);
    else
        read_step(tiles, reader, place.height, (int64_t)place.column * size, (int64_t)place.row * size,
                  cells + 1, cells + 1, heights);
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
