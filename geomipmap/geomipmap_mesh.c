// SPDX-License-Identifier: MIT
#include "geomipmap/geomipmap_mesh.h"

#include "common/report.h"
#include "geomipmap/geomipmap_strip.h"

#include <stdlib.h>

// Software and hardware vertex caches alike: columns this many cells wide reuse each row while it is still
// cached (gl-rooflines.md, section 3: 0.59 vertices a triangle).
enum { COLUMN_CELLS = 8 };

enum region { CENTRE = GEOMIPMAP_SIDES, WHOLE }; // besides enum geomipmap_side

struct writer {
    uint16_t *out;
    int count;
    int cells; // of the tile's side
    int size;  // of a cell of the level
    int step[GEOMIPMAP_SIDES];
    int region;
    bool mirror; // exchange x and y, and keep triangles counter-clockwise
};

// A border coarser than the level: vertices that it lacks move to the one before.
static int snapped(int along, int step)
{
    return along / step * step;
}

static uint16_t vertex(const struct writer *w, int a, int b)
{
    int x = w->mirror ? b : a, y = w->mirror ? a : b;
    if (y == 0 && w->step[GEOMIPMAP_SOUTH] > w->size) x = snapped(x, w->step[GEOMIPMAP_SOUTH]);
    if (y == w->cells && w->step[GEOMIPMAP_NORTH] > w->size) x = snapped(x, w->step[GEOMIPMAP_NORTH]);
    if (x == 0 && w->step[GEOMIPMAP_WEST] > w->size) y = snapped(y, w->step[GEOMIPMAP_WEST]);
    if (x == w->cells && w->step[GEOMIPMAP_EAST] > w->size) y = snapped(y, w->step[GEOMIPMAP_EAST]);
    return (uint16_t)(y * (w->cells + 1) + x);
}

static void write_triangle(struct writer *w, int ax, int ay, int bx, int by, int cx, int cy)
{
    uint16_t a = vertex(w, ax, ay), b = vertex(w, bx, by), c = vertex(w, cx, cy);
    if (a == b || b == c || c == a) return; // two of its vertices are one on a coarser border
    w->out[w->count++] = a;
    w->out[w->count++] = w->mirror ? c : b;
    w->out[w->count++] = w->mirror ? b : c;
}

static int finer(int step, int size)
{
    return step < size ? step : size;
}

// The lower triangle of the cell at (x, y) with its south edge cut every `south` vertices and its east edge
// every `east`.  The upper triangle of a cell is the mirror image: its west edge takes the place of the
// south one.
static void write_half_cell(struct writer *w, int x, int y, int south, int east)
{
    int last = x + w->size - south, end_x = x + w->size, end_y = y + w->size;
    for (int b = x; b < last; b += south) write_triangle(w, end_x, end_y, b, y, b + south, y);
    for (int c = y; c < end_y; c += east) write_triangle(w, last, y, end_x, c, end_x, c + east);
}

// Which of the five regions a half cell belongs to.  They meet in the corners, along the diagonals of the
// cells there.
static int region_of(const struct writer *w, int x, int y, bool upper)
{
    int last = w->cells - w->size;
    if (y == 0 && x == 0) return upper ? GEOMIPMAP_WEST : GEOMIPMAP_SOUTH;
    if (y == 0 && x == last) return upper ? GEOMIPMAP_EAST : GEOMIPMAP_SOUTH;
    if (y == last && x == 0) return upper ? GEOMIPMAP_NORTH : GEOMIPMAP_WEST;
    if (y == last && x == last) return upper ? GEOMIPMAP_NORTH : GEOMIPMAP_EAST;
    if (y == 0) return GEOMIPMAP_SOUTH;
    if (y == last) return GEOMIPMAP_NORTH;
    if (x == 0) return GEOMIPMAP_WEST;
    return x == last ? GEOMIPMAP_EAST : CENTRE;
}

static bool wanted(const struct writer *w, int x, int y, bool upper)
{
    return w->region == WHOLE || w->region == region_of(w, x, y, upper);
}

