// SPDX-License-Identifier: MIT
#include "common/terrain/relief/pack.h"

#include "common/report.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

struct assembly {
    struct pack *p;
    FILE *file; // NULL: only counted
    struct relief_bytes index, side;
    uint64_t payload_bytes;
    int64_t low;
    uint32_t *errors; // of the tiles of levels above the first stage; NULL without stages
    squares_wide squares[LAYOUT_LEVELS];
};

static void put_base(const struct pack *p, struct relief_bytes *to)
{
    const struct pack_coder *c = &p->coder;
    const struct patch *base = &p->top.level[p->top.coarse].decoded;
    int top = p->top.coarse;
    for (int l = 0; l < top; l++)
        for (int b = BAND_HL; b < CODER_BANDS; b++) relief_put_varint(to, (uint64_t)c->step[l][b]);
    relief_put_varint(to, (uint64_t)c->step[top][0]);
    int32_t before = 0;
    for (int64_t i = 0; i < pack_samples_of(&c->grid, top); i++) {
        int32_t k = base->samples[i] / c->step[top][0]; // a multiple: region_code_base
        relief_put_difference(to, (int64_t)k - before);
        before = k;
    }
    before = 0;
    for (int l = 0; c->poles.planet && l <= c->poles.coarsest; l++)
        for (int end = 0; end < 2; end++) {
            relief_put_difference(to, (int64_t)c->poles.q[l][end] - before);
            before = c->poles.q[l][end];
        }
}

static bool put_tile(struct assembly *a, const struct tile_entry *tile, uint32_t error_q, const uint8_t *data)
{
    relief_put_varint(&a->index, tile->bytes);
    if (tile->bytes) {
        uint32_t crc = relief_crc(data, tile->bytes);
        const uint8_t bytes[4] = {(uint8_t)crc, (uint8_t)(crc >> 8), (uint8_t)(crc >> 16),
                                  (uint8_t)(crc >> 24)};
        relief_put(&a->side, bytes, sizeof bytes);
    }
    relief_put_difference(&a->side, tile->min_q - a->low);
    relief_put_varint(&a->side, (uint64_t)((int64_t)tile->max_q - tile->min_q));
    const uint8_t code = relief_error_code(error_q);
    relief_put(&a->side, &code, 1);
    a->low = tile->min_q;
    a->payload_bytes += tile->bytes;
    return !a->file || fwrite(data, 1, tile->bytes, a->file) == tile->bytes;
}

static bool put_top(struct assembly *a, int level)
{
    const struct pack *p = a->p;
    const struct region_level *at = &p->top.level[level];
    for (size_t i = 0; i < pack_tile_count(&at->core_tiles); i++) {
        const struct packed_tile *tile = &at->packed[i];
        const struct tile_entry entry = {tile->bytes, 0, tile->min_q, tile->max_q};
        uint32_t error_q =
            a->errors ? a->errors[p->coder.grid.first_tile[level] + (int64_t)i] : tile->error_q;
        if (!put_tile(a, &entry, error_q, tile->data)) return false;
    }
    return true;
}

static size_t squares_bytes(const struct pack *p) // of all levels, kept beside the tiles of level 0
{
    return (size_t)p->coder.grid.count * sizeof(squares_wide);
}

struct kept {          // a region in the file of tiles
    struct rect tiles; // of the level at hand
    struct tile_entry *entries;
    uint64_t offset; // of the level's first tile
};

// Tiles of the levels of a region: how many before `level`, and in all.
static size_t entries_of(const struct region *r, int level, size_t *before)
{
    size_t all = 0;
    for (int l = r->fine; l < r->coarse; l++) {
        if (l == level) *before = all;
        all += pack_tile_count(&r->level[l].core_tiles);
    }
    return all;
}

