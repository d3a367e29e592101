// SPDX-License-Identifier: MIT
#include "common/terrain/voids.h"

#include <math.h>
#include <stdlib.h>

struct grid {
    int64_t width, height;
    float *values;
    uint8_t *known;
};

enum { SWEEPS = 12 };

uint64_t voids_count(const int32_t *samples, size_t count)
{
    uint64_t voids = 0;
    for (size_t i = 0; i < count; i++) voids += samples[i] == INT32_MIN;
    return voids;
}

static bool grid_init(struct grid *grid, int64_t width, int64_t height)
{
    size_t count = (size_t)width * (size_t)height;
    *grid = (struct grid){width, height, malloc(count * sizeof(float)), malloc(count)};
    return grid->values && grid->known;
}

static void grid_finish(struct grid *grid)
{
    free(grid->values);
    free(grid->known);
}

// Means of the known values of 2 x 2 blocks; returns whether a block knew none.
static bool pull(const struct grid *fine, struct grid *coarse)
{
    bool missing = false;
    for (int64_t j = 0; j < coarse->height; j++)
        for (int64_t i = 0; i < coarse->width; i++) {
            double sum = 0;
            int count = 0;
            for (int64_t y = 2 * j; y < 2 * j + 2 && y < fine->height; y++)
                for (int64_t x = 2 * i; x < 2 * i + 2 && x < fine->width; x++)
                    if (fine->known[y * fine->width + x])
                        sum += (double)fine->values[y * fine->width + x], count++;
            coarse->known[j * coarse->width + i] = count > 0;
            coarse->values[j * coarse->width + i] = count > 0 ? (float)(sum / count) : 0;
            missing |= count == 0;
        }
    return missing;
}

static int64_t inside(int64_t index, int64_t size)
{
    return index < 0 ? 0 : index >= size ? size - 1 : index;
}

// Unknown values from the coarser grid, bilinear between the middles of its blocks.
static void push(const struct grid *coarse, struct grid *fine)
{
    for (int64_t y = 0; y < fine->height; y++)
        for (int64_t x = 0; x < fine->width; x++) {
            if (fine->known[y * fine->width + x]) continue;
            int64_t i = x / 2, j = y / 2, near_i = inside(x & 1 ? i + 1 : i - 1, coarse->width);
            int64_t near_j = inside(y & 1 ? j + 1 : j - 1, coarse->height);
            const float *row = coarse->values + j * coarse->width,
                        *near_row = coarse->values + near_j * coarse->width;
            fine->values[y * fine->width + x] =
                (9 * row[i] + 3 * row[near_i] + 3 * near_row[i] + near_row[near_i]) / 16;
        }
}

// Gauss-Seidel towards the harmonic surface, row by row.
static void relax(struct grid *grid)
{
    for (int sweep = 0; sweep < SWEEPS; sweep++)
        for (int64_t y = 0; y < grid->height; y++)
            for (int64_t x = 0; x < grid->width; x++) {
                float *v = grid->values + y * grid->width + x;
                if (grid->known[y * grid->width + x]) continue;
                float sum = 0, count = 0;
                if (x > 0) sum += v[-1], count++;
                if (x + 1 < grid->width) sum += v[1], count++;
                if (y > 0) sum += v[-grid->width], count++;
                if (y + 1 < grid->height) sum += v[grid->width], count++;
                if (count > 0) *v = sum / count;
            }
}

static bool fill(struct grid *fine)
{
    struct grid coarse;
    bool good = grid_init(&coarse, (fine->width + 1) / 2, (fine->height + 1) / 2);
    if (good) {
        if (pull(fine, &coarse)) good = fill(&coarse);
        if (good) push(&coarse, fine);
        if (good) relax(fine);
    }
    grid_finish(&coarse);
    return good;
}

bool voids_fill(int32_t *samples, int64_t width, int64_t height)
{
    struct grid grid;
    size_t count = (size_t)width * (size_t)height;
    int32_t low = INT32_MAX, high = INT32_MIN;
    bool good = grid_init(&grid, width, height);
    if (good) {
        for (size_t i = 0; i < count; i++) {
            grid.known[i] = samples[i] != INT32_MIN;
            grid.values[i] = grid.known[i] ? (float)samples[i] : 0;
            if (!grid.known[i]) continue;
            low = samples[i] < low ? samples[i] : low;
            high = samples[i] > high ? samples[i] : high;
        }
        good = fill(&grid);
    }
    for (size_t i = 0; good && i < count; i++) {
        if (grid.known[i]) continue;
        long q = lrintf(grid.values[i]);
        samples[i] = q < low ? low : q > high ? high : (int32_t)q; // sums of floats may stray by an ulp
    }
    grid_finish(&grid);
    return good;
}
