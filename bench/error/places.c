// SPDX-License-Identifier: MIT
#include "bench/error/places.h"

#include "common/parallel.h"
#include "common/report.h"

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum {
    LEAF_PLACES = 8,      // a leaf holds at most so many
    BLOCK_TRIANGLES = 32, // neighbours in the stream that share one box
    BLOCKS_A_TASK = 256,
    PART_DEPTH = 4, // threads share the 2^PART_DEPTH subtrees at this depth
    STACK_MAX = 64,
    AT_ONCE = 1 << 20, // triangles whose blocks are held
};

struct box {
    float x0, y0, x1, y1;
};

struct item { // a place while the tree is built: where it comes in the order may be rounded
    float xy[2];
    uint32_t place;
};

struct cell { // what the splits above leave to a node
    float low[2], high[2];
};

// The tree is whole: at depth d node m = 0 .. 2^d - 1 holds the places from count * m >> d on, and stands at
// boxes[2^d + m].  Leaves are the nodes at depth `depth`.
struct places {
    size_t count;
    int threads, depth;
    struct box *boxes;
    double (*xy)[2];    // in the tree's order
    double *low, *high; // in the tree's order; low > high: uncovered
    uint32_t *slot;     // where in that order each place stands
    double grid;        // added and subtracted again: rounds to the common grid
    struct box *blocks; // of the triangles at hand
    struct item *items; // while the tree is built
};

static size_t node_first(const struct places *places, int depth, size_t node)
{
    return (places->count * node) >> depth;
}

static double on_grid(double value, double grid)
{
    return (value + grid) - grid;
}

static bool overlap(const struct box *a, const struct box *b)
{
    return (a->x0 <= b->x1) & (b->x0 <= a->x1) & (a->y0 <= b->y1) & (b->y0 <= a->y1);
}

// ---- the tree -----------------------------------------------------------------------------------

// Puts the place that belongs at `middle` there, nearer ones before it and farther ones after it (Hoare's
// select).
static void select_item(struct item *items, size_t begin, size_t end, size_t middle, int axis)
{
    ptrdiff_t first = (ptrdiff_t)begin, last = (ptrdiff_t)end - 1, wanted = (ptrdiff_t)middle;
    while (first < last) {
        float pivot = items[first + (last - first) / 2].xy[axis];
        ptrdiff_t i = first, j = last;
        while (i <= j) {
            while (items[i].xy[axis] < pivot) i++;
            while (items[j].xy[axis] > pivot) j--;
            if (i > j) break;
            struct item swap = items[i];
            items[i++] = items[j];
            items[j--] = swap;
        }
        if (wanted <= j) // first..j are at most the pivot, i..last at least, those between equal it
            last = j;
        else if (wanted >= i)
            first = i;
        else
            return;
    }
}

static void split(struct places *places, int depth, size_t node, const struct cell *cell,
                  struct cell halves[2])
{
    size_t first = node_first(places, depth, node), end = node_first(places, depth, node + 1);
    size_t middle = node_first(places, depth + 1, 2 * node + 1);
    int axis = cell->high[1] - cell->low[1] > cell->high[0] - cell->low[0];
    select_item(places->items, first, end, middle, axis);
    halves[0] = halves[1] = *cell;
    halves[0].high[axis] = halves[1].low[axis] = places->items[middle].xy[axis];
}

static void split_subtree(struct places *places, int depth, size_t node, const struct cell *cell)
{
    struct cell halves[2];
    if (depth == places->depth) return;
    split(places, depth, node, cell, halves);
    split_subtree(places, depth + 1, 2 * node, &halves[0]);
    split_subtree(places, depth + 1, 2 * node + 1, &halves[1]);
}

struct splitting {
    struct places *places;
    int depth;
    struct cell cells[2 << PART_DEPTH]; // of the nodes that threads share, as in boxes
};

static void split_one(int node, void *user)
{
    struct splitting *s = user;
    size_t at = ((size_t)1 << s->depth) + (size_t)node;
    split(s->places, s->depth, (size_t)node, &s->cells[at], &s->cells[2 * at]);
}

static void split_part(int node, void *user)
{
    struct splitting *s = user;
    split_subtree(s->places, s->depth, (size_t)node, &s->cells[((size_t)1 << s->depth) + (size_t)node]);
}

