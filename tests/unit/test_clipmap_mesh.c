// Index lists and the cutting of regions: the drawn levels are one closed surface.
// SPDX-License-Identifier: MIT
#include "clipmap/clipmap_mesh.h"
#include "tests/test.h"

#include <string.h>

struct world {
    struct clipmap_shape shape;
    struct view_origin eyes[CLIPMAP_MAX_LEVELS];
    struct clipmap_region regions[CLIPMAP_MAX_LEVELS];
};

static void world_at(struct world *world, int n, int64_t width, int64_t height, double x, double y)
{
    const struct clipmap_rules rules = {
        .n = n, .transition = 0.1, .alpha = CLIPMAP_ALPHA_STABLE, .fade = true, .throttle = 1};
    const struct terrain_extent extent = {-width / 2, -7, -width / 2 + width, -7 + height};
    struct view view = {.lattice_bits = 8, .eye_lattice = {llround(x * 256), llround(y * 256)}};
    memset(world, 0, sizeof *world);
    clipmap_shape_init(&world->shape, &rules, CLIPMAP_MAX_LEVELS, &extent, 1);
    for (int k = 0; k < world->shape.levels; k++) world->eyes[k] = view_level_origin(&view, k);
    clipmap_regions(&world->shape, world->eyes, 0, NULL, NULL, world->regions);
}

// Clip regions that lag behind at random: what is left of the levels must close just the same.
static void crop(struct world *world, uint64_t *seed)
{
    struct clipmap_box clips[CLIPMAP_MAX_LEVELS];
    for (int k = 0; k < world->shape.levels; k++) {
        clips[k] = k == world->shape.levels - 1 ? world->shape.map[k]
                                                : clipmap_desired(&world->shape, k, &world->eyes[k], 0, NULL);
        for (int axis = 0; k < world->shape.levels - 1 && axis < 2; axis++) {
            int64_t shift = (int64_t)(test_random(seed) % (uint64_t)world->shape.rules.n) / 2;
            if (test_random(seed) % 2) shift = -shift;
            clips[k].lo[axis] += shift;
            clips[k].hi[axis] += shift;
        }
    }
    clipmap_regions(&world->shape, world->eyes, 0, NULL, clips, world->regions);
}

// ---- lists -----------------------------------------------------------------

static void blocks_fill_their_cells(void **state)
{
    (void)state;
    struct clipmap_mesh mesh;
    assert_true(clipmap_mesh_init(&mesh, 0));
    for (int height = 1; height <= CLIPMAP_BLOCK; height++)
        for (int width = 1; width <= CLIPMAP_BLOCK; width++) {
            const struct clipmap_list *list = &mesh.lists[clipmap_block_kind(width, height)];
            assert_int_equal(list->count, 6 * width * height);
            for (uint32_t i = 0; i < list->count; i += 3) {
                int x[3], y[3];
                for (int v = 0; v < 3; v++) {
                    int id = mesh.indices[list->first + i + (uint32_t)v];
                    x[v] = id % CLIPMAP_ROW, y[v] = id / CLIPMAP_ROW;
                    assert_true(x[v] <= width && y[v] <= height);
                }
                int doubled_area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0]);
                assert_int_equal(doubled_area, 1); // counter-clockwise seen from above
            }
        }
    assert_int_equal(mesh.lists[CLIPMAP_KINDS - 1].first + mesh.lists[CLIPMAP_KINDS - 1].count, mesh.count);
    clipmap_mesh_finish(&mesh);
}

struct turned { // triangle `i` of a strip as it is drawn, in cells
    int x[3], y[3];
};

static struct turned strip_triangle(const struct clipmap_mesh *mesh, const struct clipmap_list *list,
                                    uint32_t i)
{
    const uint16_t *ids = mesh->indices + list->first + i;
    struct turned t;
    for (int v = 0; v < 3; v++) {
        int id = ids[v < 2 ? v ^ (int)(i & 1) : 2]; // every second one is turned round
        t.x[v] = id % CLIPMAP_ROW, t.y[v] = id / CLIPMAP_ROW;
    }
    return t;
}

