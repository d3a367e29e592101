// Index sets: the counts of numerics.md G1, each set covers the tile once, and borders fit every neighbour
// (C4).
// SPDX-License-Identifier: MIT
#include "geomipmap/geomipmap_mesh.h"
#include "tests/test.h"

#include <string.h>

enum { MAX_ROW = (1 << GEOMIPMAP_MAX_BITS) + 1, MAX_SETS = 2275 };

// sum of k^4 in closed form, as numerics.md gives it.
static int formula(int n)
{
    return n * (n + 1) * (2 * n + 1) * (3 * n * n + 3 * n - 1) / 30;
}

// Triangles of all sets, as numerics.md G1 counts them.
static size_t triangles_of(int n)
{
    size_t sum = 0;
    for (int l = 0; l < n; l++) {
        size_t k = (size_t)l + 1, cells = (size_t)1 << (n - l), added = 0;
        for (int j = 0; j <= l; j++) added += ((size_t)1 << (n - j)) - cells;
        sum += k * k * k * k * 2 * cells * cells + 4 * k * k * k * added;
    }
    return sum;
}

static void counts_are_those_of_the_paper(void **state)
{
    (void)state;
    static const struct {
        int bits, sets, triangles, bytes;
    } known[] = {{3, 98, 0, 0}, {4, 354, 14816, 88896}, {5, 979, 75032, 450192}, {6, 2275, 0, 0}};
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++) {
        int bits = known[i].bits;
        struct geomipmap_mesh mesh, strips, regions, region_strips;
        assert_true(geomipmap_mesh_init(&mesh, bits, GEOMIPMAP_ADD, false));
        assert_true(geomipmap_mesh_init(&strips, bits, GEOMIPMAP_ADD, true));
        assert_true(geomipmap_mesh_init(&regions, bits, GEOMIPMAP_REGIONS, false));
        assert_true(geomipmap_mesh_init(&region_strips, bits, GEOMIPMAP_REGIONS, true));
        assert_int_equal(mesh.set_count, known[i].sets);
        assert_int_equal(mesh.set_count, formula(bits));
        assert_int_equal(mesh.index_count, 3 * triangles_of(bits));
        if (known[i].triangles) {
            assert_int_equal(mesh.index_count, 3 * known[i].triangles);
            assert_int_equal(mesh.index_count * sizeof *mesh.indices, known[i].bytes);
        }
        FIGURE("tiles of %d x %d: %d sets, %zu triangles, %zu bytes (%zu as strips); five regions: %d lists, "
               "%zu bytes (%zu as strips)",
               (1 << bits) + 1, (1 << bits) + 1, mesh.set_count, mesh.index_count / 3,
               mesh.index_count * sizeof *mesh.indices, strips.index_count * sizeof *mesh.indices,
               regions.part_count, regions.index_count * sizeof *mesh.indices,
               region_strips.index_count * sizeof *mesh.indices);
        assert_true(strips.index_count < mesh.index_count); // what strips and regions are for
        assert_true(regions.index_count < mesh.index_count);
        assert_true(region_strips.index_count < regions.index_count);
        geomipmap_mesh_finish(&mesh);
        geomipmap_mesh_finish(&strips);
        geomipmap_mesh_finish(&regions);
        geomipmap_mesh_finish(&region_strips);
    }
}

// ---- the same triangles in other forms ----------------------------------------------------------

static int compare_triangles(const void *a, const void *b)
{
    uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return (x > y) - (x < y);
}

