// SPDX-License-Identifier: MIT
#include "clipmap/clipmap_store.h"

#include "clipmap/clipmap_normals.h"
#include "common/report.h"

#include <stdlib.h>

enum { TILE = 8 }; // samples on a side of a square of bounds

bool clipmap_store_init(struct clipmap_store *store, const struct terrain *terrain, int level, bool morphs,
                        int size)
{
    *store = (struct clipmap_store){.terrain = terrain, .level = level, .morphs = morphs, .size = size};
    store->clip = clipmap_empty;
    store->tiles = size / TILE + 2; // that many squares can meet a clip region
    size_t count = (size_t)store->tiles * (size_t)store->tiles;
    store->bounds = malloc(count * sizeof *store->bounds);
    if (!store->bounds) return fail("clipmap: no memory for a level of %d x %d samples", size, size);
    for (size_t i = 0; i < count; i++) store->bounds[i] = (struct clipmap_tile){.at = {INT64_MIN, INT64_MIN}};
    return true;
}

void clipmap_store_finish(struct clipmap_store *store)
{
    free(store->bounds);
    store->bounds = NULL;
}

bool clipmap_scratch_init(struct clipmap_scratch *scratch, int size)
{
    size_t fine = (size_t)size * (size_t)size, coarse = (size_t)(size / 2 + 2) * (size_t)(size / 2 + 2);
    scratch->fine = malloc(fine * sizeof *scratch->fine);
    scratch->coarse = malloc(coarse * sizeof *scratch->coarse);
    scratch->pairs = malloc(fine * sizeof *scratch->pairs);
    if (scratch->fine && scratch->coarse && scratch->pairs) return true;
    return fail("clipmap: no memory for a level of %d x %d samples", size, size);
}

void clipmap_scratch_finish(struct clipmap_scratch *scratch)
{
    free(scratch->fine);
    free(scratch->coarse);
    free(scratch->pairs);
    *scratch = (struct clipmap_scratch){NULL, NULL, NULL};
}

// z_c is half the sum of the coarse samples at both ends of the coarse edge or diagonal that the sample
// stands on. `here` and `there`: the coarse rows of these ends, one and the same on even rows.
static inline void pair_some(const int32_t *restrict fine, const int32_t *here, const int32_t *there,
                             int cells, float (*restrict out)[2])
{
    for (int k = 0; k < cells; k++) { // the even and the odd sample of a coarse cell
        out[2 * k][0] = (float)fine[2 * k];
        out[2 * k][1] = (float)(here[k] + there[k]) * 0.5f;
        out[2 * k + 1][0] = (float)fine[2 * k + 1];
        out[2 * k + 1][1] = (float)(here[k] + there[k + 1]) * 0.5f;
    }
}

// A row of whole cells.  LANES at a time, a fixed number, so that -O2 vectorises; the last may do again what
// those before did.
static void pair_cells(const int32_t *fine, const int32_t *here, const int32_t *there, int cells,
                       float (*out)[2])
{
    enum { LANES = 32 };
    if (cells < LANES) pair_some(fine, here, there, cells, out);
    for (int k = 0; k < cells && cells >= LANES; k += LANES) {
        ptrdiff_t at = k + LANES <= cells ? k : cells - LANES;
        pair_some(fine + 2 * at, here + at, there + at, LANES, out + 2 * at);
    }
}

// A row that begins on an odd sample when odd_x0 is 1.
static void pair_row(const int32_t *fine, const int32_t *here, const int32_t *there, int odd_x0, int width,
                     float (*out)[2])
{
    int cells = (width - odd_x0) / 2, last = odd_x0 + 2 * cells;
    if (odd_x0) {
        out[0][0] = (float)fine[0];
        out[0][1] = (float)(here[0] + there[1]) * 0.5f;
    }
    pair_cells(fine + odd_x0, here + odd_x0, there + odd_x0, cells, out + odd_x0);
    if (last < width) {
        out[last][0] = (float)fine[last];
        out[last][1] = (float)(here[odd_x0 + cells] + there[odd_x0 + cells]) * 0.5f;
    }
}

void clipmap_pair(const struct clipmap_box *box, bool morphs, const struct clipmap_scratch *scratch)
{
    int width = (int)(box->hi[0] - box->lo[0] + 1), height = (int)(box->hi[1] - box->lo[1] + 1);
    struct clipmap_box under = clipmap_under(box);
    ptrdiff_t stride = (ptrdiff_t)(under.hi[0] - under.lo[0] + 1);
    int odd_x0 = (int)(box->lo[0] - 2 * under.lo[0]), odd_y0 = (int)(box->lo[1] - 2 * under.lo[1]);
    for (int y = 0; y < height; y++) {
        const int32_t *fine = scratch->fine + (ptrdiff_t)y * width;
        const int32_t *here = scratch->coarse + (y + odd_y0) / 2 * stride;
        float(*out)[2] = scratch->pairs + (ptrdiff_t)y * width;
        if (morphs)
            pair_row(fine, here, here + ((y + odd_y0) & 1) * stride, odd_x0, width, out);
        else
            for (int x = 0; x < width; x++) out[x][0] = out[x][1] = (float)fine[x];
    }
}

struct clipmap_box clipmap_under(const struct clipmap_box *box)
{
    struct clipmap_box under;
    for (int axis = 0; axis < 2; axis++) {
        under.lo[axis] = clipmap_floor_div(box->lo[axis], 2);
        under.hi[axis] = clipmap_floor_div(box->hi[axis] + 1, 2);
    }
    return under;
}