// A column's list begins with that of any lower one: two triangles a cell, split as a block's are, and no
// area between rows.
static void columns_fill_their_cells(void **state)
{
    (void)state;
    enum { ROWS = 70 };
    struct clipmap_mesh mesh;
    assert_true(clipmap_mesh_init(&mesh, ROWS));
    for (int width = 1; width <= CLIPMAP_COLUMN; width++)
        for (int rows = 1; rows <= ROWS; rows++) {
            int kind = clipmap_column_kind(width), halves[ROWS][CLIPMAP_COLUMN] = {{0}};
            struct clipmap_list list = clipmap_mesh_list(&mesh, kind, rows);
            assert_int_equal(list.first, mesh.lists[kind].first);
            assert_true(list.count <= mesh.lists[kind].count);
            assert_int_equal(list.triangles, list.count - 2);
            for (uint32_t i = 0; i < list.triangles; i++) {
                struct turned t = strip_triangle(&mesh, &list, i);
                int area = (t.x[1] - t.x[0]) * (t.y[2] - t.y[0]) - (t.x[2] - t.x[0]) * (t.y[1] - t.y[0]);
                bool repeats = (t.x[0] == t.x[1] && t.y[0] == t.y[1]) ||
                               (t.x[1] == t.x[2] && t.y[1] == t.y[2]) ||
                               (t.x[0] == t.x[2] && t.y[0] == t.y[2]);
                assert_int_equal(area, !repeats); // counter-clockwise seen from above
                if (repeats) continue;
                int x = t.x[0], y = t.y[0];
                for (int v = 1; v < 3; v++) x = t.x[v] < x ? t.x[v] : x, y = t.y[v] < y ? t.y[v] : y;
                assert_true(x < width && y < rows);
                for (int v = 0, other = 1; v < 3; v++, other = (v + 1) % 3) { // no edge on the other diagonal
                    int dx = t.x[other] - t.x[v], dy = t.y[other] - t.y[v];
                    assert_true(abs(dx) <= 1 && abs(dy) <= 1 && dx * dy != -1);
                    if (dx * dy > 0) halves[y][x] |= dx > 0 ? 1 : 2; // left of the diagonal, right of it
                }
            }
            assert_int_equal(list.triangles, 2 * width * rows + 4 * (rows - 1));
            for (int y = 0; y < rows; y++)
                for (int x = 0; x < width; x++) assert_int_equal(halves[y][x], 3);
        }
    clipmap_mesh_finish(&mesh);
}

struct cells {
    struct clipmap_box box;
    uint8_t *times;
    bool columns;
};

static void cut_columns(const struct clipmap_region *region, const struct clipmap_region *finer,
                        const struct clipmap_taker *taker)
{
    struct clipmap_box rectangles[CLIPMAP_RECTANGLES];
    int count = clipmap_rectangles(region, finer, CLIPMAP_STITCH_NONE, rectangles);
    assert_int_equal(count, finer ? 4 : 1);
    for (int i = 0; i < count; i++)
        assert_int_equal(clipmap_cut_columns(&rectangles[i], taker), clipmap_columns(&rectangles[i]));
}

static void count_cells(void *user, const struct clipmap_piece *piece, unsigned planes)
{
    (void)planes;
    struct cells *cells = user;
    int64_t width = cells->box.hi[0] - cells->box.lo[0];
    assert_int_equal(piece->kind, cells->columns ? clipmap_column_kind(piece->extent[0])
                                                 : clipmap_block_kind(piece->extent[0], piece->extent[1]));
    for (int y = 0; y < piece->extent[1]; y++)
        for (int x = 0; x < piece->extent[0]; x++)
            cells->times[(piece->corner[1] + y - cells->box.lo[1]) * width + piece->corner[0] + x -
                         cells->box.lo[0]]++;
}

