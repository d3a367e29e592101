// SPDX-License-Identifier: MIT
#include "common/terrain/relief/pack_region.h"

#include "common/integer.h"
#include "common/parallel.h"

#include <stdlib.h>
#include <string.h>

enum { ROWS_A_BLOCK = 128 };

// ---- rectangles ------------------------------------------------------------

static struct rect with_edges(const struct rect *core, const int64_t size[2]) // a sample east and north
{
    const struct rect grown = {core->x0, core->y0, core->x1 + 1, core->y1 + 1};
    return rect_clipped(&grown, size);
}

// Tiles whose coefficients the samples of a rectangle hang on.
static struct rect tiles_for(const struct pack_coder *coder, int level, const struct rect *samples)
{
    if (!coder->method->smooth) return rect_blocks(samples, REGION_TILE_SHIFT);
    struct rect low = layout_wavelet_band_rect(&coder->grid, level, samples, 0);
    struct rect high = layout_wavelet_band_rect(&coder->grid, level, samples, BAND_HH);
    struct rect both = rect_hull(&low, &high);
    return rect_blocks(&both, REGION_TILE_SHIFT - 1);
}

static void plan_decoded(struct region *r)
{
    const struct grid *grid = &r->coder->grid;
    r->level[r->fine].decoded.rect = with_edges(&r->level[r->fine].core, grid->size[r->fine]);
    for (int l = r->fine; l < r->coarse; l++) {
        struct region_level *at = &r->level[l];
        at->tiles = tiles_for(r->coder, l, &at->decoded.rect);
        at->core_tiles = rect_blocks(&at->core, REGION_TILE_SHIFT);
        for (int b = BAND_HL; b < CODER_BANDS; b++) {
            const int64_t size[2] = {grid_band_size(grid, l, b, 0), grid_band_size(grid, l, b, 1)};
            const struct rect *t = &at->tiles;
            const struct rect whole = {t->x0 * CODER_TILE, t->y0 * CODER_TILE, t->x1 * CODER_TILE,
                                       t->y1 * CODER_TILE};
            at->coded[b].rect = rect_clipped(&whole, size);
        }
        struct rect coarse =
            layout_coarse_rect(grid, l, at->tiles.x0, at->tiles.y0, at->tiles.x1, at->tiles.y1);
        struct rect core = with_edges(&at[1].core, grid->size[l + 1]);
        at[1].decoded.rect = rect_hull(&coarse, &core);
    }
}

static int64_t aligned(int64_t index, int shift)
{
    return shift < 62 ? (index >> shift) * ((int64_t)1 << shift) : 0;
}

// From the coarse end: what of each level the next one, and the tiles, are made from.
static void plan_wanted(struct region *r, bool coded)
{
    const int reach = r->coder->method->reach;
    struct rect needed = r->level[r->coarse].core;
    bool any = !coded || r->fine == r->coarse;
    r->level[r->coarse].wanted.rect = needed;
    for (int l = r->coarse - 1; l >= r->fine; l--) {
        const struct rect *t = &r->level[l].tiles;
        const struct rect tiles = {t->x0 * CODER_TILE, t->y0 * CODER_TILE, t->x1 * CODER_TILE,
                                   t->y1 * CODER_TILE};
        if (coded) needed = any ? rect_hull(&needed, &tiles) : tiles;
        any = true;
        int shift = r->coarse - l; // so that all levels begin at even coordinates
        const struct rect from = {aligned(2 * needed.x0 - reach, shift),
                                  aligned(2 * needed.y0 - reach, shift), 2 * needed.x1 + reach,
                                  2 * needed.y1 + reach};
        needed = rect_clipped(&from, r->coder->grid.size[l]);
        r->level[l].wanted.rect = needed;
    }
    for (int l = r->fine; l < r->coarse; l++) { // reducing gives a little more than is needed
        for (int b = BAND_HL; b < CODER_BANDS; b++)
            r->level[l].bands[b].rect = layout_half_rect(&r->level[l].wanted.rect, b);
        r->level[l + 1].wanted.rect = layout_half_rect(&r->level[l].wanted.rect, 0);
    }
}

