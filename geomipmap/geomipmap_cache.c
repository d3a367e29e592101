// SPDX-License-Identifier: MIT
#include "geomipmap/geomipmap_cache.h"

#include "common/report.h"

#include <stdlib.h>

enum { NONE = -1, FIRST_ROOM = 64, FIRST_BITS = 7 };

// Tables stay at most three quarters full.
static size_t table_size(const struct geomipmap_cache *cache)
{
    return (size_t)1 << cache->table_bits;
}

static bool make_table(struct geomipmap_cache *cache, int bits)
{
    int32_t *table = malloc(((size_t)1 << bits) * sizeof *table);
    if (!table) return false;
    free(cache->table);
    cache->table = table;
    cache->table_bits = bits;
    for (size_t i = 0; i < table_size(cache); i++) table[i] = NONE;
    return true;
}

bool geomipmap_cache_init(struct geomipmap_cache *cache, int limit, int kept)
{
    *cache = (struct geomipmap_cache){.limit = limit, .kept = kept, .newest = NONE, .oldest = NONE};
    return make_table(cache, FIRST_BITS) || fail("geomipmap: no memory to keep track of tiles");
}

void geomipmap_cache_finish(struct geomipmap_cache *cache)
{
    free(cache->slots);
    free(cache->table);
    *cache = (struct geomipmap_cache){0};
}

size_t geomipmap_cache_bytes(const struct geomipmap_cache *cache)
{
    return (size_t)cache->slot_room * sizeof *cache->slots +
           (cache->table ? table_size(cache) * sizeof *cache->table : 0);
}

// ---- slots by tile: linear probing --------------------------------------------------------------

static size_t home_of(const struct geomipmap_cache *cache, uint64_t tile)
{
    return (size_t)(tile * 0x9e3779b97f4a7c15u >> (64 - cache->table_bits));
}

// Where a tile's slot stands in the table, or the gap where it would.
static size_t entry_of(const struct geomipmap_cache *cache, uint64_t tile)
{
    size_t mask = table_size(cache) - 1, at = home_of(cache, tile);
    while (cache->table[at] != NONE && cache->slots[cache->table[at]].tile != tile) at = (at + 1) & mask;
    return at;
}

// Closes the gap behind it, so that no search ends there too early.
static void forget_tile(struct geomipmap_cache *cache, uint64_t tile)
{
    size_t mask = table_size(cache) - 1, gap = entry_of(cache, tile);
    for (size_t at = (gap + 1) & mask; cache->table[at] != NONE; at = (at + 1) & mask) {
        size_t home = home_of(cache, cache->slots[cache->table[at]].tile);
        if (((at - home) & mask) < ((at - gap) & mask)) continue;
        cache->table[gap] = cache->table[at];
        gap = at;
    }
    cache->table[gap] = NONE;
}

// ---- the list, newest to oldest -----------------------------------------------------------------

static void unlink_slot(struct geomipmap_cache *cache, int slot)
{
    struct geomipmap_cache_slot *s = &cache->slots[slot];
    if (s->newer != NONE)
        cache->slots[s->newer].older = s->older;
    else
        cache->newest = s->older;
    if (s->older != NONE)
        cache->slots[s->older].newer = s->newer;
    else
        cache->oldest = s->newer;
}

static void link_newest(struct geomipmap_cache *cache, int slot)
{
    struct geomipmap_cache_slot *s = &cache->slots[slot];
    s->newer = NONE;
    s->older = cache->newest;
    if (cache->newest != NONE)
        cache->slots[cache->newest].newer = slot;
    else
        cache->oldest = slot;
    cache->newest = slot;
}

// Gives slot `from` the number `to`, which is free.
static void renumber_slot(struct geomipmap_cache *cache, int from, int to)
{
    struct geomipmap_cache_slot *s = &cache->slots[to];
    cache->table[entry_of(cache, cache->slots[from].tile)] = to;
    *s = cache->slots[from];
    if (s->newer != NONE)
        cache->slots[s->newer].older = to;
    else
        cache->newest = to;
    if (s->older != NONE)
        cache->slots[s->older].newer = to;
    else
        cache->oldest = to;
}

// ---- frames and requests ------------------------------------------------------------------------

bool geomipmap_cache_begin_frame(struct geomipmap_cache *cache, int *from, int *to)
{
    int used = cache->used, last = cache->slot_count - 1;
    cache->used = 0;
    cache->batch++;
    if (used >= cache->slot_count || cache->slot_count <= cache->kept) return false;
    int gone = cache->oldest;
    unlink_slot(cache, gone);
    forget_tile(cache, cache->slots[gone].tile);
    cache->slot_count--;
    cache->counts.shrunk++;
    if (gone == last) return false;
    renumber_slot(cache, last, gone);
    *from = last;
    *to = gone;
    return true;
}

void geomipmap_cache_begin_batch(struct geomipmap_cache *cache)
{
    cache->batch++;
}

static bool make_room(struct geomipmap_cache *cache)
{
    int room = cache->slot_room ? cache->slot_room + cache->slot_room / 16 : FIRST_ROOM;
    struct geomipmap_cache_slot *slots = realloc(cache->slots, (size_t)room * sizeof *slots);
    if (!slots) return false;
    cache->slots = slots;
    if (4 * (size_t)room > 3 * table_size(cache)) {
        if (!make_table(cache, cache->table_bits + 1)) return false;
        for (int slot = 0; slot < cache->slot_count; slot++)
            cache->table[entry_of(cache, slots[slot].tile)] = slot;
    }
    cache->slot_room = room;
    return true;
}

static bool add_slot(struct geomipmap_cache *cache)
{
    if (cache->limit > 0 && cache->slot_count >= cache->limit) return false;
    if (cache->slot_count == cache->slot_room && !make_room(cache)) return false;
    cache->slot_count++;
    cache->counts.grown++;
    return true;
}

// A slot for a tile that has none; NONE: there is no room.
static int take_slot(struct geomipmap_cache *cache)
{
    bool used = cache->oldest == NONE || cache->slots[cache->oldest].batch == cache->batch;
    if ((used || cache->slot_count < cache->kept) && add_slot(cache)) {
        cache->slots[cache->slot_count - 1].batch = 0;
        return cache->slot_count - 1;
    }
    if (used) return NONE;
    int slot = cache->oldest;
    unlink_slot(cache, slot);
    forget_tile(cache, cache->slots[slot].tile);
    cache->counts.evictions++;
    return slot;
}

enum geomipmap_found geomipmap_cache_find(struct geomipmap_cache *cache, uint64_t tile, int *slot)
{
    int found = cache->table[entry_of(cache, tile)];
    enum geomipmap_found result = found == NONE ? GEOMIPMAP_MISS : GEOMIPMAP_HIT;
    if (result == GEOMIPMAP_HIT) {
        unlink_slot(cache, found);
        cache->counts.hits++;
    } else {
        found = take_slot(cache);
        if (found == NONE) return GEOMIPMAP_FULL;
        cache->slots[found].tile = tile;
        cache->table[entry_of(cache, tile)] = found;
        cache->counts.misses++;
    }
    struct geomipmap_cache_slot *s = &cache->slots[found];
    // Batch 0 is no batch, so a slot that was just added counts as well.
    if (s->batch != cache->batch) cache->used++;
    s->batch = cache->batch;
    link_newest(cache, found);
    *slot = found;
    return result;
}
