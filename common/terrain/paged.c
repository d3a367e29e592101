// SPDX-License-Identifier: MIT
#include "common/terrain/paged.h"

#include "common/parallel.h"
#include "common/report.h"
#include "common/terrain/detail.h"
#include "common/terrain/extrema.h"
#include "common/terrain/paged_parts.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    TILE = LAYOUT_SAMPLES,
    WINDOWS = 32,          // that rms errors and noise are estimated from
    FEW_TILES = 8,         // so many along an axis are looked at one by one
    MOST_ERROR_TILES = 64, // along an axis: beyond, the level's largest error serves
    MOST_REFINE_BITS = 8,  // terrain.h
    REFINED_LIMIT = 1 << 21,
};
#define NOISE_REACH 8.3  // |deviate| is smaller (synthesis.h)
#define OVERSHOOT 0.2813 // of U, as a share of the range, on either side (numerics.md, B11)

struct bounds {
    int64_t low, high;
};

static struct bounds both(struct bounds a, struct bounds b)
{
    return (struct bounds){smaller(a.low, b.low), larger(a.high, b.high)};
}

// Also one step on along a line between two of these: 2 a - b.
static struct bounds continued(struct bounds b)
{
    int64_t span = b.high - b.low;
    return (struct bounds){b.low - span, b.high + span};
}

// ---- bounds of tiles -------------------------------------------------------

static bool has_tiles(const struct paged *p, int level)
{
    return level >= 0 && level < p->grid->count - 1;
}

static struct bounds stored_tile(const struct paged *p, int level, int64_t tx, int64_t ty)
{
    int32_t low, high;
    relief_bounds(p->relief, p->grid->first_tile[level] + ty * p->grid->tiles[level][0] + tx, &low, &high);
    return (struct bounds){paged_limit((int64_t)low * (1 << p->bits)),
                           paged_limit((int64_t)high * (1 << p->bits))};
}

// Of tile (tx, ty), in quanta, up to sample `to`, which may lie beyond the last stored column and row.  Those
// beyond go on along the line through the last two, which the tile before the last may have: 2 a - b along x,
// then along y of what that gave.
static struct bounds tile_bounds(const struct paged *p, int level, int64_t tx, int64_t ty,
                                 const int64_t to[2])
{
    const int64_t *stored = paged_map(p, level)->stored, *tiles = p->grid->tiles[level];
    bool beyond[2] = {to[0] >= stored[0] && tx + 1 == tiles[0], to[1] >= stored[1] && ty + 1 == tiles[1]};
    struct bounds bounds = {INT32_MAX, INT32_MIN};
    for (int64_t y = larger(ty - beyond[1], 0); y <= ty; y++)
        for (int64_t x = larger(tx - beyond[0], 0); x <= tx; x++)
            bounds = both(bounds, stored_tile(p, level, x, y));
    for (int axis = 0; axis < 2; axis++)
        if (beyond[axis]) bounds = continued(bounds);
    return bounds;
}

static struct bounds tiles_bounds(const struct paged *p, int level, int64_t x0, int64_t y0, int64_t x1,
                                  int64_t y1, const int64_t to[2])
{
    struct bounds bounds = {INT32_MAX, INT32_MIN};
    x1 = smaller(x1, p->grid->tiles[level][0] - 1);
    y1 = smaller(y1, p->grid->tiles[level][1] - 1);
    for (int64_t y = smaller(y0, y1); y <= y1; y++)
        for (int64_t x = smaller(x0, x1); x <= x1; x++)
            bounds = both(bounds, tile_bounds(p, level, x, y, to));
    return bounds;
}

struct leaf {
    const struct paged *paged;
    int level;
};

static void node_leaf(const void *user, int64_t i, int64_t j, int32_t *min_q, int32_t *max_q)
{
    const struct leaf *leaf = user;
    const int64_t *size = paged_map(leaf->paged, leaf->level)->size, end[2] = {size[0] - 1, size[1] - 1};
    struct bounds b = tiles_bounds(leaf->paged, leaf->level, 2 * i, 2 * j, 2 * i + 1, 2 * j + 1, end);
    *min_q = paged_limit(b.low);
    *max_q = paged_limit(b.high);
}