void region_plan(struct region *region, const struct pack_coder *coder, int fine, int coarse,
                 const struct rect *core, bool coded)
{
    memset(region, 0, sizeof *region);
    region->coder = coder;
    region->fine = fine;
    region->coarse = coarse;
    region->threads = 1;
    region->level[fine].core = *core;
    for (int l = fine; l < coarse; l++)
        region->level[l + 1].core = layout_half_rect(&region->level[l].core, 0);
    if (coded) plan_decoded(region);
    plan_wanted(region, coded);
}

// ---- room ------------------------------------------------------------------

static size_t place(struct patch *patch, int32_t **next)
{
    size_t count = (size_t)(rect_width(&patch->rect) * rect_height(&patch->rect));
    if (next) {
        patch->samples = *next;
        *next += count;
    }
    return count;
}

// Places all patches, or only counts their samples.
static size_t place_all(struct region *r, int32_t **next)
{
    size_t count = 0;
    bool smooth = r->coder->method->smooth;
    for (int l = r->fine; l <= r->coarse; l++) {
        struct region_level *at = &r->level[l];
        count += place(&at->wanted, next) + place(&at->decoded, next);
        for (int b = BAND_HL; smooth && l < r->coarse && b < CODER_BANDS; b++)
            count += place(&at->bands[b], next) + place(&at->coded[b], next);
    }
    return count;
}

size_t region_room(const struct region *region)
{
    struct region copy = *region;
    return (place_all(&copy, NULL) + 1) * sizeof(int32_t);
}

void region_place(struct region *region, void *room)
{
    int32_t *next = room;
    place_all(region, &next);
}

void region_finish(struct region *region)
{
    for (int l = 0; l < LAYOUT_LEVELS; l++) {
        struct region_level *at = &region->level[l];
        int64_t count = rect_width(&at->core_tiles) * rect_height(&at->core_tiles);
        for (int64_t i = 0; at->packed && i < count; i++) free(at->packed[i].data);
        free(at->packed);
        at->packed = NULL;
    }
}

// ---- poles -----------------------------------------------------------------

int64_t region_pole_row(const struct pack_coder *coder, int level, int end)
{
    int64_t margin = coder->poles.margin >> level;
    return end ? coder->grid.size[level][1] - 1 - margin : margin;
}

const int32_t *region_pole(const struct pack_coder *coder, int level, int64_t y)
{
    const struct pack_poles *poles = &coder->poles;
    for (int end = 0; poles->planet && level < poles->known && end < 2; end++)
        if (y == region_pole_row(coder, level, end)) return &poles->q[level][end];
    return NULL;
}

void region_flatten_poles(const struct pack_coder *coder, int level, int bits, const struct patch *patch)
{
    for (int end = 0; coder->poles.planet && end < 2; end++) {
        int64_t y = region_pole_row(coder, level, end);
        const int32_t *pole = region_pole(coder, level, y);
        if (!pole || y < patch->rect.y0 || y >= patch->rect.y1) continue;
        for (int64_t x = patch->rect.x0; x < patch->rect.x1; x++)
            *patch_at(patch, x, y) = *pole * (1 << bits);
    }
}

// ---- from fine to coarse ---------------------------------------------------

bool region_reduce(struct region *r)
{
    for (int l = r->fine; l < r->coarse; l++) {
        struct region_level *at = &r->level[l];
        at->bands[0] = at[1].wanted;
        if (!r->coder->method->reduce(&at->wanted, at->bands)) return false;
        // A level that tells the finer one without loss stays what it is; readers level its poles.
        if (!r->coder->method->smooth)
            region_flatten_poles(r->coder, l + 1, r->coder->fraction_bits, &at[1].wanted);
    }
    return true;
}

