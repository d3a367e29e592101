// A cache of buffers of one size under a fixed ceiling: the least recently used one goes first.  Thread-safe;
// a buffer is filled by whoever takes it first, others wait for it.  What a buffer holds follows from its key
// alone, so results do not depend on what happens to be kept.
// SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_SLOTS_H
#define COMMON_TERRAIN_SLOTS_H

#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct slot_key {
    int64_t x, y;
    int level;
};

struct slot {
    struct slot_key key;
    void *data;
    int pins; // readers and the one who fills it
    enum { SLOT_FREE, SLOT_FILLING, SLOT_FULL } state;
    int32_t next;         // in its bucket
    int32_t older, newer; // in order of use; -1: none
};

struct slots {
    size_t slot_bytes;
    int32_t count, used; // used: slots that have had a buffer
    struct slot *all;
    int32_t *buckets, bucket_count; // first slot of each; a power of two
    int32_t oldest, newest;
    pthread_mutex_t lock;
    pthread_cond_t filled;
};

// Room for `count` buffers, at least one, allocated as they are needed.  False when memory runs out.
bool slots_init(struct slots *slots, size_t slot_bytes, int32_t count);
void slots_finish(struct slots *slots); // accepts a zeroed struct

// The buffer of a key, pinned until slots_release; waits while another thread fills it.  *fill: it is the
// caller's to fill, and to pass to slots_filled before it is released.  NULL: all buffers are pinned, or
// memory ran out.
struct slot *slots_take(struct slots *slots, struct slot_key key, bool *fill);
void slots_filled(struct slots *slots, struct slot *slot);
void slots_release(struct slots *slots, struct slot *slot);

// Whether the buffer is there and filled by now; it then counts as used.
bool slots_hold(struct slots *slots, struct slot_key key);

size_t slots_bytes(struct slots *slots); // allocated by now

#endif
