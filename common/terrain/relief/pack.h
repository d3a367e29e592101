// A map on its way into a .relief file: what the parts of packing share (relief_pack.h says how it goes).
//
//   relief_pack.c    the plan, what an earlier run left, the order of things
//   pack_poles.c     what stands in the poles of a planet's levels
//   pack_stages.c    regions, stages and the top: reduced and coded
//   pack_steps.c     the steps that reach an aim
//   pack_region.c    one region: reduced and coded
//   pack_errors.c    and measured against level 0 (pack_squares.c)
//   pack_assemble.c  the file, from what was coded
// SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_RELIEF_PACK_H
#define COMMON_TERRAIN_RELIEF_PACK_H

#include "common/terrain/relief/pack_errors.h"
#include "common/terrain/relief/pack_store.h"
#include "common/terrain/relief/planet_source.h"
#include "common/terrain/relief/relief_pack.h"

#include <stdlib.h>

enum {
    STAGE_LEVELS = 3,
    SMALLEST_REGION = LAYOUT_SAMPLES << (STAGE_LEVELS - 1), // a tile of the coarsest level of a stage
    MOST_THREADS = 64,
    LAMBDA_65536 = 26 << 8, // 0.1 step^2 a bit (Sullivan & Wiegand 1998: rate against distortion)
    WORK_REDUCE = 2,        // shares of the time that a sample takes, for the time left
    WORK_CODE = 10,
};

struct done { // what is known of a region
    bool reduced, coded;
    uint64_t offset, bytes; // of its tiles
};

struct stage { // levels fine..coarse-1
    int fine, coarse;
    int64_t columns, rows; // of regions
    struct done *regions;
    bool coded; // all of them
};

struct pack {
    const struct relief_source *source;
    const struct relief_pack_options *options;
    struct pack_coder coder;
    struct stage stages[LAYOUT_LEVELS / STAGE_LEVELS];
    int stage_count, region, threads;
    struct region top; // the levels above all stages
    void *top_room;
    struct pack_store store;
    bool has_store, failed; // failed: and a line was printed
    uint32_t attempt;
    struct region_sums sums; // of the regions of level 0 that are coded
    pthread_mutex_t lock;
    struct { // rooms of the regions that are worked on
        void *room[MOST_THREADS];
        bool used[MOST_THREADS];
        size_t bytes[MOST_THREADS];
    } rooms;
    struct { // what is done, in samples of level 0 that went through everything
        double done, all, begun_s, shown_s;
        const char *what;
    } progress;
};

static inline int64_t pack_samples_of(const struct grid *grid, int level)
{
    return grid->size[level][0] * grid->size[level][1];
}

static inline bool pack_stopped(const struct pack *p)
{
    return p->failed || p->store.error || (p->options->interrupted && *p->options->interrupted);
}

static inline size_t pack_tile_count(const struct rect *tiles)
{
    return (size_t)(rect_width(tiles) * rect_height(tiles));
}

static inline struct region_sums pack_no_sums(void)
{
    return (struct region_sums){.min_q = INT32_MAX, .max_q = INT32_MIN};
}

static inline uint64_t pack_scrambled(uint64_t z) // the finaliser of splitmix64
{
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

struct tile_entry { // of a tile, in the file of tiles
    uint32_t bytes, error_q;
    int32_t min_q, max_q;
};

// How a wavelet map is quantised.
struct steps {
    double step; // 0: not known yet
    int32_t lambda_65536;
    bool uneven;
};

// ---- pack_stages.c ---------------------------------------------------------
// Those that return false have printed a line, left an error to store_fail, or were interrupted.

double pack_seconds(void);
void pack_progress_say(struct pack *p, const char *what); // what is being done now
void pack_progress_end(const struct pack *p);
bool pack_out_of_memory(struct pack *p); // prints it, once; returns false
void *pack_take_room(struct pack *p, size_t bytes);
void pack_give_room(struct pack *p, const void *room);

struct rect pack_core_of(const struct pack *p, const struct stage *stage, int region);
bool stage_is_coded(const struct stage *stage);
bool stage_any_coded(const struct stage *stage);
bool stage_any_reduced(const struct stage *stage);
void stage_forget_reduced(struct stage *stage);
bool pack_note_dropped(struct pack *p, int stage);                       // and in the journal
void pack_take_coded(struct pack *p, const struct store_record *record); // adds what it tells

bool pack_prepare_region(struct pack *p, struct region *r, void *room); // places, reads and reduces it
bool pack_read_decoded(void *pack, int level, const struct patch *to);  // a region_reader
bool pack_prepare_top(struct pack *p);
bool pack_code_top(struct pack *p, bool write);
bool pack_reduce_all(struct pack *p); // what is left to reduce
bool pack_code_all(struct pack *p);   // what is left to code, with the steps at hand

// ---- pack_poles.c ----------------------------------------------------------

// The poles of all levels, before anything is reduced: they are the same in whatever regions the rest is
// done.
bool pack_find_poles(struct pack *p, const struct planet_source *planet);

// ---- pack_steps.c ----------------------------------------------------------

double pack_rms_of(const struct pack *p, const struct region_sums *sums);
void pack_set_bounded_steps(struct pack *p);
bool pack_begin_attempt(struct pack *p, const struct steps *steps); // nothing is coded then
// Codes everything to the rms aim; looks for the steps when they are not known yet.
bool pack_code_wavelet(struct pack *p, struct steps *steps);

// ---- pack_assemble.c -------------------------------------------------------

bool pack_assemble(struct pack *p, struct relief_header *h);

#endif