static int32_t rounded_quotient(int32_t value, int32_t step)
{
    return value >= 0 ? (value + step / 2) / step : -((step / 2 - value) / step);
}

void region_code_base(struct region *r)
{
    const struct region_level *base = &r->level[r->coarse];
    int32_t step = r->coder->step[r->coarse][0];
    int64_t count = rect_width(&base->decoded.rect) * rect_height(&base->decoded.rect);
    for (int64_t i = 0; i < count; i++)
        base->decoded.samples[i] = rounded_quotient(base->wanted.samples[i], step) * step;
}

// ---- from coarse to fine ---------------------------------------------------

struct coding {
    struct region *region;
    int level;
    bool write;
};

struct packed_tile *region_own_tile(const struct region_level *at, int64_t tx, int64_t ty)
{
    const struct rect *t = &at->core_tiles;
    bool own = tx >= t->x0 && tx < t->x1 && ty >= t->y0 && ty < t->y1;
    return own ? &at->packed[(ty - t->y0) * rect_width(t) + tx - t->x0] : NULL;
}

static bool keep_tile(const struct region *r, const struct layout_tile *tile, const coder_band *k,
                      struct packed_tile *to)
{
    uint8_t data[CODER_MAX_BYTES];
    free(to->data);
    to->bytes = (uint32_t)r->coder->method->encode(tile, k, data, r->coder->counts);
    to->data = malloc(to->bytes + 1);
    if (to->data) memcpy(to->data, data, to->bytes);
    return to->data != NULL;
}

// What of a tile's coefficients lies in the patch, times the step.
static void keep_details(const struct coder_tile *tile, const coder_band *k, const int32_t *step, int64_t tx,
                         int64_t ty, struct patch *coded)
{
    for (int b = BAND_HL; b < CODER_BANDS; b++)
        for (int y = 0; y < tile->height[b]; y++) {
            int32_t *to = patch_at(&coded[b], tx * CODER_TILE, ty * CODER_TILE + y);
            const int32_t *from = k[b] + y * CODER_TILE;
            for (int x = 0; x < tile->width[b]; x++) to[x] = from[x] * step[b];
        }
}

static void keep_samples(const int32_t *samples, int64_t tx, int64_t ty, const struct patch *to)
{
    enum { S = LAYOUT_SAMPLES };
    int64_t x0 = larger(tx * S, to->rect.x0), x1 = smaller(tx * S + S, to->rect.x1);
    if (x1 <= x0) return;
    for (int64_t y = larger(ty * S, to->rect.y0); y < smaller(ty * S + S, to->rect.y1); y++)
        memcpy(patch_at(to, x0, y), samples + (y - ty * S) * S + x0 - tx * S,
               (size_t)(x1 - x0) * sizeof *samples);
}

static void code_tile_row(int block, void *user)
{
    const struct coding *c = user;
    struct region *r = c->region;
    struct region_level *at = &r->level[c->level];
    const int32_t *step = r->coder->step[c->level];
    struct layout_tile tile;
    coder_band k[CODER_BANDS];
    int32_t samples[LAYOUT_SAMPLES * LAYOUT_SAMPLES];
    struct pack_tile job = {.grid = &r->coder->grid,
                            .level = c->level,
                            .ty = at->tiles.y0 + block,
                            .step = step,
                            .lambda_65536 = r->coder->lambda_65536,
                            .uneven = r->coder->uneven,
                            .wanted = &at->wanted,
                            .bands = at->bands,
                            .coarse = &at[1].decoded};
    for (job.tx = at->tiles.x0; job.tx < at->tiles.x1; job.tx++) {
        memset(k, 0, sizeof k);
        r->coder->method->code(&job, &tile, k, samples);
        if (r->coder->method->smooth)
            keep_details(&tile.coder, (const coder_band *)k, step, job.tx, job.ty, at->coded);
        else
            keep_samples(samples, job.tx, job.ty, &at->decoded);
        struct packed_tile *own = c->write ? region_own_tile(at, job.tx, job.ty) : NULL;
        if (own && !keep_tile(r, &tile, (const coder_band *)k, own)) r->failed = true;
    }
}

