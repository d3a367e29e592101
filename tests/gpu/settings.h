// A renderer made from settings in words, and its counters by name, as the GPU tests have them.
// SPDX-License-Identifier: MIT
#ifndef TESTS_GPU_SETTINGS_H
#define TESTS_GPU_SETTINGS_H

#include "common/renderer.h"
#include "tests/test.h"

#include <string.h>

// settings: "n=31 stitch=none"; the rest as by default.  desc: all but the knobs.
static inline struct renderer *create_with(const struct renderer_type *type, struct renderer_desc desc,
                                           const char *settings)
{
    char text[256];
    renderer_default_knobs(type, desc.knobs);
    snprintf(text, sizeof text, "%s", settings);
    for (char *rest = NULL, *word = strtok_r(text, " ", &rest); word; word = strtok_r(NULL, " ", &rest)) {
        char *value = strchr(word, '=');
        assert_non_null(value);
        *value++ = 0;
        assert_true(renderer_parse_knob(type, word, value, desc.knobs));
    }
    struct renderer *renderer = type->create(&desc);
    assert_non_null(renderer);
    return renderer;
}

// What the renderer says of its last update.
static inline double counter(const struct renderer *renderer, const char *name)
{
    struct renderer_stats stats;
    renderer->type->stats(renderer, &stats);
    for (int i = 0; i < RENDERER_MAX_COUNTERS && stats.counters[i].name; i++)
        if (!strcmp(stats.counters[i].name, name)) return stats.counters[i].value;
    fail_msg("no counter %s", name);
    return 0;
}

#endif