// Bounds of a level that is in memory whole: the file's coarsest.
static struct bounds base_bounds(const struct paged *p, int level)
{
    int32_t samples[(LAYOUT_BASE + 1) * (LAYOUT_BASE + 1)];
    const int64_t *size = paged_map(p, level)->size;
    struct bounds bounds = {INT32_MAX, INT32_MIN};
    paged_window((struct paged *)p, level, 0, 0, (int)size[0], (int)size[1], samples, TERRAIN_WAIT);
    for (int64_t i = 0; i < size[0] * size[1]; i++)
        bounds = both(bounds, (struct bounds){samples[i], samples[i]});
    return bounds;
}

static struct bounds stored_bounds(const struct paged *p, int level, const int64_t from[2],
                                   const int64_t to[2])
{
    const struct paged_map *map = paged_map(p, level);
    if (!has_tiles(p, level)) return (struct bounds){map->min_q, map->max_q};
    int64_t last[2] = {larger(to[0] - 1, from[0]) / TILE, larger(to[1] - 1, from[1]) / TILE};
    if (last[0] - from[0] / TILE < FEW_TILES && last[1] - from[1] / TILE < FEW_TILES)
        return tiles_bounds(p, level, from[0] / TILE, from[1] / TILE, last[0], last[1], to);
    int32_t low, high;
    extrema_bounds(&map->extrema, NULL, 0, from, to, &low, &high);
    return (struct bounds){low, high};
}

// Of a synthesised level: what U and the noise make of the coarser one.
static struct bounds synthesised_bounds(const struct paged *p, int level, const int64_t from[2],
                                        const int64_t to[2])
{
    if (level >= 0) return stored_bounds(p, level, from, to);
    const int64_t *size = paged_map(p, level + 1)->size;
    int64_t coarse_from[2], coarse_to[2];
    bool edge = false;
    for (int k = 0; k < 2; k++) {
        coarse_from[k] = (from[k] >> 1) - 1, coarse_to[k] = (to[k] >> 1) + 2;
        edge = edge || coarse_from[k] < 0 || coarse_to[k] >= size[k];
        coarse_from[k] = clamp(coarse_from[k] - 1, 0, size[k] - 1); // one more: lines are continued from two
        coarse_to[k] = clamp(coarse_to[k], 0, size[k] - 1);
        coarse_from[k] = smaller(coarse_from[k], larger(coarse_to[k] - 2, 0));
    }
    struct bounds b = synthesised_bounds(p, level + 1, coarse_from, coarse_to);
    if (edge) b = continued(continued(b)); // two samples on along x, then along y
    if (edge) b = continued(continued(b));
    double reach = OVERSHOOT * (double)(b.high - b.low) + NOISE_REACH * paged_map(p, level)->sigma_q + 2;
    return (struct bounds){paged_limit(b.low - (int64_t)reach), paged_limit(b.high + (int64_t)reach)};
}

void paged_bounds(const struct paged *p, int level, int64_t x0, int64_t y0, int64_t x1, int64_t y1,
                  int32_t *min_q, int32_t *max_q)
{
    const int64_t *size = paged_map(p, level)->size;
    const int64_t from[2] = {clamp(x0, 0, size[0] - 1), clamp(y0, 0, size[1] - 1)};
    const int64_t to[2] = {clamp(x1, 0, size[0] - 1), clamp(y1, 0, size[1] - 1)};
    struct bounds b = synthesised_bounds(p, level, from, to);
    *min_q = paged_limit(b.low);
    *max_q = paged_limit(b.high);
}

int32_t paged_node_max(const struct paged *p, int height, int64_t i, int64_t j)
{
    const struct terrain_extrema *extrema = &paged_map(p, 0)->extrema;
    if (p->finest == 0 && height < extrema->heights && height >= PAGED_NODE_HEIGHT)
        return extrema->nodes[height].max_q[j * extrema->nodes[height].width + i];
    int32_t low, high;
    paged_bounds(p, p->finest, i << height, j << height, (i + 1) << height, (j + 1) << height, &low, &high);
    return high;
}

