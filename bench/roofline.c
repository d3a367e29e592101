// SPDX-License-Identifier: MIT
#include "bench/roofline.h"
#include "common/report.h"

#include <stdlib.h>
#include <string.h>

enum { GROUP = 512 };

struct roofline {
    struct gpu *gpu;
    struct gpu_program program;
    GLuint vertex_array, vertices, indices;
    struct frustum frustum;
    float *triangles; // kept ones, 9 floats each
    size_t count, capacity;
    uint32_t *corners; // 3 vertex numbers a triangle, in capture order
    uint32_t *order;   // triangles, grouped
    uint32_t *list;    // 3 vertex numbers a triangle, in drawing order
    float *positions;  // 3 floats a vertex
    uint32_t *table;   // hash table of vertex numbers + 1, then renumbering
    size_t table_size, work_capacity;
    size_t index_count;
    bool failed;
};

struct roofline *roofline_create(struct gpu *gpu, enum terrain_datum datum,
                                 const struct scene_effects *effects)
{
    struct roofline *roofline = calloc(1, sizeof *roofline);
    if (!roofline) return fail("out of memory"), NULL;
    roofline->gpu = gpu;
    struct scene_effects common = scene_effects_common(effects);
    const char *defines = datum == TERRAIN_SPHERE ? GPU_SPHERE : "";
    if (!gpu_program_build(gpu, &roofline->program, "bench/roofline.vert", defines, &common, PASS_SHADED)) {
        roofline_destroy(roofline);
        return NULL;
    }
    glGenVertexArrays(1, &roofline->vertex_array);
    glGenBuffers(1, &roofline->vertices);
    glGenBuffers(1, &roofline->indices);
    glBindVertexArray(roofline->vertex_array);
    glBindBuffer(GL_ARRAY_BUFFER, roofline->vertices);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, roofline->indices);
    glEnableVertexAttribArray(0);
    glVertexAttribPointer(0, 3, GL_FLOAT, GL_FALSE, 3 * sizeof(float), NULL);
    glBindVertexArray(0);
    return roofline;
}

void roofline_destroy(struct roofline *roofline)
{
    if (!roofline) return;
    gpu_program_finish(&roofline->program);
    if (roofline->vertex_array) glDeleteVertexArrays(1, &roofline->vertex_array);
    if (roofline->vertices) glDeleteBuffers(1, &roofline->vertices);
    if (roofline->indices) glDeleteBuffers(1, &roofline->indices);
    free(roofline->triangles);
    free(roofline->corners);
    free(roofline->order);
    free(roofline->list);
    free(roofline->positions);
    free(roofline->table);
    free(roofline);
}

void roofline_begin(struct roofline *roofline, const struct view *view)
{
    frustum_init(&roofline->frustum, view);
    roofline->count = 0;
    roofline->failed = false;
}

static bool degenerate(const float *t)
{
    double ux = (double)t[3] - (double)t[0], uy = (double)t[4] - (double)t[1],
           uz = (double)t[5] - (double)t[2];
    double vx = (double)t[6] - (double)t[0], vy = (double)t[7] - (double)t[1],
           vz = (double)t[8] - (double)t[2];
    double nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
    return nx == 0 && ny == 0 && nz == 0;
}

// Trivially outside: all three corners on the wrong side of one plane, as a rasteriser rejects.
static bool outside(const struct frustum *frustum, const float *t)
{
    for (int p = 0; p < FRUSTUM_PLANES; p++) {
        const double *n = frustum->normal[p];
        int behind = 0;
        for (int c = 0; c < 9; c += 3)
            behind +=
                n[0] * (double)t[c] + n[1] * (double)t[c + 1] + n[2] * (double)t[c + 2] + frustum->offset[p] <
                0;
        if (behind == 3) return true;
    }
    return false;
}

void roofline_feed(const float *triangles, size_t count, void *user)
{
    struct roofline *roofline = user;
    for (size_t i = 0; i < count; i++) {
        const float *t = triangles + 9 * i;
        if (outside(&roofline->frustum, t) || degenerate(t)) continue;
        if (roofline->count == roofline->capacity) {
            size_t capacity = roofline->capacity ? 2 * roofline->capacity : 1 << 18;
            float *larger = realloc(roofline->triangles, capacity * 9 * sizeof *larger);
            if (!larger) {
                roofline->failed = true;
                return;
            }
            roofline->triangles = larger;
            roofline->capacity = capacity;
        }
        memcpy(roofline->triangles + 9 * roofline->count++, t, 9 * sizeof *t);
    }
}

uint64_t roofline_visible(const struct roofline *roofline)
{
    return roofline->count;
}

static bool reserve_work(struct roofline *roofline)
{
    if (roofline->work_capacity >= roofline->count) return true;
    size_t n = roofline->work_capacity = roofline->capacity;
    size_t table = 1;
    while (table < 6 * n) table *= 2;
    free(roofline->corners);
    free(roofline->order);
    free(roofline->list);
    free(roofline->positions);
    free(roofline->table);
    roofline->corners = malloc(3 * n * sizeof *roofline->corners);
    roofline->order = malloc(n * sizeof *roofline->order);
    roofline->list = malloc(3 * n * sizeof *roofline->list);
    roofline->positions = malloc(9 * n * sizeof *roofline->positions);
    roofline->table = malloc(table * sizeof *roofline->table);
    roofline->table_size = table;
    bool good =
        roofline->corners && roofline->order && roofline->list && roofline->positions && roofline->table;
    if (!good) roofline->work_capacity = 0;
    return good || fail("out of memory for the roofline of %zu triangles", n);
}

