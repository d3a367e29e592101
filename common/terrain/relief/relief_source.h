// What is packed: anything whose samples can be had by windows.  A map in memory, a file of 16-bit samples
// that is read where it is needed (file_source.h), a .relief file, or a made world (generate.h, amplify.h)
// that is nowhere but in its formula. SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_RELIEF_RELIEF_SOURCE_H
#define COMMON_TERRAIN_RELIEF_RELIEF_SOURCE_H

#include "common/terrain/heightfield.h"
#include "common/terrain/relief/layout.h"

struct relief_source {
    char name[64];
    int64_t size[2];
    double spacing_m[2], quantum_m, offset_m;
    double radius_m; // of a whole planet: columns of a turn from 180 W, rows from pole to pole; 0: a plane
    uint64_t voids_filled;
    uint64_t identity;   // two sources that give different samples have different ones
    int32_t magnitude_q; // no sample is larger
    // Fills a patch within the map, quanta, row 0 south; from any thread.  False after one line on stderr.
    bool (*window)(const struct relief_source *source, const struct patch *to);
    void (*finish)(struct relief_source *source);
    void *data;
};

// Opens an elevation file or a .json that tells what to generate (amplify.h).  Files of 16-bit samples that
// are large beside `memory_bytes` are read by windows (file_source.h), others are loaded whole.  Voids are
// filled.  What has to be written out in between goes into an unnamed file in the folder of `beside` (NULL:
// of `path`).  False after one line on stderr.
bool relief_source_open(struct relief_source *source, const char *path, size_t memory_bytes,
                        const char *beside);
void relief_source_finish(struct relief_source *source); // accepts a zeroed struct

// A map that the caller keeps; its voids are filled, and cells of a planet become samples on the grid lines
// (sphere_from_pixels).  False after one line on stderr.
bool relief_source_field(struct relief_source *source, struct heightfield *field);

// The identity of a source: what describes it, then its samples by rows from the south, each hashed on.
uint64_t relief_source_described(const struct relief_source *source);
uint64_t relief_source_hashed(uint64_t hash, const void *data, size_t size);

// A planet's cells become samples on the lines between them, a row more of them.  False after one line on
// stderr.
bool relief_source_lines(struct heightfield *field);

// False after one line on stderr: no grid from pole to pole has this size.
bool relief_is_planet(const char *name, int64_t columns, int64_t rows);

#endif
