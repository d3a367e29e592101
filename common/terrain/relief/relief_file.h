// A compressed terrain on disk, read where it is needed: any window of any level decodes alone, from the
// tiles under it and those of the coarser levels above them.  relief_format.h has the bytes, layout.h what
// they mean. SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_RELIEF_RELIEF_FILE_H
#define COMMON_TERRAIN_RELIEF_RELIEF_FILE_H

#include "common/terrain/heightfield.h"
#include "common/terrain/relief/relief_format.h"

#include <stdbool.h>
#include <stdint.h>

struct relief; // opaque; may be read from several threads

// NULL after one line on stderr.  Keeps the index and the side section in memory, 11 bytes a tile; never more
// than a fixed multiple of the file's size.
struct relief *relief_open(const char *path);
void relief_close(struct relief *relief); // accepts NULL

const struct relief_header *relief_header(const struct relief *relief);
const struct grid *relief_grid(const struct relief *relief);

// Of a planet (relief_format.h): heights in quanta of its south and north pole at a level up to its coarsest.
// Each is one height on all meridians; what the tiles hold in those rows is only near it.
const int32_t *relief_poles(const struct relief *relief, int level);
// Puts them in where `samples`, quanta, hold such a row; nothing on the plane.
void relief_level_poles(const struct relief *relief, int level, const struct patch *samples);

// Bytes of header, tiles, base and index: what bits a sample count.
uint64_t relief_sample_bytes(const struct relief *relief);

// What the side section says of tile `number` (grid.first_tile + ty * tiles[0] + tx): its samples reach from
// LAYOUT_SAMPLES * t to LAYOUT_SAMPLES * (t + 1), both ends included.  Extrema are exact unless the file's
// heights span more than 65,535 quanta; then they are conservative.  Of a planet they include the poles;
// what a tile at the seam says of the column beyond it is that of the margin, which a lossy coder may have
// left a little off the first column's.
struct relief_tile_side {
    uint64_t offset; // of the tile's bytes in the payload
    uint32_t bytes, crc;
    int32_t min_q, max_q;
    uint8_t error_code; // relief_error_of: largest difference from level 0 over the tile, in quanta
};
struct relief_tile_side relief_side(const struct relief *relief, int64_t number);
// Parts of it, in constant time; the error in quanta.
void relief_bounds(const struct relief *relief, int64_t number, int32_t *min_q, int32_t *max_q);
uint32_t relief_tile_error(const struct relief *relief, int64_t number);

// rms of a level's surface less level 0, in quanta; negative when the file does not know (version 2).
double relief_level_rms(const struct relief *relief, int level);

size_t relief_resident_bytes(const struct relief *relief);

// Samples of `level`, row 0 south, in quanta: the same whatever window they are read in.  The window lies
// within the level.  False after one line on stderr, the first time: the file is harmed, cannot be read, or
// memory ran out.
bool relief_window(const struct relief *relief, int level, int64_t x0, int64_t y0, int64_t width,
                   int64_t height, int32_t *out);

// The same in internal units, rounded to nothing: what relief_refine reads.
bool relief_units(const struct relief *relief, int level, const struct patch *wanted);

// Internal units to quanta.
void relief_quanta(const struct relief *relief, int32_t *samples, int64_t count);

// The next level alone, as a viewer reads it: `coarse` holds internal units of the coarser level, at least
// what relief_coarse_rect says, and `wanted` receives internal units.
struct rect relief_coarse_rect(const struct relief *relief, int level, const struct rect *wanted);
bool relief_refine(const struct relief *relief, int level, const struct patch *coarse,
                   const struct patch *wanted);

// The whole of level 0.  False after one line on stderr.
bool relief_load(struct heightfield *field, const char *path);

#endif
