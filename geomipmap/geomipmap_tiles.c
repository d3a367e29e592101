// SPDX-License-Identifier: MIT
#include "geomipmap/geomipmap_tiles.h"

#include "common/parallel.h"
#include "common/report.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

enum {
    MAX_SIDE = 1 << 27,   // tiles of height 0 along a side: a name has 28 bits for each
    MAX_LISTED = 1 << 26, // tiles of height 0 where none may be drawn above `merge`
    KEPT_GROUPS = 1 << 16,
    ACROSS = GEOMIPMAP_GROUP_ACROSS,
    UP = GEOMIPMAP_GROUP_UP,
    CORNERS = 4
};

static int64_t tiles_along(int64_t samples, int cells)
{
    return samples <= 2 ? 1 : (samples - 1 + cells - 1) / cells;
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

struct strip { // heights of a group of tiles
    int bits, height;
    int32_t *window;                      // of the finest level
    int32_t *level[GEOMIPMAP_MAX_LEVELS]; // of filtered tiles: what each of their levels draws
    int32_t *finer;                       // and one level at a time of those below
    double *lanes, *drawn, *low, *high;   // struct geomipmap_heights
    double corner_low[CORNERS * GEOMIPMAP_LANES], corner_high[CORNERS * GEOMIPMAP_LANES]; // likewise, quanta
    struct geomipmap_range range[GEOMIPMAP_LANES];
    int64_t x, y; // its corner among the tiles' samples
};

static size_t window_size(size_t cells)
{
    return (ACROSS * cells + 1) * (UP * cells + 1);
}

static bool strip_init(struct strip *strip, const struct geomipmap_tiles *tiles, int height)
{
    *strip = (struct strip){.bits = tiles->bits, .height = height};
    size_t cells = (size_t)1 << (tiles->bits + height), lanes = (cells + 1) * (cells + 1) * GEOMIPMAP_LANES;
    size_t levels = geomipmap_level_first(tiles->bits, tiles->bits) * GEOMIPMAP_LANES;
    size_t samples = window_size(cells), extra = tiles->filtered ? levels + 2 * lanes : 0;
    for (int level = 0; level < tiles->bits && tiles->filtered; level++)
        samples += window_size((size_t)1 << (tiles->bits - level));
    if (tiles->filtered) samples += window_size(cells / 2);
    strip->window = malloc(samples * sizeof *strip->window);
    strip->lanes = malloc((lanes + extra) * sizeof *strip->lanes);
    if (!strip->window || !strip->lanes) return false;
    int32_t *next = strip->window + window_size(cells);
    for (int level = 0; level < tiles->bits && tiles->filtered; level++) {
        strip->level[level] = next;
        next += window_size((size_t)1 << (tiles->bits - level));
    }
    strip->finer = next;
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

// The first sample of one lane's tile in a window whose tiles have `cells` cells a side.
static const int32_t *lane_window(const int32_t *window, int cells, int lane)
{
    return window + (size_t)(lane / ACROSS * cells) * (size_t)(ACROSS * cells + 1) + lane % ACROSS * cells;
}

static struct geomipmap_range lane_range(const int32_t *window, int cells, int lane)
{
    struct geomipmap_range range = {INT32_MAX, INT32_MIN};
    const int32_t *line = lane_window(window, cells, lane);
    for (int j = 0; j <= cells; j++, line += ACROSS * cells + 1)
        for (int i = 0; i <= cells; i++) range = join(range, (struct geomipmap_range){line[i], line[i]});
    return range;
}

// Takes every sample of a window into the ranges.
static void join_ranges(struct strip *strip, const int32_t *window, int cells)
{
    for (int lane = 0; lane < GEOMIPMAP_LANES; lane++)
        strip->range[lane] = join(strip->range[lane], lane_range(window, cells, lane));
}

static void widen_corners(struct strip *strip, const int32_t *window, int cells)
{
    for (int n = 0; n < CORNERS * GEOMIPMAP_LANES; n++) {
        int corner = n / GEOMIPMAP_LANES, far = corner / 2 * cells;
        int32_t q =
            lane_window(window, cells, n % GEOMIPMAP_LANES)[far * (ACROSS * cells + 1) + corner % 2 * cells];
        strip->corner_low[n] = fmin(strip->corner_low[n], q);
        strip->corner_high[n] = fmax(strip->corner_high[n], q);
    }
}

static void read_group(const struct geomipmap_tiles *tiles, const struct strip *strip, int step, int32_t *out)
{
    int cells = 1 << (strip->bits + strip->height - step);
    read_step(tiles, NULL, step, strip->x, strip->y, ACROSS * cells + 1, UP * cells + 1, out);
}

// Levels finer than those that the tiles draw, from the finest up: only corners may have them, but smaller
// tiles in the same place draw them, too.
static void read_finer(struct strip *strip, const struct geomipmap_tiles *tiles)
{
    for (int n = 0; n < CORNERS * GEOMIPMAP_LANES; n++)
        strip->corner_low[n] = INFINITY, strip->corner_high[n] = -INFINITY;
    for (int step = 0; step < strip->height; step++) {
        int cells = 1 << (strip->bits + strip->height - step);
        if (step > 0) read_group(tiles, strip, step, strip->finer);
        if (step > 0) join_ranges(strip, strip->finer, cells);
        widen_corners(strip, step > 0 ? strip->finer : strip->window, cells);
    }
}

static void strip_read(struct strip *strip, const struct geomipmap_tiles *tiles)
{
    int cells = 1 << (strip->bits + strip->height);
    for (int lane = 0; lane < GEOMIPMAP_LANES; lane++)
        strip->range[lane] = (struct geomipmap_range){INT32_MAX, INT32_MIN};
    terrain_window(tiles->terrain, tiles->finest, tiles->x0 + strip->x, tiles->y0 + strip->y,
                   ACROSS * cells + 1, UP * cells + 1, strip->window, TERRAIN_WAIT);
    join_ranges(strip, strip->window, cells);
    for (int level = 0; level < strip->bits && tiles->filtered; level++) {
        read_group(tiles, strip, strip->height + level, strip->level[level]);
        join_ranges(strip, strip->level[level], 1 << (strip->bits - level));
    }
    if (tiles->filtered) read_finer(strip, tiles);
}

static void fill_lane(const int32_t *window, int cells, int lane, int32_t base, double *lanes)
{
    const int32_t *line = lane_window(window, cells, lane);
    double *out = lanes + lane;
    for (int j = 0; j <= cells; j++, line += ACROSS * cells + 1)
        for (int i = 0; i <= cells; i++, out += GEOMIPMAP_LANES) *out = (double)line[i] - base;
}

// Samples outside the map are no ground.
static void leave_out_beyond(const struct strip *strip, const struct geomipmap_tiles *tiles, int lane)
{
    struct terrain_extent e = terrain_level(tiles->terrain, tiles->finest).extent;
    int cells = 1 << (strip->bits + strip->height), row = cells + 1;
    int64_t x = tiles->x0 + strip->x + (int64_t)(lane % ACROSS) * cells;
    int64_t y = tiles->y0 + strip->y + (int64_t)(lane / ACROSS) * cells;
    if (x >= e.x0 && y >= e.y0 && x + cells < e.x1 && y + cells < e.y1) return;
    for (int j = 0; j < row; j++)
        for (int i = 0; i < row; i++)
            if (x + i < e.x0 || x + i >= e.x1 || y + j < e.y0 || y + j >= e.y1)
                strip->lanes[((size_t)j * (size_t)row + (size_t)i) * GEOMIPMAP_LANES + (size_t)lane] = NAN;
}

static void strip_lane(struct strip *strip, const struct geomipmap_tiles *tiles, int lane)
{
    int32_t base = strip->range[lane].low;
    for (int n = lane; n < CORNERS * GEOMIPMAP_LANES && tiles->filtered; n += GEOMIPMAP_LANES)
        strip->corner_low[n] -= base, strip->corner_high[n] -= base;
    fill_lane(strip->window, 1 << (strip->bits + strip->height), lane, base, strip->lanes);
    for (int level = 0; level < strip->bits && tiles->filtered; level++)
        fill_lane(strip->level[level], 1 << (strip->bits - level), lane, base,
                  strip->drawn + geomipmap_level_first(strip->bits, level) * GEOMIPMAP_LANES);
    if (tiles->filtered) leave_out_beyond(strip, tiles, lane);
}

// What is kept of the errors of one tile of a group.
static float *errors_of(const struct geomipmap_tiles *tiles, int slot, int lane)
{
    return tiles->errors + ((size_t)slot * GEOMIPMAP_LANES + (size_t)lane) * (size_t)tiles->levels;
}

static void measure_group(const struct geomipmap_tiles *tiles, struct strip *strip, int column, int row,
                          int slot)
{
    struct geomipmap_facts *facts = &tiles->facts[slot];
    double spans[GEOMIPMAP_LANES];
    float errors[GEOMIPMAP_LANES][GEOMIPMAP_MAX_LEVELS];
    const struct geomipmap_heights heights = {strip->lanes,      tiles->filtered ? strip->drawn : NULL,
                                              strip->corner_low, strip->corner_high,
                                              strip->low,        strip->high};
    strip->x = (int64_t)column << (strip->bits + strip->height);
    strip->y = (int64_t)row << (strip->bits + strip->height);
    strip_read(strip, tiles);
    for (int lane = 0; lane < GEOMIPMAP_LANES; lane++) {
        strip_lane(strip, tiles, lane);
        facts->range[lane] = strip->range[lane];
        spans[lane] = (double)strip->range[lane].high - strip->range[lane].low;
    }
    geomipmap_plan_measure(&tiles->plans[strip->height], tiles->delta, &heights, spans, errors);
    for (int lane = 0; lane < GEOMIPMAP_LANES; lane++)
        memcpy(errors_of(tiles, slot, lane), errors[lane], (size_t)tiles->levels * sizeof(float));
    facts->known = UINT8_MAX;
}

struct job {
    struct geomipmap_tiles *tiles;
    int blocks;
    atomic_bool failed;
};

// Every blocks-th of the groups asked for, height by height.
static void measure_block(int block, void *user)
{
    struct job *job = user;
    struct geomipmap_tiles *tiles = job->tiles;
    struct strip strip = {0};
    strip.height = -1;
    for (int i = block; i < tiles->asked_count && !atomic_load(&job->failed); i += job->blocks) {
        int slot = tiles->asked[i];
        uint64_t name = tiles->groups.slots[slot].tile;
        int height = (int)(name >> 56), row = (int)(name >> 28 & 0xfffffff), column = (int)(name & 0xfffffff);
        if (strip.height != height) {
            strip_finish(&strip);
            if (!strip_init(&strip, tiles, height)) {
                atomic_store(&job->failed, true);
                break;
            }
        }
        measure_group(tiles, &strip, column * ACROSS, row * UP, slot);
    }
    strip_finish(&strip);
}

bool geomipmap_tiles_measure(struct geomipmap_tiles *tiles)
{
    struct job job = {.tiles = tiles, .blocks = tiles->threads > 0 ? tiles->threads : parallel_processors()};
    if (job.blocks > tiles->asked_count) job.blocks = tiles->asked_count;
    parallel_blocks(job.blocks, job.blocks, measure_block, &job);
    tiles->asked_count = 0;
    return (!tiles->failed && !atomic_load(&job.failed)) || fail("geomipmap: no memory to measure tiles");
}

// ---- bounds -------------------------------------------------------------------------------------

struct geomipmap_range geomipmap_tiles_bounds(const struct geomipmap_tiles *tiles,
                                              struct geomipmap_place place)
{
    int shift = tiles->bits + place.height, last = level_of_step(tiles, shift - 1);
    int64_t x = tiles->x0 + ((int64_t)place.column << shift), y = tiles->y0 + ((int64_t)place.row << shift);
    int64_t size = (int64_t)1 << shift;
    struct geomipmap_range range = {INT32_MAX, INT32_MIN};
    for (int up = 0; up <= last; up++) {
        struct geomipmap_range level;
        terrain_bounds(tiles->terrain, tiles->finest + up, x >> up, y >> up, (x + size) >> up,
                       (y + size) >> up, &level.low, &level.high);
        range = join(range, level);
    }
    return range;
}

// e_j in quanta over a rectangle of the finest level's samples, both ends included.
static double level_error(const struct geomipmap_tiles *tiles, int up, const int64_t from[2],
                          const int64_t to[2])
{
    return terrain_error(tiles->terrain, tiles->finest + up, from[0] >> up, from[1] >> up, to[0] >> up,
                         to[1] >> up) /
           tiles->quantum_m;
}

// Largest error of the levels up to `end` that a tile's corners may have.
static double corner_error(const struct geomipmap_tiles *tiles, int end, const int64_t from[2],
                           const int64_t to[2])
{
    double most = 0;
    for (int up = 0; up < end; up++)
        for (int corner = 0; corner < CORNERS; corner++) {
            const int64_t at[2] = {corner & 1 ? to[0] : from[0], corner & 2 ? to[1] : from[1]};
            most = fmax(most, level_error(tiles, up, at, at));
        }
    return most;
}

// Mean distance of a level from the finest near a tile: that of the whole level, less where the level's error
// is less.
static double mean_error(const struct geomipmap_tiles *tiles, int up, double error_q)
{
    struct terrain_level level = terrain_level(tiles->terrain, tiles->finest + up);
    double most_q = level.max_error_m / tiles->quantum_m;
    return most_q > 0 ? level.rms_error_m / tiles->quantum_m * fmin(error_q / most_q, 1) : 0;
}

// The errors of a tile that is not measured (see the header).
static void bound_errors(const struct geomipmap_tiles *tiles, struct geomipmap_place place, float *errors)
{
    int shift = tiles->bits + place.height;
    const int64_t from[2] = {tiles->x0 + ((int64_t)place.column << shift),
                             tiles->y0 + ((int64_t)place.row << shift)};
    const int64_t to[2] = {from[0] + ((int64_t)1 << shift), from[1] + ((int64_t)1 << shift)};
    bool saving = tiles->delta == GEOMIPMAP_SAVING, stable = tiles->delta == GEOMIPMAP_STABLE;
    double finer = stable ? corner_error(tiles, place.height, from, to) : 0, mean = 0;
    if (saving) mean = mean_error(tiles, place.height - 1, level_error(tiles, place.height - 1, from, to));
    for (int level = 0; level < tiles->levels; level++) {
        int up = place.height + level;
        errors[level] = INFINITY;
        if (level_of_step(tiles, up) != up) continue;
        double error = level_error(tiles, up, from, to), coarser = saving ? mean_error(tiles, up, error) : 0;
        double bound = saving ? ldexp(coarser - mean, 2 * up) : stable ? 2 * error + finer : error;
        errors[level] = nextafterf((float)(bound * (1 + 0x1p-40)), INFINITY);
        finer = fmax(finer, error);
        mean = coarser;
    }
}

// ---- what is known ------------------------------------------------------------------------------

static bool reserve(struct geomipmap_tiles *tiles)
{
    if (tiles->room >= tiles->groups.slot_room) return true;
    size_t room = (size_t)tiles->groups.slot_room;
    struct geomipmap_facts *facts = realloc(tiles->facts, room * sizeof *facts);
    if (facts) tiles->facts = facts;
    float *errors = realloc(tiles->errors, room * GEOMIPMAP_LANES * (size_t)tiles->levels * sizeof *errors);
    if (errors) tiles->errors = errors;
    int *asked = realloc(tiles->asked, room * sizeof *asked);
    if (asked) tiles->asked = asked;
    if (!facts || !errors || !asked) return false;
    tiles->room = (int)room;
    return true;
}

void geomipmap_tiles_begin(struct geomipmap_tiles *tiles)
{
    int from, to;
    if (!geomipmap_cache_begin_frame(&tiles->groups, &from, &to)) return;
    tiles->facts[to] = tiles->facts[from];
    memcpy(errors_of(tiles, to, 0), errors_of(tiles, from, 0),
           GEOMIPMAP_LANES * (size_t)tiles->levels * sizeof(float));
}

bool geomipmap_tiles_know(struct geomipmap_tiles *tiles, struct geomipmap_place place,
                          struct geomipmap_range *range, const float **error)
{
    const struct geomipmap_place group = {place.height, place.column / ACROSS, place.row / UP};
    int lane = place.row % UP * ACROSS + place.column % ACROSS, slot;
    enum geomipmap_found found = geomipmap_cache_find(&tiles->groups, geomipmap_tiles_name(group), &slot);
    if (found == GEOMIPMAP_FULL || !reserve(tiles)) {
        tiles->failed = true;
        return false;
    }
    struct geomipmap_facts *facts = &tiles->facts[slot];
    if (found == GEOMIPMAP_MISS) facts->known = 0;
    if (found == GEOMIPMAP_MISS && place.height <= tiles->merge) tiles->asked[tiles->asked_count++] = slot;
    if (!(facts->known >> lane & 1) && place.height > tiles->merge) {
        facts->range[lane] = geomipmap_tiles_bounds(tiles, place);
        if (place.height <= tiles->drawn) bound_errors(tiles, place, errors_of(tiles, slot, lane));
        facts->known |= (uint8_t)(1 << lane);
    }
    *range = facts->range[lane];
    *error = errors_of(tiles, slot, lane);
    return facts->known >> lane & 1;
}

// ---- the whole ----------------------------------------------------------------------------------

// Sets the corner, the tiles along both axes and the greatest height, one tile of which covers the map.
static void lay_out(struct geomipmap_tiles *tiles, bool all_heights)
{
    struct terrain_extent e = terrain_level(tiles->terrain, tiles->finest).extent;
    int64_t columns, rows;
    tiles->top = tiles->merge;
    for (;; tiles->top++) {
        tiles->drawn = all_heights ? tiles->top : tiles->merge;
        // The coarsest level that is drawn must have its samples at vertices.
        int coarsest = tiles->filtered ? tiles->drawn + tiles->bits - 1 : 0;
        tiles->x0 = e.x0 >> coarsest << coarsest;
        tiles->y0 = e.y0 >> coarsest << coarsest;
        columns = tiles_along(e.x1 - tiles->x0, 1 << tiles->bits);
        rows = tiles_along(e.y1 - tiles->y0, 1 << tiles->bits);
        int64_t size = (int64_t)1 << tiles->top;
        if ((columns <= size && rows <= size) || tiles->top == GEOMIPMAP_MAX_HEIGHTS - 1) break;
    }
    for (int height = 0; height <= tiles->top; height++) {
        tiles->grid[height].columns = (int)((columns + ((int64_t)1 << height) - 1) >> height);
        tiles->grid[height].rows = (int)((rows + ((int64_t)1 << height) - 1) >> height);
    }
}

static bool check_size(const struct geomipmap_tiles *tiles)
{
    struct terrain_extent e = terrain_level(tiles->terrain, tiles->finest).extent;
    int64_t columns = tiles_along(e.x1 - tiles->x0, 1 << tiles->bits);
    int64_t rows = tiles_along(e.y1 - tiles->y0, 1 << tiles->bits);
    if (columns > MAX_SIDE || rows > MAX_SIDE)
        return fail("geomipmap: %lld x %lld tiles of %d x %d samples; %d along a side are accepted",
                    (long long)columns, (long long)rows, (1 << tiles->bits) + 1, (1 << tiles->bits) + 1,
                    MAX_SIDE);
    if (tiles->drawn < tiles->top && columns * rows > MAX_LISTED)
        return fail("geomipmap: %lld x %lld tiles of %d x %d samples; %d are accepted, and any number from a "
                    ".relief file with heights=levels",
                    (long long)columns, (long long)rows, (1 << tiles->bits) + 1, (1 << tiles->bits) + 1,
                    MAX_LISTED);
    return true;
}

// Whether a tile may span more than 16 bits hold: by the bounds of those that may be drawn.
static bool any_wide(const struct geomipmap_tiles *tiles)
{
    const struct geomipmap_grid *grid = &tiles->grid[tiles->drawn];
    for (int row = 0; row < grid->rows; row++)
        for (int column = 0; column < grid->columns; column++) {
            struct geomipmap_range range =
                geomipmap_tiles_bounds(tiles, (struct geomipmap_place){tiles->drawn, column, row});
            if ((int64_t)range.high - range.low > UINT16_MAX) return true;
        }
    return false;
}

bool geomipmap_tiles_init(struct geomipmap_tiles *tiles, const struct terrain *terrain, int bits, int merge,
                          enum geomipmap_delta delta, bool filtered, int threads)
{
    const struct terrain_info *info = terrain_info(terrain);
    struct terrain_level level = terrain_level(terrain, info->finest);
    size_t stride;
    *tiles = (struct geomipmap_tiles){
        .terrain = terrain,
        .bits = bits,
        .levels = bits,
        .merge = merge,
        .finest = info->finest,
        .filtered = filtered,
        .spacing_m = {level.spacing_m[0], level.spacing_m[1]},
        .quantum_m = info->quantum_m,
        .offset_m = info->offset_m,
        .delta = delta,
        .threads = threads,
    };
    lay_out(tiles, filtered && !terrain_samples(terrain, info->finest, &stride));
    bool good = check_size(tiles) && geomipmap_cache_init(&tiles->groups, 0, KEPT_GROUPS);
    for (int height = 0; height <= merge && good; height++)
        good = geomipmap_plan_init(&tiles->plans[height], bits, height);
    if (good) tiles->wide = any_wide(tiles);
    if (!good) geomipmap_tiles_finish(tiles);
    return good;
}

void geomipmap_tiles_finish(struct geomipmap_tiles *tiles)
{
    for (int height = 0; height <= GEOMIPMAP_MAX_MERGE; height++)
        geomipmap_plan_finish(&tiles->plans[height]);
    geomipmap_cache_finish(&tiles->groups);
    free(tiles->facts);
    free(tiles->errors);
    free(tiles->asked);
    *tiles = (struct geomipmap_tiles){0};
}

// ---- heights ------------------------------------------------------------------------------------

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
    size_t bytes = geomipmap_cache_bytes(&tiles->groups) +
                   (size_t)tiles->room * (sizeof *tiles->facts + sizeof *tiles->asked +
                                          GEOMIPMAP_LANES * (size_t)tiles->levels * sizeof *tiles->errors);
    for (int height = 0; height <= tiles->merge; height++)
        bytes += geomipmap_plan_bytes(&tiles->plans[height]);
    return bytes;
}