// What synthesised levels differ from the coarser ones is not known in advance; and under a small ceiling
// pages of several levels chase each other out.
int paged_coarsest_page(const struct paged *p)
{
    return p->finest < 0 || !p->keeps_parents ? p->finest : (int)clamp(p->grid->count - 2, 0, p->coarsest);
}

double paged_error(const struct paged *p, int level, int64_t x0, int64_t y0, int64_t x1, int64_t y1)
{
    const struct paged_map *map = paged_map(p, level);
    double quantum_m = p->header->quantum_m;
    int64_t from[2] = {clamp(x0, 0, map->size[0] - 1) / TILE, clamp(y0, 0, map->size[1] - 1) / TILE};
    int64_t to[2] = {clamp(x1 - 1, 0, map->size[0] - 1) / TILE, clamp(y1 - 1, 0, map->size[1] - 1) / TILE};
    if (!has_tiles(p, level) || p->finest < 0 || to[0] - from[0] > MOST_ERROR_TILES ||
        to[1] - from[1] > MOST_ERROR_TILES)
        return ldexp(map->max_error_q * quantum_m, -p->bits);
    const int64_t *tiles = p->grid->tiles[level];
    uint32_t most = 0;
    for (int64_t y = from[1]; y <= smaller(larger(to[1], from[1]), tiles[1] - 1); y++)
        for (int64_t x = from[0]; x <= smaller(larger(to[0], from[0]), tiles[0] - 1); x++) {
            uint32_t error_q = relief_tile_error(p->relief, p->grid->first_tile[level] + y * tiles[0] + x);
            most = error_q > most ? error_q : most;
        }
    return most * quantum_m;
}

// ---- what levels differ from the finest ------------------------------------

// Height of a level's surface, in quanta times 2^shift, over the point of the finer lattice that is (u, v)
// from the cell's south-west corner; all integers.
static int64_t surface(const int32_t *sw, int64_t stride, int shift, int64_t u, int64_t v)
{
    int64_t cell = (int64_t)1 << shift, a = sw[0], east = sw[1], north = sw[stride], far = sw[stride + 1];
    return a * cell + (u < v ? v * (north - a) + u * (far - north) : u * (east - a) + v * (far - east));
}

struct difference {
    double squares, most, count;
};

// Adds what `level` differs from `fine` over a window of the latter.
static bool compare(struct paged *p, int level, int fine, const struct rect *window, const int32_t *truth,
                    struct difference *sum)
{
    int shift = level - fine;
    int64_t cell = (int64_t)1 << shift, x0 = window->x0 >> shift, y0 = window->y0 >> shift;
    int columns = (int)(((window->x1 - 1) >> shift) - x0 + 2),
        rows = (int)(((window->y1 - 1) >> shift) - y0 + 2);
    int32_t *samples = malloc((size_t)columns * (size_t)rows * sizeof *samples);
    if (!samples) return false;
    paged_window(p, level, x0, y0, columns, rows, samples, TERRAIN_WAIT);
    for (int64_t y = window->y0; y < window->y1; y++)
        for (int64_t x = window->x0; x < window->x1; x++, truth++) {
            const int32_t *sw = samples + ((y >> shift) - y0) * columns + ((x >> shift) - x0);
            int64_t height = surface(sw, columns, shift, x & (cell - 1), y & (cell - 1));
            double d = ldexp((double)(height - *truth * cell), -shift);
            sum->squares += d * d;
            sum->most = fmax(sum->most, fabs(d));
            sum->count++;
        }
    free(samples);
    return true;
}

// Window number k: a block of the level; all of them where there are few, else chosen by a hash.
static int64_t window_count(const struct paged *p, int level)
{
    const int64_t *stored = paged_map(p, level)->stored;
    return ((stored[0] + PAGED_BLOCK - 1) / PAGED_BLOCK) * ((stored[1] + PAGED_BLOCK - 1) / PAGED_BLOCK);
}