// Puts the items into the tree's order.
static void order_items(struct places *places)
{
    struct splitting s = {.places = places};
    struct cell *root = &s.cells[1];
    for (int axis = 0; axis < 2; axis++) root->low[axis] = HUGE_VALF, root->high[axis] = -HUGE_VALF;
    for (size_t k = 0; k < places->count; k++)
        for (int axis = 0; axis < 2; axis++) {
            float value = places->items[k].xy[axis];
            root->low[axis] = value < root->low[axis] ? value : root->low[axis];
            root->high[axis] = value > root->high[axis] ? value : root->high[axis];
        }
    for (; s.depth < PART_DEPTH && s.depth < places->depth; s.depth++)
        parallel_blocks(1 << s.depth, places->threads, split_one, &s);
    parallel_blocks(1 << s.depth, places->threads, split_part, &s);
}

static float float_below(double value)
{
    float nearest = (float)value;
    return (double)nearest > value ? nextafterf(nearest, -HUGE_VALF) : nearest;
}

static float float_above(double value)
{
    return -float_below(-value);
}

static struct box join(const struct box *a, const struct box *b)
{
    return (struct box){a->x0 < b->x0 ? a->x0 : b->x0, a->y0 < b->y0 ? a->y0 : b->y0,
                        a->x1 > b->x1 ? a->x1 : b->x1, a->y1 > b->y1 ? a->y1 : b->y1};
}

static struct box leaf_box(const struct places *places, size_t leaf)
{
    double low[2] = {HUGE_VAL, HUGE_VAL}, high[2] = {-HUGE_VAL, -HUGE_VAL};
    double unit = places->grid / (1.5 * 0x1p52); // triangles' boxes are not on the grid
    size_t end = node_first(places, places->depth, leaf + 1);
    for (size_t k = node_first(places, places->depth, leaf); k < end; k++)
        for (int axis = 0; axis < 2; axis++) {
            double value = places->xy[k][axis];
            low[axis] = value < low[axis] ? value : low[axis];
            high[axis] = value > high[axis] ? value : high[axis];
        }
    return (struct box){float_below(low[0] - unit), float_below(low[1] - unit), float_above(high[0] + unit),
                        float_above(high[1] + unit)};
}

static void make_boxes(struct places *places)
{
    size_t leaves = (size_t)1 << places->depth;
    for (size_t leaf = 0; leaf < leaves; leaf++) places->boxes[leaves + leaf] = leaf_box(places, leaf);
    for (size_t node = leaves - 1; node > 0; node--)
        places->boxes[node] = join(&places->boxes[2 * node], &places->boxes[2 * node + 1]);
}

static void set_grid(struct places *places, const double (*xy)[2])
{
    double farthest = 0;
    int exponent = 0;
    for (size_t k = 0; k < places->count; k++)
        for (int axis = 0; axis < 2; axis++)
            if (fabs(xy[k][axis]) > farthest) farthest = fabs(xy[k][axis]);
    frexp(farthest, &exponent);
    places->grid = ldexp(1.5 * 0x1p52, exponent - 49);
}

static bool allocate(struct places *places)
{
    size_t count = places->count + 1; // malloc(0) may be NULL
    places->boxes = malloc(((size_t)2 << places->depth) * sizeof *places->boxes);
    places->xy = malloc(count * sizeof *places->xy);
    places->low = malloc(count * sizeof *places->low);
    places->high = malloc(count * sizeof *places->high);
    places->slot = malloc(count * sizeof *places->slot);
    places->items = malloc(count * sizeof *places->items);
    places->blocks = malloc(AT_ONCE / BLOCK_TRIANGLES * sizeof *places->blocks);
    return places->blocks && places->boxes && places->xy && places->low && places->high && places->slot &&
           places->items;
}

struct places *places_create(const double (*xy)[2], size_t count, int threads)
{
    struct places *places = calloc(1, sizeof *places);
    if (places) {
        places->count = count;
        places->threads = threads;
        while ((count >> places->depth) >= LEAF_PLACES) places->depth++;
    }
    if (!places || count > UINT32_MAX || !allocate(places)) {
        places_destroy(places);
        fail("no memory for an index of %zu places", count);
        return NULL;
    }
    set_grid(places, xy);
    for (size_t k = 0; k < count; k++)
        places->items[k] = (struct item){{(float)xy[k][0], (float)xy[k][1]}, (uint32_t)k};
    order_items(places);
    for (size_t k = 0; k < count; k++) {
        uint32_t place = places->items[k].place;
        for (int axis = 0; axis < 2; axis++) places->xy[k][axis] = on_grid(xy[place][axis], places->grid);
        places->slot[place] = (uint32_t)k;
    }
    make_boxes(places);
    free(places->items);
    places->items = NULL;
    places_clear(places);
    return places;
}