static int write_region(int bits, int level, const int neighbours[GEOMIPMAP_SIDES], int region, uint16_t *out)
{
    struct writer w = {.out = out, .cells = 1 << bits, .size = 1 << level, .region = region};
    int size = w.size, last = w.cells - size, fan[GEOMIPMAP_SIDES];
    for (int side = 0; side < GEOMIPMAP_SIDES; side++) {
        w.step[side] = 1 << neighbours[side];
        fan[side] = finer(w.step[side], size);
    }
    for (int column = 0; column < w.cells; column += COLUMN_CELLS * size)
        for (int y = 0; y < w.cells; y += size)
            for (int x = column; x < w.cells && x < column + COLUMN_CELLS * size; x += size) {
                w.mirror = false;
                if (wanted(&w, x, y, false))
                    write_half_cell(&w, x, y, y == 0 ? fan[GEOMIPMAP_SOUTH] : size,
                                    x == last ? fan[GEOMIPMAP_EAST] : size);
                w.mirror = true;
                if (wanted(&w, x, y, true))
                    write_half_cell(&w, y, x, x == 0 ? fan[GEOMIPMAP_WEST] : size,
                                    y == last ? fan[GEOMIPMAP_NORTH] : size);
            }
    return w.count;
}

int geomipmap_mesh_write(int bits, int level, const int neighbours[GEOMIPMAP_SIDES], uint16_t *out)
{
    return write_region(bits, level, neighbours, WHOLE, out);
}

size_t geomipmap_mesh_bound(int bits)
{
    size_t cells = (size_t)1 << bits;
    return 3 * (2 * cells * cells + 4 * cells);
}

// ---- numbers of sets and parts ------------------------------------------------------------------

// Sets of the levels below `level`: 1^4 + 2^4 + ... + level^4.
static int sets_below(int level)
{
    int sum = 0;
    for (int k = 1; k <= level; k++) sum += k * k * k * k;
    return sum;
}

// Removing counts levels from the coarsest, so that the neighbours that matter are again those of lower
// number.
static int rank_of(int bits, enum geomipmap_borders borders, int level)
{
    return borders == GEOMIPMAP_REMOVE ? bits - 1 - level : level;
}

int geomipmap_mesh_set(int bits, enum geomipmap_borders borders, int level,
                       const int neighbours[GEOMIPMAP_SIDES])
{
    int own = rank_of(bits, borders, level), code = 0;
    for (int side = GEOMIPMAP_SIDES - 1; side >= 0; side--) {
        int rank = rank_of(bits, borders, neighbours[side]);
        code = code * (own + 1) + (rank < 0 ? 0 : rank < own ? rank : own);
    }
    return sets_below(own) + code;
}

struct configuration {
    int level, neighbours[GEOMIPMAP_SIDES];
};

static struct configuration configuration_of(int bits, enum geomipmap_borders borders, int set)
{
    int own = 0;
    while (set >= sets_below(own + 1)) own++;
    struct configuration c = {.level = rank_of(bits, borders, own)};
    int code = set - sets_below(own);
    for (int side = 0; side < GEOMIPMAP_SIDES; side++, code /= own + 1)
        c.neighbours[side] = rank_of(bits, borders, code % (own + 1));
    return c;
}

// Parts of the levels below `level`, each with the centre, south and north by two neighbours, east and west
// by one.
static int parts_below(int level)
{
    int sum = 0;
    for (int k = 1; k <= level; k++) sum += 1 + 2 * k * k + 2 * k;
    return sum;
}

// Number of the part that draws a region of a configuration.
static int part_of(const struct configuration *c, int region)
{
    int k = c->level + 1, first = parts_below(c->level);
    const int *n = c->neighbours;
    if (region == CENTRE) return first;
    if (region == GEOMIPMAP_SOUTH) return first + 1 + n[GEOMIPMAP_SOUTH] * k + n[GEOMIPMAP_EAST];
    if (region == GEOMIPMAP_NORTH) return first + 1 + k * k + n[GEOMIPMAP_NORTH] * k + n[GEOMIPMAP_WEST];
    return first + 1 + 2 * k * k + (region == GEOMIPMAP_WEST ? k : 0) + n[region];
}

int geomipmap_mesh_parts(const struct geomipmap_mesh *mesh, int set,
                         struct geomipmap_part parts[GEOMIPMAP_MAX_PARTS])
{
    int count = 0;
    if (mesh->borders != GEOMIPMAP_REGIONS) {
        parts[0] = mesh->parts[set];
        return 1;
    }
    struct configuration c = configuration_of(mesh->bits, mesh->borders, set);
    for (int region = 0; region <= CENTRE; region++) {
        struct geomipmap_part part = mesh->parts[part_of(&c, region)];
        if (part.count > 0) parts[count++] = part;
    }
    return count;
}