static void read_window(const struct clipmap_store *store, int level, const struct clipmap_box *box,
                        int32_t *out)
{
    terrain_window(store->terrain, level, box->lo[0], box->lo[1], (int)(box->hi[0] - box->lo[0] + 1),
                   (int)(box->hi[1] - box->lo[1] + 1), out, TERRAIN_WAIT);
}

void clipmap_store_read(const struct clipmap_store *store, const struct clipmap_box *box,
                        const struct clipmap_scratch *scratch)
{
    struct clipmap_box under = clipmap_under(box);
    read_window(store, store->level, box, scratch->fine);
    if (store->morphs) read_window(store, store->level + 1, &under, scratch->coarse);
    clipmap_pair(box, store->morphs, scratch);
}

static void widen(struct clipmap_range *range, struct clipmap_range other)
{
    if (other.low < range->low) range->low = other.low;
    if (other.high > range->high) range->high = other.high;
}

// Bounds over the whole square, whatever part of it is in memory: so they do not depend on the way that led
// here.
static void bound_tile(struct clipmap_store *store, int64_t x, int64_t y)
{
    struct clipmap_tile *tile =
        &store->bounds[clipmap_slot(y, store->tiles) * store->tiles + clipmap_slot(x, store->tiles)];
    if (tile->at[0] == x && tile->at[1] == y) return;
    *tile = (struct clipmap_tile){.at = {x, y}};
    terrain_bounds(store->terrain, store->level, x * TILE, y * TILE, x * TILE + TILE - 1, y * TILE + TILE - 1,
                   &tile->range.low, &tile->range.high);
    if (!store->morphs) return;
    struct clipmap_range coarse;
    const int side = TILE / 2;
    terrain_bounds(store->terrain, store->level + 1, x * side, y * side, (x + 1) * side, (y + 1) * side,
                   &coarse.low, &coarse.high);
    widen(&tile->range, coarse);
}

void clipmap_store_bound(struct clipmap_store *store, const struct clipmap_box *box)
{
    for (int64_t y = clipmap_floor_div(box->lo[1], TILE); y * TILE <= box->hi[1]; y++)
        for (int64_t x = clipmap_floor_div(box->lo[0], TILE); x * TILE <= box->hi[0]; x++)
            bound_tile(store, x, y);
}

// ---- what is there ---------------------------------------------------------

static bool window_there(const struct clipmap_store *store, int level, const struct clipmap_box *box)
{
    return terrain_reader_window(store->reader, level, box->lo[0], box->lo[1],
                                 (int)(box->hi[0] - box->lo[0] + 1), (int)(box->hi[1] - box->lo[1] + 1),
                                 NULL);
}

// Asks for all that a box is made of, the coarser level first: finer ones are decoded from it.
static bool box_there(void *user, const struct clipmap_box *box)
{
    const struct clipmap_store *store = user;
    struct clipmap_box under = clipmap_under(box), normals;
    bool there = !store->morphs || window_there(store, store->level + 1, &under);
    there = window_there(store, store->level, box) && there;
    if (!store->shaded) return there;
    int finer = clipmap_normals_window(store->terrain, store->level, box, &normals);
    return window_there(store, finer, &normals) && there;
}

// ---- moves -----------------------------------------------------------------

uint64_t clipmap_store_move(struct clipmap_store *store, const struct clipmap_box *target, uint64_t budget,
                            const struct clipmap_scratch *scratch, clipmap_write_fn *write, void *user)
{
    struct clipmap_box kept = clipmap_box_common(&store->clip, target), exposed[4], pieces[4];
    uint64_t there = store->reader ? clipmap_budget_there(&kept, target, budget, box_there, store) : budget;
    if (!store->wait) budget = there;
    struct clipmap_box now = clipmap_grown(&kept, target, budget);
    int exposed_count = clipmap_exposed(&kept, &now, exposed);
    uint64_t samples = 0;
    for (int i = 0; i < exposed_count; i++) {
        int piece_count = clipmap_unwrap(&exposed[i], store->size, pieces);
        for (int p = 0; p < piece_count; p++) {
            const struct clipmap_box *piece = &pieces[p];
            clipmap_store_read(store, piece, scratch);
            write(user, clipmap_slot(piece->lo[0], store->size), clipmap_slot(piece->lo[1], store->size),
                  (int)(piece->hi[0] - piece->lo[0] + 1), (int)(piece->hi[1] - piece->lo[1] + 1),
                  (const float(*)[2])scratch->pairs);
        }
        samples += clipmap_box_samples(&exposed[i]);
        clipmap_store_bound(store, &exposed[i]);
    }
    store->clip = now;
    return samples;
}

struct clipmap_range clipmap_store_range(const struct clipmap_store *store, const struct clipmap_box *box)
{
    struct clipmap_range range = {INT32_MAX, INT32_MIN};
    int64_t first[2], end[2];
    for (int axis = 0; axis < 2; axis++) {
        first[axis] = clipmap_floor_div(box->lo[axis], TILE);
        end[axis] = clipmap_floor_div(box->hi[axis], TILE) + 1;
    }
    int from = clipmap_slot(first[0], store->tiles), row = clipmap_slot(first[1], store->tiles);
    for (int64_t y = first[1]; y < end[1]; y++, row = row + 1 == store->tiles ? 0 : row + 1) {
        const struct clipmap_tile *tiles = store->bounds + (size_t)row * (size_t)store->tiles;
        int column = from;
        for (int64_t x = first[0]; x < end[0]; x++, column = column + 1 == store->tiles ? 0 : column + 1)
            widen(&range, tiles[column].range);
    }
    return range;
}
