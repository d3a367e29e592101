// SPDX-License-Identifier: MIT
#include "common/terrain/reader.h"

#include "common/report.h"
#include "common/terrain/detail.h"
#include "common/terrain/paged.h"
#include "common/terrain/terrain_parts.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { NONE = -1, AHEAD_FRAMES = 4 }; // beyond the frame in which what is asked for now arrives

enum entry_state { ENTRY_FREE, ENTRY_COMING, ENTRY_THERE };

struct entry { // a block that has arrived or is on its way
    struct slot_key key;
    enum entry_state state;
    int64_t due;          // time at which it arrives
    int32_t next;         // in its bucket, or of the free ones
    int32_t older, newer; // THERE: in order of use.  COMING: in order of arrival
};

struct entry_list {
    int32_t oldest, newest, count;
};

struct window { // in blocks; empty: none
    int level;
    struct terrain_extent blocks;
};

struct terrain_reader {
    const struct terrain *terrain;
    struct paged *paged;  // NULL: in memory
    bool realtime, waits; // waits: for whatever is asked for
    int64_t now;
    int frame;                    // of begin_frame; -1: none yet
    double place_m[2], step_m[2]; // where the viewer is and how far it moves a frame
    bool blocked;                 // a window of this frame was not there
    struct window first;          // the first such, of this frame or the one before
    int32_t keep, budget, left;   // blocks: kept, a frame, left of this frame's
    int latency;
    struct entry *entries;
    int32_t *buckets, bucket_count, free;
    struct entry_list there, coming;
    struct slot_key *ahead; // asked for after all that is needed
    int32_t ahead_count;
    struct terrain_reader_counters counters;
};

// ---- lists -----------------------------------------------------------------

static void append(struct terrain_reader *r, struct entry_list *list, int32_t index)
{
    struct entry *entry = &r->entries[index];
    entry->older = list->newest;
    entry->newer = NONE;
    *(list->newest == NONE ? &list->oldest : &r->entries[list->newest].newer) = index;
    list->newest = index;
    list->count++;
}

static void take_out(struct terrain_reader *r, struct entry_list *list, int32_t index)
{
    struct entry *entry = &r->entries[index];
    *(entry->older == NONE ? &list->oldest : &r->entries[entry->older].newer) = entry->newer;
    *(entry->newer == NONE ? &list->newest : &r->entries[entry->newer].older) = entry->older;
    list->count--;
}

static int32_t *bucket_of(struct terrain_reader *r, struct slot_key key)
{
    uint64_t z = (uint64_t)key.x * 0x9e3779b97f4a7c15u ^ (uint64_t)key.y * 0xbf58476d1ce4e5b9u ^
                 (uint64_t)(int64_t)key.level * 0x94d049bb133111ebu;
    return &r->buckets[((z ^ z >> 29) * 0xd6e8feb86659fd93u >> 40) & (uint64_t)(r->bucket_count - 1)];
}

static int32_t find(struct terrain_reader *r, struct slot_key key)
{
    int32_t i = *bucket_of(r, key);
    for (; i != NONE; i = r->entries[i].next) {
        const struct slot_key *k = &r->entries[i].key;
        if (k->x == key.x && k->y == key.y && k->level == key.level) break;
    }
    return i;
}

// ---- blocks ----------------------------------------------------------------

// Sends for a block; false: it is on its way already, or no room is left.
static bool send_for(struct terrain_reader *r, struct slot_key key, int64_t asked)
{
    if (r->left < 1 || r->free == NONE || find(r, key) != NONE) return false;
    int32_t index = r->free, *bucket = bucket_of(r, key);
    struct entry *entry = &r->entries[index];
    r->free = entry->next;
    entry->key = key;
    entry->state = ENTRY_COMING;
    entry->due = asked + r->latency;
    entry->next = *bucket;
    *bucket = index;
    append(r, &r->coming, index);
    r->left--;
    paged_request(r->paged, key);
    return true;
}

static void evict_oldest(struct terrain_reader *r)
{
    int32_t index = r->there.oldest;
    struct entry *entry = &r->entries[index];
    int32_t *link = bucket_of(r, entry->key);
    take_out(r, &r->there, index);
    while (*link != index) link = &r->entries[*link].next;
    *link = entry->next;
    entry->state = ENTRY_FREE;
    entry->next = r->free;
    r->free = index;
    r->counters.evicted++;
}

