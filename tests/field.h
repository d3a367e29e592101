// An empty map in memory for tests to fill.
// SPDX-License-Identifier: MIT
#ifndef TESTS_FIELD_H
#define TESTS_FIELD_H

#include "common/terrain/heightfield.h"
#include "tests/test.h"

// heightfield_finish frees it.
static inline struct heightfield test_field(const char *name, int width, int height)
{
    struct heightfield field = {.width = width,
                                .height = height,
                                .spacing_m = {30, 40},
                                .quantum_m = 0.1,
                                .offset_m = 7,
                                .samples = calloc((size_t)width * (size_t)height, sizeof(int32_t))};
    assert_non_null(field.samples);
    snprintf(field.name, sizeof field.name, "%s", name);
    return field;
}

#endif