static struct rect window_number(const struct paged *p, int level, int k)
{
    const int64_t *stored = paged_map(p, level)->stored;
    int64_t across = (stored[0] + PAGED_BLOCK - 1) / PAGED_BLOCK, count = window_count(p, level);
    int64_t number =
        count <= WINDOWS ? k : (int64_t)((double)count * (k + 0.5) / WINDOWS); // evenly spread ...
    if (count > WINDOWS)                                                       // ... then moved along its row
        number = number / across * across +
                 (int64_t)(((uint64_t)number * 0x9e3779b97f4a7c15u >> 33) % (uint64_t)across);
    int64_t x = number % across * PAGED_BLOCK, y = number / across * PAGED_BLOCK;
    return (struct rect){x, y, smaller(x + PAGED_BLOCK, stored[0]), smaller(y + PAGED_BLOCK, stored[1])};
}

struct estimate {
    struct paged *paged;
    struct window_estimate {
        bool good;
        struct difference levels[PYRAMID_MAX_FINER + LAYOUT_LEVELS]; // from the finest
    } windows[WINDOWS];
};

static void compare_window(int k, void *user)
{
    struct estimate *estimate = user;
    struct paged *p = estimate->paged;
    struct window_estimate *window = &estimate->windows[k];
    struct rect w = window_number(p, p->finest, k);
    int32_t truth[PAGED_BLOCK * PAGED_BLOCK];
    paged_window(p, p->finest, w.x0, w.y0, (int)rect_width(&w), (int)rect_height(&w), truth, TERRAIN_WAIT);
    window->good = true;
    for (int l = p->finest + 1; l <= p->coarsest && window->good; l++)
        window->good = compare(p, l, p->finest, &w, truth, &window->levels[l - p->finest]);
}

// rms_error_q of all levels, and what the finest differs from level 0 at most, from windows of the finest.
static bool estimate_errors(struct paged *p, double *most_of_zero_q)
{
    struct estimate *estimate = calloc(1, sizeof *estimate);
    int windows = (int)smaller(window_count(p, p->finest), WINDOWS);
    bool good = true;
    if (!estimate) return false;
    estimate->paged = p;
    parallel_blocks(windows, 0, compare_window, estimate);
    *most_of_zero_q = 0;
    for (int l = p->finest + 1; l <= p->coarsest; l++) {
        struct difference sum = {0};
        for (int k = 0; k < windows; k++) {
            const struct difference *d = &estimate->windows[k].levels[l - p->finest];
            sum =
                (struct difference){sum.squares + d->squares, fmax(sum.most, d->most), sum.count + d->count};
        }
        paged_map(p, l)->rms_error_q = sum.count > 0 ? sqrt(sum.squares / sum.count) : 0;
        if (l <= 0) paged_map(p, l)->max_error_q = sum.most;
        if (l == 0) *most_of_zero_q = sum.most;
    }
    for (int k = 0; k < windows; k++) good = good && estimate->windows[k].good;
    free(estimate);
    return good;
}

// The coarsest level of the file has no tiles: what it differs from the one before, and that from level 0.
static bool measure_base(struct paged *p)
{
    int top = p->grid->count - 1;
    if (top == 0 || p->coarsest < top) return true;
    const int64_t *size = paged_map(p, top - 1)->size;
    const struct rect all = {0, 0, size[0], size[1]};
    int32_t samples[(2 * LAYOUT_BASE + 1) * (2 * LAYOUT_BASE + 1)];
    struct difference sum = {0};
    paged_window(p, top - 1, 0, 0, (int)size[0], (int)size[1], samples, TERRAIN_WAIT);
    if (!compare(p, top, top - 1, &all, samples, &sum)) return false;
    paged_map(p, top)->max_error_q = paged_map(p, top - 1)->max_error_q + sum.most;
    return true;
}

