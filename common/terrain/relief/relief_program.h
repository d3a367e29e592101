// What the `terrain` program does with .relief files: pack, unpack, info, and compare of any two maps.
// SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_RELIEF_RELIEF_PROGRAM_H
#define COMMON_TERRAIN_RELIEF_RELIEF_PROGRAM_H

#include <stdbool.h>

// Each takes the words behind the program's name, the command first, and returns the exit code.
int relief_pack_main(int argc, char **argv);
int relief_unpack_main(int argc, char **argv);
int relief_compare_main(int argc, char **argv);

bool relief_is_name(const char *path); // ends in .relief
// Prints what the file says of itself; decodes nothing.  Returns the exit code.
int relief_print_info(const char *path, bool json);

#endif
