// SPDX-License-Identifier: MIT
#include "geomipmap/geomipmap_cache.h"

#include "common/report.h"

#include <stdlib.h>

enum { NONE = -1, FIRST_ROOM = 64 };

bool geomipmap_cache_init(struct geomipmap_cache *cache, int tile_count, int limit)
{
    *cache =
        (struct geomipmap_cache){.limit = limit, .tile_count = tile_count, .newest = NONE, .oldest = NONE};
    cache->slot_of = malloc((size_t)tile_count * sizeof *cache->slot_of);
    if (!cache->slot_of) return fail("geomipmap: no memory to keep track of %d tiles", tile_count);
    for (int tile = 0; tile < tile_count; tile++) cache->slot_of[tile] = NONE;
    return true;
}

void geomipmap_cache_finish(struct geomipmap_cache *cache)
{
    free(cache->slots);
    free(cache->slot_of);
    *cache = (struct geomipmap_cache){0};
}

size_t geomipmap_cache_bytes(const struct geomipmap_cache *cache)
{
    return (size_t)cache->slot_room * sizeof *cache->slots +
           (size_t)cache->tile_count * sizeof *cache->slot_of;
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
    *s = cache->slots[from];
    cache->slot_of[s->tile] = to;
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
    if (used >= cache->slot_count) return false;
    int gone = cache->oldest;
    unlink_slot(cache, gone);
    cache->slot_of[cache->slots[gone].tile] = NONE;
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

static bool add_slot(struct geomipmap_cache *cache)
{
    if (cache->limit > 0 && cache->slot_count >= cache->limit) return false;
    if (cache->slot_count == cache->slot_room) {
        int room = cache->slot_room ? 2 * cache->slot_room : FIRST_ROOM;
        struct geomipmap_cache_slot *slots = realloc(cache->slots, (size_t)room * sizeof *slots);
        if (!slots) return false;
        cache->slots = slots;
        cache->slot_room = room;
    }
    cache->slot_count++;
    cache->counts.grown++;
    return true;
}

enum geomipmap_found geomipmap_cache_find(struct geomipmap_cache *cache, int tile, int *slot)
{
    int found = cache->slot_of[tile];
    enum geomipmap_found result = found == NONE ? GEOMIPMAP_MISS : GEOMIPMAP_HIT;
    if (result == GEOMIPMAP_HIT) {
        unlink_slot(cache, found);
    } else if (cache->oldest != NONE && cache->slots[cache->oldest].batch != cache->batch) {
        found = cache->oldest;
        unlink_slot(cache, found);
        cache->slot_of[cache->slots[found].tile] = NONE;
        cache->counts.evictions++;
    } else if (add_slot(cache)) {
        found = cache->slot_count - 1;
        cache->slots[found].batch = 0;
    } else {
        return GEOMIPMAP_FULL;
    }
    struct geomipmap_cache_slot *s = &cache->slots[found];
    if (result == GEOMIPMAP_HIT)
        cache->counts.hits++;
    else
        cache->counts.misses++;
    // Batch 0 is no batch, so a slot that was just added counts as well.
    if (s->batch != cache->batch) cache->used++;
    s->batch = cache->batch;
    s->tile = tile;
    cache->slot_of[tile] = found;
    link_newest(cache, found);
    *slot = found;
    return result;
}
