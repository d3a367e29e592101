// SPDX-License-Identifier: MIT
#include "bench/error/truth_sphere.h"

#include "common/report.h"
#include "common/terrain/detail.h"

#include <float.h>
#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

// A tile holds the cells 0..TILE-1 of one level and the samples about them that they, and the finer tiles
// under them, are made of.
enum { TILE = 8, BEFORE = 3, SIDE = TILE + 7, TILES = 4096, HEIGHTS = 40, REACH = 2, EXPONENTS = 40 };

// Of the rows about a cell, those nearest to the equator may have posts so much closer than its own.
enum { MOST_FINER = 4 };

// Of a terrain that is read on demand: the cells of a node of height PAGE_HEIGHT, bounded as in memory. Nodes
// from there up are bounded by what the file tells of its tiles.
enum { PAGE_HEIGHT = 6, PAGE = 1 << PAGE_HEIGHT, PAGE_SIDE = PAGE + 1 + 2 * REACH, PAGES = 256 };
enum { PAGE_NODES = (4 * PAGE * PAGE - 1) / 3 }; // of all heights

static const double NORMS[2] = {DETAIL_NORM, DETAIL_NORM_MIXED};

struct truth_sphere {
    const struct terrain *terrain;
    const struct detail *detail;
    const int32_t *samples; // of level 0; NULL: read in pages
    double radius_m, quantum_m, offset_m;
    double spacing_rad[2];  // of level 0
    int64_t first, columns; // of level 0
    int64_t pole;
    int finest, heights;
    // Rows of the finest level from the equator on, from which posts are 2^e columns apart; how far apart
    // they may be in level 0 (detail.h).
    int64_t apart[EXPONENTS];
    int most_apart;
    uint8_t *wide[HEIGHTS]; // exponents of nodes by their rows
    // Highest height of the finest surface over nodes of 2^k rows of level 0, quanta; NULL: in pages.
    float *high[HEIGHTS];
    int64_t width[HEIGHTS], height[HEIGHTS];
    double leeway_q[2][DETAIL_MAX_FINER + 1]; // [mixed][-level]: what noise and roundings may add to U
    double low, highest;                      // of all, as the finest level tells
    struct idle *idle;
};

struct tile {
    int64_t x, y;
    int level, exponent; // 1: empty; samples are 2^exponent columns apart
    int32_t samples[SIDE][SIDE];
    unsigned bounded;       // a bit for each row of cells
    float high[TILE][TILE]; // of the finest surface over a cell, where it is bounded
};

struct page { // of level 0
    int64_t x, y;
    bool read;
    int32_t samples[PAGE_SIDE][PAGE_SIDE]; // from REACH before its cells on
    float high[PAGE_NODES];                // height after height
};

struct truth_tiles {
    struct truth_tiles *next; // idle, too
    struct page *pages;       // NULL: level 0 is in memory
    struct tile all[TILES];
};

struct idle { // tiles that no thread holds
    pthread_mutex_t lock;
    struct truth_tiles *first;
};

// ---- bounds ----------------------------------------------------------------

// That of the posts of a row of level k, from the equator on.
static int exponent_of(const struct truth_sphere *s, int k, int64_t row)
{
    int64_t pole = s->pole << -k, from_equator = llabs(row) <= pole ? llabs(row) : 2 * pole - llabs(row);
    int64_t finest = from_equator << (k - s->finest);
    int exponent = 0, most = s->most_apart - k;
    while (exponent < most && finest >= s->apart[exponent + 1]) exponent++;
    return exponent;
}

// Of rows j and j + 1.
static int64_t equatorward(int64_t j)
{
    return j >= 0 ? j : j + 1;
}

// Nodes of height k in row j are 2^(k + e) columns wide: of levels, as their cells are (detail.h), and over
// level 0 as much wider than high where columns crowd, but not wider than what they are part of.
static int exponent_at(const struct truth_sphere *s, int k, int64_t j)
{
    if (k >= 0) return s->wide[k][j];
    return exponent_of(s, k, equatorward(j - (s->pole << -k)));
}

static bool find_widths(struct truth_sphere *s)
{
    for (int k = s->heights - 1; k >= 0; k--) {
        if (!(s->wide[k] = calloc((size_t)s->height[k], 1))) return false;
        for (int64_t j = 0; j < s->height[k] && s->finest < 0 && k < s->heights - 1; j++) {
            int64_t south = (j << k) - s->pole, north = south + ((int64_t)1 << k);
            int64_t row = south > 0 ? south : north < 0 ? -north : 0;
            int exponent = detail_exponent(s->detail, 0, row), most = s->wide[k + 1][j / 2] + 1;
            s->wide[k][j] = (uint8_t)(exponent < most ? exponent : most);
        }
    }
    return true;
}

static void find_exponents(struct truth_sphere *s)
{
    int64_t pole = s->pole << -s->finest;
    for (int e = 0; e < EXPONENTS; e++) s->apart[e] = pole + 1;
    for (int e = 1; s->finest < 0 && e <= detail_exponent(s->detail, s->finest, pole); e++) {
        int64_t low = 0, high = pole; // it is less than e in the one, and not in the other
        while (high - low > 1) {
            int64_t middle = low + (high - low) / 2;
            *(detail_exponent(s->detail, s->finest, middle) < e ? &low : &high) = middle;
        }
        s->apart[e] = high;
    }
    s->most_apart = s->finest < 0 ? detail_exponent(s->detail, 0, s->pole) : 0;
}

// Nodes of height k in row j.
static int64_t nodes_in(const struct truth_sphere *s, int k, int64_t j)
{
    int wide = exponent_at(s, k, j) + k;
    if (wide < 0) return s->columns << -wide;
    return (s->columns + ((int64_t)1 << wide) - 1) >> wide;
}

