// How a renderer reads terrain without waiting: what it asks for in one frame arrives some frames later, at
// most a budget of samples a frame.  What has arrived depends only on what this reader was asked for and on
// frame numbers, never on the clock, on threads or on other readers, so that measured flights repeat.  With
// `realtime` a window is there as soon as it is decoded.
//
// Terrain in memory is always there.  Of terrain on disk (paged.h) blocks of 128 x 128 samples arrive.  They
// are decoded ahead by worker threads; one that has arrived by its frame number but is not decoded yet, or no
// longer kept, is decoded when it is read.
//
// One reader a renderer, used by one thread.  No allocation after creation.
// SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_READER_H
#define COMMON_TERRAIN_READER_H

#include "common/terrain/terrain.h"

struct terrain_reader;

struct terrain_reader_counters { // of this frame
    uint64_t asked;              // windows
    uint64_t missed;             // windows that were not there
    uint64_t arrived, evicted;   // blocks
};

// The terrain is borrowed until destroy.  NULL after one line on stderr.
struct terrain_reader *terrain_reader_create(const struct terrain *terrain, bool realtime);
void terrain_reader_destroy(struct terrain_reader *reader); // accepts NULL

// Begins a frame: time goes on by frame - the frame before, by one where that is less.  What was missed in
// the frame before goes to the workers in the order in which it was asked for, as far as the budget reaches;
// the rest is forgotten, so whatever is still wanted must be asked for again.  `place_m` is where the viewer
// is: windows are also asked for as far ahead as it moves until they arrive.
void terrain_reader_begin_frame(struct terrain_reader *reader, int frame, const double place_m[2]);

// As terrain_window.  False: not here yet, now asked for; `out` is left alone.  Ask for what matters most
// first.  out NULL: only whether it is there.  A window of more blocks than the reader may keep is read at
// once.
bool terrain_reader_window(struct terrain_reader *reader, int level, int64_t x0, int64_t y0, int width,
                           int height, int32_t *out);

struct terrain_reader_counters terrain_reader_counters(const struct terrain_reader *reader);

// Nothing that was asked for up to now is still to come, and nothing was missed in this frame.
bool terrain_reader_idle(const struct terrain_reader *reader);

#endif