// Whether the file tells the rms errors: from level 0, so not where that is not the finest.
static bool knows_rms(const struct paged *p)
{
    return p->finest == 0 && p->grid->count > 1 && relief_level_rms(p->relief, 1) >= 0;
}

static bool measure_errors(struct paged *p)
{
    for (int l = 1; l <= p->coarsest && has_tiles(p, l); l++) {
        uint32_t most = 0;
        for (int64_t i = 0; i < p->grid->tiles[l][0] * p->grid->tiles[l][1]; i++) {
            uint32_t error_q = relief_tile_error(p->relief, p->grid->first_tile[l] + i);
            most = error_q > most ? error_q : most;
        }
        paged_map(p, l)->max_error_q = ldexp(most, p->bits);
    }
    if (!measure_base(p)) return false;
    if (knows_rms(p)) {
        for (int l = 1; l <= p->coarsest; l++)
            paged_map(p, l)->rms_error_q = ldexp(relief_level_rms(p->relief, l), p->bits);
        return true;
    }
    double most_of_zero_q;
    if (!estimate_errors(p, &most_of_zero_q)) return false;
    for (int l = 1; l <= p->coarsest; l++) paged_map(p, l)->max_error_q += most_of_zero_q;
    return true;
}

// ---- noise of synthesised levels -------------------------------------------

struct residual {
    struct paged *paged;
    int level;
    struct difference windows[WINDOWS];
};

// Of one window, without what stands next to the border.
static void measure_residual(int k, void *user)
{
    enum { MARGIN = 4, SIDE = PAGED_BLOCK };
    struct residual *r = user;
    int32_t fine[SIDE * SIDE], predicted[SIDE * SIDE], coarse[(SIDE / 2 + 4) * (SIDE / 2 + 4)];
    const int64_t *stored = paged_map(r->paged, r->level)->stored;
    struct rect w = window_number(r->paged, r->level, k), under;
    w = (struct rect){larger(w.x0, MARGIN), larger(w.y0, MARGIN), smaller(w.x1, stored[0] - MARGIN),
                      smaller(w.y1, stored[1] - MARGIN)};
    int width = (int)rect_width(&w), height = (int)rect_height(&w);
    if (width < 1 || height < 1) return;
    under.x0 = (w.x0 >> 1) - 1, under.x1 = under.x0 + upsample_coarse_size(w.x0, width);
    under.y0 = (w.y0 >> 1) - 1, under.y1 = under.y0 + upsample_coarse_size(w.y0, height);
    paged_rect_and_parents(r->paged, r->level, &(struct patch){w, fine}, &(struct patch){under, coarse});
    upsample(coarse, w.x0, w.y0, width, height, predicted);
    for (int i = 0; i < width * height; i++) {
        double d = fine[i] - predicted[i];
        r->windows[k].squares += d * d;
    }
    r->windows[k].count = (double)width * height;
}

// Root mean square of a level's residuals against U of the coarser one.
static double residual_rms(struct paged *p, int level)
{
    struct residual residual = {.paged = p, .level = level};
    int windows = (int)smaller(window_count(p, level), WINDOWS);
    double squares = 0, count = 0;
    parallel_blocks(windows, 0, measure_residual, &residual);
    for (int k = 0; k < windows; k++) {
        squares += residual.windows[k].squares;
        count += residual.windows[k].count;
    }
    return count > 0 ? sqrt(squares / count) : 0;
}

double paged_noise_q(const struct paged *p, int level)
{
    return exp2(p->noise_log2 + p->noise_slope * level);
}

static void choose_sigmas(struct paged *p)
{
    double rms_q[PYRAMID_FIT_LEVELS];
    int count = 0;
    for (int l = 0; l < p->coarsest && count < PYRAMID_FIT_LEVELS; l++) {
        const int64_t *stored = paged_map(p, l)->stored;
        if (stored[0] < PYRAMID_FIT_SIZE || stored[1] < PYRAMID_FIT_SIZE) break;
        double rms = residual_rms(p, l);
        if (rms == 0) break;
        rms_q[count++] = rms;
    }
    pyramid_fit_noise(rms_q, count, &p->noise_log2, &p->noise_slope);
    for (int l = -1; l >= p->finest; l--) paged_map(p, l)->sigma_q = paged_noise_q(p, l);
}

