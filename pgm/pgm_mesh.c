// SPDX-License-Identifier: MIT
#include "pgm/pgm_mesh.h"

#include <math.h>

enum { CACHE = 256, APART = PGM_TILE + 4 }; // entries of the cache; least distance of two rows in it

int pgm_mesh_stride(int columns)
{
    int stride = columns + 1;
    while (stride % CACHE < APART || stride % CACHE > CACHE - 4) stride++;
    return stride;
}

size_t pgm_mesh_vertex_count(int rows, int columns)
{
    return (size_t)(rows + 1) * (size_t)pgm_mesh_stride(columns);
}

double pgm_focus(double u, double focus, double width)
{
    if (!(width > 0) || u <= 0 || u >= 1) return fmin(fmax(u, 0), 1);
    double first = atan(-focus / width), last = atan((1 - focus) / width);
    return fmin(fmax(focus + width * tan(first + u * (last - first)), 0), 1);
}

double pgm_mesh_across(int columns, double focus, double width, int i)
{
    if (!(width > 0)) return (double)(2 * i - columns) / columns;
    return 2 * pgm_focus((double)i / columns, focus, width) - 1;
}

void pgm_mesh_vertices(int rows, int columns, double focus, double width, float (*vertices)[2])
{
    size_t stride = (size_t)pgm_mesh_stride(columns);
    for (size_t i = 0; i < stride; i++) {
        int used = i < (size_t)columns ? (int)i : columns;
        vertices[i][0] = 0;
        vertices[i][1] = (float)pgm_mesh_across(columns, focus, width, used);
    }
    for (size_t v = stride; v < (size_t)(rows + 1) * stride; v++) {
        vertices[v][0] = (float)(v / stride);
        vertices[v][1] = vertices[v % stride][1];
    }
}

size_t pgm_mesh_index_count(int rows, int columns)
{
    return (size_t)rows * (size_t)columns * 6;
}

static int tiles_along(int quads)
{
    return (quads + PGM_TILE - 1) / PGM_TILE;
}

int pgm_mesh_tile_count(int rows, int columns)
{
    return tiles_along(rows) * tiles_along(columns);
}

struct pgm_tile pgm_mesh_tile(int rows, int columns, int tile)
{
    int across = tiles_along(columns), band = tile / across;
    int near_end = rows - band * PGM_TILE, far_end = near_end > PGM_TILE ? near_end - PGM_TILE : 0;
    struct pgm_tile t = {.row = far_end, .column = tile % across * PGM_TILE, .rows = near_end - far_end};
    t.columns = columns - t.column < PGM_TILE ? columns - t.column : PGM_TILE;
    size_t quads_before = (size_t)(band * PGM_TILE) * (size_t)columns + (size_t)t.rows * (size_t)t.column;
    t.first = 6 * quads_before;
    t.count = 6 * (size_t)t.rows * (size_t)t.columns;
    return t;
}

static uint32_t *add_quad(uint32_t *out, uint32_t far_left, uint32_t stride)
{
    uint32_t near_left = far_left + stride;
    const uint32_t quad[6] = {near_left, near_left + 1, far_left + 1, near_left, far_left + 1, far_left};
    for (int k = 0; k < 6; k++) *out++ = quad[k];
    return out;
}

void pgm_mesh_indices(int rows, int columns, uint32_t *indices)
{
    uint32_t stride = (uint32_t)pgm_mesh_stride(columns);
    for (int k = 0; k < pgm_mesh_tile_count(rows, columns); k++) {
        struct pgm_tile tile = pgm_mesh_tile(rows, columns, k);
        uint32_t *out = indices + tile.first;
        for (int j = 0; j < tile.rows; j++)
            for (int i = 0; i < tile.columns; i++)
                out = add_quad(out, (uint32_t)(tile.row + j) * stride + (uint32_t)(tile.column + i), stride);
    }
}
