// Files of 16-bit samples that are packed without holding them: raw files and SRTM tiles are read by windows
// where they lie, a PNG once, row by row, into an unnamed file of plain samples that is then read in their
// stead. SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_RELIEF_FILE_SOURCE_H
#define COMMON_TERRAIN_RELIEF_FILE_SOURCE_H

#include "common/terrain/relief/relief_source.h"

enum file_source {
    FILE_SOURCE_GOOD,
    FILE_SOURCE_WHOLE, // another kind of file, a small one, or, after a note, one that must be loaded whole
    FILE_SOURCE_BAD    // after one line on stderr
};

// The samples, their identity and what describes them are those of the whole load, which is left to maps with
// voids (filling them takes the whole map), interlaced PNGs and planets whose samples are the middles of
// cells.  A raw file with voids that --memory could not hold is refused.  `beside`: as in relief_source_open.
enum file_source file_source_open(struct relief_source *source, const char *path, size_t memory_bytes,
                                  const char *beside);

#endif
