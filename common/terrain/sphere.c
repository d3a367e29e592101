// SPDX-License-Identifier: MIT
#include "common/terrain/sphere.h"

#include "common/terrain/upsample.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

// ---- indices ---------------------------------------------------------------

struct sphere_grid sphere_grid(int64_t first, int64_t columns, int64_t rows)
{
    return (struct sphere_grid){first, columns, (rows - 1) / 2};
}

struct sphere_grid sphere_level(const struct sphere_grid *level0, int level)
{
    int64_t scale = (int64_t)1 << abs(level);
    if (level > 0)
        return (struct sphere_grid){level0->first / scale, level0->columns / scale, level0->pole / scale};
    return (struct sphere_grid){level0->first * scale, level0->columns * scale, level0->pole * scale};
}

struct terrain_extent sphere_extent(const struct sphere_grid *grid)
{
    return (struct terrain_extent){grid->first, -grid->pole, grid->first + grid->columns, grid->pole + 1};
}

static int64_t floor_mod(int64_t a, int64_t b)
{
    int64_t rest = a % b;
    return rest < 0 ? rest + b : rest;
}

void sphere_fold(const struct sphere_grid *grid, int64_t *i, int64_t *j)
{
    int64_t turn = 4 * grid->pole, row = floor_mod(*j + grid->pole, turn); // from the south pole, northwards
    if (row > 2 * grid->pole) {
        row = turn - row;
        *i += grid->columns / 2;
    }
    *j = row - grid->pole;
    *i = grid->first + floor_mod(*i - grid->first, grid->columns);
}

void sphere_window(const struct sphere_grid *grid, const int32_t *samples, int64_t x0, int64_t y0, int width,
                   int height, int32_t *out)
{
    for (int64_t y = y0; y < y0 + height; y++) {
        int64_t i = x0, j = y;
        sphere_fold(grid, &i, &j);
        const int32_t *row = samples + (j + grid->pole) * grid->columns;
        for (int64_t done = 0, at = i - grid->first; done < width; at = 0) {
            int64_t run = grid->columns - at < width - done ? grid->columns - at : width - done;
            memcpy(out, row + at, (size_t)run * sizeof *out);
            out += run;
            done += run;
        }
    }
}

// ---- levels ----------------------------------------------------------------

void sphere_level_poles(const struct sphere_grid *grid, int32_t *samples)
{
    for (int end = 0; end < 2; end++) {
        int32_t *row = samples + end * 2 * grid->pole * grid->columns;
        int64_t sum = 0;
        for (int64_t i = 0; i < grid->columns; i++) sum += row[i];
        int32_t mean = (int32_t)llround((double)sum / (double)grid->columns);
        for (int64_t i = 0; i < grid->columns; i++) row[i] = mean;
    }
}

bool sphere_has_coarser(const struct sphere_grid *grid)
{
    return grid->first % 2 == 0 && grid->columns % 4 == 0 && grid->pole % 2 == 0;
}

bool sphere_downsample(const struct sphere_grid *grid, const int32_t *samples, enum terrain_filter filter,
                       int32_t *coarse)
{
    enum { GHOSTS = 8 }; // more than any filter reaches, and even
    int64_t first[2] = {grid->first - GHOSTS, -grid->pole - GHOSTS};
    int64_t size[2] = {grid->columns + 2 * GHOSTS, 2 * grid->pole + 1 + 2 * GHOSTS};
    int64_t coarse_size[2] = {downsample_size(first[0], size[0]), downsample_size(first[1], size[1])};
    struct sphere_grid next = sphere_level(grid, 1);
    int32_t *padded = malloc((size_t)(size[0] * size[1]) * sizeof *padded);
    int32_t *all = malloc((size_t)(coarse_size[0] * coarse_size[1]) * sizeof *all);
    bool good = padded && all;
    if (good) {
        sphere_window(grid, samples, first[0], first[1], (int)size[0], (int)size[1], padded);
        good = downsample(padded, first, size, filter, all);
    }
    for (int64_t j = 0; good && j <= 2 * next.pole; j++)
        memcpy(coarse + j * next.columns, all + (j + GHOSTS / 2) * coarse_size[0] + GHOSTS / 2,
               (size_t)next.columns * sizeof *coarse);
    if (good) sphere_level_poles(&next, coarse);
    free(padded);
    free(all);
    return good;
}

// Sample of the centres of cells: row -1 is row 0 seen over the pole.
static int64_t pixel(const int32_t *samples, int64_t columns, int64_t rows, int64_t i, int64_t j)
{
    if (j < 0 || j >= rows) {
        j = j < 0 ? -1 - j : 2 * rows - 1 - j;
        i += columns / 2;
    }
    return samples[j * columns + floor_mod(i, columns)];
}

int32_t *sphere_from_pixels(const int32_t *samples, int64_t columns, int64_t rows)
{
    static const int64_t WEIGHTS[4] = {-1, 9, 9, -1};
    int32_t *out = malloc((size_t)(columns * (rows + 1)) * sizeof *out);
    for (int64_t j = 0; out && j <= rows; j++)
        for (int64_t i = 0; i < columns; i++) {
            int64_t sum = 128;
            for (int b = 0; b < 4; b++)
                for (int a = 0; a < 4; a++)
                    sum += WEIGHTS[a] * WEIGHTS[b] * pixel(samples, columns, rows, i + a - 2, j + b - 2);
            out[j * columns + i] = (int32_t)(sum >> 8);
        }
    return out;
}

// ---- place and world -------------------------------------------------------

void sphere_axes(double radius_m, const double place[3], double axes[3][3])
{
    double longitude = place[0] / radius_m, latitude = place[1] / radius_m;
    double cx = cos(longitude), sx = sin(longitude), cy = cos(latitude), sy = sin(latitude);
    double rows[3][3] = {{-sx, cx, 0}, {-sy * cx, -sy * sx, cy}, {cy * cx, cy * sx, sy}};
    memcpy(axes, rows, sizeof rows);
}

void sphere_world_from_place(double radius_m, const double place[3], double world_m[3])
{
    double axes[3][3], distance_m = radius_m + place[2];
    sphere_axes(radius_m, place, axes);
    for (int axis = 0; axis < 3; axis++) world_m[axis] = distance_m * axes[2][axis];
}

void sphere_place_from_world(double radius_m, const double world_m[3], double place[3])
{
    double across = hypot(world_m[0], world_m[1]), z = world_m[2];
    place[0] = radius_m * atan2(world_m[1], world_m[0]);
    place[1] = radius_m * atan2(z, across);
    place[2] = hypot(across, z) - radius_m;
}