void places_destroy(struct places *places)
{
    if (!places) return;
    free(places->boxes);
    free(places->xy);
    free(places->low);
    free(places->high);
    free(places->slot);
    free(places->blocks);
    free(places->items);
    free(places);
}

void places_clear(struct places *places)
{
    for (size_t k = 0; k < places->count; k++) places->low[k] = HUGE_VAL, places->high[k] = -HUGE_VAL;
}

bool places_height(const struct places *places, size_t k, double *low, double *high)
{
    size_t slot = places->slot[k];
    *low = places->low[slot];
    *high = places->high[slot];
    return *low <= *high;
}

// ---- one triangle -------------------------------------------------------------------------------

// Both triangles of an edge see it from the same end, so that they agree on which side a place is on.
struct edge {
    double x, y, dx, dy; // inside: dx * (y_place - y) >= dy * (x_place - x)
};

struct triangle {
    struct edge edge[3]; // edge[k] faces vertex k
    double z[3], z_low, z_high, per_area;
};

static struct edge make_edge(const double from[2], const double to[2])
{
    if (from[0] > to[0] || (from[0] == to[0] && from[1] > to[1]))
        return (struct edge){to[0], to[1], to[0] - from[0], to[1] - from[1]};
    return (struct edge){from[0], from[1], to[0] - from[0], to[1] - from[1]};
}

static inline double edge_side(const struct edge *edge, double x, double y)
{
    return edge->dx * (y - edge->y) - edge->dy * (x - edge->x);
}

// False when it has no area seen from above.
static bool make_triangle(struct triangle *triangle, const float *vertices, double grid)
{
    double xy[3][2];
    for (int k = 0; k < 3; k++) {
        for (int axis = 0; axis < 2; axis++) xy[k][axis] = on_grid((double)vertices[3 * k + axis], grid);
        triangle->z[k] = (double)vertices[3 * k + 2];
    }
    struct edge base = make_edge(xy[0], xy[1]);
    double area = edge_side(&base, xy[2][0], xy[2][1]);
    if (!(fabs(area) > 0)) return false;
    triangle->edge[2] = base;
    triangle->edge[0] = make_edge(xy[1], xy[2]);
    triangle->edge[1] = make_edge(xy[2], xy[0]);
    if (area < 0) // clockwise: inside is the other side
        for (int k = 0; k < 3; k++) triangle->edge[k].dx *= -1, triangle->edge[k].dy *= -1;
    triangle->per_area = 1 / fabs(area);
    triangle->z_low = fmin(fmin(triangle->z[0], triangle->z[1]), triangle->z[2]);
    triangle->z_high = fmax(fmax(triangle->z[0], triangle->z[1]), triangle->z[2]);
    return true;
}

static void cover(struct places *places, const struct triangle *triangle, size_t first, size_t end)
{
    for (size_t k = first; k < end; k++) {
        double x = places->xy[k][0], y = places->xy[k][1];
        double side0 = edge_side(&triangle->edge[0], x, y);
        double side1 = edge_side(&triangle->edge[1], x, y);
        double side2 = edge_side(&triangle->edge[2], x, y);
        if (!((side0 >= 0) & (side1 >= 0) & (side2 >= 0))) continue;
        const double *corner = triangle->z;
        double z = corner[0] +
                   (side1 * (corner[1] - corner[0]) + side2 * (corner[2] - corner[0])) * triangle->per_area;
        // Slivers lose digits, and a mesh is never beyond its vertices.  + 0.0: -0 would depend on the order.
        z = (z < triangle->z_low ? triangle->z_low : z > triangle->z_high ? triangle->z_high : z) + 0.0;
        if (z < places->low[k]) places->low[k] = z;
        if (z > places->high[k]) places->high[k] = z;
    }
}

// ---- the stream ---------------------------------------------------------------------------------

static inline float min3(float a, float b, float c)
{
    float d = a < b ? a : b;
    return d < c ? d : c;
}