// A step rounds by half a quantum, and noise that is not all rounded away once more, and as much where there
// are samples between posts; finer levels of U take each that much further.
static void find_leeways(struct truth_sphere *s)
{
    for (int mixed = 0; mixed < 2; mixed++)
        for (int l = s->finest; l < 0; l++) {
            double noise = DETAIL_DEVIATE * s->detail->sigma_q[-l], rounding = mixed ? 1 : 0.5;
            if (noise >= 0.5) rounding += noise + 0.5;
            s->leeway_q[mixed][-l - 1] = s->leeway_q[mixed][-l] + NORMS[mixed] * rounding;
        }
}

// Of the finest surface over a cell of a level whose samples about it are low..high; `mixed`: their rows'
// posts are not all as far apart.
static float bound_of(const struct truth_sphere *s, int level, bool mixed, double low, double high)
{
    double bound = high + (high - low) * DETAIL_OVERSHOOT(NORMS[mixed]) + s->leeway_q[mixed][-level];
    return (float)(bound + fabs(bound) * 0x1p-23); // not rounded below it
}

// Of level 0: samples to either side of a cell's own that the surface over it is made of.
static int reach_of(const struct truth_sphere *s)
{
    return s->finest < 0 ? REACH : 0;
}

// Over a cell of level 0; `around`: the first of the samples about it, rows of `stride`.
static float bound_cell(const struct truth_sphere *s, const int32_t *around, int stride)
{
    int32_t low = INT32_MAX, high = INT32_MIN;
    int rows = 2 * reach_of(s) + 2;
    for (int y = 0; y < rows; y++)
        for (int x = 0; x < rows; x++) {
            int32_t q = around[y * stride + x];
            low = q < low ? q : low;
            high = q > high ? q : high;
        }
    return s->finest == 0 ? (float)high : bound_of(s, 0, false, low, high);
}

// The smallest exponent of the rows that the surface over cells of row j is made of; whether others differ.
static int least_about(const struct truth_sphere *s, int level, int64_t j, bool *mixed)
{
    int south = exponent_of(s, level, j - REACH), north = exponent_of(s, level, j + 1 + REACH);
    bool over_pole = llabs(j) + 2 * REACH >= s->pole << -level;
    *mixed = south != north || over_pole;
    return south < north ? south : north;
}

// Over cells first.. of row j of a synthesised level or of level 0, as wide as posts there are apart,
// whatever the rows about it.  `room` holds all posts about them.
static void bound_any_row(const struct truth_sphere *s, int level, int64_t first, int64_t j, int count,
                          int32_t *room, float *high)
{
    bool mixed;
    int least = least_about(s, level, j, &mixed), finer = exponent_of(s, level, equatorward(j)) - least;
    int width = ((count + 2 * REACH + 1) << finer) + 1, rows = 2 * REACH + 2;
    detail_posts(s->detail, level, least, (first - REACH) * ((int64_t)1 << finer), j - REACH, width, rows,
                 room);
    for (int i = 0; i < count; i++) {
        int32_t least_q = INT32_MAX, most_q = INT32_MIN;
        for (int y = 0; y < rows; y++)
            for (int x = i << finer; x <= (i + 2 * REACH + 1) << finer; x++) {
                int32_t q = room[y * width + x];
                least_q = q < least_q ? q : least_q;
                most_q = q > most_q ? q : most_q;
            }
        high[i] = bound_of(s, level, mixed, least_q, most_q);
    }
}

// Over the cells of one row of level 0.
static bool bound_row(struct truth_sphere *s, int64_t j)
{
    int count = (int)nodes_in(s, 0, j), width = count + 1;
    size_t room = (2 * REACH + 2) * (((size_t)count + 2 * REACH + 1) * MOST_FINER + 1);
    int32_t *samples = malloc(room * sizeof *samples);
    float *high = s->high[0] + j * s->columns;
    if (samples && s->finest < 0) bound_any_row(s, 0, 0, j - s->pole, count, samples, high);
    if (samples && s->finest == 0) {
        terrain_window(s->terrain, 0, s->first, j - s->pole, width, 2, samples, TERRAIN_WAIT);
        for (int i = 0; i < count; i++) high[i] = bound_cell(s, samples + i, width);
    }
    free(samples);
    return samples != NULL;
}

// Over the nodes that are pages, unread.
static void bound_pages(struct truth_sphere *s)
{
    int reach = reach_of(s), k = PAGE_HEIGHT;
    for (int64_t y = 0; y < s->height[k]; y++) {
        int64_t j = y * PAGE - s->pole, last = j + PAGE - 1, wide = (int64_t)PAGE << exponent_at(s, k, y);
        int64_t aside = reach;
        if (s->finest < 0) aside += detail_aside(s->detail, j - reach, last + 1 + reach);
        for (int64_t x = 0; x < nodes_in(s, k, y); x++) {
            int64_t i = s->first + x * wide;
            int32_t low, high;
            terrain_bounds(s->terrain, 0, i - aside, j - reach, i + wide + aside, last + 1 + reach, &low,
                           &high);
            s->high[k][y * s->width[k] + x] =
                s->finest == 0 ? (float)high : bound_of(s, 0, aside > reach, low, high);
        }
    }
}

static void bound_parents(const struct truth_sphere *s, int k)
{
    for (int64_t j = 0; j < s->height[k]; j++)
        for (int64_t i = 0; i < nodes_in(s, k, j); i++) {
            float high = -HUGE_VALF;
            for (int64_t y = 2 * j; y < 2 * j + 2 && y < s->height[k - 1]; y++) {
                int halves = exponent_at(s, k - 1, y) == exponent_at(s, k, j); // else as wide
                int64_t count = nodes_in(s, k - 1, y);
                for (int64_t x = i << halves; x < (i + 1) << halves && x < count; x++)
                    high = fmaxf(high, s->high[k - 1][y * s->width[k - 1] + x]);
            }
            s->high[k][j * s->width[k] + i] = high;
        }
}

