// The block coder of "Geometry clipmapping for Mars": each block has an image pyramid of its own; of each
// level the residual against the upsampled coarser one is taken, its last bit is dropped, and runs of zeros
// are counted.  A baseline: residuals are taken against coarser levels as they *were*, so the errors of the
// levels add up, and the dropped bit drops all of them the same way (numerics.md, B10).  `closed` and
// `rounded` are the answers to that.
//
// What the paper leaves open: the pyramid's filter is (1 2 1)/4 with repeated borders, U the 4-point scheme
// with repeated borders, blocks end at 8 samples. SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_RELIEF_CODEC_MARS_H
#define COMMON_TERRAIN_RELIEF_CODEC_MARS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct mars_form { // zeroed: as published
    bool closed;   // residuals against the coarser level as decoded
    bool rounded;  // to the nearest even number, instead of the last bit dropped
    int least;     // levels are added while a side has more samples than this; 0: 8
};

// Bytes of width x height samples, |sample| < 2^24, row by row; 0 when memory runs out or `room` is too
// little (mars_most is enough).
size_t mars_encode(const int32_t *samples, int width, int height, const struct mars_form *form, uint8_t *out,
                   size_t room);
size_t mars_most(int width, int height);
// False when the bytes are not what mars_encode writes for that size and form; never reads beyond them.
bool mars_decode(const uint8_t *data, size_t size, int width, int height, const struct mars_form *form,
                 int32_t *samples);

// Run lengths: a zero and how many follow, other values as they are (varints, small ones a byte); or all
// values in 2 bytes each, or 4 where they need them, if that is less: at most one byte more than plain
// values.
size_t runs_encode(const int32_t *values, size_t count, uint8_t *out); // 4 * count + 1 bytes are enough
// Bytes read, or 0: they end too early or hold more than `count` values.
size_t runs_decode(const uint8_t *data, size_t size, int32_t *values, size_t count);

#endif
