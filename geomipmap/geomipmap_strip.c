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
    uint64_t chance;
    int turn_cost; // of two for a triangle
    bool gathers;  // turns for triangles that would be left alone
};
enum { USED = INT32_MAX, ATTEMPTS = 48, FEW = 600 };

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

static bool is_free(const struct stripper *s, int triangle, int mark)
{
    return triangle != NONE && s->round[triangle] != USED && s->round[triangle] != mark;
}

static int free_neighbours(const struct stripper *s, int triangle)
{
    int count = 0;
    for (int k = 0; k < 3; k++)
        count += s->beside[triangle][k] != NONE && s->round[s->beside[triangle][k]] != USED;
    return count;
}

struct walked {
    int triangles, turns;
};

// Follows the strip that leaves `triangle` over its edge `leave`, as far as triangles are free.  A strip goes
// on over the edge between its last two vertices; to go on over the other one, it repeats the vertex before
// these (a turn: one more index).  Writes its vertices when `out` is given, and then uses its triangles up.
static struct walked walk(struct stripper *s, int triangle, int leave, uint16_t *out)
{
    const uint16_t *v = s->list + 3 * triangle;
    uint16_t before = v[(leave + 2) % 3], last[2] = {v[leave], v[(leave + 1) % 3]};
    int mark = out ? USED : ++s->walks;
    struct walked walked = {0, 0};
    if (out) *out++ = before, *out++ = last[0], *out++ = last[1];
    for (;;) {
        s->round[triangle] = mark;
        walked.triangles++;
        int ahead = s->beside[triangle][edge_between(s, triangle, last[0], last[1])];
        int aside = s->beside[triangle][edge_between(s, triangle, before, last[1])];
        bool on = is_free(s, ahead, mark), turn = is_free(s, aside, mark);
        if (!on && !turn) return walked;
        // A triangle aside that nothing else leads to would have to be a strip of its own.
        if (on && turn) turn = s->gathers && free_neighbours(s, aside) <= 1 && free_neighbours(s, ahead) > 1;
        if (turn) {
            if (out) out[-1] = before, *out++ = last[1];
            walked.turns++;
            last[0] = before;
        }
        triangle = turn ? aside : ahead;
        int across = edge_between(s, triangle, last[0], last[1]);
        before = last[0]; // the edge that is crossed
        last[0] = last[1];
        last[1] = s->list[3 * triangle + (across + 2) % 3];
        if (out) *out++ = last[1];
    }
}

// A free triangle with the fewest free neighbours, so that none is left alone: one of them by chance.
static int next_start(struct stripper *s)
{
    int best = NONE, fewest = 4, found = 0;
    for (int t = 0; t < s->triangles; t++) {
        if (s->round[t] == USED) continue;
        int count = free_neighbours(s, t);
        if (count < fewest) fewest = count, found = 0;
        if (count > fewest) continue;
        s->chance = s->chance * 6364136223846793005u + 1442695040888963407u;
        if (s->chance >> 33 < (UINT64_C(1) << 31) / (uint64_t)++found) best = t;
    }
    return best;
}

static size_t write_strips(struct stripper *s, uint16_t *out)
{
    size_t count = 0;
    memset(s->round, 0, (size_t)s->triangles * sizeof *s->round);
    s->walks = 0;
    for (int start; (start = next_start(s)) != NONE;) {
        int best = 0, longest = -1;
        for (int k = 0; k < 3; k++) {
            struct walked walked = walk(s, start, k, NULL);
            int length = 2 * walked.triangles - s->turn_cost * walked.turns;
            if (length > longest) longest = length, best = k;
        }
        if (count > 0) { // every strip starts at an even place, where triangles are not turned around
            uint16_t first = s->list[3 * start + (best + 2) % 3];
            out[count] = out[count - 1];
            out[count + 1] = first;
            count += 2;
            if (count % 2) out[count++] = first;
        }
        struct walked walked = walk(s, start, best, out + count);
        count += (size_t)(walked.triangles + walked.turns) + 2;
    }
    return count;
}

// The shortest of some attempts, which differ in what is left to chance and in what a turn is taken to cost.
static size_t best_strips(struct stripper *s, uint16_t *out, uint16_t *attempt)
{
    size_t best = 0;
    for (int n = 0; n < (s->triangles <= FEW ? ATTEMPTS : 1); n++) {
        s->chance = (uint64_t)n;
        s->turn_cost = n % 3;
        s->gathers = n / 3 % 2;
        size_t count = write_strips(s, attempt);
        if (best && count >= best) continue;
        best = count;
        memcpy(out, attempt, count * sizeof *out);
    }
    return best;
}

size_t geomipmap_strip_bound(size_t count)
{
    return 2 * count; // a strip of n triangles has at most 2 n + 1 vertices, and joining takes three
}

size_t geomipmap_strip_write(const uint16_t *list, size_t count, uint16_t *out)
{
    struct stripper s = {.list = list, .triangles = (int)(count / 3)};
    struct edge *edges = malloc(count * sizeof *edges);
    s.beside = malloc(count / 3 * sizeof *s.beside);
    s.round = calloc(count / 3, sizeof *s.round);
    uint16_t *attempt = malloc(geomipmap_strip_bound(count) * sizeof *attempt);
    size_t written = 0;
    if (edges && s.beside && s.round && attempt) {
        find_neighbours(&s, edges);
        written = best_strips(&s, out, attempt);
    }
    free(edges);
    free(s.beside);
    free(s.round);
    free(attempt);
    return written;
}