static bool build_bounds(struct truth_sphere *s)
{
    int64_t size[2] = {s->columns, 2 * s->pole};
    for (int k = 0; k < HEIGHTS; k++) {
        s->width[k] = (size[0] + ((int64_t)1 << k) - 1) >> k;
        s->height[k] = (size[1] + ((int64_t)1 << k) - 1) >> k;
        s->heights = k + 1;
        if (s->width[k] == 1 && s->height[k] == 1) break;
    }
    if (!find_widths(s)) return false;
    for (int k = s->samples ? 0 : PAGE_HEIGHT; k < s->heights; k++) {
        s->high[k] = malloc((size_t)(s->width[k] * s->height[k]) * sizeof *s->high[k]);
        if (!s->high[k]) return false;
        if (k > 0 && s->high[k - 1])
            bound_parents(s, k);
        else if (k > 0)
            bound_pages(s);
        for (int64_t j = 0; k == 0 && j < size[1]; j++)
            if (!bound_row(s, j)) return false;
    }
    return true;
}

struct truth_sphere *truth_sphere_create(const struct terrain *terrain)
{
    const struct terrain_info *info = terrain_info(terrain);
    struct truth_sphere *s = calloc(1, sizeof *s);
    size_t stride;
    if (s) {
        s->terrain = terrain;
        s->detail = terrain_detail(terrain);
        s->samples = terrain_samples(terrain, 0, &stride);
        s->radius_m = info->radius_m;
        s->quantum_m = info->quantum_m;
        s->offset_m = info->offset_m;
        for (int axis = 0; axis < 2; axis++) s->spacing_rad[axis] = info->spacing_m[axis] / info->radius_m;
        s->first = s->detail->grid.first;
        s->columns = s->detail->grid.columns;
        s->pole = s->detail->grid.pole;
        s->finest = info->finest;
        find_exponents(s);
        find_leeways(s);
        // Rays are cut at these: they are those of the map as a whole, which read on demand is what it is in
        // memory, so that hits are the same, bit for bit.
        struct terrain_level stored = terrain_level(terrain, 0);
        double range_q = (double)stored.max_q - stored.min_q, over_q = 0;
        if (s->finest < 0)
            over_q = range_q * DETAIL_OVERSHOOT(DETAIL_NORM_MIXED) +
                     detail_noise_limit(s->detail, -s->finest, DETAIL_NORM_MIXED);
        s->low = stored.min_q - over_q;
        s->highest = stored.max_q + over_q;
    }
    if (s && (s->idle = calloc(1, sizeof *s->idle))) pthread_mutex_init(&s->idle->lock, NULL);
    if (s && s->idle && build_bounds(s)) return s;
    fail("terrain %s: no memory for the ray caster", info->name);
    truth_sphere_destroy(s);
    return NULL;
}

void truth_sphere_destroy(struct truth_sphere *s)
{
    if (!s) return;
    for (struct truth_tiles *tiles = s->idle ? s->idle->first : NULL, *next; tiles; tiles = next) {
        next = tiles->next;
        free(tiles->pages);
        free(tiles);
    }
    if (s->idle) pthread_mutex_destroy(&s->idle->lock);
    free(s->idle);
    for (int k = 0; k < HEIGHTS; k++) free(s->high[k]), free(s->wide[k]);
    free(s);
}

// ---- tiles -----------------------------------------------------------------

struct truth_tiles *truth_tiles_take(const struct truth_sphere *s)
{
    pthread_mutex_lock(&s->idle->lock);
    struct truth_tiles *tiles = s->idle->first;
    if (tiles) s->idle->first = tiles->next;
    pthread_mutex_unlock(&s->idle->lock);
    if (tiles || !(tiles = malloc(sizeof *tiles))) return tiles;
    tiles->pages = s->samples ? NULL : calloc(PAGES, sizeof *tiles->pages);
    for (int k = 0; k < TILES; k++) tiles->all[k].level = 1;
    if (s->samples || tiles->pages) return tiles;
    free(tiles);
    return NULL;
}

void truth_tiles_give(const struct truth_sphere *s, struct truth_tiles *tiles)
{
    if (!tiles) return;
    pthread_mutex_lock(&s->idle->lock);
    tiles->next = s->idle->first;
    s->idle->first = tiles;
    pthread_mutex_unlock(&s->idle->lock);
}

static size_t slot_of(int level, int exponent, int64_t x, int64_t y)
{
    uint64_t key = (uint64_t)x * 0x9e3779b97f4a7c15u ^ (uint64_t)y * 0xc2b2ae3d27d4eb4fu ^
                   (uint64_t)(-level) << 57 ^ (uint64_t)exponent << 51;
    return (size_t)((key * 0xd6e8feb86659fd93u) >> 52) % TILES;
}

// Over the cells of row j: they are of the finest level, or all about them counts.
static void bound_tile_row(const struct truth_sphere *s, struct tile *tile, int j)
{
    bool finest = tile->level == s->finest;
    int reach = finest ? 0 : REACH;
    int64_t row = tile->y * TILE + j;
    bool mixed = false;
    if (!finest) least_about(s, tile->level, row, &mixed);
    if (mixed) {
        int32_t room[(2 * REACH + 2) * ((TILE + 2 * REACH + 1) * MOST_FINER + 1)];
        bound_any_row(s, tile->level, tile->x * TILE, row, TILE, room, tile->high[j]);
        tile->bounded |= 1u << j;
        return;
    }
    int32_t low[SIDE], high[SIDE]; // along y
    for (int i = 0; i < SIDE; i++) low[i] = INT32_MAX, high[i] = INT32_MIN;
    for (int y = BEFORE + j - reach; y < BEFORE + j + 2 + reach; y++)
        for (int i = 0; i < SIDE; i++) {
            int32_t q = tile->samples[y][i];
            low[i] = q < low[i] ? q : low[i];
            high[i] = q > high[i] ? q : high[i];
        }
    for (int i = 0; i < TILE; i++) {
        int32_t least = INT32_MAX, most = INT32_MIN;
        for (int x = BEFORE + i - reach; x < BEFORE + i + 2 + reach; x++) {
            least = low[x] < least ? low[x] : least;
            most = high[x] > most ? high[x] : most;
        }
        tile->high[j][i] = finest ? (float)most : bound_of(s, tile->level, false, least, most);
    }
    tile->bounded |= 1u << j;
}