// The triangles that draw a set, each from its lowest vertex on, sorted; those without area are left out.
static size_t list_triangles(const struct geomipmap_mesh *mesh, int set, uint64_t *triangles)
{
    struct geomipmap_part parts[GEOMIPMAP_MAX_PARTS];
    int part_count = geomipmap_mesh_parts(mesh, set, parts);
    size_t count = 0;
    for (int p = 0; p < part_count; p++)
        for (int t = 0; t < geomipmap_mesh_triangles(mesh, parts[p]); t++) {
            const uint16_t *v = mesh->indices + parts[p].first + (mesh->strips ? t : 3 * t);
            bool turned = mesh->strips && t % 2;
            uint64_t a = v[turned], b = v[!turned], c = v[2];
            if (a == b || b == c || c == a) continue;
            for (int k = 0; k < 2 && (b < a || c < a); k++) {
                uint64_t first = a;
                a = b, b = c, c = first;
            }
            triangles[count++] = a << 32 | b << 16 | c;
        }
    qsort(triangles, count, sizeof *triangles, compare_triangles);
    return count;
}

static void every_form_draws_the_same_triangles(void **state)
{
    (void)state;
    static uint64_t expected[3 * MAX_ROW * MAX_ROW], found[3 * MAX_ROW * MAX_ROW];
    static const struct {
        enum geomipmap_borders borders, as;
        bool strips;
    } forms[] = {{GEOMIPMAP_ADD, GEOMIPMAP_ADD, true},
                 {GEOMIPMAP_REGIONS, GEOMIPMAP_ADD, false},
                 {GEOMIPMAP_REGIONS, GEOMIPMAP_ADD, true},
                 {GEOMIPMAP_REMOVE, GEOMIPMAP_REMOVE, true}};
    uint64_t sets = 0, parts = 0, most_parts = 0;
    int most_bits = test_size(GEOMIPMAP_MAX_BITS - 1, GEOMIPMAP_MAX_BITS);
    for (int bits = GEOMIPMAP_MIN_BITS; bits <= most_bits; bits++)
        for (size_t f = 0; f < sizeof forms / sizeof forms[0]; f++) {
            struct geomipmap_mesh lists, mesh;
            assert_true(geomipmap_mesh_init(&lists, bits, forms[f].as, false));
            assert_true(geomipmap_mesh_init(&mesh, bits, forms[f].borders, forms[f].strips));
            for (int set = 0; set < mesh.set_count; set++) {
                struct geomipmap_part list[GEOMIPMAP_MAX_PARTS];
                size_t count = list_triangles(&lists, set, expected);
                assert_int_equal(list_triangles(&mesh, set, found), count);
                assert_memory_equal(found, expected, count * sizeof *found);
                uint64_t n = (uint64_t)geomipmap_mesh_parts(&mesh, set, list);
                if (forms[f].borders != GEOMIPMAP_REGIONS || forms[f].strips) continue;
                sets++, parts += n, most_parts = n > most_parts ? n : most_parts;
            }
            geomipmap_mesh_finish(&lists);
            geomipmap_mesh_finish(&mesh);
        }
    FIGURE("%llu sets in regions: %.2f draw calls each, at most %llu", (unsigned long long)sets,
           (double)parts / (double)sets, (unsigned long long)most_parts);
    assert_int_equal(most_parts, GEOMIPMAP_MAX_PARTS);
}

// ---- covering -----------------------------------------------------------------------------------

// Which vertices of each side a set uses, and whether the set covers the tile exactly once.
struct border {
    bool used[GEOMIPMAP_SIDES][MAX_ROW];
};

// Number of the side that both vertices lie on, or -1.
static int common_side(int ax, int ay, int bx, int by, int cells)
{
    if (ay == 0 && by == 0) return GEOMIPMAP_SOUTH;
    if (ax == cells && bx == cells) return GEOMIPMAP_EAST;
    if (ay == cells && by == cells) return GEOMIPMAP_NORTH;
    if (ax == 0 && bx == 0) return GEOMIPMAP_WEST;
    return -1;
}

