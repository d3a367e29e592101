// The JSON file beside a file of heights; its keys are described in heightfield.h.
// SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_SIDECAR_H
#define COMMON_TERRAIN_SIDECAR_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum sidecar_type { SIDECAR_UINT16, SIDECAR_INT16, SIDECAR_FLOAT32 };

struct sidecar {
    enum sidecar_type type;
    bool has_type, big_endian, has_nodata;
    int64_t width, height; // 0: not said
    double spacing_m[2], height_scale, height_offset, nodata;
    double radius_m, spacing_deg; // 0: not said
};

// What holds for a file without a sidecar: unsigned, 30 m between samples, a metre a step.
struct sidecar sidecar_default(void);

// `path` names the sidecar in messages.  False after one line on stderr.
bool sidecar_parse(struct sidecar *sidecar, const char *path, const char *text, size_t size);

// Reads the sidecar of a file of heights: its name with the ending .json.
enum sidecar_found { SIDECAR_GOOD, SIDECAR_ABSENT, SIDECAR_BAD /* after one line on stderr */ };
enum sidecar_found sidecar_load(struct sidecar *sidecar, const char *heights_path);

// The name of the sidecar of a file of heights.
void sidecar_path(const char *heights_path, char *path, size_t size);

// False after one line on stderr when the sidecar states another size.
bool sidecar_agrees(const struct sidecar *sidecar, const char *heights_path, int64_t width, int64_t height);

#endif