// Keeps a window's blocks from being evicted.
static void use(struct terrain_reader *r, const struct window *window)
{
    const struct terrain_extent *blocks = &window->blocks;
    for (int64_t y = blocks->y0; y < blocks->y1; y++)
        for (int64_t x = blocks->x0; x < blocks->x1; x++) {
            int32_t index = find(r, (struct slot_key){x, y, window->level});
            if (index == NONE || r->entries[index].state != ENTRY_THERE) continue;
            take_out(r, &r->there, index);
            append(r, &r->there, index);
            paged_holds(r->paged, r->entries[index].key);
        }
}

static void receive(struct terrain_reader *r)
{
    while (r->coming.count && r->entries[r->coming.oldest].due <= r->now) {
        int32_t index = r->coming.oldest;
        take_out(r, &r->coming, index);
        r->entries[index].state = ENTRY_THERE;
        append(r, &r->there, index);
        r->counters.arrived++;
    }
    // Whatever else has arrived or is in use: the window that was missed first is complete in the end.
    use(r, &r->first);
    while (r->there.count > r->keep) evict_oldest(r);
}

// ---- making ----------------------------------------------------------------

static bool allocate(struct terrain_reader *r)
{
    int32_t count = r->keep + r->budget * (r->latency + 1) + 1;
    for (r->bucket_count = 2; r->bucket_count < count;) r->bucket_count *= 2;
    r->entries = calloc((size_t)count, sizeof *r->entries);
    r->buckets = malloc((size_t)r->bucket_count * sizeof *r->buckets);
    r->ahead = malloc((size_t)r->budget * sizeof *r->ahead);
    if (!r->entries || !r->buckets || !r->ahead) return false;
    for (int32_t i = 0; i < r->bucket_count; i++) r->buckets[i] = NONE;
    for (int32_t i = 0; i < count; i++) r->entries[i].next = i + 1 < count ? i + 1 : NONE;
    r->there = r->coming = (struct entry_list){NONE, NONE, 0};
    return true;
}

struct terrain_reader *terrain_reader_create(const struct terrain *terrain, bool realtime)
{
    struct terrain_reader *r = calloc(1, sizeof *r);
    if (r) {
        *r = (struct terrain_reader){
            .terrain = terrain, .paged = terrain->paged, .realtime = realtime, .frame = -1};
        if (!r->paged) return r;
        int32_t blocks = paged_block_count(r->paged);
        int64_t most = paged_frame_samples(r->paged) / (PAGED_BLOCK * PAGED_BLOCK);
        r->waits = paged_frame_samples(r->paged) < 0;
        r->latency = paged_latency(r->paged);
        r->keep = blocks > 3 ? blocks / 4 * 3 : 1; // the rest: blocks that others are decoded from
        int32_t share = r->keep / (2 * r->latency);
        r->budget = share < most ? share : (int32_t)most;
        if (r->budget < 1) r->budget = 1;
        r->left = r->budget;
        if (allocate(r)) return r;
    }
    terrain_reader_destroy(r);
    fail("terrain %s: out of memory", terrain_info(terrain)->name);
    return NULL;
}

void terrain_reader_destroy(struct terrain_reader *reader)
{
    if (!reader) return;
    free(reader->entries);
    free(reader->buckets);
    free(reader->ahead);
    free(reader);
}

// ---- a frame ---------------------------------------------------------------

static void look_where_it_goes(struct terrain_reader *r, int steps, bool onwards, const double place_m[2])
{
    for (int k = 0; k < 2; k++) {
        r->step_m[k] = onwards ? (place_m[k] - r->place_m[k]) / steps : 0;
        r->place_m[k] = place_m[k];
    }
}

void terrain_reader_begin_frame(struct terrain_reader *r, int frame, const double place_m[2])
{
    r->counters = (struct terrain_reader_counters){0};
    if (!r->paged) return;
    bool onwards = r->frame >= 0 && frame > r->frame;
    int steps = onwards ? frame - r->frame : 1;
    for (int32_t i = 0; i < r->ahead_count; i++) {
        if (r->realtime)
            paged_request(r->paged, r->ahead[i]);
        else
            send_for(r, r->ahead[i], r->now);
    }
    r->ahead_count = 0;
    if (!r->blocked) r->first = (struct window){0};
    r->now += steps;
    r->frame = frame;
    r->blocked = false;
    receive(r);
    r->left = r->budget * (r->latency + 1) - r->coming.count; // what there are entries for
    if (r->left > (int64_t)r->budget * steps) r->left = r->budget * steps;
    look_where_it_goes(r, steps, onwards, place_m);
}