static void inverse_rows(int block, void *user)
{
    const struct coding *c = user;
    struct region_level *at = &c->region->level[c->level];
    const struct rect *all = &at->decoded.rect;
    int64_t y = all->y0 + (int64_t)block * ROWS_A_BLOCK;
    struct patch wanted = {{all->x0, y, all->x1, smaller(y + ROWS_A_BLOCK, all->y1)},
                           patch_at(&at->decoded, all->x0, y)};
    struct patch bands[CODER_BANDS];
    memcpy(bands, at->coded, sizeof bands);
    bands[0] = at[1].decoded;
    if (!layout_wavelet_inverse(&c->region->coder->grid, c->level, bands, &wanted)) c->region->failed = true;
}

static void measure_tile(const struct region *r, int level, int64_t tx, int64_t ty)
{
    const struct region_level *at = &r->level[level];
    const struct rect *core = &at->decoded.rect;
    int bits = r->coder->fraction_bits;
    int64_t x0 = tx * LAYOUT_SAMPLES, x1 = smaller(x0 + LAYOUT_SAMPLES + 1, core->x1);
    int64_t y0 = ty * LAYOUT_SAMPLES, y1 = smaller(y0 + LAYOUT_SAMPLES + 1, core->y1);
    int32_t low = INT32_MAX, high = INT32_MIN;
    for (int64_t y = y0; y < y1; y++) {
        const int32_t *row = patch_at(&at->decoded, x0, y);
        for (int64_t x = 0; x < x1 - x0; x++) {
            low = row[x] < low ? row[x] : low;
            high = row[x] > high ? row[x] : high;
        }
    }
    struct packed_tile *tile = region_own_tile(at, tx, ty);
    tile->min_q = region_quanta(low, bits); // rounding keeps the order
    tile->max_q = region_quanta(high, bits);
    for (int end = 0; end < 2; end++) {
        int64_t y = region_pole_row(r->coder, level, end);
        const int32_t *pole = y >= y0 && y < y1 ? region_pole(r->coder, level, y) : NULL;
        if (pole && *pole < tile->min_q) tile->min_q = *pole;
        if (pole && *pole > tile->max_q) tile->max_q = *pole;
    }
}

static void measure_tile_row(int block, void *user)
{
    const struct coding *c = user;
    const struct region_level *at = &c->region->level[c->level];
    for (int64_t tx = at->core_tiles.x0; tx < at->core_tiles.x1; tx++)
        measure_tile(c->region, c->level, tx, at->core_tiles.y0 + block);
}

bool region_code(struct region *r, bool write)
{
    struct coding c = {.region = r, .write = write};
    for (int l = r->fine; write && l < r->coarse; l++) {
        struct region_level *at = &r->level[l];
        size_t count = (size_t)(rect_width(&at->core_tiles) * rect_height(&at->core_tiles));
        if (!at->packed) at->packed = calloc(count + 1, sizeof *at->packed);
        if (!at->packed) return false;
    }
    for (c.level = r->coarse - 1; c.level >= r->fine; c.level--) {
        const struct region_level *at = &r->level[c.level];
        parallel_blocks((int)rect_height(&at->tiles), r->threads, code_tile_row, &c);
        int64_t rows = rect_height(&at->decoded.rect);
        if (r->coder->method->smooth)
            parallel_blocks((int)((rows + ROWS_A_BLOCK - 1) / ROWS_A_BLOCK), r->threads, inverse_rows, &c);
        if (write) parallel_blocks((int)rect_height(&at->core_tiles), r->threads, measure_tile_row, &c);
    }
    return !r->failed;
}
