// SPDX-License-Identifier: MIT
#include "geomipmap/geomipmap_mesh.h"

#include "common/report.h"

#include <stdlib.h>

// Software and hardware vertex caches alike: columns this many cells wide reuse each row while it is still
// cached (gl-rooflines.md, section 3: 0.59 vertices a triangle).
enum { COLUMN_CELLS = 8 };

struct writer {
    uint16_t *out;
    int count;
    int row;     // vertices in a row
    bool mirror; // exchange x and y, and keep triangles counter-clockwise
};

static uint16_t vertex(const struct writer *w, int x, int y)
{
    return (uint16_t)(w->mirror ? x * w->row + y : y * w->row + x);
}

static void write_triangle(struct writer *w, int ax, int ay, int bx, int by, int cx, int cy)
{
    uint16_t b = vertex(w, bx, by), c = vertex(w, cx, cy);
    w->out[w->count++] = vertex(w, ax, ay);
    w->out[w->count++] = w->mirror ? c : b;
    w->out[w->count++] = w->mirror ? b : c;
}

// The lower triangle of the cell at (x, y), `size` wide, with its south edge cut every `south` vertices and
// its east edge every `east`.  The upper triangle of a cell is the mirror image: its west edge takes the
// place of the south one.
static void write_half_cell(struct writer *w, int x, int y, int size, int south, int east)
{
    int last = x + size - south, end_x = x + size, end_y = y + size;
    for (int b = x; b < last; b += south) write_triangle(w, end_x, end_y, b, y, b + south, y);
    for (int c = y; c < end_y; c += east) write_triangle(w, last, y, end_x, c, end_x, c + east);
}

int geomipmap_mesh_write(int bits, int level, const int neighbours[GEOMIPMAP_SIDES], uint16_t *out)
{
    int cells = 1 << bits, size = 1 << level, step[GEOMIPMAP_SIDES];
    for (int side = 0; side < GEOMIPMAP_SIDES; side++)
        step[side] = 1 << (neighbours[side] < level ? neighbours[side] : level);
    struct writer w = {.out = out, .row = cells + 1};
    for (int column = 0; column < cells; column += COLUMN_CELLS * size)
        for (int y = 0; y < cells; y += size)
            for (int x = column; x < cells && x < column + COLUMN_CELLS * size; x += size) {
                w.mirror = false;
                write_half_cell(&w, x, y, size, y == 0 ? step[GEOMIPMAP_SOUTH] : size,
                                x + size == cells ? step[GEOMIPMAP_EAST] : size);
                w.mirror = true;
                write_half_cell(&w, y, x, size, x == 0 ? step[GEOMIPMAP_WEST] : size,
                                y + size == cells ? step[GEOMIPMAP_NORTH] : size);
            }
    return w.count;
}

size_t geomipmap_mesh_bound(int bits)
{
    size_t cells = (size_t)1 << bits;
    return 3 * (2 * cells * cells + 4 * cells);
}

// Sets of the levels below `level`: 1^4 + 2^4 + ... + level^4.
static int sets_below(int level)
{
    int sum = 0;
    for (int k = 1; k <= level; k++) sum += k * k * k * k;
    return sum;
}

int geomipmap_mesh_set(int level, const int neighbours[GEOMIPMAP_SIDES])
{
    int code = 0;
    for (int side = GEOMIPMAP_SIDES - 1; side >= 0; side--)
        code = code * (level + 1) + (neighbours[side] < level ? neighbours[side] : level);
    return sets_below(level) + code;
}

// Triangles of a level's sets together: each of (level + 1)^4 sets has two a cell, and one more for each
// vertex that is added on a side, which happens alike in (level + 1)^3 sets (numerics.md, G1).
static size_t level_triangles(int bits, int level)
{
    size_t k = (size_t)level + 1, cells = (size_t)1 << (bits - level), added = 0;
    for (int finer = 0; finer <= level; finer++) added += ((size_t)1 << (bits - finer)) - cells;
    return k * k * k * k * 2 * cells * cells + 4 * k * k * k * added;
}

bool geomipmap_mesh_init(struct geomipmap_mesh *mesh, int bits)
{
    *mesh = (struct geomipmap_mesh){.bits = bits, .set_count = sets_below(bits)};
    if (bits < GEOMIPMAP_MIN_BITS || bits > GEOMIPMAP_MAX_BITS)
        return fail("geomipmap: tiles of 2^%d cells; 2^%d to 2^%d are accepted", bits, GEOMIPMAP_MIN_BITS,
                    GEOMIPMAP_MAX_BITS);
    size_t indices = 0;
    for (int level = 0; level < bits; level++) indices += 3 * level_triangles(bits, level);
    mesh->sets = calloc((size_t)mesh->set_count, sizeof *mesh->sets);
    mesh->indices = malloc(indices * sizeof *mesh->indices);
    if (!mesh->sets || !mesh->indices) {
        geomipmap_mesh_finish(mesh);
        return fail("geomipmap: no memory for %zu bytes of index sets", indices * sizeof *mesh->indices);
    }
    for (int level = 0; level < bits; level++)
        for (int set = sets_below(level); set < sets_below(level + 1); set++) {
            int neighbours[GEOMIPMAP_SIDES], code = set - sets_below(level);
            for (int side = 0; side < GEOMIPMAP_SIDES; side++, code /= level + 1)
                neighbours[side] = code % (level + 1);
            int count = geomipmap_mesh_write(bits, level, neighbours, mesh->indices + mesh->index_count);
            mesh->sets[set] = (struct geomipmap_set){.first = mesh->index_count, .count = count};
            mesh->index_count += (size_t)count;
        }
    return true;
}

void geomipmap_mesh_finish(struct geomipmap_mesh *mesh)
{
    free(mesh->sets);
    free(mesh->indices);
    *mesh = (struct geomipmap_mesh){0};
}