// ---- opening ---------------------------------------------------------------

static int refine_bits(const struct terrain_options *options, const struct relief_header *header)
{
    int64_t magnitude = larger(llabs((int64_t)header->min_q), llabs((int64_t)header->max_q));
    int wanted = options->refine_bits > 0         ? options->refine_bits
                 : options->synthesize_levels > 0 ? MOST_REFINE_BITS
                                                  : 0;
    int bits = 0;
    while (bits < wanted && magnitude << (bits + 1) <= REFINED_LIMIT) bits++;
    return bits;
}

static void size_levels(struct paged *p)
{
    int64_t cells[2] = {p->grid->size[0][0] - 1, p->grid->size[0][1] - 1};
    p->finest = -p->options.synthesize_levels;
    p->coarsest = p->grid->count - 1;
    for (int l = 0; l <= p->coarsest; l++)
        for (int k = 0; k < 2; k++) {
            paged_map(p, l)->stored[k] = p->grid->size[l][k];
            paged_map(p, l)->size[k] = cells[k] + 1;
            cells[k] = (cells[k] + 1) / 2;
        }
    for (int l = -1; l >= p->finest; l--)
        for (int k = 0; k < 2; k++)
            paged_map(p, l)->stored[k] = paged_map(p, l)->size[k] = 2 * paged_map(p, l + 1)->size[k] - 1;
    for (const int64_t *size; p->coarsest > 0 && p->options.min_size > 0; p->coarsest--) {
        size = paged_map(p, p->coarsest - 1)->size;
        if (size[0] > p->options.min_size || size[1] > p->options.min_size) break;
    }
}

static bool bound_levels(struct paged *p)
{
    for (int l = 0; l < p->grid->count; l++) {
        struct paged_map *map = paged_map(p, l);
        const int64_t cells[2] = {larger(map->size[0] - 1, 1), larger(map->size[1] - 1, 1)};
        struct bounds bounds;
        if (has_tiles(p, l)) {
            if (!extrema_init_from(&map->extrema, cells, PAGED_NODE_HEIGHT, node_leaf, &(struct leaf){p, l}))
                return false;
            const struct terrain_extrema_nodes *root = &map->extrema.nodes[map->extrema.heights - 1];
            bounds = (struct bounds){root->min_q[0], root->max_q[0]};
        } else
            bounds = base_bounds(p, l);
        map->min_q = paged_limit(bounds.low);
        map->max_q = paged_limit(bounds.high);
    }
    return true;
}

static void bound_synthesised(struct paged *p)
{
    for (int l = -1; l >= p->finest; l--) {
        struct paged_map *map = paged_map(p, l);
        paged_bounds(p, l, 0, 0, map->size[0] - 1, map->size[1] - 1, &map->min_q, &map->max_q);
    }
}

static bool prepare(struct paged *p, const char *path)
{
    p->header = relief_header(p->relief);
    p->grid = relief_grid(p->relief);
    bool planet = p->header->radius_m > 0;
    int finer = p->options.synthesize_levels, most = planet ? DETAIL_MAX_FINER : PYRAMID_MAX_FINER;
    if (finer < 0 || finer > most)
        return fail("%s: synthesize_levels is %d; 0 to %d is accepted", path, finer, most);
    p->bits = refine_bits(&p->options, p->header);
    if (planet) p->planet = relief_planet(p->header);
    if (planet) p->options.synthesize_levels = 0; // detail.h makes them
    size_levels(p);
    if (planet) p->coarsest = p->planet.coarsest;
    synthesis_fill_table(&p->table, p->options.seed);
    if (!paged_read_init(p) || !bound_levels(p)) return fail("%s: its index does not fit in memory", path);
    if (finer > 0) choose_sigmas(p); // from blocks all over the map, which take seconds to decode
    bound_synthesised(p);
    if (!measure_errors(p)) return fail("%s: does not fit in memory", path);
    return !paged_failed(p); // told where it was found
}

