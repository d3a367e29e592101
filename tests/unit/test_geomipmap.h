// Terrain for the tests of GeoMipMaps: midpoint displacement, as rough as asked for.
// SPDX-License-Identifier: MIT
#ifndef TESTS_UNIT_TEST_GEOMIPMAP_H
#define TESTS_UNIT_TEST_GEOMIPMAP_H

#include "common/terrain/terrain.h"
#include "tests/test.h"

struct test_map {
    int width, height;
    int64_t first[2];
    double spacing_m[2], quantum_m, offset_m;
    double height_m, rough; // largest displacement; its share at half the distance
};

static inline double test_corner(const double *z, int side, int step, int i, int j)
{
    int a = i / (2 * step) * 2 * step, b = j / (2 * step) * 2 * step;
    int c = i == a ? a : a + 2 * step, d = j == b ? b : b + 2 * step;
    return (z[b * side + a] + z[b * side + c] + z[d * side + a] + z[d * side + c]) / 4;
}

static inline struct terrain *test_fractal(const struct test_map *map, uint64_t seed)
{
    int side = 2;
    while (side + 1 < map->width || side + 1 < map->height) side *= 2;
    int last = side++;
    double *z = calloc((size_t)side * (size_t)side, sizeof *z), amplitude = map->height_m;
    int32_t *samples = malloc((size_t)map->width * (size_t)map->height * sizeof *samples);
    assert_true(z && samples);
    for (int step = last; step >= 1; step /= 2, amplitude *= map->rough)
        for (int j = 0; j < side; j += step)
            for (int i = 0; i < side; i += step) {
                if (step < last && i % (2 * step) == 0 && j % (2 * step) == 0) continue;
                double mean = step == last ? 0 : test_corner(z, side, step, i, j);
                z[j * side + i] = mean + test_uniform(&seed, -amplitude, amplitude);
            }
    for (int j = 0; j < map->height; j++)
        for (int i = 0; i < map->width; i++)
            samples[j * map->width + i] = (int32_t)lround(z[j * side + i] / map->quantum_m);
    const struct terrain_grid grid = {.name = "fractal",
                                      .samples = samples,
                                      .width = map->width,
                                      .height = map->height,
                                      .first = {map->first[0], map->first[1]},
                                      .spacing_m = {map->spacing_m[0], map->spacing_m[1]},
                                      .quantum_m = map->quantum_m,
                                      .offset_m = map->offset_m};
    struct terrain *terrain = terrain_from_grid(&grid, &(struct terrain_options){0});
    assert_non_null(terrain);
    free(z);
    free(samples);
    return terrain;
}

#endif
