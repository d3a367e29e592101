// Which slot holds which tile: the least-recently-used manager of Brodersen 2005, section 5.  No GL.
//
// Tiles have names, any numbers: what is kept depends on the tiles that are asked for, not on how many there
// are.
//
// A tile that is asked for and has no slot takes the least recently used one.  A slot is never used twice
// in a frame: when all were used in this one, the cache grows by a slot instead.  When a frame used fewer
// slots than there are, the next frame begins by giving one back, and one only.  Slots are always 0 ..
// slots-1, so that the buffer behind them can follow.
//
// A cache with a limit may not grow beyond it.  Then a full cache says so: the caller draws what it has
// asked for so far, begins a new batch and goes on.  With fewer slots than a frame needs, every tile is
// uploaded in every frame.
//
// A cache that keeps some slots takes no used one and gives none back while it has no more than those: what
// is dear to make again outlives the frames that do not ask for it.
// SPDX-License-Identifier: MIT
#ifndef GEOMIPMAP_GEOMIPMAP_CACHE_H
#define GEOMIPMAP_GEOMIPMAP_CACHE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum geomipmap_found {
    GEOMIPMAP_HIT,  // the slot holds the tile
    GEOMIPMAP_MISS, // the slot is the tile's now; the caller must fill it
    GEOMIPMAP_FULL, // no slot: all were used in this batch, or there is no memory for another
};

struct geomipmap_cache_slot {
    uint64_t tile;    // the name of the tile it holds
    int newer, older; // neighbours in order of use; -1: none
    uint64_t batch;   // in which it was last used
};

struct geomipmap_cache {
    int limit; // most slots; 0: as many as a frame uses
    int kept;  // slots that are kept in any case
    int slot_count, slot_room;
    struct geomipmap_cache_slot *slots;
    int32_t *table; // slots by a hash of their tiles, 1 << table_bits entries with gaps; -1: none
    int table_bits;
    int newest, oldest;
    uint64_t batch;
    int used; // slots asked for in this frame, each batch counted
    struct geomipmap_cache_counts {
        uint64_t hits, misses, evictions, grown, shrunk; // since init
    } counts;
};

bool geomipmap_cache_init(struct geomipmap_cache *cache, int limit, int kept); // false after one line
size_t geomipmap_cache_bytes(const struct geomipmap_cache *cache);
void geomipmap_cache_finish(struct geomipmap_cache *cache); // accepts a zeroed cache

// Begins a frame.  True when a slot was given back and the content of slot `*from` (the last one, which is
// gone) must be copied to slot `*to`.
bool geomipmap_cache_begin_frame(struct geomipmap_cache *cache, int *from, int *to);

// Begins a batch within a frame: slots used so far may be taken again.
void geomipmap_cache_begin_batch(struct geomipmap_cache *cache);

// Asks for a tile's slot and makes it the most recently used.
enum geomipmap_found geomipmap_cache_find(struct geomipmap_cache *cache, uint64_t tile, int *slot);

#endif