static uint32_t find_vertex(struct roofline *roofline, const float *corner, uint32_t *vertex_count)
{
    uint32_t bits[3];
    memcpy(bits, corner, sizeof bits);
    uint64_t hash =
        (bits[0] * 0x9e3779b97f4a7c15u) ^ (bits[1] * 0xc2b2ae3d27d4eb4fu) ^ (bits[2] * 0x165667b19e3779f9u);
    size_t mask = roofline->table_size - 1, slot = (hash ^ (hash >> 29)) & mask;
    for (;; slot = (slot + 1) & mask) {
        uint32_t entry = roofline->table[slot];
        if (!entry) {
            memcpy(roofline->positions + 3 * (size_t)*vertex_count, corner, 3 * sizeof *corner);
            roofline->table[slot] = ++*vertex_count;
            return *vertex_count - 1;
        }
        if (memcmp(roofline->positions + 3 * (size_t)(entry - 1), corner, 3 * sizeof *corner) == 0)
            return entry - 1;
    }
}

static uint32_t weld(struct roofline *roofline)
{
    uint32_t vertex_count = 0;
    memset(roofline->table, 0, roofline->table_size * sizeof *roofline->table);
    for (size_t c = 0; c < 3 * roofline->count; c++)
        roofline->corners[c] = find_vertex(roofline, roofline->triangles + 3 * c, &vertex_count);
    return vertex_count;
}

static float centre(const struct roofline *roofline, uint32_t triangle, int axis)
{
    const float *t = roofline->triangles + 9 * (size_t)triangle + axis;
    return t[0] + t[3] + t[6];
}

static void swap_triangles(uint32_t *a, uint32_t *b)
{
    uint32_t triangle = *a;
    *a = *b;
    *b = triangle;
}

// Partial order: afterwards the `middle` smallest centres along `axis` stand first.
static void select_middle(const struct roofline *roofline, uint32_t *order, size_t count, size_t middle,
                          int axis)
{
    size_t low = 0, high = count - 1;
    while (low < high) {
        float pivot = centre(roofline, order[low + (high - low) / 2], axis);
        size_t i = low, j = high;
        for (;;) {
            while (centre(roofline, order[i], axis) < pivot) i++;
            while (pivot < centre(roofline, order[j], axis)) j--;
            if (i >= j) break;
            swap_triangles(&order[i++], &order[j--]);
        }
        if (middle <= j)
            high = j;
        else
            low = j + 1;
    }
}

// Halves along the longer side until a group is as small as a tile; capture order stays random within a
// group, so each group is sorted back to it: neighbours then follow each other as the renderer emitted them.
static int compare_numbers(const void *a, const void *b)
{
    uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

static void group(const struct roofline *roofline, uint32_t *order, size_t count)
{
    if (count <= GROUP) {
        qsort(order, count, sizeof *order, compare_numbers);
        return;
    }
    float low[2] = {centre(roofline, order[0], 0), centre(roofline, order[0], 1)}, high[2] = {low[0], low[1]};
    for (size_t i = 1; i < count; i++)
        for (int axis = 0; axis < 2; axis++) {
            float c = centre(roofline, order[i], axis);
            if (c < low[axis]) low[axis] = c;
            if (c > high[axis]) high[axis] = c;
        }
    size_t half = count / 2;
    select_middle(roofline, order, count, half, high[1] - low[1] > high[0] - low[0]);
    group(roofline, order, half);
    group(roofline, order + half, count - half);
}

// Numbers vertices in the order of first use, so that a group's vertices lie side by side.
static void renumber(struct roofline *roofline, uint32_t vertex_count, float *positions)
{
    uint32_t *number = roofline->table, next = 0; // the hash table has done its work
    memset(number, 0xff, vertex_count * sizeof *number);
    for (size_t k = 0; k < roofline->count; k++)
        for (int c = 0; c < 3; c++) {
            uint32_t old = roofline->corners[3 * (size_t)roofline->order[k] + (size_t)c];
            if (number[old] == UINT32_MAX) {
                memcpy(positions + 3 * (size_t)next, roofline->positions + 3 * (size_t)old,
                       3 * sizeof *positions);
                number[old] = next++;
            }
            roofline->list[3 * k + (size_t)c] = number[old];
        }
}

bool roofline_build(struct roofline *roofline)
{
    roofline->index_count = 0;
    if (roofline->failed) return fail("out of memory for the roofline's triangles");
    if (!roofline->count) return true;
    if (!reserve_work(roofline)) return false;
    uint32_t vertex_count = weld(roofline);
    for (size_t i = 0; i < roofline->count; i++) roofline->order[i] = (uint32_t)i;
    group(roofline, roofline->order, roofline->count);
    float *positions =
        roofline
            ->triangles; // room for 9 floats a triangle, and no longer needed once corners and order stand
    renumber(roofline, vertex_count, positions);
    glBindVertexArray(roofline->vertex_array);
    glBindBuffer(GL_ARRAY_BUFFER, roofline->vertices);
    gpu_buffer_data(roofline->gpu, GL_ARRAY_BUFFER, (size_t)vertex_count * 3 * sizeof(float), positions,
                    GL_STATIC_DRAW);
    gpu_buffer_data(roofline->gpu, GL_ELEMENT_ARRAY_BUFFER, roofline->count * 3 * sizeof(uint32_t),
                    roofline->list, GL_STATIC_DRAW);
    glBindVertexArray(0);
    roofline->index_count = 3 * roofline->count;
    return true;
}

void roofline_draw(struct roofline *roofline)
{
    if (!roofline->index_count) return;
    gpu_use_program(roofline->gpu, &roofline->program);
    glBindVertexArray(roofline->vertex_array);
    gpu_draw_elements(roofline->gpu, GL_TRIANGLES, roofline->index_count, GL_UNSIGNED_INT, 0, 0,
                      roofline->index_count / 3);
    glBindVertexArray(0);
}
