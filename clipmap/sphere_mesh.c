// SPDX-License-Identifier: MIT
#include "clipmap/sphere_mesh.h"

#include "common/report.h"

#include <stdlib.h>
#include <string.h>

enum { BLOCK_DRAWN = 1, BLOCK_KEPT = 2 };

// ---- vertices --------------------------------------------------------------

static size_t vertex_count(const struct sphere_mesh *mesh)
{
    return (size_t)SPHERE_SECTORS * (size_t)mesh->rings->count * (size_t)mesh->row;
}

static size_t first_vertex(const struct sphere_mesh *mesh, int sector, int ring)
{
    return ((size_t)sector * (size_t)mesh->rings->count + (size_t)ring) * (size_t)mesh->row;
}

static bool upload_vertices(struct sphere_mesh *mesh)
{
    const struct sphere_rings *rings = mesh->rings;
    float(*vertices)[4] = malloc(vertex_count(mesh) * sizeof *vertices);
    if (!vertices) return fail("clipmap: no memory for %d rings", rings->count);
    for (int sector = 0; sector < SPHERE_SECTORS; sector++)
        for (int ring = 0; ring < rings->count; ring++) {
            float(*row)[4] = vertices + first_vertex(mesh, sector, ring);
            for (int a = 0; a <= mesh->across; a++)
                sphere_ring_vertex(rings, ring, sector * mesh->across + a, row[a]);
            sphere_ring_vertex(rings, rings->count - 1, 0, row[mesh->across + 1]);
        }
    glBindBuffer(GL_ARRAY_BUFFER, mesh->vertices);
    gpu_buffer_data(mesh->gpu, GL_ARRAY_BUFFER, vertex_count(mesh) * sizeof *vertices, vertices,
                    GL_STATIC_DRAW);
    free(vertices);
    return true;
}

// ---- index lists, counter-clockwise from above: azimuths run so, rings inwards ----------------

static uint32_t *add_triangle(uint32_t *to, int a, int b, int c)
{
    to[0] = (uint32_t)a, to[1] = (uint32_t)b, to[2] = (uint32_t)c;
    return to + 3;
}

static uint32_t *add_quads(uint32_t *to, int row, int ring, int ring_step, int rings, int across, int step)
{
    for (int r = ring; r < ring + rings; r += ring_step)
        for (int a = 0; a < across; a += step) {
            int outer = r * row + a, inner = outer + ring_step * row;
            to = add_triangle(to, outer, outer + step, inner + step);
            to = add_triangle(to, outer, inner + step, inner);
        }
    return to;
}

// From a ring with azimuths `step` / 2 apart to one with `step`.
static uint32_t *add_transition(uint32_t *to, int row, int ring_step, int across, int step)
{
    for (int a = 0; a < across; a += step) {
        int outer = a, middle = a + step / 2, inner = ring_step * row + a;
        to = add_triangle(to, outer, middle, inner);
        to = add_triangle(to, middle, inner + step, inner);
        to = add_triangle(to, middle, outer + step, inner + step);
    }
    return to;
}

static int disc_ring_step(int octave)
{
    return 1 << (octave < 4 ? octave : 4); // an octave has a multiple of 16 rings
}