static inline float max3(float a, float b, float c)
{
    float d = a > b ? a : b;
    return d > c ? d : c;
}

static inline struct box triangle_box(const float *v)
{
    return (struct box){min3(v[0], v[3], v[6]), min3(v[1], v[4], v[7]), max3(v[0], v[3], v[6]),
                        max3(v[1], v[4], v[7])};
}

static void feed_triangle(struct places *places, size_t root, const float *vertices)
{
    struct box box = triangle_box(vertices);
    struct triangle triangle;
    bool made = false;
    size_t leaves = (size_t)1 << places->depth, stack[STACK_MAX];
    int top = 0;
    stack[top++] = root;
    while (top > 0) {
        size_t node = stack[--top];
        if (!overlap(&places->boxes[node], &box)) continue;
        if (node < leaves) {
            stack[top++] = 2 * node + 1;
            stack[top++] = 2 * node;
            continue;
        }
        if (!made && !make_triangle(&triangle, vertices, places->grid)) return;
        made = true;
        cover(places, &triangle, node_first(places, places->depth, node - leaves),
              node_first(places, places->depth, node - leaves + 1));
    }
}

struct feeding {
    struct places *places;
    const float *triangles;
    size_t count, blocks;
    int part_depth;
};

static void box_blocks(int task, void *user)
{
    const struct feeding *f = user;
    size_t first = (size_t)task * BLOCKS_A_TASK, end = first + BLOCKS_A_TASK;
    if (end > f->blocks) end = f->blocks;
    for (size_t b = first; b < end; b++) {
        struct box all = {HUGE_VALF, HUGE_VALF, -HUGE_VALF, -HUGE_VALF};
        size_t last = (b + 1) * BLOCK_TRIANGLES < f->count ? (b + 1) * BLOCK_TRIANGLES : f->count;
        for (size_t k = b * BLOCK_TRIANGLES; k < last; k++) {
            struct box box = triangle_box(f->triangles + 9 * k);
            all.x0 = box.x0 < all.x0 ? box.x0 : all.x0;
            all.y0 = box.y0 < all.y0 ? box.y0 : all.y0;
            all.x1 = box.x1 > all.x1 ? box.x1 : all.x1;
            all.y1 = box.y1 > all.y1 ? box.y1 : all.y1;
        }
        f->places->blocks[b] = all;
    }
}

static void feed_part(int part, void *user)
{
    const struct feeding *f = user;
    struct places *places = f->places;
    size_t root = ((size_t)1 << f->part_depth) + (size_t)part, leaves = (size_t)1 << places->depth;
    for (size_t b = 0; b < f->blocks; b++) {
        const struct box *box = &places->blocks[b];
        size_t node = root;
        if (!overlap(&places->boxes[node], box)) continue;
        while (node < leaves) { // down to the smallest node that holds all the block can touch
            bool left = overlap(&places->boxes[2 * node], box),
                 right = overlap(&places->boxes[2 * node + 1], box);
            if (left && right) break;
            node = left || right ? 2 * node + right : 0;
            if (node == 0) break;
        }
        if (node == 0) continue;
        size_t last = (b + 1) * BLOCK_TRIANGLES < f->count ? (b + 1) * BLOCK_TRIANGLES : f->count;
        for (size_t k = b * BLOCK_TRIANGLES; k < last; k++) feed_triangle(places, node, f->triangles + 9 * k);
    }
}

static void feed_some(struct places *places, const float *triangles, size_t count)
{
    struct feeding f = {places, triangles, count, (count + BLOCK_TRIANGLES - 1) / BLOCK_TRIANGLES, 0};
    int threads = count < (size_t)BLOCK_TRIANGLES * BLOCKS_A_TASK
                      ? 1
                      : places->threads; // starting threads has its price
    if (threads != 1) f.part_depth = places->depth < PART_DEPTH ? places->depth : PART_DEPTH;
    parallel_blocks((int)((f.blocks + BLOCKS_A_TASK - 1) / BLOCKS_A_TASK), threads, box_blocks, &f);
    parallel_blocks(1 << f.part_depth, threads, feed_part, &f);
}

void places_feed(const float *triangles, size_t count, void *user)
{
    struct places *places = user;
    if (places->count == 0) return;
    for (size_t first = 0; first < count; first += AT_ONCE)
        feed_some(places, triangles + 9 * first, count - first < AT_ONCE ? count - first : AT_ONCE);
}
