// The bytes of a .relief file, version 3.  Little-endian throughout:
//
//   header   256 bytes, ends with its CRC-32
//   payload  tiles, coarsest level first, row by row northwards (coder.h)
//   base     varints: the step of each level and band, then the coarsest level as differences; of a planet
//   then
//            the heights of its south and north pole, level by level from level 0, in quanta, as differences
//   index    a varint a tile: its bytes in the payload, 0 for a tile of zeros
//   side     of each tile, in the same order: CRC-32 of its bytes if it has any; lowest sample as a
//   difference from the
//            tile before, span to the highest, both varints in quanta, shared edges to the north and east
//            included; one byte for the largest difference of the level's surface from level 0 over the tile;
//            then, not in version 2, of each level from 1 a double: rms of its surface less level 0, in
//            quanta, over the samples of level 0 without a planet's margin
//
// Base, index and side have a CRC-32 each in the header, which also names the coder's tables by theirs: a
// file that was coded with others is refused.
//
// A whole planet (radius_m > 0) is stored with a margin on each side that goes on over the seam and over the
// poles (sphere.h), wide enough that levels 0..coarsest are those of an endless map wherever they lie on the
// planet: coders and filters know nothing of seams.  relief_planet says what of it is the planet.
// SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_RELIEF_RELIEF_FORMAT_H
#define COMMON_TERRAIN_RELIEF_RELIEF_FORMAT_H

#include "common/terrain/relief/layout.h"
#include "common/terrain/sphere.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { RELIEF_HEADER = 256, RELIEF_VERSION_NUMBER = 3, RELIEF_FRACTION_BITS = 4 };

struct relief_header {
    int version; // that was read; what is written is of RELIEF_VERSION_NUMBER
    enum layout layout;
    int64_t size[2]; // samples of level 0, a planet's margin included
    double spacing_m[2], quantum_m, offset_m;
    double rms_m, max_m; // of level 0 against the source
    int fraction_bits;
    int32_t min_q, max_q; // of the decoded level 0
    uint64_t voids_filled;
    uint64_t payload_bytes, base_bytes, index_bytes, side_bytes;
    uint32_t base_crc, index_crc, side_crc;
    char name[64];
    double radius_m;      // 0: a plane
    int margin, coarsest; // of a planet; both 0 on the plane
};

void relief_header_write(const struct relief_header *header, uint8_t bytes[RELIEF_HEADER]);
// NULL, or what is wrong with the header.
const char *relief_header_read(struct relief_header *header, const uint8_t bytes[RELIEF_HEADER]);

// What of a planet's file is the planet: sample (i, j) of level l <= coarsest stands in column
// i - first + (margin >> l) and row j + pole + (margin >> l), first and pole being those of
// sphere_level(&grid, l).  Its first column is the 180th meridian.
struct relief_planet {
    struct sphere_grid grid; // of level 0
    int64_t margin;
    int coarsest;
};
struct relief_planet relief_planet(const struct relief_header *header);
// Levels that a planet of this grid can have when its coarser samples are made from `reach` on either side,
// and the margin that they need.
struct relief_planet relief_planet_plan(int64_t columns, int64_t rows, int reach);

uint32_t relief_crc(const uint8_t *data, size_t size);

// Bytes that grow.
struct relief_bytes {
    uint8_t *data;
    size_t size, room;
    bool full; // memory ran out; what was put since is lost
};
void relief_put(struct relief_bytes *bytes, const void *data, size_t size);
void relief_put_varint(struct relief_bytes *bytes, uint64_t value);
void relief_put_difference(struct relief_bytes *bytes, int64_t difference);
void relief_put_double(struct relief_bytes *bytes, double value);

// Bytes that are read in order.
struct relief_reader {
    const uint8_t *at, *end;
    bool bad; // read beyond the end, or a varint of more than 64 bits
};
uint64_t relief_get_varint(struct relief_reader *reader);
int64_t relief_get_difference(struct relief_reader *reader);
uint32_t relief_get_u32(struct relief_reader *reader);
double relief_get_double(struct relief_reader *reader);

// An error in quanta as one byte, rounded up, and back: exact below 16, then 3 bits of mantissa.
uint8_t relief_error_code(uint32_t error_q);
uint32_t relief_error_of(uint8_t code);

#endif