static bool upload_indices(struct sphere_mesh *mesh)
{
    int across = mesh->across, octave = mesh->rings->an_octave, last = 1 << mesh->rings->halvings;
    size_t most = 6 * (size_t)across * (size_t)(SPHERE_PART_RINGS + 2 * octave + 4) + 3 * (size_t)across;
    uint32_t *indices = malloc(most * sizeof *indices), *to = indices;
    if (!indices) return fail("clipmap: no memory for %zu indices", most);
    to = add_quads(to, mesh->row, 0, 1, SPHERE_PART_RINGS, across, 1);
    for (int k = 0; k <= mesh->rings->halvings; k++) {
        int step = 1 << k, ring_step = disc_ring_step(k), done = k ? ring_step : 0;
        mesh->disc_first[k] = (size_t)(to - indices);
        if (k) to = add_transition(to, mesh->row, ring_step, across, step);
        to = add_quads(to, mesh->row, done, ring_step, octave - done, across, step);
        mesh->disc_count[k] = (GLsizei)((size_t)(to - indices) - mesh->disc_first[k]);
    }
    mesh->fan_first = (size_t)(to - indices);
    mesh->fan_count = 3 * (across / last);
    for (int a = 0; a < across; a += last) to = add_triangle(to, a, a + last, mesh->row - 1);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, mesh->indices);
    gpu_buffer_data(mesh->gpu, GL_ELEMENT_ARRAY_BUFFER, (size_t)(to - indices) * sizeof *indices, indices,
                    GL_STATIC_DRAW);
    free(indices);
    return true;
}

static void describe_vertices(int floats)
{
    glEnableVertexAttribArray(0);
    glVertexAttribPointer(0, floats, GL_FLOAT, GL_FALSE, floats * (GLsizei)sizeof(float), NULL);
    glBindVertexArray(0);
}

bool sphere_mesh_init(struct sphere_mesh *mesh, struct gpu *gpu, const struct sphere_rings *rings)
{
    *mesh = (struct sphere_mesh){.gpu = gpu, .rings = rings, .across = rings->azimuths / SPHERE_SECTORS};
    mesh->row = mesh->across + 2;
    glGenVertexArrays(1, &mesh->vertex_array);
    glBindVertexArray(mesh->vertex_array);
    glGenBuffers(1, &mesh->vertices);
    glGenBuffers(1, &mesh->indices);
    if (!upload_vertices(mesh) || !upload_indices(mesh)) return false;
    describe_vertices(4);
    return true;
}

void sphere_mesh_finish(struct sphere_mesh *mesh)
{
    if (mesh->vertex_array) glDeleteVertexArrays(1, &mesh->vertex_array);
    if (mesh->vertices) glDeleteBuffers(1, &mesh->vertices);
    if (mesh->indices) glDeleteBuffers(1, &mesh->indices);
}

uint64_t sphere_mesh_bytes(const struct sphere_mesh *mesh)
{
    return vertex_count(mesh) * 4 * sizeof(float);
}

// ---- parts -----------------------------------------------------------------

int sphere_mesh_most_parts(const struct sphere_mesh *mesh)
{
    return mesh->rings->count / SPHERE_PART_RINGS + mesh->rings->halvings + 3;
}

int sphere_mesh_parts(const struct sphere_mesh *mesh, const struct sphere_ring_range *range,
                      struct sphere_part *parts)
{
    int count = 0, inner = range->inner, octave = mesh->rings->an_octave;
    for (int r = range->outer; r < inner; r += SPHERE_PART_RINGS) {
        int end = r + SPHERE_PART_RINGS < inner ? r + SPHERE_PART_RINGS : inner;
        parts[count++] = (struct sphere_part){r, end, 6 * mesh->across * (end - r), 0};
    }
    for (int k = 0; k <= mesh->rings->halvings; k++, inner += octave)
        parts[count++] =
            (struct sphere_part){inner, inner + octave, mesh->disc_count[k], mesh->disc_first[k]};
    parts[count++] = (struct sphere_part){inner, inner, mesh->fan_count, mesh->fan_first};
    return count;
}

// ---- blocks of a view ------------------------------------------------------

