// The folder OUT.part, in which a map is packed: a journal of what is done, the levels that later steps read,
// the regions' tiles.  Killed at any moment, what the journal tells is there.
//
//   journal    records of one size, each with its checksum; a torn one at the end is forgotten
//   wanted-NN, level-NN   a level before and after coding: int32, row by row northwards, internal units
//   tiles      what coded regions give, in the order in which they were finished
//   out        the file to be, when it is put together
//
// What goes wrong with files is kept and told once, by store_fail.  SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_RELIEF_PACK_STORE_H
#define COMMON_TERRAIN_RELIEF_PACK_STORE_H

#include "common/terrain/relief/layout.h"

#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum store_kind { STORE_BEGUN = 1, STORE_REDUCED, STORE_STEP, STORE_CODED, STORE_DROPPED };

struct store_record { // the fields that a kind uses; the others are 0
    uint32_t kind, stage, attempt, region;
    uint64_t identity; // begun: of the source and the options
    uint64_t offset, bytes;
    uint64_t squares[2];
    int64_t samples, most;
    int32_t min_q, max_q;
    double step;
    int32_t lambda_65536;
    uint32_t uneven, unused;
    uint32_t crc;
};

enum store_level { STORE_WANTED, STORE_DECODED, STORE_LEVELS };

struct pack_store {
    char folder[4160], path[4096]; // of the work, of the file to be
    int journal, tiles;
    int levels[STORE_LEVELS][LAYOUT_LEVELS]; // -1: not open
    int64_t width[LAYOUT_LEVELS];
    uint64_t tiles_bytes;
    pthread_mutex_t lock;
    int error; // the first that a file gave, and which
    char wrong[32];
};

// Opens or makes the folder; `restart` empties it first.  Gives the records that the journal holds, which the
// caller frees.  False after one line on stderr.
bool store_open(struct pack_store *store, const char *path, bool restart, struct store_record **records,
                size_t *count);
void store_close(struct pack_store *store);
void store_remove(struct pack_store *store); // closes, and removes the folder with all that is in it

// False when a file does not serve (store_fail tells); safe in any thread.
bool store_note(struct pack_store *store, struct store_record *record);
bool store_write_level(struct pack_store *store, enum store_level kind, int level, const struct patch *from,
                       const struct rect *part);
bool store_read_level(struct pack_store *store, enum store_level kind, int level, const struct patch *to);
bool store_has_level(const struct pack_store *store, enum store_level kind, int level);
void store_drop_level(struct pack_store *store, enum store_level kind, int level);
void store_drop_levels(struct pack_store *store, int kept); // but the wanted level `kept`
bool store_add_tiles(struct pack_store *store, const void *data, size_t bytes, uint64_t *offset);
bool store_read_tiles(struct pack_store *store, void *data, size_t bytes, uint64_t offset);
bool store_forget_tiles(struct pack_store *store); // all of them: another attempt begins
bool store_fail(struct pack_store *store);         // prints what went wrong, if anything did; returns false

#endif