static struct tile *tile_at(const struct truth_sphere *s, struct truth_tiles *tiles, int level, int exponent,
                            int64_t x, int64_t y);

// Whether all rows of a tile, and so those that they are made of, have posts so far apart.
static bool is_uniform(const struct truth_sphere *s, const struct tile *tile)
{
    int64_t south = tile->y * TILE - BEFORE, north = south + SIDE - 1;
    int level = tile->level, e = tile->exponent;
    return level < 0 && e <= s->most_apart - level - 1 && detail_exponent(s->detail, level, south) == e &&
           detail_exponent(s->detail, level, north) == e;
}

static void make_samples(const struct truth_sphere *s, struct truth_tiles *tiles, struct tile *tile)
{
    enum { COARSE = 11 };
    int64_t x = tile->x, y = tile->y;
    if (!is_uniform(s, tile)) {
        detail_posts(s->detail, tile->level, tile->exponent, x * TILE - BEFORE, y * TILE - BEFORE, SIDE, SIDE,
                     &tile->samples[0][0]);
        return;
    }
    const struct tile *above = tile_at(s, tiles, tile->level + 1, tile->exponent, x >> 1, y >> 1);
    int32_t coarse[COARSE * COARSE];
    int64_t i = (x & 1) * (TILE / 2), j = (y & 1) * (TILE / 2);
    for (int row = 0; row < COARSE; row++)
        memcpy(coarse + row * COARSE, &above->samples[j + row][i], COARSE * sizeof *coarse);
    detail_refine(s->detail, tile->level, tile->exponent, coarse, x * TILE - BEFORE, y * TILE - BEFORE, SIDE,
                  SIDE, &tile->samples[0][0]);
}

// The tile (x, y) of a level, in tiles from the first column and the equator on; another call may make it
// another one.
static struct tile *tile_at(const struct truth_sphere *s, struct truth_tiles *tiles, int level, int exponent,
                            int64_t x, int64_t y)
{
    struct tile *slot = &tiles->all[slot_of(level, exponent, x, y)];
    if (slot->level == level && slot->exponent == exponent && slot->x == x && slot->y == y) return slot;
    struct tile tile; // one that it is made of may have the same slot
    tile.x = x, tile.y = y, tile.level = level, tile.exponent = exponent, tile.bounded = 0;
    make_samples(s, tiles, &tile);
    *slot = tile;
    return slot;
}

// At least the highest height of the finest surface over cell (x, y) of a level.
static double highest_over(const struct truth_sphere *s, struct truth_tiles *tiles, int level, int exponent,
                           int64_t x, int64_t y)
{
    struct tile *tile = tile_at(s, tiles, level, exponent, x >> 3, y >> 3);
    if (!(tile->bounded >> (y & 7) & 1)) bound_tile_row(s, tile, (int)(y & 7));
    return (double)tile->high[y & 7][x & 7];
}

// ---- pages -----------------------------------------------------------------

// Nodes of height k of a page, PAGE >> k a row.
static float *page_nodes(struct page *page, int k)
{
    float *nodes = page->high;
    for (int below = 0; below < k; below++) nodes += (PAGE >> below) * (PAGE >> below);
    return nodes;
}

static void bound_page(const struct truth_sphere *s, struct page *page)
{
    int before = REACH - reach_of(s);
    for (int j = 0; j < PAGE; j++) {
        // Posts of rows about it may be farther apart.
        int64_t row = page->y * PAGE + j;
        bool mixed = s->finest < 0 && (detail_exponent(s->detail, 0, row - s->pole - REACH) > 0 ||
                                       detail_exponent(s->detail, 0, row - s->pole + 1 + REACH) > 0);
        for (int i = 0; i < PAGE; i++)
            page->high[j * PAGE + i] =
                mixed ? HUGE_VALF : bound_cell(s, &page->samples[j + before][i + before], PAGE_SIDE);
    }
    for (int k = 1; k <= PAGE_HEIGHT; k++) {
        const float *below = page_nodes(page, k - 1);
        float *nodes = page_nodes(page, k);
        int side = PAGE >> k;
        for (int j = 0; j < side; j++)
            for (int i = 0; i < side; i++) {
                const float *b = below + 4 * j * side + 2 * i;
                nodes[j * side + i] = fmaxf(fmaxf(b[0], b[1]), fmaxf(b[2 * side], b[2 * side + 1]));
            }
    }
}

// Page (x, y), in nodes of its height; another call may make it another one.
static struct page *page_at(const struct truth_sphere *s, struct truth_tiles *tiles, int64_t x, int64_t y)
{
    struct page *page = &tiles->pages[slot_of(0, 0, x, y) % PAGES];
    if (page->read && page->x == x && page->y == y) return page;
    page->x = x, page->y = y;
    page->read = true;
    terrain_window(s->terrain, 0, s->first + x * PAGE - REACH, y * PAGE - s->pole - REACH, PAGE_SIDE,
                   PAGE_SIDE, &page->samples[0][0], TERRAIN_WAIT);
    bound_page(s, page);
    return page;
}

// ---- a ray -----------------------------------------------------------------

struct ray {
    const struct truth_sphere *s;
    struct truth_tiles *tiles;
    double origin[3], direction[3];
    double nearest; // t where it is nearest to the centre
};

// Where the ray is: columns and rows in cells of level 0 from the south-west sample, height in quanta.
struct at {
    double t, place[2], height_q;
};

static double clamp(double value, double low, double high)
{
    return value < low ? low : value > high ? high : value;
}

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// `near`: a column less than half a turn away.
static struct at at_time(const struct ray *ray, double t, double near)
{
    const struct truth_sphere *s = ray->s;
    double p[3];
    for (int k = 0; k < 3; k++) p[k] = ray->origin[k] + t * ray->direction[k];
    double across = hypot(p[0], p[1]), column = atan2(p[1], p[0]) / s->spacing_rad[0] - (double)s->first;
    struct at at = {.t = t};
    at.place[0] = near + remainder(column - near, (double)s->columns);
    at.place[1] = clamp(atan2(p[2], across) / s->spacing_rad[1] + (double)s->pole, 0, 2 * (double)s->pole);
    at.height_q = (hypot(across, p[2]) - s->radius_m - s->offset_m) / s->quantum_m;
    return at;
}

