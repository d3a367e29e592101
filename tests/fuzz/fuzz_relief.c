// SPDX-License-Identifier: MIT
#define _GNU_SOURCE // memfd_create
#include "tests/fuzz/fuzz_relief.h"

#include "common/terrain/relief/relief_file.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

static void put_crc(uint8_t *to, uint32_t crc)
{
    for (int i = 0; i < 4; i++) to[i] = (uint8_t)(crc >> 8 * i);
}

// Checksums that fit what they cover, where the parts lie in the file.
static void mend(uint8_t *data, size_t size)
{
    struct relief_header h;
    put_crc(data + RELIEF_HEADER - 4, relief_crc(data, RELIEF_HEADER - 4));
    if (relief_header_read(&h, data)) return;
    uint64_t at = RELIEF_HEADER;
    const uint64_t parts[4] = {h.payload_bytes, h.base_bytes, h.index_bytes, h.side_bytes};
    uint32_t *crcs[4] = {NULL, &h.base_crc, &h.index_crc, &h.side_crc};
    for (int i = 0; i < 4; at += parts[i++]) {
        if (parts[i] > size - at) return;
        if (crcs[i]) *crcs[i] = relief_crc(data + at, (size_t)parts[i]);
    }
    relief_header_write(&h, data);
}

// The tiles' checksums stand in the side section, whose place follows from the header: set right as well.
static void mend_tiles(uint8_t *data, size_t size)
{
    struct relief_header h;
    struct grid grid;
    if (size < RELIEF_HEADER || relief_header_read(&h, data)) return;
    const uint64_t parts[4] = {h.payload_bytes, h.base_bytes, h.index_bytes, h.side_bytes};
    uint64_t left = size - RELIEF_HEADER;
    for (int i = 0; i < 4; left -= parts[i++])
        if (parts[i] > left) return;
    uint64_t index = RELIEF_HEADER + h.payload_bytes + h.base_bytes, side = index + h.index_bytes;
    grid_init(&grid, h.size[0], h.size[1]);
    struct relief_reader sizes = {data + index, data + side, false};
    struct relief_reader sides = {data + side, data + side + h.side_bytes, false};
    uint64_t offset = RELIEF_HEADER;
    for (int64_t i = 0; i < grid.tile_count && !sizes.bad && !sides.bad; i++) {
        uint64_t bytes = relief_get_varint(&sizes);
        if (bytes > size - offset) return;
        if (bytes > 0) {
            uint8_t *crc = data + (sides.at - data);
            relief_get_u32(&sides);
            if (!sides.bad) put_crc(crc, relief_crc(data + offset, (size_t)bytes));
        }
        relief_get_difference(&sides);
        relief_get_varint(&sides);
        if (sides.at < sides.end) sides.at++;
        offset += bytes;
    }
}

// Corners of level 0, which are decoded through all the levels above; and of one in the middle.
static void read_windows(const struct relief *relief)
{
    enum { SIDE = 70 };
    static int32_t out[SIDE * SIDE];
    const struct grid *grid = relief_grid(relief);
    for (int k = 0; k < 2; k++) {
        int l = k * (grid->count / 2);
        int64_t width = grid->size[l][0] < SIDE ? grid->size[l][0] : SIDE;
        int64_t height = grid->size[l][1] < SIDE ? grid->size[l][1] : SIDE;
        bool good =
            relief_window(relief, l, 0, 0, width, height, out) &&
            relief_window(relief, l, grid->size[l][0] - width, grid->size[l][1] - height, width, height, out);
        if (!good || grid->count < 2) return;
    }
}

int fuzz_relief(const uint8_t *data, size_t size)
{
    uint8_t *bytes = malloc(size + 1); // of its own, so that a sanitizer sees a read beyond it
    if (!bytes) return 0;
    if (size > 0) memcpy(bytes, data, size);
    if (size >= RELIEF_HEADER) {
        mend(bytes, size);
        mend_tiles(bytes, size);
        mend(bytes, size);
    }
    int file = memfd_create("fuzz", MFD_CLOEXEC), opened = 0;
    char path[64];
    snprintf(path, sizeof path, "/proc/self/fd/%d", file);
    if (file >= 0 && write(file, bytes, size) == (ssize_t)size) {
        struct relief *relief = relief_open(path);
        opened = relief != NULL;
        if (relief) read_windows(relief);
        relief_close(relief);
    }
    if (file >= 0) close(file);
    free(bytes);
    return opened;
}

#ifdef RELIEF_LIBFUZZER
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    fuzz_relief(data, size);
    return 0;
}
#endif