bool sphere_blocks_init(struct sphere_blocks *blocks, const struct sphere_mesh *mesh)
{
    size_t parts = (size_t)sphere_mesh_most_parts(mesh), count = parts * SPHERE_SECTORS;
    *blocks = (struct sphere_blocks){.parts = malloc(parts * sizeof *blocks->parts),
                                     .state = calloc(count, 1),
                                     .counts = malloc(count * sizeof *blocks->counts),
                                     .first_index = malloc(count * sizeof *blocks->first_index),
                                     .base_vertex = malloc(count * sizeof *blocks->base_vertex),
                                     .most_parts = (int)parts};
    if (!blocks->parts || !blocks->state || !blocks->counts || !blocks->first_index || !blocks->base_vertex)
        return fail("clipmap: no memory for %zu blocks", count);
    glGenVertexArrays(1, &blocks->kept_array);
    glBindVertexArray(blocks->kept_array);
    glGenBuffers(1, &blocks->kept);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, mesh->indices);
    glBindBuffer(GL_ARRAY_BUFFER, blocks->kept);
    gpu_buffer_data(mesh->gpu, GL_ARRAY_BUFFER, vertex_count(mesh) * 3 * sizeof(float), NULL,
                    GL_DYNAMIC_COPY);
    describe_vertices(3);
    return true;
}

void sphere_blocks_finish(struct sphere_blocks *blocks)
{
    if (blocks->kept_array) glDeleteVertexArrays(1, &blocks->kept_array);
    if (blocks->kept) glDeleteBuffers(1, &blocks->kept);
    free(blocks->parts);
    free(blocks->state);
    free(blocks->counts);
    free(blocks->first_index);
    free(blocks->base_vertex);
}

static uint8_t *state_of(const struct sphere_blocks *blocks, int part, int sector)
{
    return &blocks->state[sector * blocks->most_parts + part];
}

void sphere_blocks_begin(struct sphere_blocks *blocks, const struct sphere_mesh *mesh,
                         const struct sphere_ring_range *range, bool same)
{
    blocks->part_count = sphere_mesh_parts(mesh, range, blocks->parts);
    blocks->draws = 0;
    blocks->triangles = 0;
    for (int k = 0; k < blocks->most_parts * SPHERE_SECTORS; k++) blocks->state[k] &= same ? BLOCK_KEPT : 0;
}

void sphere_blocks_add(struct sphere_blocks *blocks, const struct sphere_mesh *mesh, int part, int sector)
{
    const struct sphere_part *p = &blocks->parts[part];
    int k = blocks->draws++;
    blocks->counts[k] = p->count;
    blocks->first_index[k] = p->first_index;
    blocks->base_vertex[k] = (GLint)first_vertex(mesh, sector, p->outer);
    blocks->triangles += (uint64_t)p->count / 3;
    *state_of(blocks, part, sector) |= BLOCK_DRAWN;
}

// Parts of a sector that follow each other go in one.
uint64_t sphere_blocks_keep(struct sphere_blocks *blocks, const struct sphere_mesh *mesh)
{
    uint64_t transformed = 0;
    glBindVertexArray(mesh->vertex_array);
    for (int sector = 0; sector < SPHERE_SECTORS; sector++)
        for (int part = 0; part < blocks->part_count; part++) {
            int first = part;
            while (part < blocks->part_count && *state_of(blocks, part, sector) == BLOCK_DRAWN)
                *state_of(blocks, part++, sector) |= BLOCK_KEPT;
            if (part == first) continue;
            size_t from = first_vertex(mesh, sector, blocks->parts[first].outer);
            size_t to = first_vertex(mesh, sector, blocks->parts[part - 1].inner + 1);
            gpu_transform_vertices(mesh->gpu, blocks->kept, from, to - from);
            transformed += to - from;
        }
    glBindVertexArray(0);
    return transformed;
}

void sphere_blocks_draw(const struct sphere_blocks *blocks, const struct sphere_mesh *mesh, bool kept)
{
    glBindVertexArray(kept ? blocks->kept_array : mesh->vertex_array);
    gpu_multi_draw_elements(mesh->gpu, GL_TRIANGLES, blocks->counts, GL_UNSIGNED_INT, blocks->first_index,
                            blocks->base_vertex, blocks->draws, blocks->triangles);
    glBindVertexArray(0);
}

uint64_t sphere_blocks_bytes(const struct sphere_blocks *blocks, const struct sphere_mesh *mesh)
{
    return blocks->kept ? vertex_count(mesh) * 3 * sizeof(float) : 0;
}