static bool kept_read(struct pack *p, const struct stage *stage, int number, int level, struct kept *kept)
{
    struct region *r = malloc(sizeof *r);
    if (!r) return pack_out_of_memory(p);
    struct rect core = pack_core_of(p, stage, number);
    region_plan(r, &p->coder, stage->fine, stage->coarse, &core, true);
    size_t before = 0, all = entries_of(r, level, &before),
           own = pack_tile_count(&r->level[level].core_tiles);
    size_t beyond = stage->fine == 0 ? squares_bytes(p) + region_beyond(r) * sizeof(uint32_t) : 0;
    kept->tiles = r->level[level].core_tiles;
    free(r);
    struct tile_entry *entries = malloc((all + 1) * sizeof *entries);
    uint64_t offset = stage->regions[number].offset;
    bool good =
        entries ? store_read_tiles(&p->store, entries, all * sizeof *entries, offset) : pack_out_of_memory(p);
    kept->offset = offset + all * sizeof *entries + beyond;
    for (size_t i = 0; good && i < before; i++) kept->offset += entries[i].bytes;
    if (good) memmove(entries, entries + before, own * sizeof *entries);
    kept->entries = entries;
    return good;
}

// A row of tiles of one region.
static bool put_kept_row(struct assembly *a, struct kept *kept, int level, int64_t ty,
                         struct relief_bytes *room)
{
    struct pack *p = a->p;
    int64_t columns = rect_width(&kept->tiles), first = (ty - kept->tiles.y0) * columns;
    const struct grid *grid = &p->coder.grid;
    size_t bytes = 0;
    for (int64_t i = 0; i < columns; i++) bytes += kept->entries[first + i].bytes;
    if (room->room < bytes + 1) {
        free(room->data);
        room->room = 2 * bytes + 1;
        room->data = malloc(room->room);
    }
    if (!room->data) return pack_out_of_memory(p);
    if (!store_read_tiles(&p->store, room->data, bytes, kept->offset)) return false;
    kept->offset += bytes;
    const uint8_t *data = room->data;
    for (int64_t i = 0; i < columns; i++) {
        const struct tile_entry *entry = &kept->entries[first + i];
        int64_t number = grid->first_tile[level] + ty * grid->tiles[level][0] + kept->tiles.x0 + i;
        uint32_t error_q = level < p->stages[0].coarse ? entry->error_q : a->errors[number];
        if (!put_tile(a, entry, error_q, data)) return false;
        data += entry->bytes;
    }
    return true;
}

static bool put_region_row(struct assembly *a, const struct stage *stage, int level, int64_t row)
{
    struct kept *kept = calloc((size_t)stage->columns, sizeof *kept);
    struct relief_bytes room = {0};
    bool good = kept || pack_out_of_memory(a->p);
    for (int64_t i = 0; good && i < stage->columns; i++)
        good = kept_read(a->p, stage, (int)(row * stage->columns + i), level, &kept[i]);
    for (int64_t ty = good ? kept[0].tiles.y0 : 0; good && ty < kept[0].tiles.y1; ty++)
        for (int64_t i = 0; good && i < stage->columns; i++)
            good = put_kept_row(a, &kept[i], level, ty, &room);
    for (int64_t i = 0; kept && i < stage->columns; i++) free(kept[i].entries);
    free(kept);
    free(room.data);
    return good;
}

// The errors of tiles above the first stage, and of whole levels, from what the regions of level 0 saw.
static bool gather_errors(struct assembly *a)
{
    struct pack *p = a->p;
    const struct grid *grid = &p->coder.grid;
    const struct stage *stage = &p->stages[0];
    size_t count = (size_t)grid->first_tile[stage->coarse - 1];
    a->errors = calloc(count + 1, sizeof *a->errors);
    struct region *r = malloc(sizeof *r);
    bool good = (a->errors && r) || pack_out_of_memory(p);
    for (int64_t i = 0; good && i < stage->columns * stage->rows; i++) {
        struct rect core = pack_core_of(p, stage, (int)i);
        region_plan(r, &p->coder, 0, stage->coarse, &core, true);
        size_t before = 0, skipped = entries_of(r, 0, &before) * sizeof(struct tile_entry);
        size_t beyond_count = region_beyond(r);
        uint32_t *beyond = malloc((beyond_count + 1) * sizeof *beyond), *next = beyond;
        squares_wide squares[LAYOUT_LEVELS];
        uint64_t offset = stage->regions[i].offset + skipped;
        good = beyond ? store_read_tiles(&p->store, squares, squares_bytes(p), offset) &&
                            store_read_tiles(&p->store, beyond, beyond_count * sizeof *beyond,
                                             offset + squares_bytes(p))
                      : pack_out_of_memory(p);
        for (int l = 1; good && l < grid->count; l++) a->squares[l] += squares[l];
        for (int l = stage->coarse; good && l < grid->count - 1; l++) {
            struct rect tiles = region_tiles_above(r, l);
            for (int64_t y = tiles.y0; y < tiles.y1; y++)
                for (int64_t x = tiles.x0; x < tiles.x1; x++, next++) {
                    uint32_t *error = &a->errors[grid->first_tile[l] + y * grid->tiles[l][0] + x];
                    if (*next > *error) *error = *next;
                }
        }
        free(beyond);
    }
    free(r);
    return good;
}

