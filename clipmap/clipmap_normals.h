// Normal maps at twice the geometry's resolution (Losasso & Hoppe 2004, section 6.3).  PURE: what is exposed
// is computed from the terrain and handed to a writer, as clipmap_store does with heights.
//
// Texels are counted in half samples of their level: texel h stands at h g / 2 and has the slot h mod size,
// so a clip region of s x s samples has 2s x 2s texels.  Half samples are the samples of the next finer
// level: the normal is that of its central differences, or, where no finer level exists, of the level's own
// prediction U (section 5), taken with as many more bits as fit.  Beyond the level's extent the nearest
// normal within holds; on its border the surface is continued straight.
//
// A texel is (x, y) of the unit normal times CLIPMAP_NORMAL_ONE; z = sqrt(1 - x x - y y) follows.  16 bits:
// the light of terrain.frag is at most 1.05 n.s with |s_x| = |s_y| = 0.58, so on flat ground half a step of 8
// bits in both would change the picture by 1.05 * 255 * 1.16 / 254 = 1.2 of its own steps, of 16 bits by
// 0.005.
//
// Error of a texel, in its own steps: rounding 0.5, 2^-9 of the sum that it is rounded by, the root 0.16
// (4.7e-6), arithmetic in float32 0.02.  The same bits on any machine.
// SPDX-License-Identifier: MIT
#ifndef CLIPMAP_CLIPMAP_NORMALS_H
#define CLIPMAP_CLIPMAP_NORMALS_H

#include "clipmap/clipmap_levels.h"
#include "common/terrain/terrain.h"

enum { CLIPMAP_NORMAL_ONE = 32767 };

struct clipmap_normals {           // of one level
    const struct terrain *terrain; // borrowed
    int level;                     // of the terrain, whose surface is shaded
    int size;                      // slots on a side, at least twice the store's
    struct clipmap_box clip;       // texels in memory
};

struct clipmap_normals_scratch { // room for one refill, shared by the levels
    int32_t *heights, *coarse;
    int16_t (*texels)[2];
};

// size: texels on a side of the largest box that is computed at once.  False after one line on stderr.
bool clipmap_normals_scratch_init(struct clipmap_normals_scratch *scratch, int size);
void clipmap_normals_scratch_finish(struct clipmap_normals_scratch *scratch);

// Computes the normals of a box of texels, row by row northwards, into scratch->texels: a function of the
// box, the level and the terrain alone.
void clipmap_normals_compute(const struct terrain *terrain, int level, const struct clipmap_box *texels,
                             const struct clipmap_normals_scratch *scratch);

// Which level's samples, and which of them, the normals of a box of samples of `level` are made of.
int clipmap_normals_window(const struct terrain *terrain, int level, const struct clipmap_box *samples,
                           struct clipmap_box *window);

// Takes a rectangle of slots, row by row northwards.
typedef void clipmap_normals_write_fn(void *user, int slot_x, int slot_y, int width, int height,
                                      const int16_t (*texels)[2]);

// Follows the clip region of the level's store, in samples, and computes what this exposes, each texel once.
// Returns how many.
uint64_t clipmap_normals_move(struct clipmap_normals *normals, const struct clipmap_box *samples,
                              const struct clipmap_normals_scratch *scratch, clipmap_normals_write_fn *write,
                              void *user);

#endif