// Each cell between the active region and its hole is drawn once, and none in the hole.
static void blocks_and_columns_cover_the_render_region_once(void **state)
{
    (void)state;
    static const int sizes[] = {11, 15, 31, 63, 127};
    uint64_t seed = 1;
    for (int s = 0; s < 5; s++)
        for (int i = 0; i < test_size(60, 2000); i++) {
            struct world world;
            world_at(&world, sizes[s], 40000, 30000, test_uniform(&seed, -9000, 9000),
                     test_uniform(&seed, 9000, 20000));
            for (int k = 0; k + 4 < world.shape.levels; k++) { // away from the map's edge
                const struct clipmap_region *region = &world.regions[k];
                const struct clipmap_region *finer = k > 0 ? region - 1 : NULL;
                struct cells cells = {.box = region->active, .columns = i % 2};
                int64_t width = region->active.hi[0] - region->active.lo[0];
                cells.times = calloc((size_t)(width * (region->active.hi[1] - region->active.lo[1])), 1);
                assert_non_null(cells.times);
                const struct clipmap_taker taker = {NULL, count_cells, &cells, 0};
                if (cells.columns)
                    cut_columns(region, finer, &taker);
                else
                    clipmap_cut_blocks(region, finer, CLIPMAP_STITCH_NONE, &taker);
                for (int64_t y = region->active.lo[1]; y < region->active.hi[1]; y++)
                    for (int64_t x = region->active.lo[0]; x < region->active.hi[0]; x++) {
                        const struct clipmap_box *hole = &region->hole;
                        bool in_hole =
                            x >= hole->lo[0] && x < hole->hi[0] && y >= hole->lo[1] && y < hole->hi[1];
                        assert_int_equal(
                            cells.times[(y - region->active.lo[1]) * width + x - region->active.lo[0]],
                            !in_hole);
                    }
                free(cells.times);
            }
        }
}

// ---- one closed surface ----------------------------------------------------

struct edge { // between two vertices in cells of the finest level, a before b; turns: +1 drawn a to b, -1 b
              // to a
    int64_t a[2], b[2];
    int turns;
};

struct surface {
    const struct world *world;
    const struct clipmap_mesh *mesh;
    int level;
    struct edge *edges;
    size_t count, capacity;
};

static void add_edge(struct surface *surface, const int64_t from[2], const int64_t to[2])
{
    if (surface->count == surface->capacity) {
        surface->capacity = surface->capacity ? 2 * surface->capacity : 1 << 16;
        surface->edges = realloc(surface->edges, surface->capacity * sizeof *surface->edges);
        assert_non_null(surface->edges);
    }
    bool forward = from[0] < to[0] || (from[0] == to[0] && from[1] < to[1]);
    const int64_t *a = forward ? from : to, *b = forward ? to : from;
    surface->edges[surface->count++] = (struct edge){{a[0], a[1]}, {b[0], b[1]}, forward ? 1 : -1};
}

static void add_piece(void *user, const struct clipmap_piece *piece, unsigned planes)
{
    (void)planes;
    struct surface *surface = user;
    const struct clipmap_list *list = &surface->mesh->lists[piece->kind];
    bool split = piece->kind >= CLIPMAP_BLOCK_KINDS + CLIPMAP_ZERO_AREA_KINDS;
    int row = split ? CLIPMAP_HALF_ROW : CLIPMAP_ROW;
    for (uint32_t i = 0; i < list->count; i += 3) {
        int64_t at[3][2];
        for (int v = 0; v < 3; v++) {
            int id = surface->mesh->indices[list->first + i + (uint32_t)v], place[2] = {id % row, id / row};
            for (int axis = 0; axis < 2; axis++) { // in half cells of the level
                int64_t half = 2 * piece->corner[axis] + (split ? place[axis] : 2 * place[axis]);
                at[v][axis] = half * ((int64_t)1 << surface->level) / 2;
                assert_true(place[axis] <= (split ? 2 : 1) * piece->extent[axis]);
            }
        }
        for (int v = 0; v < 3; v++) add_edge(surface, at[v], at[(v + 1) % 3]);
    }
}