static bool put_payload(struct assembly *a)
{
    struct pack *p = a->p;
    if (p->stage_count > 0 && !gather_errors(a)) return false;
    if (p->stage_count == 0) memcpy(a->squares, p->top.squares, sizeof a->squares);
    for (int l = p->top.coarse - 1; l >= p->top.fine; l--)
        if (!put_top(a, l)) return false;
    for (int l = p->top.fine - 1; l >= 0; l--) {
        const struct stage *stage = &p->stages[l / STAGE_LEVELS];
        for (int64_t row = 0; row < stage->rows; row++)
            if (!put_region_row(a, stage, l, row)) return false;
    }
    return true;
}

static void put_level_errors(struct assembly *a)
{
    const struct region_sums *sums = &a->p->sums;
    for (int l = 1; l < a->p->coder.grid.count; l++)
        relief_put_double(&a->side, ldexp(sqrt((double)a->squares[l] / (double)sums->samples), -l));
}

static bool put_sections(struct assembly *a, struct relief_header *h)
{
    struct relief_bytes base = {0};
    put_base(a->p, &base);
    put_level_errors(a);
    const struct relief_bytes *const parts[3] = {&base, &a->index, &a->side};
    bool good = !base.full && !a->index.full && !a->side.full;
    h->payload_bytes = a->payload_bytes;
    h->base_bytes = base.size, h->index_bytes = a->index.size, h->side_bytes = a->side.size;
    if (good) {
        h->base_crc = relief_crc(base.data, base.size);
        h->index_crc = relief_crc(a->index.data, a->index.size);
        h->side_crc = relief_crc(a->side.data, a->side.size);
    }
    for (int i = 0; good && a->file && i < 3; i++)
        good = !parts[i]->size || fwrite(parts[i]->data, 1, parts[i]->size, a->file) == parts[i]->size;
    uint8_t bytes[RELIEF_HEADER];
    relief_header_write(h, bytes);
    if (good && a->file)
        good = fseek(a->file, 0, SEEK_SET) == 0 && fwrite(bytes, 1, sizeof bytes, a->file) == sizeof bytes &&
               fflush(a->file) == 0 && fsync(fileno(a->file)) == 0;
    free(base.data);
    return good;
}

bool pack_assemble(struct pack *p, struct relief_header *h)
{
    struct assembly a = {.p = p};
    char out[4300];
    const uint8_t nothing[RELIEF_HEADER] = {0};
    snprintf(out, sizeof out, "%s/out", p->store.folder);
    pack_progress_say(p, "putting together");
    if (p->has_store) {
        store_drop_levels(&p->store, p->top.fine); // a pack killed from here on codes the top again
        a.file = fopen(out, "wb");
        if (!a.file) return fail("%s: cannot be written (%s)", out, strerror(errno));
    }
    errno = 0;
    bool good = (!a.file || fwrite(nothing, 1, sizeof nothing, a.file) == sizeof nothing) &&
                put_payload(&a) && put_sections(&a, h);
    int error = errno;
    if (a.file && fclose(a.file) != 0 && good) good = false, error = errno;
    if (good && a.file && rename(out, p->store.path) != 0) good = false, error = errno;
    if (!good && !p->failed && !store_fail(&p->store)) {
        if (!p->store.error)
            fail("%s: cannot be written (%s)", p->store.path, error ? strerror(error) : "out of memory");
        p->failed = true;
    }
    free(a.index.data);
    free(a.side.data);
    free(a.errors);
    return good;
}
