// PNG files in and out.
// SPDX-License-Identifier: MIT
#ifndef COMMON_IMAGE_H
#define COMMON_IMAGE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// Writes 8-bit pixels (channels 3 or 4; the first row given is the BOTTOM row, as OpenGL reads it) under a
// temporary name and renames it: the file is whole or absent.  False after one line on stderr.
bool image_write_png(const char *path, int width, int height, int channels, const uint8_t *pixels);

// Reads a 16-bit grey PNG, from a file, or from memory when data is not NULL (path then only names it in
// messages). *samples: width * height values, top row first, to be freed by the caller.  False after one line
// on stderr.
bool image_read_grey16(const char *path, const void *data, size_t size, int *width, int *height,
                       uint16_t **samples);

// Size of a 16-bit grey PNG, and whether it is interlaced, by its header alone.  False, without a line, for
// any other file.
bool image_size_grey16(const char *path, int *width, int *height, bool *interlaced);

// Writes the samples of a 16-bit grey PNG that is not interlaced to an open file, big-endian, top row first,
// with one row in memory.  False after one line on stderr.
bool image_copy_grey16(const char *path, int to);

// Reads any PNG as 8-bit RGBA, top row first; *pixels is to be freed by the caller.  False after one line on
// stderr.
bool image_read_rgba8(const char *path, int *width, int *height, uint8_t **pixels);

// Writes a 16-bit grey PNG, top row first; whole or absent.
bool image_write_grey16(const char *path, int width, int height, const uint16_t *samples);

#endif
