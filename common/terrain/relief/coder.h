// The tile coder: small signed integers of up to four bands of at most 32 x 32 in, bytes out, and back.
//
// A magnitude is a token (rANS, static tables, one of CODER_CONTEXTS contexts) and raw bits; the context of a
// coefficient is a weighted sum of magnitudes west and north of it and of how rough the coarser level is
// there
// (`activity`).  Beyond the highest context magnitudes lose low bits, which stand among the raw bits, so that
// one alphabet serves coarse steps and lossless data alike.  Tables are constants, trained on terrain that no
// figure is quoted for (`make tables`).
//
// A tile's bytes: one byte (context shift + 2; 8 when each band has a rANS state of its own; 16 when the one
// state has three bytes), the states, 16-bit words forwards; raw bits and then signs stand at the end and are
// read backwards.  The first signs stand in what is left of the states.  A tile of zeros has no bytes.
//
// SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_RELIEF_CODER_H
#define COMMON_TERRAIN_RELIEF_CODER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum {
    CODER_TILE = 32, // coefficients of a band along one axis
    CODER_BANDS = 4,
    CODER_CONTEXTS = 24,
    CODER_TOKENS = 16,
    CODER_BITS = 14, // probabilities are of 2^14
    CODER_SETS = 16,
    CODER_SHIFTS = 5,                 // of the context: -2..2, chosen tile by tile
    CODER_MAX_BYTES = 10 * 4096 + 64, // of a tile: 54 raw bits and a word at most for each coefficient
    CODER_LIMIT = 1 << 26,            // |k| is smaller
};

struct coder_tables {
    uint16_t start[CODER_SETS][CODER_CONTEXTS][CODER_TOKENS]; // cumulated; the last token ends at 2^14
};
extern const struct coder_tables CODER_TABLES;
extern const uint32_t CODER_TABLES_CRC; // of their 16-bit words, little-endian

// What of a tile both sides know beforehand.
struct coder_tile {
    int first_band, bands;                       // bands first_band..bands-1 are present
    int width[CODER_BANDS], height[CODER_BANDS]; // each at most CODER_TILE
    int set[CODER_BANDS];                        // of tables, one a band
    bool siblings;                               // contexts also look at the bands before, at the same place
    // What the coarser level says, in units of a context sum; [band][y * CODER_TILE + x]
    const uint16_t (*activity)[CODER_TILE * CODER_TILE];
};

typedef int32_t coder_band[CODER_TILE * CODER_TILE]; // y * CODER_TILE + x

// How values become magnitudes: exact ones, or the cheapest of what lies near (rate against distortion).
struct coder_rate {
    const int32_t (*values)[CODER_TILE * CODER_TILE]; // unquantised
    const int32_t *step;                              // one a band
    int32_t lambda_65536;                             // in step^2 / bit / 65536
    bool uneven; // up to twice that, by place, so that like coefficients do not fall at once; any may fall to
                 // 0
};

// Sums of tokens seen, for training.
struct coder_counts {
    uint64_t of[CODER_SETS][CODER_CONTEXTS][CODER_TOKENS];
};

// Chooses k for the values of a tile, each the nearest or one nearer to zero.
void coder_quantise(const struct coder_tile *tile, const struct coder_rate *rate, coder_band *k);

// Writes the tile and returns its size in bytes, at most CODER_MAX_BYTES; 0: every k is zero.
// `counts` may be NULL.
size_t coder_encode(const struct coder_tile *tile, const coder_band *k, uint8_t *out,
                    struct coder_counts *counts);

// False when the bytes are not what coder_encode writes; k is then filled with something.  Never reads beyond
// them.
bool coder_decode(const struct coder_tile *tile, const uint8_t *data, size_t size, coder_band *k);

#endif
