// Files that the programs carry in themselves: shaders, the default scene and the default terrain.  The
// Makefile makes the table (build/embedded.S) from the list EMBEDDED, so that a program runs from any folder.
// SPDX-License-Identifier: MIT
#ifndef COMMON_EMBEDDED_H
#define COMMON_EMBEDDED_H

#include <stddef.h>

struct embedded_file {
    const char *path; // as in the source tree: "clipmap/clipmap.vert"
    const unsigned char *data, *end;
};
extern const struct embedded_file embedded_files[];
extern const size_t embedded_file_count;

// NULL when there is no such file.
const struct embedded_file *embedded_find(const char *path);

#endif