static bool same_blocks(const struct terrain_extent *a, const struct terrain_extent *b)
{
    return a->x0 == b->x0 && a->y0 == b->y0 && a->x1 == b->x1 && a->y1 == b->y1;
}

// Notes the blocks that the window will touch a little after what is asked for now has arrived.
static void look_ahead(struct terrain_reader *r, int level, int64_t x0, int64_t y0, int width, int height,
                       const struct terrain_extent *blocks)
{
    const struct terrain_info *info = terrain_info(r->terrain);
    int64_t shift[2];
    for (int k = 0; k < 2; k++) {
        double samples = r->step_m[k] * (r->latency + AHEAD_FRAMES) / ldexp(info->spacing_m[k], level);
        if (!(fabs(samples) < 1e9)) return;
        shift[k] = (int64_t)rint(samples);
    }
    struct terrain_extent then = paged_blocks(r->paged, level, x0 + shift[0], y0 + shift[1], width, height);
    if (same_blocks(&then, blocks)) return;
    for (int64_t y = then.y0; y < then.y1; y++)
        for (int64_t x = then.x0; x < then.x1 && r->ahead_count < r->budget; x++) {
            struct slot_key key = {x, y, level};
            if (r->realtime ? !paged_holds(r->paged, key) : find(r, key) == NONE)
                r->ahead[r->ahead_count++] = key;
        }
}

// Sends for what is missing of a window; true when nothing is.
static bool is_there(struct terrain_reader *r, int level, const struct terrain_extent *blocks)
{
    bool there = true;
    for (int64_t y = blocks->y0; y < blocks->y1; y++)
        for (int64_t x = blocks->x0; x < blocks->x1; x++) {
            struct slot_key key = {x, y, level};
            int32_t index = find(r, key);
            if (index != NONE && r->entries[index].state == ENTRY_THERE) continue;
            there = false;
            send_for(r, key, r->now);
        }
    return there;
}

struct asking {
    struct terrain_reader *reader;
    bool there;
};

// Of one window of the file; goes on whatever comes of it.
static bool ask_for(void *user, int level, int64_t x0, int64_t y0, int width, int height)
{
    struct asking *asking = user;
    struct terrain_reader *r = asking->reader;
    struct terrain_extent blocks = paged_blocks(r->paged, level, x0, y0, width, height);
    int64_t count = (blocks.x1 - blocks.x0) * (blocks.y1 - blocks.y0);
    bool fits = count <= r->keep && !r->waits, there = true;
    if (!r->waits) look_ahead(r, level, x0, y0, width, height, &blocks);
    if (fits && r->realtime) there = paged_window(r->paged, level, x0, y0, width, height, NULL, TERRAIN_TRY);
    if (fits && !r->realtime) {
        there = is_there(r, level, &blocks);
        const struct window window = {level, blocks};
        // Of what is not there only the first window holds on to its blocks.
        if (there || !r->blocked) use(r, &window);
        if (!there && !r->blocked) r->first = window;
    }
    r->blocked = r->blocked || !there;
    asking->there = asking->there && there;
    return true;
}

bool terrain_reader_window(struct terrain_reader *r, int level, int64_t x0, int64_t y0, int width, int height,
                           int32_t *out)
{
    r->counters.asked++;
    if (width < 1 || height < 1) return true;
    if (r->paged) {
        struct asking asking = {r, true};
        if (paged_planet(r->paged)) {
            // Detail is made on demand, from the stored samples under it.
            struct terrain_extent e = detail_under(terrain_detail(r->terrain), level, x0, y0, width, height);
            paged_planet_pieces(r->paged, level < 0 ? 0 : level, e.x0, e.y0, (int)(e.x1 - e.x0),
                                (int)(e.y1 - e.y0), ask_for, &asking);
        } else
            ask_for(&asking, level, x0, y0, width, height);
        r->counters.missed += !asking.there;
        if (!asking.there) return false;
    }
    return !out || terrain_window(r->terrain, level, x0, y0, width, height, out, TERRAIN_WAIT);
}

struct terrain_reader_counters terrain_reader_counters(const struct terrain_reader *reader)
{
    return reader->counters;
}

bool terrain_reader_idle(const struct terrain_reader *reader)
{
    return reader->coming.count == 0 && !reader->blocked && reader->ahead_count == 0;
}