struct paged *paged_open(const char *path, const struct terrain_options *options)
{
    struct paged *p = calloc(1, sizeof *p);
    if (!p) {
        fail("%s: out of memory", path);
        return NULL;
    }
    p->options = *options;
    p->relief = relief_open(path);
    if (p->relief && prepare(p, path)) return p;
    paged_close(p);
    return NULL;
}

void paged_close(struct paged *p)
{
    if (!p) return;
    paged_read_finish(p);
    for (int l = 0; p->grid && l < p->grid->count; l++) extrema_finish(&paged_map(p, l)->extrema);
    relief_close(p->relief);
    free(p);
}

// ---- describing ------------------------------------------------------------

void paged_info(const struct paged *p, struct terrain_info *info)
{
    const struct relief_header *h = p->header;
    const struct paged_map *finest = paged_map(p, p->finest);
    *info = (struct terrain_info){.datum = TERRAIN_PLANE,
                                  .radius_m = h->radius_m,
                                  .spacing_m = {h->spacing_m[0], h->spacing_m[1]},
                                  .quantum_m = ldexp(h->quantum_m, -p->bits),
                                  .offset_m = h->offset_m,
                                  .finest = p->finest,
                                  .coarsest = p->coarsest,
                                  .outline_m = {0, 0, (double)(h->size[0] - 1) * h->spacing_m[0],
                                                (double)(h->size[1] - 1) * h->spacing_m[1]},
                                  .min_q = finest->min_q,
                                  .max_q = finest->max_q,
                                  .voids_filled = h->voids_filled,
                                  .samples = (uint64_t)finest->size[0] * (uint64_t)finest->size[1]};
    snprintf(info->packed.codec, sizeof info->packed.codec, "%s", LAYOUT_NAMES[h->layout]);
    double columns = (double)(h->size[0] - 2 * (int64_t)h->margin),
           rows = (double)(h->size[1] - 2 * (int64_t)h->margin);
    info->packed.bits_per_sample = 8 * (double)relief_sample_bytes(p->relief) / (columns * rows);
    info->packed.rms_m = h->rms_m;
    info->packed.max_m = h->max_m;
}

struct terrain_level paged_level(const struct paged *p, int level)
{
    const struct paged_map *map = paged_map(p, level);
    double quantum_m = ldexp(p->header->quantum_m, -p->bits);
    bool windows = level > p->finest && window_count(p, p->finest) > WINDOWS;
    return (struct terrain_level){
        .extent = {0, 0, map->size[0], map->size[1]},
        .spacing_m = {ldexp(p->header->spacing_m[0], level), ldexp(p->header->spacing_m[1], level)},
        .min_q = map->min_q,
        .max_q = map->max_q,
        .rms_error_m = map->rms_error_q * quantum_m,
        .max_error_m = map->max_error_q * quantum_m,
        .rms_estimated = windows && !knows_rms(p),
        .max_estimated = windows && p->finest < 0,
        .noise_q = map->sigma_q};
}

bool paged_failed(const struct paged *p)
{
    return atomic_load(&((struct paged *)p)->failed);
}

size_t paged_resident_bytes(struct paged *p)
{
    size_t bytes =
        sizeof *p + relief_resident_bytes(p->relief) + slots_bytes(&p->blocks) + slots_bytes(&p->pages);
    for (int l = 0; l < p->grid->count; l++) bytes += extrema_bytes(&paged_map(p, l)->extrema);
    return bytes;
}

int32_t paged_block_count(const struct paged *p)
{
    return p->blocks.count;
}

int paged_latency(const struct paged *p)
{
    return p->options.latency_frames > 0 ? p->options.latency_frames : 2;
}

int64_t paged_frame_samples(const struct paged *p)
{
    return p->options.frame_samples != 0 ? p->options.frame_samples : 1 << 19;
}
