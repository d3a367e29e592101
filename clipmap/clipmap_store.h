// The samples of one level at their toroidal slots (Losasso & Hoppe 2004, sections 3 and 5).  PURE: what is
// exposed is read from the terrain and handed to a writer, which puts it into a texture (or, in tests, into
// memory).
//
// A sample is the pair (z, z_c) in quanta: z the height in this level, z_c the height of the next coarser
// level's *surface* at the same place: a sample of it, the mean of two, or, in the middle of a cell, the mean
// of the two on the diagonal that is drawn, (i, j)-(i+1, j+1) (numerics.md, B4).  Levels are filtered, so z_c
// differs from z at shared places too.  Both are exact in float32.
//
// With a reader (common/terrain/reader.h) nothing is waited for: a move goes as far as what it would read is
// there, and asks for the rest.  SPDX-License-Identifier: MIT
#ifndef CLIPMAP_CLIPMAP_STORE_H
#define CLIPMAP_CLIPMAP_STORE_H

#include "clipmap/clipmap_levels.h"
#include "common/terrain/reader.h"

struct clipmap_range { // of heights, quanta
    int32_t low, high;
};

struct clipmap_store {
    const struct terrain *terrain; // borrowed
    struct terrain_reader *reader; // borrowed; NULL: all is there
    bool wait;                     // with a reader: it is asked, but what is read is waited for
    bool shaded;                   // with a reader: what the level's normals are made of has to be there, too
    int level;                     // of the terrain
    bool morphs;                   // false: the coarsest, z_c is z
    int size;                      // slots on a side
    struct clipmap_box clip;       // samples in memory
    int tiles;                     // slots on a side of `bounds`
    struct clipmap_tile { // bounds of z and z_c over a square of samples, aligned to multiples of its side
        int64_t at[2];    // which square, in sides
        struct clipmap_range range;
    } * bounds;
};

struct clipmap_scratch { // room for one refill, shared by the levels
    int32_t *fine, *coarse;
    float (*pairs)[2];
};

bool clipmap_store_init(struct clipmap_store *store, const struct terrain *terrain, int level, bool morphs,
                        int size);
void clipmap_store_finish(struct clipmap_store *store);
bool clipmap_scratch_init(struct clipmap_scratch *scratch, int size);
void clipmap_scratch_finish(struct clipmap_scratch *scratch);

// Takes a rectangle of slots, row by row northwards.
typedef void clipmap_write_fn(void *user, int slot_x, int slot_y, int width, int height,
                              const float (*pairs)[2]);

// Forgets what is outside of `target`, no larger than size x size, and reads what is missing of it, each
// sample once and no more than `budget` or than is there: the clip region stays a rectangle.  Returns how
// many it read.
uint64_t clipmap_store_move(struct clipmap_store *store, const struct clipmap_box *target, uint64_t budget,
                            const struct clipmap_scratch *scratch, clipmap_write_fn *write, void *user);

// Reads the pairs of a box, row by row, into scratch->pairs.
void clipmap_store_read(const struct clipmap_store *store, const struct clipmap_box *box,
                        const struct clipmap_scratch *scratch);

// What a move does with a box, part by part: the samples of the coarser level that a box needs, the bounds
// for culling of the squares that meet it (those in memory already are kept), and the pairs of a box out of
// scratch->fine (the box's samples) and, when the level morphs, scratch->coarse (those of clipmap_under).
struct clipmap_box clipmap_under(const struct clipmap_box *box);
void clipmap_store_bound(struct clipmap_store *store, const struct clipmap_box *box);
void clipmap_pair(const struct clipmap_box *box, bool morphs, const struct clipmap_scratch *scratch);

// Bounds of z and z_c over a box within the clip region; at most 7 samples looser on each side.  A function
// of the box alone.
struct clipmap_range clipmap_store_range(const struct clipmap_store *store, const struct clipmap_box *box);

#endif
