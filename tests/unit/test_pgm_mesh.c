// The persistent grid's index list: every quad once, wound one way, in tiles that a vertex cache likes.
// SPDX-License-Identifier: MIT
#include "tests/test.h"

#include "pgm/pgm_mesh.h"

#include <string.h>

static const int sizes[][2] = {{1, 1},   {1, 40},   {40, 1},    {16, 16},
                               {17, 31}, {33, 255}, {150, 600}, {16, 256}};
enum { SIZES = sizeof sizes / sizeof *sizes };

struct mesh {
    int rows, columns;
    size_t vertex_count, index_count;
    float (*vertices)[2];
    uint32_t *indices;
};

static struct mesh make_mesh(int rows, int columns)
{
    struct mesh mesh = {
        rows, columns, pgm_mesh_vertex_count(rows, columns), pgm_mesh_index_count(rows, columns), NULL, NULL};
    mesh.vertices = malloc(mesh.vertex_count * sizeof *mesh.vertices);
    mesh.indices = malloc(mesh.index_count * sizeof *mesh.indices);
    assert_true(mesh.vertices && mesh.indices);
    memset(mesh.indices, 0xff, mesh.index_count * sizeof *mesh.indices);
    pgm_mesh_vertices(rows, columns, 0, 0, mesh.vertices);
    pgm_mesh_indices(rows, columns, mesh.indices);
    return mesh;
}

static void free_mesh(struct mesh *mesh)
{
    free(mesh->vertices);
    free(mesh->indices);
}

static void test_every_quad_is_there_once(void **state)
{
    (void)state;
    for (int k = 0; k < SIZES; k++) {
        struct mesh mesh = make_mesh(sizes[k][0], sizes[k][1]);
        int stride = pgm_mesh_stride(mesh.columns);
        uint8_t *seen = calloc((size_t)mesh.rows * (size_t)mesh.columns, 1);
        assert_non_null(seen);
        double doubled_area = 0;
        for (size_t i = 0; i < mesh.index_count; i += 3) {
            int row = mesh.rows, column = mesh.columns;
            double x[3], y[3];
            for (int v = 0; v < 3; v++) {
                assert_true(mesh.indices[i + v] < mesh.vertex_count);
                int number = (int)mesh.indices[i + v];
                assert_true(number % stride <= mesh.columns); // never a padding vertex
                if (number / stride < row) row = number / stride;
                if (number % stride < column) column = number % stride;
                x[v] = number % stride;
                y[v] = -number / stride; // ahead is up
            }
            double area = (x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0]);
            assert_true(area == 1); // half a quad, counter-clockwise from above
            doubled_area += area;
            seen[row * mesh.columns + column]++;
        }
        assert_true(doubled_area == 2.0 * mesh.rows * mesh.columns);
        for (int q = 0; q < mesh.rows * mesh.columns; q++) assert_int_equal(seen[q], 2);
        free(seen);
        free_mesh(&mesh);
    }
}

static void test_vertices_span_the_rows(void **state)
{
    (void)state;
    for (int k = 0; k < SIZES; k++) {
        struct mesh mesh = make_mesh(sizes[k][0], sizes[k][1]);
        int stride = pgm_mesh_stride(mesh.columns);
        for (int j = 0; j <= mesh.rows; j++) {
            const float(*row)[2] = (const float(*)[2])mesh.vertices + j * stride;
            assert_true(row[0][1] == -1 && row[mesh.columns][1] == 1);
            for (int i = 0; i < stride; i++) assert_true(row[i][0] == (float)j);
            for (int i = 0; i < mesh.columns; i++) assert_true(row[i][1] < row[i + 1][1]);
        }
        free_mesh(&mesh);
    }
}

static void test_tiles_partition_the_index_list(void **state)
{
    (void)state;
    for (int k = 0; k < SIZES; k++) {
        int rows = sizes[k][0], columns = sizes[k][1], count = pgm_mesh_tile_count(rows, columns);
        struct mesh mesh = make_mesh(rows, columns);
        size_t next = 0;
        int farthest = rows;
        for (int t = 0; t < count; t++) {
            struct pgm_tile tile = pgm_mesh_tile(rows, columns, t);
            assert_true(tile.first == next && tile.count == 6u * (size_t)tile.rows * (size_t)tile.columns);
            assert_true(tile.rows >= 1 && tile.rows <= PGM_TILE && tile.columns >= 1 &&
                        tile.columns <= PGM_TILE);
            assert_true(tile.row <= farthest); // nearest first
            farthest = tile.row;
            next += tile.count;
            for (size_t i = tile.first; i < next; i++) {
                int j = (int)mesh.indices[i] / pgm_mesh_stride(columns);
                int c = (int)mesh.indices[i] % pgm_mesh_stride(columns);
                assert_in_range(j, tile.row, tile.row + tile.rows);
                assert_in_range(c, tile.column, tile.column + tile.columns);
            }
        }
        assert_true(next == mesh.index_count);
        free_mesh(&mesh);
    }
}

// A cache of 256 entries mapped on the vertex number's last 8 bits, flushed every 1024 indices
// (gl-rooflines.md: what llvmpipe has).  A tile of 512 triangles has 17 * 17 vertices, 0.565 a triangle; a
// flush each 341 triangles costs at most the two rows of 17 that were still wanted, 0.1 more.
static double shaded_per_triangle(const uint32_t *indices, size_t count)
{
    uint32_t cache[256];
    size_t shaded = 0;
    for (size_t i = 0; i < count; i++) {
        if (i % 1024 == 0) memset(cache, 0xff, sizeof cache);
        if (cache[indices[i] % 256] == indices[i]) continue;
        cache[indices[i] % 256] = indices[i];
        shaded++;
    }
    return (double)shaded / ((double)count / 3);
}

static void test_row_stride_suits_a_mapped_cache(void **state)
{
    (void)state;
    double worst = 0;
    for (int columns = 240; columns <= 1200; columns += 16) {
        struct mesh mesh = make_mesh(64, columns);
        double rate = shaded_per_triangle(mesh.indices, mesh.index_count);
        worst = fmax(worst, rate);
        free_mesh(&mesh);
    }
    // The same grid numbered with 256 vertices a row: every row of a tile falls on the one before.
    struct mesh mesh = make_mesh(64, 255);
    uint32_t stride = (uint32_t)pgm_mesh_stride(255);
    for (size_t i = 0; i < mesh.index_count; i++)
        mesh.indices[i] = mesh.indices[i] / stride * 256 + mesh.indices[i] % stride;
    double unpadded = shaded_per_triangle(mesh.indices, mesh.index_count);
    free_mesh(&mesh);
    FIGURE("vertices shaded a triangle: at most %.3f padded (bound 0.67), %.3f at a stride of 256", worst,
           unpadded);
    assert_true(worst <= 0.67);
    assert_true(unpadded > 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_every_quad_is_there_once),
        cmocka_unit_test(test_vertices_span_the_rows),
        cmocka_unit_test(test_tiles_partition_the_index_list),
        cmocka_unit_test(test_row_stride_suits_a_mapped_cache),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
