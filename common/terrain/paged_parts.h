// What the two halves of a demand-read terrain share: paged.c opens and describes, paged_read.c reads.
// SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_PAGED_PARTS_H
#define COMMON_TERRAIN_PAGED_PARTS_H

#include "common/integer.h"
#include "common/terrain/paged.h"
#include "common/terrain/pyramid.h"
#include "common/terrain/relief/relief_file.h"
#include "common/terrain/synthesis.h"
#include "common/terrain/upsample.h"

#include <stdatomic.h>

static inline int64_t clamp(int64_t value, int64_t low, int64_t high)
{
    return value < low ? low : value > high ? high : value;
}

enum { PAGED_MAX_WORKERS = 16, PAGED_REQUESTS = 4096 };

struct paged_map {                  // one level
    int64_t stored[2];              // samples that the file or synthesis has
    int64_t size[2];                // with the column and row that continue it
    struct terrain_extrema extrema; // levels of the file with tiles
    int32_t min_q, max_q;
    double rms_error_q, max_error_q; // against the finest
    double sigma_q;
};

struct paged_workers {
    pthread_t threads[PAGED_MAX_WORKERS];
    int wanted, started;
    pthread_mutex_t lock;
    pthread_cond_t asked;
    struct slot_key queue[PAGED_REQUESTS]; // a ring
    int first, count;
    bool stop;
};

struct paged {
    struct relief *relief;
    const struct relief_header *header;
    const struct grid *grid;
    struct terrain_options options;
    struct synthesis_table table; // of the noise
    int bits;                     // that the quantum is refined by
    int finest, coarsest;
    struct relief_planet planet;    // when the header has a radius
    double noise_log2, noise_slope; // of synthesised levels
    struct paged_map maps[PYRAMID_MAX_FINER + LAYOUT_LEVELS];
    struct slots blocks, pages;
    bool ready;         // paged_read_init was here
    bool keeps_parents; // blocks are decoded from blocks of the coarser level
    atomic_bool failed;
    struct paged_workers workers;
};

static inline struct paged_map *paged_map(const struct paged *paged, int level)
{
    return (struct paged_map *)&paged->maps[level + PYRAMID_MAX_FINER];
}

static inline int32_t paged_limit(int64_t q)
{
    return q > QUANTA_LIMIT ? QUANTA_LIMIT : q < -QUANTA_LIMIT ? -QUANTA_LIMIT : (int32_t)q;
}

// paged_read.c
// Samples of a rectangle inside what is stored, in quanta, rows `stride` apart, which may be negative.
bool paged_rect(struct paged *paged, int level, const struct rect *rect, int32_t *out, int64_t stride);
// The same of a rectangle and of one of the coarser level, row by row, of a level of the file.  No block is
// kept: far from everything else that is read, those on the way to it would be decoded for it alone.
void paged_rect_and_parents(struct paged *paged, int level, const struct patch *wanted,
                            const struct patch *parents);
// Asks for the blocks of a rectangle that are not there; true when all are.
bool paged_ask(struct paged *paged, int level, const struct rect *rect);
bool paged_read_init(struct paged *paged); // false when memory runs out
void paged_read_finish(struct paged *paged);

#endif