static double meridian_time(const struct ray *ray, double column)
{
    double longitude = (column + (double)ray->s->first) * ray->s->spacing_rad[0];
    double x = cos(longitude), y = sin(longitude);
    return (ray->origin[0] * y - ray->origin[1] * x) / (ray->direction[1] * x - ray->direction[0] * y);
}

// z c - rho s, 0 on the cone, and its change with t.
static double off_cone(const struct ray *ray, double s, double c, double t, double *change)
{
    double x = ray->origin[0] + t * ray->direction[0], y = ray->origin[1] + t * ray->direction[1];
    double z = ray->origin[2] + t * ray->direction[2], across = hypot(x, y);
    double outward = across > 0 ? (x * ray->direction[0] + y * ray->direction[1]) / across
                                : hypot(ray->direction[0], ray->direction[1]);
    *change = ray->direction[2] * c - outward * s;
    return z * c - across * s;
}

// The crossing of a cone of latitude between t0 and t1, on whose sides these lie: the quadratic's root there,
// polished; where rounding leaves no root, bisection stands in.
static double cone_time(const struct ray *ray, double row, double t0, double t1)
{
    double latitude = (row - (double)ray->s->pole) * ray->s->spacing_rad[1], s = sin(latitude),
           c = cos(latitude);
    const double *e = ray->origin, *d = ray->direction;
    double a = d[2] * d[2] * c * c - s * s * (d[0] * d[0] + d[1] * d[1]);
    double b = e[2] * d[2] * c * c - s * s * (e[0] * d[0] + e[1] * d[1]), across = hypot(e[0], e[1]);
    double constant = (e[2] * c - across * s) * (e[2] * c + across * s), inside = b * b - a * constant;
    double q = -(b + copysign(sqrt(fmax(inside, 0)), b)), roots[2] = {q / a, constant / q}, best = NAN,
           change;
    double least = HUGE_VAL, slack = 1e-9 * (fabs(t0) + fabs(t1));
    for (int k = 0; k < 2; k++) {
        if (!(roots[k] >= t0 - slack && roots[k] <= t1 + slack)) continue;
        double off = fabs(off_cone(ray, s, c, roots[k], &change));
        if (off < least) least = off, best = roots[k];
    }
    if (!isnan(best)) {
        double off = off_cone(ray, s, c, best, &change), polished = best - off / change;
        return clamp(isfinite(polished) ? polished : best, t0, t1);
    }
    double side = off_cone(ray, s, c, t0, &change);
    for (int k = 0; k < 60; k++) {
        double middle = 0.5 * (t0 + t1);
        *((off_cone(ray, s, c, middle, &change) > 0) == (side > 0) ? &t0 : &t1) = middle;
    }
    return 0.5 * (t0 + t1);
}

// Where the ray crosses line `line` of an axis between a and b, which lie on its two sides.
static struct at crossing(const struct ray *ray, int axis, double line, const struct at *a,
                          const struct at *b)
{
    double t = axis ? cone_time(ray, line, a->t, b->t) : meridian_time(ray, line);
    if (!(t > a->t)) t = a->t;
    if (!(t < b->t)) t = b->t;
    struct at at = at_time(ray, t, 0.5 * (a->place[0] + b->place[0]));
    for (int k = 0; k < 2; k++)
        at.place[k] = clamp(at.place[k], fmin(a->place[k], b->place[k]), fmax(a->place[k], b->place[k]));
    at.place[axis] = line;
    return at;
}

// ---- one cell of the finest level ------------------------------------------

struct cell {
    double west, south, size[2]; // in cells of level 0
    double corner[2][2];         // quanta, [north][east]
    double axis_m;               // at most its distance from the planet's axis; 0: it ends at a pole
};

// What a cell is made of: two triangles, or, at a pole and where it is several columns wide, one bilinear
// facet (terrain.h).
enum { NORTH_WEST, SOUTH_EAST, BILINEAR, DIAGONAL };

static void fractions(const struct cell *cell, const struct at *at, double uv[2])
{
    uv[0] = clamp((at->place[0] - cell->west) / cell->size[0], 0, 1);
    uv[1] = clamp((at->place[1] - cell->south) / cell->size[1], 0, 1);
}

// How the height of a part changes over the cell's width and height, quanta; of a bilinear facet, at a place
// in it.
static void rises(const struct cell *cell, int part, const double uv[2], double rise[2])
{
    const double(*z)[2] = cell->corner;
    double u = part == BILINEAR ? uv[0] : part == SOUTH_EAST,
           v = part == BILINEAR ? uv[1] : part != SOUTH_EAST;
    rise[0] = (1 - v) * (z[0][1] - z[0][0]) + v * (z[1][1] - z[1][0]);
    rise[1] = (1 - u) * (z[1][0] - z[0][0]) + u * (z[1][1] - z[0][1]);
}

// Height of the ray over a part.
static double clearance(const struct cell *cell, int part, const struct at *at)
{
    double uv[2], rise[2], height_q;
    fractions(cell, at, uv);
    rises(cell, part, uv, rise);
    if (part == BILINEAR)
        height_q = cell->corner[0][0] + uv[0] * (cell->corner[0][1] - cell->corner[0][0]) + uv[1] * rise[1];
    else
        height_q = cell->corner[0][0] + uv[0] * rise[0] + uv[1] * rise[1];
    return at->height_q - height_q;
}