static int compare_edges(const void *left, const void *right)
{
    return memcmp(left, right, offsetof(struct edge, turns));
}

static bool on_or_off_the_edge(const struct world *world, const int64_t at[2])
{
    const struct clipmap_box *map = &world->shape.map[0];
    return at[0] <= map->lo[0] || at[1] <= map->lo[1] || at[0] >= map->hi[0] || at[1] >= map->hi[1];
}

// Edges inside the map that are not drawn once in each direction.
static uint64_t open_edges(const struct world *world, const struct clipmap_mesh *mesh,
                           enum clipmap_stitch stitch)
{
    struct surface surface = {.world = world, .mesh = mesh};
    const struct clipmap_taker taker = {NULL, add_piece, &surface, 0};
    for (int k = 0; k < world->shape.levels; k++) {
        surface.level = k;
        const struct clipmap_region *region = &world->regions[k], *finer = k > 0 ? region - 1 : NULL;
        clipmap_cut_blocks(region, finer, stitch, &taker);
        clipmap_cut_stitches(region, finer, stitch, &taker);
    }
    qsort(surface.edges, surface.count, sizeof *surface.edges, compare_edges);
    uint64_t open = 0;
    for (size_t i = 0, end; i < surface.count; i = end) {
        int turns = 0;
        for (end = i; end < surface.count && compare_edges(&surface.edges[i], &surface.edges[end]) == 0;
             end++)
            turns += surface.edges[end].turns;
        bool border =
            on_or_off_the_edge(world, surface.edges[i].a) && on_or_off_the_edge(world, surface.edges[i].b);
        open += turns != 0 && !border;
    }
    free(surface.edges);
    return open;
}

static void levels_and_stitches_are_one_closed_surface(void **state)
{
    (void)state;
    static const int sizes[] = {11, 15, 31, 63};
    static const int64_t maps[][2] = {{1000, 700}, {65, 65}, {300, 12}, {513, 512}, {3, 200}};
    struct clipmap_mesh mesh;
    assert_true(clipmap_mesh_init(&mesh, 0));
    uint64_t seed = 2, open[3] = {0}, views = 0;
    for (int s = 0; s < 4; s++)
        for (int m = 0; m < 5; m++)
            for (int i = 0; i < test_size(6, 100); i++, views++) {
                struct world world;
                double x = test_uniform(&seed, -0.6, 0.6) * (double)maps[m][0];
                double y = test_uniform(&seed, -0.1, 1.1) * (double)maps[m][1];
                world_at(&world, sizes[s], maps[m][0], maps[m][1], x, y);
                if (i % 2) crop(&world, &seed);
                for (int stitch = 0; stitch < 3; stitch++)
                    open[stitch] += open_edges(&world, &mesh, (enum clipmap_stitch)stitch);
            }
    FIGURE("closed surface: %lu views, %lu open edges inside the map with split edges, %lu with stitches, "
           "%lu with neither",
           views, open[CLIPMAP_STITCH_SPLIT], open[CLIPMAP_STITCH_ZERO_AREA], open[CLIPMAP_STITCH_NONE]);
    assert_int_equal(open[CLIPMAP_STITCH_SPLIT], 0);
    assert_int_equal(open[CLIPMAP_STITCH_ZERO_AREA], 0);
    assert_true(open[CLIPMAP_STITCH_NONE] > 0);
    clipmap_mesh_finish(&mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(blocks_fill_their_cells),
        cmocka_unit_test(columns_fill_their_cells),
        cmocka_unit_test(blocks_and_columns_cover_the_render_region_once),
        cmocka_unit_test(levels_and_stitches_are_one_closed_surface),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
