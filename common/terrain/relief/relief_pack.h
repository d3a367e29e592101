// Packs a map into a .relief file within a fixed amount of memory.
//
// Levels are grouped in stages of three.  A map is reduced stage by stage, region by region, until what is
// left fits in memory; that is coded first, whole, and then the stages from coarse to fine, again region by
// region, each region from its own samples and the coarser level as decoded.  A small map is all "what is
// left".  What is done is kept in OUT.part (pack_store.h): a pack that was interrupted, or killed, goes on
// where it was.  The file depends neither on that nor on the number of threads. SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_RELIEF_RELIEF_PACK_H
#define COMMON_TERRAIN_RELIEF_RELIEF_PACK_H

#include "common/terrain/heightfield.h"
#include "common/terrain/relief/relief_format.h"
#include "common/terrain/relief/relief_source.h"

#include <signal.h>

struct relief_pack_options {
    enum layout layout;
    // wavelet: the aim; what is reached lies within [0.98, 1.001] of it, or below when that is all there is.
    // The steps that reach it are searched for on the whole map where it fits in memory, else on a sample of
    // it.
    double rms_m;
    // bounded: no sample of any level differs by more; 0: lossless.  pyramid: of its filtered levels.
    double max_m;
    bool scaled;         // pyramid: level l may differ 2^l times as much, the paper's first approach
    int threads;         // 0: one for each processor; the file does not depend on it
    size_t memory_bytes; // not to be exceeded but by a loaded source; 0: 512 MiB
    bool restart;        // what an earlier pack left in OUT.part is thrown away
    bool progress;       // a line on stderr, again and again: how much is done, how long it will take
    const volatile sig_atomic_t *interrupted; // NULL, or becomes nonzero: stop, keep what is done
    int region;                  // samples along a side; 0: chosen.  For tests; changes no result
    struct coder_counts *counts; // NULL, or what the coder saw (threads = 1)
};

// Writes `path` by way of `path`.part, so that it appears whole or not at all; fills `header` with what was
// reached.  `path` may be NULL: nothing is written, and the map must fit in memory.  False after one line on
// stderr; or, without one, when it was interrupted.
bool relief_pack_source(const struct relief_source *source, const struct relief_pack_options *options,
                        const char *path, struct relief_header *header);

// The same of a map in memory, whose voids are filled.
bool relief_pack(struct heightfield *field, const struct relief_pack_options *options, const char *path,
                 struct relief_header *header);

// Layouts that keep a largest error: sets options->max_m to the largest one, in whole quanta, whose rms is at
// most `rms_m`.  False after one line on stderr.
bool relief_pack_max_for_rms(struct heightfield *field, struct relief_pack_options *options, double rms_m);

#endif