static void set_hit(const struct ray *ray, const struct cell *cell, int part, const struct at *at,
                    struct truth_sphere_hit *hit)
{
    const struct truth_sphere *s = ray->s;
    double place[3], axes[3][3], uv[2], rise[2], slope[2];
    fractions(cell, at, uv);
    rises(cell, part, uv, rise);
    for (int axis = 0; axis < 2; axis++)
        slope[axis] = rise[axis] * (s->quantum_m / cell->size[axis]) / s->spacing_rad[axis];
    place[0] = (at->place[0] + (double)s->first) * s->spacing_rad[0];
    place[1] = (at->place[1] - (double)s->pole) * s->spacing_rad[1];
    sphere_axes(1, place, axes);
    hit->t = at->t;
    hit->height_m = at->height_q * s->quantum_m + s->offset_m;
    double r = s->radius_m + hit->height_m, east = slope[0] / (r * fmax(cos(place[1]), 1e-12)),
           north = slope[1] / r;
    for (int k = 0; k < 3; k++) hit->normal[k] = axes[2][k] - east * axes[0][k] - north * axes[1][k];
}

// Narrows a..b, where f changes its sign, to where it is 0 up to rounding (regula falsi, Illinois).
struct narrowing {
    const struct ray *ray;
    const struct cell *cell;
    int what; // the clearance over a part, or the distance from the DIAGONAL
};

static double value_at(const struct narrowing *n, const struct at *at)
{
    if (n->what != DIAGONAL) return clearance(n->cell, n->what, at);
    const struct cell *c = n->cell;
    return (at->place[0] - c->west) * (c->size[1] / c->size[0]) - (at->place[1] - c->south);
}

static struct at narrow(const struct narrowing *n, struct at a, struct at b, double fa, double fb)
{
    // One step in four halves the interval, which so ends at neighbouring times whatever f does.
    for (int k = 0, side = 0; k < 240 && b.t - a.t > 4 * DBL_EPSILON * fabs(b.t); k++) {
        double t = a.t + (b.t - a.t) * (fa / (fa - fb)), middle = 0.5 * (a.t + b.t);
        if (k % 4 == 3 || !(t > a.t && t < b.t)) t = middle; // halved values lead past the end, too
        if (t == a.t || t == b.t) break;
        struct at m = at_time(n->ray, t, a.place[0]);
        double f = value_at(n, &m);
        if (f == 0) return m;
        if ((f > 0) == (fa > 0)) {
            a = m, fa = f;
            if (side == 1) fb *= 0.5;
            side = 1;
        } else {
            b = m, fb = f;
            if (side == 2) fa *= 0.5;
            side = 2;
        }
    }
    return b;
}

// The most that the second derivative along a straight ray, by metres, may be of the latitude and of the
// longitude, radians, with rho the distance from the axis; of the height it is 1/R.
static double latitude_bend(const struct truth_sphere *s, const struct cell *cell)
{
    return 1 / (s->radius_m * cell->axis_m) + 2 / (s->radius_m * s->radius_m);
}

static double longitude_bend(const struct cell *cell)
{
    return 1 / (cell->axis_m * cell->axis_m);
}

// How far a value along the ray may dip under the lower of those at two ends: an eighth of the square of the
// length times its second derivative.  The factor 2 covers heights under the datum.
static double dip(const struct ray *ray, const struct at *a, const struct at *b, double bend)
{
    double length_m = (b->t - a->t) * sqrt(dot(ray->direction, ray->direction));
    return 0.25 * length_m * length_m * bend;
}

// Of the clearance over a part: its slopes by the bends, and of a bilinear facet the change of one slope
// along the other axis.
static double clearance_bend(const struct truth_sphere *s, const struct cell *cell, int part)
{
    const double(*z)[2] = cell->corner;
    double size_rad[2] = {cell->size[0] * s->spacing_rad[0], cell->size[1] * s->spacing_rad[1]};
    double rise[2], twist_m = 0;
    if (part == BILINEAR) {
        rise[0] = fmax(fabs(z[0][1] - z[0][0]), fabs(z[1][1] - z[1][0]));
        rise[1] = fmax(fabs(z[1][0] - z[0][0]), fabs(z[1][1] - z[0][1]));
        twist_m = 2 * fabs(z[1][1] - z[1][0] - z[0][1] + z[0][0]) /
                  (size_rad[0] * cell->axis_m * size_rad[1] * s->radius_m);
    } else
        rises(cell, part, NULL, rise);
    return 1 / (s->radius_m * s->quantum_m) + fabs(rise[1]) / size_rad[1] * latitude_bend(s, cell) +
           fabs(rise[0]) / size_rad[0] * longitude_bend(cell) + twist_m;
}

// Inside one part the clearance of a straight ray bends one way: it may dip below between two ends above.
static bool part_hit(const struct ray *ray, const struct cell *cell, int part, const struct at *a,
                     const struct at *b, struct truth_sphere_hit *hit)
{
    struct narrowing n = {ray, cell, part};
    double fa = clearance(cell, part, a), fb = clearance(cell, part, b);
    struct at found = *a;
    if (fa > 0 && fb <= 0)
        found = narrow(&n, *a, *b, fa, fb);
    else if (fa > 0) {
        if (fmin(fa, fb) > dip(ray, a, b, clearance_bend(ray->s, cell, part))) return false;
        struct at m = at_time(ray, 0.5 * (a->t + b->t), a->place[0]);
        double fm = clearance(cell, part, &m), bend = 2 * (fa + fb - 2 * fm), lean = 4 * fm - 3 * fa - fb;
        if (bend <= 0) return false;
        double lowest = -lean / (2 * bend);
        if (!(lowest > 0 && lowest < 1)) return false;
        struct at low = at_time(ray, a->t + lowest * (b->t - a->t), a->place[0]);
        double fl = clearance(cell, part, &low);
        if (fl > 0) return false;
        found = narrow(&n, *a, low, fa, fl);
    }
    set_hit(ray, cell, part, &found, hit);
    return true;
}

