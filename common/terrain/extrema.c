// SPDX-License-Identifier: MIT
#include "common/terrain/extrema.h"

#include "common/integer.h"
#include "common/parallel.h"

#include <stdlib.h>
#include <string.h>

enum { ROWS_A_BLOCK = 64 };

static inline void widen(int32_t q, int32_t *min_q, int32_t *max_q)
{
    *min_q = q < *min_q ? q : *min_q;
    *max_q = q > *max_q ? q : *max_q;
}

struct leaves { // the lowest nodes, read from samples
    const int32_t *samples;
    int64_t width, height; // samples
    int shift;
    struct terrain_extrema_nodes *nodes;
};

static void build_leaves(int block, void *user)
{
    const struct leaves *l = user;
    int32_t *min_q = (int32_t *)l->nodes->min_q,
            *max_q = (int32_t *)l->nodes->max_q; // allocated by extrema_init
    int64_t columns = l->nodes->width, end = smaller((int64_t)(block + 1) * ROWS_A_BLOCK, l->nodes->height);
    for (int64_t j = (int64_t)block * ROWS_A_BLOCK; j < end; j++) {
        int32_t *row_min = min_q + j * columns, *row_max = max_q + j * columns;
        for (int64_t i = 0; i < columns; i++) row_min[i] = INT32_MAX, row_max[i] = INT32_MIN;
        int64_t y_end = smaller((j + 1) << l->shift, l->height - 1);
        for (int64_t y = j << l->shift; y <= y_end; y++) {
            const int32_t *row = l->samples + y * l->width;
            for (int64_t i = 0; i < columns; i++) {
                int64_t x_end = smaller((i + 1) << l->shift, l->width - 1);
                for (int64_t x = i << l->shift; x <= x_end; x++) widen(row[x], &row_min[i], &row_max[i]);
            }
        }
    }
}

// A height of nodes from the one below.
static void build_parents(const struct terrain_extrema_nodes *below, struct terrain_extrema_nodes *nodes)
{
    int32_t *min_q = (int32_t *)nodes->min_q, *max_q = (int32_t *)nodes->max_q;
    for (int64_t j = 0; j < nodes->height; j++)
        for (int64_t i = 0; i < nodes->width; i++) {
            int64_t at = j * nodes->width + i;
            min_q[at] = INT32_MAX, max_q[at] = INT32_MIN;
            for (int64_t y = 2 * j; y < smaller(2 * j + 2, below->height); y++)
                for (int64_t x = 2 * i; x < smaller(2 * i + 2, below->width); x++) {
                    widen(below->min_q[y * below->width + x], &min_q[at], &max_q[at]);
                    widen(below->max_q[y * below->width + x], &min_q[at], &max_q[at]);
                }
        }
}

static bool allocate_nodes(struct terrain_extrema_nodes *nodes)
{
    size_t count = (size_t)(nodes->width * nodes->height);
    int32_t *values = malloc(2 * count * sizeof *values);
    nodes->min_q = values;
    nodes->max_q = values ? values + count : NULL;
    return values != NULL;
}

// Sizes the nodes of height k; false when memory runs out.
static bool add_nodes(struct terrain_extrema *extrema, const int64_t cells[2], int k)
{
    struct terrain_extrema_nodes *nodes = &extrema->nodes[k];
    nodes->width = (cells[0] + ((int64_t)1 << k) - 1) >> k;
    nodes->height = (cells[1] + ((int64_t)1 << k) - 1) >> k;
    extrema->heights = k + 1;
    return allocate_nodes(nodes);
}

static bool add_parents(struct terrain_extrema *extrema, const int64_t cells[2], int first_height)
{
    for (int k = first_height; extrema->nodes[k].width > 1 || extrema->nodes[k].height > 1; k++) {
        if (!add_nodes(extrema, cells, k + 1)) return false;
        build_parents(&extrema->nodes[k], &extrema->nodes[k + 1]);
    }
    return true;
}

bool extrema_init(struct terrain_extrema *extrema, const int32_t *samples, int64_t width, int64_t height,
                  int first_height)
{
    memset(extrema, 0, sizeof *extrema);
    const int64_t cells[2] = {larger(width - 1, 1), larger(height - 1, 1)};
    if (!add_nodes(extrema, cells, first_height)) return false;
    struct leaves leaves = {samples, width, height, first_height, &extrema->nodes[first_height]};
    parallel_blocks((int)((leaves.nodes->height + ROWS_A_BLOCK - 1) / ROWS_A_BLOCK), 0, build_leaves,
                    &leaves);
    return add_parents(extrema, cells, first_height);
}

bool extrema_init_from(struct terrain_extrema *extrema, const int64_t cells[2], int first_height,
                       void (*leaf)(const void *user, int64_t i, int64_t j, int32_t *min_q, int32_t *max_q),
                       const void *user)
{
    memset(extrema, 0, sizeof *extrema);
    if (!add_nodes(extrema, cells, first_height)) return false;
    const struct terrain_extrema_nodes *nodes = &extrema->nodes[first_height];
    for (int64_t j = 0; j < nodes->height; j++)
        for (int64_t i = 0; i < nodes->width; i++) {
            int64_t at = j * nodes->width + i;
            leaf(user, i, j, (int32_t *)&nodes->min_q[at], (int32_t *)&nodes->max_q[at]);
        }
    return add_parents(extrema, cells, first_height);
}

void extrema_finish(struct terrain_extrema *extrema)
{
    for (int k = 0; k < extrema->heights; k++) free((void *)extrema->nodes[k].min_q);
    memset(extrema, 0, sizeof *extrema);
}

void extrema_bounds(const struct terrain_extrema *extrema, const int32_t *samples, int64_t width,
                    const int64_t from[2], const int64_t to[2], int32_t *min_q, int32_t *max_q)
{
    enum { DIRECT = 16 }; // up to so many samples a side are read one by one
    int32_t low = INT32_MAX, high = INT32_MIN;
    int64_t side = larger(to[0] - from[0], to[1] - from[1]) + 1;
    if (side <= DIRECT) {
        for (int64_t y = from[1]; y <= to[1]; y++)
            for (int64_t x = from[0]; x <= to[0]; x++) widen(samples[y * width + x], &low, &high);
        *min_q = low, *max_q = high;
        return;
    }
    int k = 0; // the height at which about eight nodes span the longer side, if there are such
    while (k + 1 < extrema->heights && (extrema->nodes[k].width == 0 || side >> k > 8)) k++;
    const struct terrain_extrema_nodes *nodes = &extrema->nodes[k];
    // Samples from..to are corners of the cells from..to-1; a single line of samples belongs to the cells
    // after it.
    int64_t x_end = smaller(larger(from[0], to[0] - 1) >> k, nodes->width - 1);
    int64_t y_end = smaller(larger(from[1], to[1] - 1) >> k, nodes->height - 1);
    for (int64_t y = smaller(from[1] >> k, y_end); y <= y_end; y++)
        for (int64_t x = smaller(from[0] >> k, x_end); x <= x_end; x++) {
            widen(nodes->min_q[y * nodes->width + x], &low, &high);
            widen(nodes->max_q[y * nodes->width + x], &low, &high);
        }
    *min_q = low, *max_q = high;
}

size_t extrema_bytes(const struct terrain_extrema *extrema)
{
    size_t bytes = 0;
    for (int k = 0; k < extrema->heights; k++)
        bytes += (size_t)(extrema->nodes[k].width * extrema->nodes[k].height) * 2 * sizeof(int32_t);
    return bytes;
}
