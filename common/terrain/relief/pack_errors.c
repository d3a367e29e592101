// SPDX-License-Identifier: MIT
#include "common/terrain/relief/pack_errors.h"

#include "common/integer.h"
#include "common/parallel.h"

#include <stdlib.h>
#include <string.h>

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
        const int32_t *got = patch_at(&at->decoded, core.x0, y), *pole = region_pole(r->coder, 0, y);
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
    return rect_blocks(&r->level[0].core, level);
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
    struct rect known = rect_clipped(&s->at.rect, size);
    s->at.samples = malloc((size_t)(rect_width(&s->at.rect) * rect_height(&s->at.rect)) * sizeof(int32_t));
    int32_t *room = malloc((size_t)(rect_width(&known) * rect_height(&known) + 1) * sizeof *room);
    struct patch read = {known, room};
    bool here = level < r->coarse || !reader->read;
    bool good = s->at.samples && room && (here || reader->read(reader->user, level, &read));
    const struct patch *from = here ? &r->level[level].decoded : &read;
    for (int64_t y = known.y0; good && y < known.y1; y++)
        for (int64_t x = known.x0; x < known.x1; x++)
            *patch_at(&s->at, x, y) = region_quanta(*patch_at(from, x, y), r->coder->fraction_bits);
    if (good) region_flatten_poles(r->coder, level, 0, &s->at);
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

// The surface over line v of a cell's samples, times 2^level: at u = 0, and its slope.
struct cell_line {
    int64_t cell, v;
    int64_t over[2], under[2]; // over the diagonal, where u < v, and under it
};

static struct cell_line cell_line_of(int64_t cell, int64_t v, const int32_t *south, const int32_t *north)
{
    int64_t sw = south[0], se = south[1], nw = north[0], ne = north[1];
    return (struct cell_line){
        cell, v, {sw * cell + v * (nw - sw), ne - nw}, {sw * cell + v * (ne - se), se - sw}};
}

// Largest error for u in from..to-1; adds the squares.
static int64_t cell_line_error(const struct cell_line *c, const int32_t *fine, int64_t from, int64_t to,
                               uint64_t *squares)
{
    int64_t middle = larger(smaller(c->v, to), from);
    int64_t over = line_error(c->over[0], c->over[1], c->cell, fine, from, middle, squares);
    int64_t under = line_error(c->under[0], c->under[1], c->cell, fine, middle, to, squares);
    return larger(over, under);
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
            int64_t x = (s->cells.x0 + i) * cell, end = smaller(cell, known->x1 - x);
            const struct cell_line c = cell_line_of(cell, v, south + i, north + i);
            uint64_t sum = 0, beyond = 0;
            int64_t most = cell_line_error(&c, fine, 0, end, &sum);
            if (x + cell < known->x1) // the edge to the east, which is the next cell's
                most = larger(most, line_error(c.under[0], c.under[1], cell, fine, cell, cell + 1, &beyond));
            if (x < own.x0 || x + end > own.x1) { // a planet's margin
                sum = 0;
                cell_line_error(&c, fine, larger(own.x0 - x, 0), smaller(own.x1 - x, end), &sum);
            }
            if (own_row) squares += sum;
            if (j < s->cells.y1) out[i] = larger(out[i], most);
            if (v == 0 && j > s->cells.y0) out[i - columns] = larger(out[i - columns], most);
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
            struct packed_tile *tile = region_own_tile(at, i >> REGION_TILE_SHIFT, j >> REGION_TILE_SHIFT);
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
            uint32_t *to = &out[((j >> (up + REGION_TILE_SHIFT)) - tiles->y0) * rect_width(tiles) +
                                (i >> (up + REGION_TILE_SHIFT)) - tiles->x0];
            *to = error > *to ? error : *to;
        }
}

struct rect region_tiles_above(const struct region *region, int level)
{
    return rect_blocks(&region->level[0].core, level + REGION_TILE_SHIFT);
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
    region_flatten_poles(r->coder, 0, 0, finest);
    parallel_blocks(r->coarse - 1, r->threads, measure_level, &m);
    if (m.failed || !measure_squares(r, reader)) return false;
    return r->coarse >= r->coder->grid.count - 1 || measure_beyond(r, reader, beyond);
}