// Triangles that turn the same way, meet their neighbours edge to edge, close along the outline and add up
// to the tile's area cover it exactly once.
static struct border check_set(const struct geomipmap_mesh *mesh, int set)
{
    int cells = 1 << mesh->bits, row = cells + 1;
    const uint16_t *index = mesh->indices + mesh->parts[set].first;
    int64_t area = 0, open_x = 0, open_y = 0;
    struct border border = {0};
    for (int i = 0; i < mesh->parts[set].count; i += 3) {
        int x[3], y[3];
        for (int k = 0; k < 3; k++) x[k] = index[i + k] % row, y[k] = index[i + k] / row;
        int64_t twice = (int64_t)(x[1] - x[0]) * (y[2] - y[0]) - (int64_t)(x[2] - x[0]) * (y[1] - y[0]);
        assert_true(twice > 0);
        area += twice;
        for (int k = 0; k < 3; k++) {
            int n = (k + 1) % 3, side = common_side(x[k], y[k], x[n], y[n], cells);
            if (side < 0) continue;
            open_x += abs(x[n] - x[k]), open_y += abs(y[n] - y[k]);
            int along = side == GEOMIPMAP_SOUTH || side == GEOMIPMAP_NORTH;
            border.used[side][along ? x[k] : y[k]] = border.used[side][along ? x[n] : y[n]] = true;
        }
    }
    assert_int_equal(area, 2 * cells * cells);
    assert_int_equal(open_x, 2 * cells);
    assert_int_equal(open_y, 2 * cells);
    return border;
}

