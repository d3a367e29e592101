// Terrain for the tests of the clipmap: seeded fractals of any size, anywhere.
// SPDX-License-Identifier: MIT
#ifndef TESTS_UNIT_TEST_CLIPMAP_H
#define TESTS_UNIT_TEST_CLIPMAP_H

#include "common/terrain/terrain.h"
#include "tests/test.h"

static inline double test_lattice(int64_t i, int64_t j, int octave, uint64_t seed)
{
    uint64_t state =
        seed ^ (uint64_t)i * 0x9e3779b97f4a7c15u ^ (uint64_t)j * 0xc2b2ae3d27d4eb4fu ^ (uint64_t)octave << 57;
    return test_uniform(&state, -1, 1);
}

// Sum of octaves of bilinear noise; `rough` quanta on the shortest scale, twice that on each longer one.
static inline int32_t test_fractal(int64_t i, int64_t j, double rough, uint64_t seed)
{
    double sum = 0;
    for (int octave = 0; octave < 8; octave++) {
        int64_t cell = (int64_t)1 << octave;
        int64_t a = (i >= 0 ? i : i - cell + 1) / cell, b = (j >= 0 ? j : j - cell + 1) / cell;
        double u = (double)(i - a * cell) / (double)cell, v = (double)(j - b * cell) / (double)cell;
        double south = test_lattice(a, b, octave, seed) * (1 - u) + test_lattice(a + 1, b, octave, seed) * u;
        double north =
            test_lattice(a, b + 1, octave, seed) * (1 - u) + test_lattice(a + 1, b + 1, octave, seed) * u;
        sum += (south * (1 - v) + north * v) * rough * (double)cell;
    }
    return (int32_t)lrint(sum);
}

struct test_map {
    int64_t width, height, first[2];
    double spacing_m[2], quantum_m, rough; // rough 0: flat
    int32_t flat_q;
    uint64_t seed;
};

// Heights depend on the place within the map, not on `first`.
static inline struct terrain *test_terrain(const struct test_map *map)
{
    int32_t *samples = malloc((size_t)(map->width * map->height) * sizeof *samples);
    assert_non_null(samples);
    for (int64_t j = 0; j < map->height; j++)
        for (int64_t i = 0; i < map->width; i++)
            samples[j * map->width + i] =
                map->flat_q + (map->rough > 0 ? test_fractal(i, j, map->rough, map->seed) : 0);
    struct terrain_grid grid = {.name = "test",
                                .samples = samples,
                                .width = map->width,
                                .height = map->height,
                                .first = {map->first[0], map->first[1]},
                                .spacing_m = {map->spacing_m[0], map->spacing_m[1]},
                                .quantum_m = map->quantum_m};
    struct terrain_options options = {.filter = TERRAIN_FILTER_HALFBAND};
    struct terrain *terrain = terrain_from_grid(&grid, &options);
    assert_non_null(terrain);
    free(samples);
    return terrain;
}

#endif
