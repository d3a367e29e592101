// SPDX-License-Identifier: MIT
#include "common/terrain/slots.h"

#include <stdlib.h>
#include <string.h>

enum { NONE = -1 };

bool slots_init(struct slots *slots, size_t slot_bytes, int32_t count)
{
    memset(slots, 0, sizeof *slots);
    slots->slot_bytes = slot_bytes;
    slots->count = count < 1 ? 1 : count;
    slots->oldest = slots->newest = NONE;
    for (slots->bucket_count = 2; slots->bucket_count < slots->count;) slots->bucket_count *= 2;
    slots->all = calloc((size_t)slots->count, sizeof *slots->all);
    slots->buckets = malloc((size_t)slots->bucket_count * sizeof *slots->buckets);
    pthread_mutex_init(&slots->lock, NULL);
    pthread_cond_init(&slots->filled, NULL);
    for (int32_t i = 0; slots->buckets && i < slots->bucket_count; i++) slots->buckets[i] = NONE;
    return slots->all && slots->buckets;
}

void slots_finish(struct slots *slots)
{
    if (!slots->slot_bytes) return;
    for (int32_t i = 0; slots->all && i < slots->used; i++) free(slots->all[i].data);
    free(slots->all);
    free(slots->buckets);
    pthread_mutex_destroy(&slots->lock);
    pthread_cond_destroy(&slots->filled);
    memset(slots, 0, sizeof *slots);
}

// ---- by key ----------------------------------------------------------------

static int32_t *bucket_of(struct slots *slots, struct slot_key key)
{
    uint64_t z = (uint64_t)key.x * 0x9e3779b97f4a7c15u ^ (uint64_t)key.y * 0xbf58476d1ce4e5b9u ^
                 (uint64_t)(int64_t)key.level * 0x94d049bb133111ebu;
    z ^= z >> 29;
    return &slots->buckets[(z * 0xd6e8feb86659fd93u >> 40) & (uint64_t)(slots->bucket_count - 1)];
}

static struct slot *find(struct slots *slots, struct slot_key key)
{
    for (int32_t i = *bucket_of(slots, key); i != NONE; i = slots->all[i].next) {
        struct slot *slot = &slots->all[i];
        if (slot->key.x == key.x && slot->key.y == key.y && slot->key.level == key.level) return slot;
    }
    return NULL;
}

static void leave_bucket(struct slots *slots, struct slot *slot)
{
    int32_t *link = bucket_of(slots, slot->key);
    while (&slots->all[*link] != slot) link = &slots->all[*link].next;
    *link = slot->next;
}

// ---- by use ----------------------------------------------------------------

static void unlink_slot(struct slots *slots, struct slot *slot)
{
    *(slot->older == NONE ? &slots->oldest : &slots->all[slot->older].newer) = slot->newer;
    *(slot->newer == NONE ? &slots->newest : &slots->all[slot->newer].older) = slot->older;
}

static void link_newest(struct slots *slots, struct slot *slot)
{
    int32_t index = (int32_t)(slot - slots->all);
    slot->older = slots->newest;
    slot->newer = NONE;
    *(slots->newest == NONE ? &slots->oldest : &slots->all[slots->newest].newer) = index;
    slots->newest = index;
}

// A slot that nobody needs, out of all lists; NULL: there is none.
static struct slot *spare(struct slots *slots)
{
    if (slots->used < slots->count) {
        struct slot *slot = &slots->all[slots->used];
        slot->data = malloc(slots->slot_bytes);
        if (slot->data) return slots->used++, slot;
    }
    for (int32_t i = slots->oldest; i != NONE; i = slots->all[i].newer) {
        struct slot *slot = &slots->all[i];
        if (slot->pins > 0) continue;
        unlink_slot(slots, slot);
        leave_bucket(slots, slot);
        return slot;
    }
    return NULL;
}

// ---- taking and giving back ------------------------------------------------

struct slot *slots_take(struct slots *slots, struct slot_key key, bool *fill)
{
    *fill = false;
    pthread_mutex_lock(&slots->lock);
    struct slot *slot = find(slots, key);
    if (slot) {
        slot->pins++;
        while (slot->state == SLOT_FILLING) pthread_cond_wait(&slots->filled, &slots->lock);
        unlink_slot(slots, slot);
        link_newest(slots, slot);
    } else if ((slot = spare(slots))) {
        int32_t *bucket = bucket_of(slots, key);
        *fill = true;
        slot->key = key;
        slot->pins = 1;
        slot->state = SLOT_FILLING;
        slot->next = *bucket;
        *bucket = (int32_t)(slot - slots->all);
        link_newest(slots, slot);
    }
    pthread_mutex_unlock(&slots->lock);
    return slot;
}

void slots_filled(struct slots *slots, struct slot *slot)
{
    pthread_mutex_lock(&slots->lock);
    slot->state = SLOT_FULL;
    pthread_cond_broadcast(&slots->filled);
    pthread_mutex_unlock(&slots->lock);
}

void slots_release(struct slots *slots, struct slot *slot)
{
    pthread_mutex_lock(&slots->lock);
    slot->pins--;
    pthread_mutex_unlock(&slots->lock);
}

bool slots_hold(struct slots *slots, struct slot_key key)
{
    pthread_mutex_lock(&slots->lock);
    struct slot *slot = find(slots, key);
    bool held = slot && slot->state == SLOT_FULL;
    if (held) {
        unlink_slot(slots, slot);
        link_newest(slots, slot);
    }
    pthread_mutex_unlock(&slots->lock);
    return held;
}

size_t slots_bytes(struct slots *slots)
{
    pthread_mutex_lock(&slots->lock);
    size_t bytes = (size_t)slots->used * slots->slot_bytes + (size_t)slots->count * sizeof *slots->all +
                   (size_t)slots->bucket_count * sizeof *slots->buckets;
    pthread_mutex_unlock(&slots->lock);
    return bytes;
}
