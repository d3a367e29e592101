// Packs a map into a .relief file.  The whole map is held in memory, several times over.
// SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_RELIEF_PACK_H
#define COMMON_TERRAIN_RELIEF_PACK_H

#include "common/terrain/heightfield.h"
#include "common/terrain/relief_format.h"

struct relief_pack_options {
    enum layout layout;
    double rms_m; // wavelet: the aim; what is reached lies within [0.98, 1] of it, or below when that is all
                  // there is (a map that its coarsest level, of 8 x 8 samples, nearly describes)
    double max_m; // bounded: no sample of any level differs by more; 0: lossless
    int threads;  // 0: one for each processor; the file does not depend on it
    struct coder_counts *counts; // NULL, or what the coder saw (threads = 1)
};

// Fills the field's voids and writes `path` by way of `path`.part, so that it appears whole or not at all;
// fills `header` with what was reached.  `path` may be NULL: nothing is written.  False after one line on
// stderr.
bool relief_pack(struct heightfield *field, const struct relief_pack_options *options, const char *path,
                 struct relief_header *header);

#endif
