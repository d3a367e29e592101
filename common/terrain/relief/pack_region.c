// SPDX-License-Identifier: MIT
#include "common/terrain/relief/pack_region.h"

#include "common/parallel.h"
#include "common/terrain/upsample.h"

#include <stdlib.h>
#include <string.h>

enum { ROWS_A_BLOCK = 128 };

static int64_t smaller(int64_t a, int64_t b)
{
    return a < b ? a : b;
}
static int64_t larger(int64_t a, int64_t b)
{
    return a > b ? a : b;
}

// ---- rectangles ------------------------------------------------------------

static struct rect hull(const struct rect *a, const struct rect *b)
{
    return (struct rect){smaller(a->x0, b->x0), smaller(a->y0, b->y0), larger(a->x1, b->x1),
                         larger(a->y1, b->y1)};
}

static struct rect clipped(const struct rect *r, const int64_t size[2])
{
    return (struct rect){larger(r->x0, 0), larger(r->y0, 0), smaller(r->x1, size[0]),
                         smaller(r->y1, size[1])};
}

static struct rect with_edges(const struct rect *core, const int64_t size[2]) // a sample east and north
{
    const struct rect grown = {core->x0, core->y0, core->x1 + 1, core->y1 + 1};
    return clipped(&grown, size);
}

static struct rect tiles_of(const struct rect *samples, int shift) // blocks of 2^shift that it touches
{
    int64_t last = ((int64_t)1 << shift) - 1;
    return (struct rect){samples->x0 >> shift, samples->y0 >> shift, (samples->x1 + last) >> shift,
                         (samples->y1 + last) >> shift};
}

enum { TILE_SHIFT = 6, COARSE_SHIFT = 5 }; // LAYOUT_SAMPLES, CODER_TILE

// Tiles whose coefficients the samples of a rectangle hang on.
static struct rect tiles_for(const struct pack_coder *coder, int level, const struct rect *samples)
{
    if (!coder->method->smooth) return tiles_of(samples, TILE_SHIFT);
    struct rect low = layout_wavelet_band_rect(&coder->grid, level, samples, 0);
    struct rect high = layout_wavelet_band_rect(&coder->grid, level, samples, BAND_HH);
    struct rect both = hull(&low, &high);
    return tiles_of(&both, COARSE_SHIFT);
}