static int compare_edges(const void *a, const void *b)
{
    uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

// Every edge inside the tile is drawn once in each direction.
static void check_edges(const struct geomipmap_mesh *mesh, int set)
{
    static uint32_t forth[3 * 4 * MAX_ROW * MAX_ROW], back[3 * 4 * MAX_ROW * MAX_ROW];
    int cells = 1 << mesh->bits, row = cells + 1;
    const uint16_t *index = mesh->indices + mesh->parts[set].first;
    size_t count = 0;
    for (int i = 0; i < mesh->parts[set].count; i += 3)
        for (int k = 0; k < 3; k++) {
            uint32_t a = index[i + k], b = index[i + (k + 1) % 3];
            if (common_side((int)a % row, (int)a / row, (int)b % row, (int)b / row, cells) >= 0) continue;
            forth[count] = a << 16 | b;
            back[count++] = b << 16 | a;
        }
    qsort(forth, count, sizeof *forth, compare_edges);
    qsort(back, count, sizeof *back, compare_edges);
    assert_memory_equal(forth, back, count * sizeof *forth);
    for (size_t i = 1; i < count; i++) assert_true(forth[i] != forth[i - 1]);
}

static void each_set_covers_the_tile_once(void **state)
{
    (void)state;
    for (int n = 2 * GEOMIPMAP_MIN_BITS; n < 2 * GEOMIPMAP_MAX_BITS + 2; n++) {
        int bits = n / 2;
        struct geomipmap_mesh mesh;
        assert_true(geomipmap_mesh_init(&mesh, bits, n % 2 ? GEOMIPMAP_REMOVE : GEOMIPMAP_ADD, false));
        int step = bits < 6 ? 1 : test_size(7, 1);
        for (int set = 0; set < mesh.set_count; set += step) {
            check_set(&mesh, set);
            check_edges(&mesh, set);
        }
        geomipmap_mesh_finish(&mesh);
    }
}

// ---- borders ------------------------------------------------------------------------------------

struct known_set {
    int level, neighbours[GEOMIPMAP_SIDES];
    struct border border;
};

static int list_sets(const struct geomipmap_mesh *mesh, struct known_set *sets)
{
    int count = 0, n[GEOMIPMAP_SIDES];
    bool remove = mesh->borders == GEOMIPMAP_REMOVE;
    for (int level = 0; level < mesh->bits; level++) {
        int low = remove ? level : 0, high = remove ? mesh->bits - 1 : level;
        for (n[0] = low; n[0] <= high; n[0]++)
            for (n[1] = low; n[1] <= high; n[1]++)
                for (n[2] = low; n[2] <= high; n[2]++)
                    for (n[3] = low; n[3] <= high; n[3]++, count++) {
                        int set = geomipmap_mesh_set(mesh->bits, mesh->borders, level, n);
                        assert_in_range(set, 0, mesh->set_count - 1);
                        sets[set] = (struct known_set){level, {n[0], n[1], n[2], n[3]}, check_set(mesh, set)};
                    }
    }
    return count;
}

// Tile a with its side `side` against tile b with the opposite one: do they draw each other's edge?
// `asked`: the levels that each takes the other to have.
static bool may_meet(const struct geomipmap_mesh *mesh, const struct known_set *a, const struct known_set *b,
                     int side)
{
    int asked_by_a = a->neighbours[side], asked_by_b = b->neighbours[(side + 2) % 4];
    int finer = a->level < b->level ? a->level : b->level, coarser = a->level + b->level - finer;
    int drawn = mesh->borders == GEOMIPMAP_REMOVE ? coarser : finer;
    return asked_by_a == drawn && asked_by_b == drawn;
}

static void borders_fit_every_neighbour(void **state)
{
    (void)state;
    static struct known_set sets[MAX_SETS];
    for (int form = 6; form < 2 * GEOMIPMAP_MAX_BITS + test_size(1, 2); form++) {
        int bits = form / 2;
        struct geomipmap_mesh mesh;
        assert_true(geomipmap_mesh_init(&mesh, bits, form % 2 ? GEOMIPMAP_REMOVE : GEOMIPMAP_ADD, false));
        assert_int_equal(list_sets(&mesh, sets),
                         mesh.set_count); // every set has one number, every number a set
        uint64_t meetings = 0, cracks = 0, naive_cracks = 0;
        for (int a = 0; a < mesh.set_count; a++)
            for (int b = 0; b < mesh.set_count; b++)
                for (int side = 0; side < GEOMIPMAP_SIDES; side++) {
                    bool differ = memcmp(sets[a].border.used[side], sets[b].border.used[(side + 2) % 4],
                                         sizeof sets[a].border.used[side]) != 0;
                    if (may_meet(&mesh, &sets[a], &sets[b], side)) {
                        meetings++;
                        cracks += differ;
                    } else { // a tile that takes its neighbour's level to be another
                        naive_cracks += differ;
                    }
                }
        FIGURE(
            "tiles of %d, vertices %s: %llu meetings of sets, %llu cracks (%llu if neighbours are not asked)",
            (1 << bits) + 1, form % 2 ? "removed" : "added", (unsigned long long)meetings,
            (unsigned long long)cracks, (unsigned long long)naive_cracks);
        assert_int_equal(cracks, 0);
        assert_true(naive_cracks > 0); // the comparison can tell
        geomipmap_mesh_finish(&mesh);
    }
}

static void other_neighbours_ask_for_nothing(void **state)
{
    (void)state;
    for (int level = 0; level < GEOMIPMAP_MAX_BITS; level++) {
        int same[4] = {level, level, level, level}, coarser[4] = {level + 1, level + 3, 5, 255};
        coarser[2] = level > 5 ? level : 5;
        assert_int_equal(geomipmap_mesh_set(GEOMIPMAP_MAX_BITS, GEOMIPMAP_ADD, level, same),
                         geomipmap_mesh_set(GEOMIPMAP_MAX_BITS, GEOMIPMAP_ADD, level, coarser));
    }
}

static void other_sizes_are_refused(void **state)
{
    (void)state;
    struct geomipmap_mesh mesh;
    assert_false(geomipmap_mesh_init(&mesh, 1, GEOMIPMAP_ADD, false));
    assert_false(geomipmap_mesh_init(&mesh, 7, GEOMIPMAP_ADD, false));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(counts_are_those_of_the_paper),
        cmocka_unit_test(every_form_draws_the_same_triangles),
        cmocka_unit_test(each_set_covers_the_tile_once),
        cmocka_unit_test(borders_fit_every_neighbour),
        cmocka_unit_test(other_neighbours_ask_for_nothing),
        cmocka_unit_test(other_sizes_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