// Where the ray is on the other side of the diagonal than at both ends, if anywhere: in (longitude, latitude)
// it bends one way over a cell, and may cross the diagonal and come back.
static bool strays(const struct narrowing *n, const struct at *a, const struct at *b, double fa, double fb,
                   struct at *beyond)
{
    static const double SECTION = 0.38196601125010515; // golden
    const struct truth_sphere *s = n->ray->s;
    double bend = longitude_bend(n->cell) / s->spacing_rad[0] * (n->cell->size[1] / n->cell->size[0]) +
                  latitude_bend(s, n->cell) / s->spacing_rad[1];
    if (fmin(fabs(fa), fabs(fb)) > dip(n->ray, a, b, bend)) return false;
    double sign = fa + fb < 0 ? -1 : 1, from = a->t, to = b->t, least[2];
    struct at inner[2] = {at_time(n->ray, from + SECTION * (to - from), a->place[0]),
                          at_time(n->ray, to - SECTION * (to - from), a->place[0])};
    for (int k = 0; k < 2; k++) least[k] = sign * value_at(n, &inner[k]);
    for (int step = 0; step < 80 && inner[0].t < inner[1].t; step++) {
        int low = least[1] < least[0];
        *beyond = inner[low];
        if (least[low] < 0) return true;
        if (low)
            from = inner[0].t, inner[0] = inner[1], least[0] = least[1];
        else
            to = inner[1].t, inner[1] = inner[0], least[1] = least[0];
        double t = low ? to - SECTION * (to - from) : from + SECTION * (to - from);
        inner[low] = at_time(n->ray, t, a->place[0]);
        least[low] = sign * value_at(n, &inner[low]);
    }
    return false;
}

// The part of a cell at a distance from the DIAGONAL.
static int part_at(double distance)
{
    return distance >= 0 ? SOUTH_EAST : NORTH_WEST;
}

static bool cell_hit(const struct ray *ray, int64_t i, int64_t j, const struct at *a, const struct at *b,
                     struct truth_sphere_hit *hit)
{
    const struct truth_sphere *s = ray->s;
    int exponent = exponent_at(s, s->finest, j);
    struct cell cell = {.size = {ldexp(1, s->finest + exponent), ldexp(1, s->finest)}};
    if (s->finest == 0 && !s->samples) {
        const struct page *page = page_at(s, ray->tiles, i / PAGE, j / PAGE);
        for (int north = 0; north < 2; north++)
            for (int east = 0; east < 2; east++)
                cell.corner[north][east] = page->samples[j % PAGE + REACH + north][i % PAGE + REACH + east];
    } else if (s->finest == 0) {
        const int32_t *south = s->samples + j * s->columns, *north = south + s->columns;
        int64_t east = i + 1 == s->columns ? 0 : i + 1;
        cell.corner[0][0] = south[i], cell.corner[0][1] = south[east];
        cell.corner[1][0] = north[i], cell.corner[1][1] = north[east];
    } else {
        int64_t y = j - (s->pole << -s->finest);
        const struct tile *tile = tile_at(s, ray->tiles, s->finest, exponent, i >> 3, y >> 3);
        const bool wider[2] = {exponent_of(s, s->finest, y) > exponent,
                               exponent_of(s, s->finest, y + 1) > exponent};
        detail_corners(i, wider, &tile->samples[(y & 7) + BEFORE][(i & 7) + BEFORE - 1], SIDE, cell.corner);
    }
    cell.west = (double)i * cell.size[0];
    cell.south = (double)j * cell.size[1];
    // The sine of an angle up to a quarter turn is at least 2 / pi of it.
    double from_pole = fmin(cell.south, 2 * (double)s->pole - cell.south - cell.size[1]);
    cell.axis_m =
        2 / M_PI * from_pole * s->spacing_rad[1] * (s->radius_m + s->offset_m + s->low * s->quantum_m);
    if (from_pole <= 0 || exponent > 0) return part_hit(ray, &cell, BILINEAR, a, b, hit);
    struct narrowing diagonal = {ray, &cell, DIAGONAL};
    double fa = value_at(&diagonal, a), fb = value_at(&diagonal, b);
    struct at beyond;
    if ((fa > 0 && fb < 0) || (fa < 0 && fb > 0)) {
        struct at m = narrow(&diagonal, *a, *b, fa, fb);
        return part_hit(ray, &cell, part_at(fa), a, &m, hit) || part_hit(ray, &cell, part_at(fb), &m, b, hit);
    }
    int part = part_at(fa + fb); // one of them may be 0
    if (strays(&diagonal, a, b, fa, fb, &beyond)) {
        double f = value_at(&diagonal, &beyond);
        struct at out = narrow(&diagonal, *a, beyond, fa, f), back = narrow(&diagonal, beyond, *b, f, fb);
        return part_hit(ray, &cell, part, a, &out, hit) ||
               part_hit(ray, &cell, part_at(f), &out, &back, hit) ||
               part_hit(ray, &cell, part, &back, b, hit);
    }
    return part_hit(ray, &cell, part, a, b, hit);
}

// ---- the quadtree ----------------------------------------------------------

// At least the highest height of the finest surface over node (i, j) of height k, in nodes.  Pages know of
// nodes of single columns alone.
static double highest(const struct ray *ray, int k, int64_t i, int64_t j)
{
    const struct truth_sphere *s = ray->s;
    if (k >= 0 && s->high[k]) return (double)s->high[k][j * s->width[k] + i];
    int exponent = exponent_at(s, k, j);
    if (k >= 0 && exponent == 0) {
        int above = PAGE_HEIGHT - k, side = 1 << above;
        struct page *page = page_at(s, ray->tiles, i >> above, j >> above);
        float high = page_nodes(page, k)[j % side * side + i % side];
        if (k > 0 || high < HUGE_VALF) return (double)high;
    }
    if (k > 0) return HUGE_VAL;
    return highest_over(s, ray->tiles, k, exponent, i, j - (s->pole << -k));
}

static bool visit(const struct ray *ray, int k, int64_t i, int64_t j, const struct at *a, const struct at *b,
                  struct truth_sphere_hit *hit);

// Whether a line lies between two places.
static bool is_between(double line, double from, double to)
{
    return (from < line && to > line) || (from > line && to < line);
}