static void plan_decoded(struct region *r)
{
    const struct grid *grid = &r->coder->grid;
    r->level[r->fine].decoded.rect = with_edges(&r->level[r->fine].core, grid->size[r->fine]);
    for (int l = r->fine; l < r->coarse; l++) {
        struct region_level *at = &r->level[l];
        at->tiles = tiles_for(r->coder, l, &at->decoded.rect);
        at->core_tiles = tiles_of(&at->core, TILE_SHIFT);
        for (int b = BAND_HL; b < CODER_BANDS; b++) {
            const int64_t size[2] = {grid_band_size(grid, l, b, 0), grid_band_size(grid, l, b, 1)};
            const struct rect *t = &at->tiles;
            const struct rect whole = {t->x0 * CODER_TILE, t->y0 * CODER_TILE, t->x1 * CODER_TILE,
                                       t->y1 * CODER_TILE};
            at->coded[b].rect = clipped(&whole, size);
        }
        struct rect coarse =
            layout_coarse_rect(grid, l, at->tiles.x0, at->tiles.y0, at->tiles.x1, at->tiles.y1);
        struct rect core = with_edges(&at[1].core, grid->size[l + 1]);
        at[1].decoded.rect = hull(&coarse, &core);
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
        if (coded) needed = any ? hull(&needed, &tiles) : tiles;
        any = true;
        int shift = r->coarse - l; // so that all levels begin at even coordinates
        const struct rect from = {aligned(2 * needed.x0 - reach, shift),
                                  aligned(2 * needed.y0 - reach, shift), 2 * needed.x1 + reach,
                                  2 * needed.y1 + reach};
        needed = clipped(&from, r->coder->grid.size[l]);
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

// The pole's height where a row is one that is known.
static const int32_t *pole_at(const struct pack_coder *coder, int level, int64_t y)
{
    const struct pack_poles *poles = &coder->poles;
    for (int end = 0; poles->planet && level < poles->known && end < 2; end++)
        if (y == region_pole_row(coder, level, end)) return &poles->q[level][end];
    return NULL;
}

// A pole is one height on all meridians.
static void flatten_poles(const struct pack_coder *coder, int level, int bits, const struct patch *patch)
{
    for (int end = 0; coder->poles.planet && end < 2; end++) {
        int64_t y = region_pole_row(coder, level, end);
        const int32_t *pole = pole_at(coder, level, y);
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
        if (!r->coder->method->smooth) flatten_poles(r->coder, l + 1, r->coder->fraction_bits, &at[1].wanted);
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

static struct packed_tile *own_tile(const struct region_level *at, int64_t tx, int64_t ty)
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
        struct packed_tile *own = c->write ? own_tile(at, job.tx, job.ty) : NULL;
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
    struct packed_tile *tile = own_tile(at, tx, ty);
    tile->min_q = region_quanta(low, bits); // rounding keeps the order
    tile->max_q = region_quanta(high, bits);
    for (int end = 0; end < 2; end++) {
        int64_t y = region_pole_row(r->coder, level, end);
        const int32_t *pole = y >= y0 && y < y1 ? pole_at(r->coder, level, y) : NULL;
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

// ---- errors ----------------------------------------------------------------

int32_t region_quanta(int32_t value, int fraction_bits)
{
    int32_t round = fraction_bits ? 1 << (fraction_bits - 1) : 0, q = (value + round) >> fraction_bits;
    return q > QUANTA_LIMIT ? QUANTA_LIMIT : q < -QUANTA_LIMIT ? -QUANTA_LIMIT : q;
}

// The region's own samples of level 0, without a planet's margin.
static struct rect own_samples(const struct region *r)
{
    const struct rect *core = &r->level[0].core;
    const int64_t *size = r->coder->grid.size[0], margin = r->coder->poles.margin;
    return (struct rect){larger(core->x0, margin), larger(core->y0, margin),
                         smaller(core->x1, size[0] - margin), smaller(core->y1, size[1] - margin)};
}

void region_measure(const struct region *r, struct region_sums *sums)
{
    const struct region_level *at = &r->level[0];
    int bits = r->coder->fraction_bits;
    const struct rect core = own_samples(r);
    if (core.x1 <= core.x0 || core.y1 <= core.y0) return;
    for (int64_t y = core.y0; y < core.y1; y++) {
        const int32_t *got = patch_at(&at->decoded, core.x0, y), *pole = pole_at(r->coder, 0, y);
        const int32_t *wanted = patch_at(&at->wanted, core.x0, y);
        uint64_t row = 0; // a square is less than 2^48: emptied every 2^16 samples
        for (int64_t x = 0; x < rect_width(&core); x++) {
            int32_t q = pole ? *pole : region_quanta(got[x], bits);
            int64_t d = llabs((int64_t)q - (wanted[x] >> bits));
            row += (uint64_t)(d * d);
            sums->most = d > sums->most ? d : sums->most;
            sums->min_q = q < sums->min_q ? q : sums->min_q;
            sums->max_q = q > sums->max_q ? q : sums->max_q;
            if ((x & 0xffff) == 0xffff) sums->squares += row, row = 0;
        }
        sums->squares += row;
    }
    sums->samples += rect_width(&core) * rect_height(&core);
}

// The surface of a level over the cells that the core touches: its samples in quanta, cells + 1 along each
// axis. Where the level ends before level 0 does, one more column and row continue it: 2 a - b, a being the
// last.
struct surface {
    int level;
    struct rect cells;
    struct patch at;        // vertices
    int64_t x_last, y_last; // the vertices that samples of level 0 reach
};

static struct rect cells_of(const struct region *r, int level)
{
    return tiles_of(&r->level[0].core, level);
}

static void continue_surface(struct surface *s, const int64_t size[2], const struct rect *known)
{
    const struct rect *v = &s->at.rect;
    if (v->x1 > size[0])
        for (int64_t y = v->y0; y < known->y1; y++) {
            int32_t *last = patch_at(&s->at, size[0] - 1, y);
            last[1] = size[0] > 1 && v->x0 < size[0] - 1 ? 2 * last[0] - last[-1] : last[0];
        }
    if (v->y1 > size[1])
        for (int64_t x = v->x0; x < v->x1; x++) {
            int32_t *last = patch_at(&s->at, x, size[1] - 1), stride = (int32_t)rect_width(v);
            last[stride] = size[1] > 1 && v->y0 < size[1] - 1 ? 2 * last[0] - last[-stride] : last[0];
        }
}

static bool surface_init(struct surface *s, struct region *r, int level, const struct region_reader *reader)
{
    const int64_t *size = r->coder->grid.size[level];
    struct rect cells = cells_of(r, level);
    s->level = level;
    s->cells = cells;
    s->x_last = (r->coder->grid.size[0][0] - 2 + ((int64_t)1 << level)) >> level;
    s->y_last = (r->coder->grid.size[0][1] - 2 + ((int64_t)1 << level)) >> level;
    // One vertex more to the west and south, so that a continued edge has two to go by.
    s->at.rect = (struct rect){larger(cells.x0 - 1, 0), larger(cells.y0 - 1, 0), cells.x1 + 1, cells.y1 + 1};
    struct rect known = clipped(&s->at.rect, size);
    s->at.samples = malloc((size_t)(rect_width(&s->at.rect) * rect_height(&s->at.rect)) * sizeof(int32_t));
    int32_t *room = malloc((size_t)(rect_width(&known) * rect_height(&known) + 1) * sizeof *room);
    struct patch read = {known, room};
    bool here = level < r->coarse || !reader->read;
    bool good = s->at.samples && room && (here || reader->read(reader->user, level, &read));
    const struct patch *from = here ? &r->level[level].decoded : &read;
    for (int64_t y = known.y0; good && y < known.y1; y++)
        for (int64_t x = known.x0; x < known.x1; x++)
            *patch_at(&s->at, x, y) = region_quanta(*patch_at(from, x, y), r->coder->fraction_bits);
    if (good) flatten_poles(r->coder, level, 0, &s->at);
    if (good) continue_surface(s, size, &known);
    free(room);
    return good;
}

enum { REFERENCE = 3 }; // levels up to this are compared with level 0 sample by sample (pack_squares.h)

// Largest |a + u b - cell fine[u]| for u in from..to-1; adds their squares.
static int64_t line_error(int64_t a, int64_t b, int64_t cell, const int32_t *fine, int64_t from, int64_t to,
                          uint64_t *squares)
{
    int64_t most = 0;
    uint64_t sum = 0;
    for (int64_t u = from; u < to; u++) {
        int64_t off = llabs(a + u * b - cell * fine[u]);
        sum += (uint64_t)off * (uint64_t)off;
        most = off > most ? off : most;
    }
    *squares += sum;
    return most;
}

// Largest |surface - level 0| over each cell, edges included, times 2^level; returns the sum of the squares
// at the region's own samples, which is right up to level REFERENCE.
static squares_wide cell_errors(const struct surface *s, const struct region *r, int64_t *errors)
{
    const struct rect *core = &r->level[0].core, *known = &r->level[0].decoded.rect, own = own_samples(r);
    int64_t cell = (int64_t)1 << s->level, stride = rect_width(&s->at.rect), columns = rect_width(&s->cells);
    squares_wide squares = 0;
    memset(errors, 0, (size_t)(columns * rect_height(&s->cells)) * sizeof *errors);
    for (int64_t y = core->y0; y < known->y1; y++) {
        int64_t j = y >> s->level, v = y - j * cell;
        const int32_t *south = patch_at(&s->at, s->cells.x0, j), *north = v ? south + stride : south;
        int64_t *out = errors + (j - s->cells.y0) * columns;
        const int32_t *fine = patch_at(&r->level[0].decoded, core->x0, y);
        bool own_row = y >= own.y0 && y < own.y1;
        for (int64_t i = 0; i < columns; i++, fine += cell) {
            int64_t sw = south[i], se = south[i + 1], nw = north[i], ne = north[i + 1];
            int64_t x = (s->cells.x0 + i) * cell, end = smaller(cell, known->x1 - x),
                    middle = smaller(v, end);
            int64_t over = sw * cell + v * (nw - sw), under = sw * cell + v * (ne - se);
            uint64_t sum = 0, beyond = 0;
            int64_t a = line_error(over, ne - nw, cell, fine, 0, middle, &sum);
            int64_t b = line_error(under, se - sw, cell, fine, middle, end, &sum);
            a = a > b ? a : b;
            if (x + cell < known->x1) // the edge to the east, which is the next cell's
                a = larger(a, line_error(under, se - sw, cell, fine, cell, cell + 1, &beyond));
            if (x < own.x0 || x + end > own.x1) { // a planet's margin
                int64_t from = larger(own.x0 - x, 0), to = smaller(own.x1 - x, end);
                sum = 0;
                line_error(over, ne - nw, cell, fine, from, smaller(middle, to), &sum);
                line_error(under, se - sw, cell, fine, larger(middle, from), to, &sum);
            }
            if (own_row) squares += sum;
            if (j < s->cells.y1) out[i] = a > out[i] ? a : out[i];
            if (v == 0 && j > s->cells.y0) out[i - columns] = larger(out[i - columns], a);
        }
    }
    return squares;
}

static uint32_t rounded_up(int64_t error, int bits)
{
    int64_t q = (error + ((int64_t)1 << bits) - 1) >> bits;
    return q < UINT32_MAX ? (uint32_t)q : UINT32_MAX;
}

static void keep_tile_errors(struct region *r, const struct surface *s, const int64_t *errors)
{
    const struct region_level *at = &r->level[s->level];
    for (int64_t j = s->cells.y0; j < s->cells.y1; j++)
        for (int64_t i = s->cells.x0; i < s->cells.x1; i++) {
            struct packed_tile *tile = own_tile(at, i >> TILE_SHIFT, j >> TILE_SHIFT);
            uint32_t error = rounded_up(*errors++, s->level);
            tile->error_q = error > tile->error_q ? error : tile->error_q;
        }
}

// Height of a surface at vertex (x, y) of a level `up` levels finer, times 2^up.
static int64_t height_at(const struct surface *s, int up, int64_t x, int64_t y)
{
    int64_t cell = (int64_t)1 << up;
    int64_t i = smaller(x >> up, s->cells.x1 - 1), j = smaller(y >> up, s->cells.y1 - 1);
    int64_t u = x - i * cell, v = y - j * cell;
    const int32_t *south = patch_at(&s->at, i, j), *north = south + rect_width(&s->at.rect);
    int64_t sw = south[0], se = south[1], nw = north[0], ne = north[1];
    return u < v ? sw * cell + v * (nw - sw) + u * (ne - nw) : sw * cell + u * (se - sw) + v * (ne - se);
}

// A surface is linear over each triangle of a finer one: their difference is largest at vertices.
static void bound_errors(const struct surface *s, const struct surface *fine, const int64_t *fine_errors,
                         const struct rect *tiles, uint32_t *out)
{
    int up = s->level - fine->level;
    int64_t x_last = fine->x_last, y_last = fine->y_last;
    memset(out, 0, (size_t)(rect_width(tiles) * rect_height(tiles)) * sizeof *out);
    for (int64_t j = fine->cells.y0; j < fine->cells.y1; j++)
        for (int64_t i = fine->cells.x0; i < fine->cells.x1; i++) {
            int64_t most = 0;
            for (int corner = 0; corner < 4; corner++) {
                int64_t x = smaller(i + (corner & 1), x_last), y = smaller(j + (corner >> 1), y_last);
                int64_t off = llabs(height_at(s, up, x, y) - *patch_at(&fine->at, x, y) * ((int64_t)1 << up));
                most = off > most ? off : most;
            }
            uint32_t error = rounded_up((most << fine->level) + (*fine_errors++ << up), s->level);
            uint32_t *to = &out[((j >> (up + TILE_SHIFT)) - tiles->y0) * rect_width(tiles) +
                                (i >> (up + TILE_SHIFT)) - tiles->x0];
            *to = error > *to ? error : *to;
        }
}

struct rect region_tiles_above(const struct region *region, int level)
{
    return tiles_of(&region->level[0].core, level + TILE_SHIFT);
}

size_t region_beyond(const struct region *region)
{
    size_t count = 0;
    for (int l = region->coarse; l < region->coder->grid.count - 1; l++) {
        struct rect tiles = region_tiles_above(region, l);
        count += (size_t)(rect_width(&tiles) * rect_height(&tiles));
    }
    return count;
}

// Sums of the two triangles of each cell in row j of a surface: under the diagonal, over it.
static void sum_cells(const struct surface *s, const struct region *r, int64_t j,
                      struct triangle_sums (*cells)[2])
{
    const struct rect own = own_samples(r);
    int64_t cell = (int64_t)1 << s->level;
    memset(cells, 0, (size_t)rect_width(&s->cells) * sizeof *cells);
    for (int64_t y = larger(j * cell, own.y0); y < smaller((j + 1) * cell, own.y1); y++) {
        int64_t v = y - j * cell;
        const int32_t *south = patch_at(&s->at, s->cells.x0, j);
        const int32_t *north = v ? south + rect_width(&s->at.rect) : south;
        for (int64_t i = 0; i < rect_width(&s->cells); i++) {
            int64_t sw = south[i], se = south[i + 1], nw = north[i], ne = north[i + 1];
            int64_t x = (s->cells.x0 + i) * cell, from = larger(own.x0 - x, 0),
                    to = smaller(own.x1 - x, cell);
            const struct triangle_line under = {sw * cell + v * (ne - se), se - sw, v, larger(v, from), to};
            const struct triangle_line over = {sw * cell + v * (nw - sw), ne - nw, v, from, smaller(v, to)};
            const int32_t *fine = patch_at(&r->level[0].decoded, x, y);
            triangle_add_line(&cells[i][0], &under, cell, fine);
            triangle_add_line(&cells[i][1], &over, cell, fine);
        }
    }
}

// What a surface differs from the reference level's at a vertex of that, times 2^up.
static int64_t corner_of(const struct surface *s, const struct surface *reference, int64_t x, int64_t y)
{
    int up = s->level - reference->level;
    return height_at(s, up, x, y) - *patch_at(&reference->at, x, y) * ((int64_t)1 << up);
}

// Squares of what a surface differs from level 0 over a row of the reference level's cells.
static squares_wide row_squares(const struct surface *s, const struct surface *reference, int64_t j,
                                struct triangle_sums (*cells)[2])
{
    int up = s->level - reference->level, shift = reference->level;
    int64_t x0 = reference->cells.x0, sw = corner_of(s, reference, x0, j),
            nw = corner_of(s, reference, x0, j + 1);
    squares_wide squares = 0;
    for (int64_t i = 0; i < rect_width(&reference->cells); i++) {
        int64_t se = corner_of(s, reference, x0 + i + 1, j), ne = corner_of(s, reference, x0 + i + 1, j + 1);
        int64_t origin = sw * ((int64_t)1 << shift);
        const int64_t under[3] = {origin, se - sw, ne - se}, over[3] = {origin, ne - nw, nw - sw};
        squares += triangle_squares(&cells[i][0], under, up) + triangle_squares(&cells[i][1], over, up);
        sw = se, nw = ne;
    }
    return squares;
}

// Of the levels from the reference on; measure_level has done those below.
static bool measure_squares(struct region *r, const struct region_reader *reader)
{
    int count = r->coder->grid.count, lowest = r->coarse < REFERENCE ? r->coarse : REFERENCE;
    struct surface surfaces[LAYOUT_LEVELS] = {{0}}, *reference = &surfaces[lowest];
    bool good = true;
    for (int l = lowest; l < count && good; l++) good = surface_init(&surfaces[l], r, l, reader);
    size_t columns = good ? (size_t)rect_width(&reference->cells) : 0;
    struct triangle_sums(*cells)[2] = good ? malloc((columns + 1) * sizeof *cells) : NULL;
    for (int64_t j = reference->cells.y0; cells && j < reference->cells.y1; j++) {
        sum_cells(reference, r, j, cells);
        for (size_t i = 0; i < columns; i++)
            r->squares[lowest] += (squares_wide)cells[i][0].ee + cells[i][1].ee;
        for (int l = lowest + 1; l < count; l++)
            r->squares[l] += row_squares(&surfaces[l], reference, j, cells);
    }
    for (int l = lowest; l < count; l++) free(surfaces[l].at.samples);
    free(cells);
    return cells != NULL;
}

struct measuring { // levels of a region are measured side by side
    struct region *region;
    const struct region_reader *reader;
    bool failed;
};

static void measure_level(int block, void *user)
{
    struct measuring *m = user;
    struct surface s = {0};
    bool good = surface_init(&s, m->region, block + 1, m->reader);
    int64_t *errors =
        good ? malloc((size_t)(rect_width(&s.cells) * rect_height(&s.cells) + 1) * sizeof *errors) : NULL;
    if (errors) {
        squares_wide squares = cell_errors(&s, m->region, errors);
        if (s.level < REFERENCE) m->region->squares[s.level] = squares;
        keep_tile_errors(m->region, &s, errors);
    } else
        m->failed = true;
    free(errors);
    free(s.at.samples);
}

static bool measure_beyond(struct region *r, const struct region_reader *reader, uint32_t *beyond)
{
    struct surface fine = {0};
    bool good = surface_init(&fine, r, r->coarse, reader);
    size_t cells = (size_t)(rect_width(&fine.cells) * rect_height(&fine.cells));
    int64_t *errors = good ? malloc((cells + 1) * sizeof *errors) : NULL;
    if (errors) cell_errors(&fine, r, errors);
    good = errors != NULL;
    for (int l = r->coarse; good && l < r->coder->grid.count - 1; l++) {
        struct surface s = {0};
        struct rect tiles = region_tiles_above(r, l);
        good = surface_init(&s, r, l, reader);
        if (good) bound_errors(&s, &fine, errors, &tiles, beyond);
        beyond += rect_width(&tiles) * rect_height(&tiles);
        free(s.at.samples);
    }
    free(errors);
    free(fine.at.samples);
    return good;
}

bool region_errors(struct region *r, const struct region_reader *reader, uint32_t *beyond)
{
    if (r->coarse == 0) return true; // a map without tiles
    struct measuring m = {r, reader, false};
    struct patch *finest = &r->level[0].decoded;
    int64_t count = rect_width(&finest->rect) * rect_height(&finest->rect);
    for (int64_t i = 0; i < count; i++)
        finest->samples[i] = region_quanta(finest->samples[i], r->coder->fraction_bits);
    flatten_poles(r->coder, 0, 0, finest);
    parallel_blocks(r->coarse - 1, r->threads, measure_level, &m);
    if (m.failed || !measure_squares(r, reader)) return false;
    return r->coarse >= r->coder->grid.count - 1 || measure_beyond(r, reader, beyond);
}
