// SPDX-License-Identifier: MIT
#include "geomipmap/geomipmap_strip.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

enum { NONE = -1 };

struct edge {
    uint32_t from_to; // both vertices of a directed edge
    int32_t triangle;
};

struct stripper {
    const uint16_t *list;
    int triangles;
    int32_t (*beside)[3]; // by triangle and edge (k to k + 1): the triangle on the other side; NONE
    int32_t *round;       // by triangle: 0 free, USED, or the walk that last met it
    int walks;
};
enum { USED = INT32_MAX };

static int compare_edges(const void *a, const void *b)
{
    uint32_t x = ((const struct edge *)a)->from_to, y = ((const struct edge *)b)->from_to;
    return (x > y) - (x < y);
}

static void find_neighbours(struct stripper *s, struct edge *edges)
{
    size_t count = 3 * (size_t)s->triangles;
    for (size_t i = 0; i < count; i++) {
        size_t next = i - i % 3 + (i + 1) % 3;
        edges[i] = (struct edge){(uint32_t)s->list[i] << 16 | s->list[next], (int32_t)(i / 3)};
    }
    qsort(edges, count, sizeof *edges, compare_edges);
    for (size_t i = 0; i < count; i++) {
        size_t next = i - i % 3 + (i + 1) % 3;
        struct edge back = {(uint32_t)s->list[next] << 16 | s->list[i], 0};
        const struct edge *found = bsearch(&back, edges, count, sizeof *edges, compare_edges);
        s->beside[i / 3][i % 3] = found ? found->triangle : NONE;
    }
}

// The edge of a triangle that joins two of its vertices, in either direction.
static int edge_between(const struct stripper *s, int triangle, uint16_t a, uint16_t b)
{
    const uint16_t *v = s->list + 3 * triangle;
    for (int k = 0; k < 2; k++)
        if ((v[k] == a && v[k + 1] == b) || (v[k] == b && v[k + 1] == a)) return k;
    return 2;
}

// Follows the strip that leaves `triangle` over its edge `leave`, as far as triangles are free.  Writes its
// vertices when `out` is given, and then uses its triangles up.  Returns the number of triangles.
static int walk(struct stripper *s, int triangle, int leave, uint16_t *out)
{
    const uint16_t *v = s->list + 3 * triangle;
    uint16_t last[2] = {v[leave], v[(leave + 1) % 3]};
    int length = 0, mark = out ? USED : ++s->walks, next = s->beside[triangle][leave];
    if (out) *out++ = v[(leave + 2) % 3], *out++ = last[0], *out++ = last[1];
    s->round[triangle] = mark;
    for (length = 1; next != NONE && s->round[next] != USED && s->round[next] != mark; length++) {
        int across = edge_between(s, next, last[0], last[1]);
        uint16_t opposite = s->list[3 * next + (across + 2) % 3];
        s->round[next] = mark;
        if (out) *out++ = opposite;
        last[0] = last[1];
        last[1] = opposite;
        next = s->beside[next][edge_between(s, next, last[0], last[1])];
    }
    return length;
}

static int free_neighbours(const struct stripper *s, int triangle)
{
    int count = 0;
    for (int k = 0; k < 3; k++)
        count += s->beside[triangle][k] != NONE && s->round[s->beside[triangle][k]] != USED;
    return count;
}

// The free triangle with the fewest free neighbours, so that none is left alone.
static int next_start(const struct stripper *s)
{
    int best = NONE, fewest = 4;
    for (int t = 0; t < s->triangles && fewest > 0; t++) {
        if (s->round[t] == USED) continue;
        int count = free_neighbours(s, t);
        if (count < fewest) fewest = count, best = t;
    }
    return best;
}

static size_t write_strips(struct stripper *s, uint16_t *out)
{
    size_t count = 0;
    for (int start; (start = next_start(s)) != NONE;) {
        int best = 0, longest = 0;
        for (int k = 0; k < 3; k++) {
            int length = walk(s, start, k, NULL);
            if (length > longest) longest = length, best = k;
        }
        if (count > 0) { // every strip starts at an even place, where triangles are not turned around
            uint16_t first = s->list[3 * start + (best + 2) % 3];
            out[count] = out[count - 1];
            out[count + 1] = first;
            count += 2;
            if (count % 2) out[count++] = first;
        }
        count += (size_t)walk(s, start, best, out + count) + 2;
    }
    return count;
}

size_t geomipmap_strip_bound(size_t count)
{
    return 2 * count; // no strip has fewer than three vertices, and joining takes three
}

size_t geomipmap_strip_write(const uint16_t *list, size_t count, uint16_t *out)
{
    struct stripper s = {.list = list, .triangles = (int)(count / 3)};
    struct edge *edges = malloc(count * sizeof *edges);
    s.beside = malloc(count / 3 * sizeof *s.beside);
    s.round = calloc(count / 3, sizeof *s.round);
    size_t written = 0;
    if (edges && s.beside && s.round) {
        find_neighbours(&s, edges);
        written = write_strips(&s, out);
    }
    free(edges);
    free(s.beside);
    free(s.round);
    return written;
}