// Goes on in those nodes of height k in row j that are halves of column i above, or as wide.
static bool visit_row(const struct ray *ray, int k, int64_t i, int64_t j, bool halves, const struct at *a,
                      const struct at *b, struct truth_sphere_hit *hit)
{
    const struct truth_sphere *s = ray->s;
    if (!halves) return visit(ray, k, i, j, a, b, hit);
    double middle = ldexp((double)(2 * i + 1), k + exponent_at(s, k, j));
    struct at stops[3] = {*a, *b, *b};
    int count = 1;
    if (is_between(middle, a->place[0], b->place[0])) {
        stops[1] = crossing(ray, 0, middle, a, b);
        count = 2;
    }
    int64_t last = nodes_in(s, k, j) - 1; // along the far border: in the last one
    for (int part = 0; part < count; part++) {
        const struct at *from = &stops[part], *to = &stops[part + 1];
        int64_t x = 2 * i + (0.5 * (from->place[0] + to->place[0]) >= middle);
        if (visit(ray, k, x < last ? x : last, j, from, to, hit)) return true;
    }
    return false;
}

static bool visit(const struct ray *ray, int k, int64_t i, int64_t j, const struct at *a, const struct at *b,
                  struct truth_sphere_hit *hit)
{
    const struct truth_sphere *s = ray->s;
    double lowest = fmin(a->height_q, b->height_q);
    if (ray->nearest > a->t && ray->nearest < b->t) lowest = at_time(ray, ray->nearest, a->place[0]).height_q;
    if (lowest > highest(ray, k, i, j)) return false;
    if (k == s->finest) return cell_hit(ray, i, j, a, b, hit);
    double middle = ldexp((double)(2 * j + 1), k - 1);
    struct at stops[3] = {*a, *b, *b};
    int count = 1, exponent = exponent_at(s, k, j);
    if (is_between(middle, a->place[1], b->place[1])) {
        stops[1] = crossing(ray, 1, middle, a, b);
        count = 2;
    }
    int64_t last = k > 0 ? s->height[k - 1] - 1 : (2 * s->pole << (1 - k)) - 1;
    for (int part = 0; part < count; part++) {
        const struct at *from = &stops[part], *to = &stops[part + 1];
        int64_t y = 2 * j + (0.5 * (from->place[1] + to->place[1]) >= middle);
        y = y < last ? y : last;
        bool halves = exponent_at(s, k - 1, y) == exponent;
        if (visit_row(ray, k - 1, i, y, halves, from, to, hit)) return true;
    }
    return false;
}

// Between two times at which nothing turns: from the root.
static bool visit_piece(const struct ray *ray, double t0, double t1, struct truth_sphere_hit *hit)
{
    const struct truth_sphere *s = ray->s;
    double columns = (double)s->columns, middle = at_time(ray, 0.5 * (t0 + t1), 0.5 * columns).place[0];
    struct at a = at_time(ray, t0, middle), b = at_time(ray, t1, middle);
    a.place[0] = clamp(a.place[0], 0, columns);
    b.place[0] = clamp(b.place[0], 0, columns);
    return visit(ray, s->heights - 1, 0, 0, &a, &b, hit);
}

// ---- the contract ----------------------------------------------------------

// Cuts t0..t1 to where the ray is below the highest and above the lowest ground.
static bool enter_shell(const struct ray *ray, double *t0, double *t1)
{
    const struct truth_sphere *s = ray->s;
    double top = s->radius_m + s->offset_m + (s->highest + 1) * s->quantum_m;
    double core = s->radius_m + s->offset_m + (s->low - 1) * s->quantum_m;
    double a = dot(ray->direction, ray->direction), b = dot(ray->origin, ray->direction);
    double distance = sqrt(dot(ray->origin, ray->origin)),
           least = sqrt(fmax(distance * distance - b * b / a, 0));
    if (!(a > 0) || least > top) return false;
    double half = sqrt((top - least) * (top + least) / a), t_near = -b / a;
    *t0 = fmax(*t0, t_near - half);
    *t1 = t_near + half;
    double deep = least < core ? t_near - sqrt((core - least) * (core + least) / a) : *t1;
    if (deep >= *t0) *t1 = fmin(*t1, deep);
    return *t0 < *t1;
}

// Whether the ray begins below the surface.
static bool begins_below(const struct ray *ray, double t0)
{
    const struct truth_sphere *s = ray->s;
    struct at at = at_time(ray, t0, 0.5 * (double)s->columns);
    if (at.height_q > s->highest) return false; // and need not be read there
    double q, x = (at.place[0] + (double)s->first) * s->spacing_rad[0] * s->radius_m;
    double y = (at.place[1] - (double)s->pole) * s->spacing_rad[1] * s->radius_m;
    return terrain_truth_at(s->terrain, x, y, &q, NULL) && at.height_q < q;
}

bool truth_sphere_cast(const struct truth_sphere *s, struct truth_tiles *tiles, const double origin_m[3],
                       const double direction[3], double t0, struct truth_sphere_hit *hit)
{
    struct ray ray = {.s = s, .tiles = tiles};
    memcpy(ray.origin, origin_m, sizeof ray.origin);
    memcpy(ray.direction, direction, sizeof ray.direction);
    const double *e = ray.origin, *d = ray.direction;
    double t1 = HUGE_VAL, ee = dot(e, e), ed = dot(e, d), dd = dot(d, d), cuts[4];
    ray.nearest = -ed / dd;
    if (!enter_shell(&ray, &t0, &t1) || begins_below(&ray, t0)) return false;
    double turn = (d[2] * ee - e[2] * ed) / (e[2] * dd - d[2] * ed); // of the latitude
    double seam = meridian_time(&ray, 0);
    int count = 0;
    cuts[count++] = t0;
    if (turn > t0 && turn < t1) cuts[count++] = turn;
    if (seam > t0 && seam < t1) cuts[count++] = seam;
    if (count == 3 && seam < turn) cuts[1] = seam, cuts[2] = turn;
    cuts[count] = t1;
    for (int k = 0; k < count; k++)
        if (visit_piece(&ray, cuts[k], cuts[k + 1], hit)) return true;
    return false;
}
