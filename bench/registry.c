// SPDX-License-Identifier: MIT
#include "bench/registry.h"
#include "clipmap/clipmap.h"
#include "geomipmap/geomipmap.h"
#include "pgm/pgm.h"

#include <string.h>

const struct renderer_type *const renderer_table[] = {
    &null_renderer,
    &brute_renderer,
    &decimated_renderer, // baselines
    &clipmap_renderer,
    &geomipmap_renderer,
    &pgm_renderer, // methods
    NULL,
};

const struct renderer_type *renderer_find(const char *name, size_t length)
{
    for (int i = 0; renderer_table[i]; i++)
        if (strlen(renderer_table[i]->name) == length && strncmp(renderer_table[i]->name, name, length) == 0)
            return renderer_table[i];
    return NULL;
}