// ---- building -----------------------------------------------------------------------------------

struct builder {
    struct geomipmap_mesh *mesh;
    uint16_t *list, *strip; // of one part
    size_t room;            // indices in the mesh
};

static bool add_part(struct builder *b, int number, const struct configuration *c, int region)
{
    struct geomipmap_mesh *mesh = b->mesh;
    size_t count = (size_t)write_region(mesh->bits, c->level, c->neighbours, region, b->list);
    const uint16_t *from = mesh->strips ? b->strip : b->list;
    if (mesh->strips && count > 0) {
        count = geomipmap_strip_write(b->list, count, b->strip);
        if (count == 0) return false;
    }
    if (mesh->index_count + count > b->room) {
        size_t room = 2 * (mesh->index_count + count);
        uint16_t *indices = realloc(mesh->indices, room * sizeof *indices);
        if (!indices) return false;
        mesh->indices = indices;
        b->room = room;
    }
    mesh->parts[number] = (struct geomipmap_part){.first = mesh->index_count, .count = (int)count};
    for (size_t i = 0; i < count; i++) mesh->indices[mesh->index_count++] = from[i];
    return true;
}

static bool add_sets(struct builder *b)
{
    struct geomipmap_mesh *mesh = b->mesh;
    for (int set = 0; set < mesh->set_count; set++) {
        struct configuration c = configuration_of(mesh->bits, mesh->borders, set);
        if (!add_part(b, set, &c, WHOLE)) return false;
    }
    return true;
}

static bool add_regions(struct builder *b)
{
    for (int level = 0; level < b->mesh->bits; level++) {
        for (int near = 0; near <= level; near++)
            for (int far = 0; far <= level; far++) {
                struct configuration c = {level, {near, far, near, far}};
                if (!add_part(b, part_of(&c, GEOMIPMAP_SOUTH), &c, GEOMIPMAP_SOUTH) ||
                    !add_part(b, part_of(&c, GEOMIPMAP_NORTH), &c, GEOMIPMAP_NORTH))
                    return false;
                if (near == 0 && (!add_part(b, part_of(&c, GEOMIPMAP_EAST), &c, GEOMIPMAP_EAST) ||
                                  !add_part(b, part_of(&c, GEOMIPMAP_WEST), &c, GEOMIPMAP_WEST)))
                    return false;
            }
        struct configuration c = {level, {level, level, level, level}};
        if (!add_part(b, part_of(&c, CENTRE), &c, CENTRE)) return false;
    }
    return true;
}

bool geomipmap_mesh_init(struct geomipmap_mesh *mesh, int bits, enum geomipmap_borders borders, bool strips)
{
    bool regions = borders == GEOMIPMAP_REGIONS;
    *mesh = (struct geomipmap_mesh){.bits = bits, .borders = borders, .strips = strips};
    if (bits < GEOMIPMAP_MIN_BITS || bits > GEOMIPMAP_MAX_BITS)
        return fail("geomipmap: tiles of 2^%d cells; 2^%d to 2^%d are accepted", bits, GEOMIPMAP_MIN_BITS,
                    GEOMIPMAP_MAX_BITS);
    mesh->set_count = sets_below(bits);
    mesh->part_count = regions ? parts_below(bits) : mesh->set_count;
    mesh->parts = calloc((size_t)mesh->part_count, sizeof *mesh->parts);
    size_t bound = geomipmap_mesh_bound(bits);
    struct builder b = {.mesh = mesh,
                        .list = malloc(bound * sizeof *b.list),
                        .strip = malloc(geomipmap_strip_bound(bound) * sizeof *b.strip)};
    bool good = mesh->parts && b.list && b.strip && (regions ? add_regions(&b) : add_sets(&b));
    free(b.list);
    free(b.strip);
    if (good) {
        uint16_t *exact = realloc(mesh->indices, mesh->index_count * sizeof *exact);
        if (exact) mesh->indices = exact;
        return true;
    }
    geomipmap_mesh_finish(mesh);
    return fail("geomipmap: no memory for the index sets");
}

void geomipmap_mesh_release(struct geomipmap_mesh *mesh)
{
    free(mesh->indices);
    mesh->indices = NULL;
}

void geomipmap_mesh_finish(struct geomipmap_mesh *mesh)
{
    free(mesh->parts);
    free(mesh->indices);
    *mesh = (struct geomipmap_mesh){0};
}
