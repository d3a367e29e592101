// The index over places against brute force over all triangles, and a mesh without gaps that leaves no place
// out. SPDX-License-Identifier: MIT
#include "tests/test.h"

#include "bench/error/places.h"
#include "common/parallel.h"

#include <string.h>
#include <time.h>

__extension__ typedef __float128 quad;

static double milliseconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec * 1e3 + (double)now.tv_nsec * 1e-6;
}

// ---- meshes ---------------------------------------------------------------------------------------

struct mesh {
    float *vertices; // 9 a triangle
    size_t count;
};

static void mesh_add(struct mesh *mesh, const float corner[3][3])
{
    memcpy(mesh->vertices + 9 * mesh->count++, corner, 9 * sizeof(float));
}

static struct mesh mesh_room(size_t triangles)
{
    struct mesh mesh = {malloc(triangles * 9 * sizeof(float)), 0};
    assert_non_null(mesh.vertices);
    return mesh;
}

// Triangles thrown about: of any size and both orientations, some of no area, some standing upright.
static struct mesh mesh_random(int count, uint64_t *random)
{
    struct mesh mesh = mesh_room((size_t)count);
    for (int t = 0; t < count; t++) {
        float corner[3][3];
        double reach = exp2(test_uniform(random, -4, 8)), x = test_uniform(random, -100, 100);
        double y = test_uniform(random, -100, 100);
        for (int k = 0; k < 3; k++) {
            corner[k][0] = (float)(x + test_uniform(random, -reach, reach));
            corner[k][1] = (float)(y + test_uniform(random, -reach, reach));
            corner[k][2] = (float)test_uniform(random, -50, 50);
        }
        if (t % 7 == 0) corner[2][0] = corner[1][0], corner[2][1] = corner[1][1];
        mesh_add(&mesh, (const float(*)[3])corner);
    }
    return mesh;
}

// A square of size x size cells whose vertices are moved about by less than half a cell: no gap, no overlap.
// On float coordinates that are as crooked as they come.
static struct mesh mesh_sheet(int size, double cell, double centre, uint64_t *random)
{
    size_t side = (size_t)size + 1;
    float(*grid)[3] = malloc(side * side * sizeof *grid);
    assert_non_null(grid);
    for (int j = 0; j <= size; j++)
        for (int i = 0; i <= size; i++) {
            float *v = grid[(size_t)j * side + (size_t)i];
            double shake = i > 0 && j > 0 && i < size && j < size ? 0.24 * cell : 0;
            v[0] = (float)(centre + (i - 0.5 * size) * cell + test_uniform(random, -shake, shake));
            v[1] = (float)(centre / 3 + (j - 0.5 * size) * cell + test_uniform(random, -shake, shake));
            v[2] = (float)test_uniform(random, -50, 50);
        }
    struct mesh mesh = mesh_room(2 * (size_t)size * (size_t)size);
    for (int j = 0; j < size; j++)
        for (int i = 0; i < size; i++) {
            const float(*sw)[3] = (const float(*)[3])grid + (size_t)j * side + (size_t)i;
            float corner[3][3];
            for (int half = 0; half < 2; half++) {
                memcpy(corner[0], sw[0], sizeof corner[0]);
                memcpy(corner[1], half ? sw[side + 1] : sw[1], sizeof corner[1]);
                memcpy(corner[2], half ? sw[side] : sw[side + 1], sizeof corner[2]);
                mesh_add(&mesh, (const float(*)[3])corner);
            }
        }
    free(grid);
    return mesh;
}

// ---- brute force ----------------------------------------------------------------------------------

// Height of a triangle at a place, clockwise or not; false when it does not cover it by more than `inside` (a
// share of the triangle: 0 its edges belong to it, below 0 it is a little larger).
static bool triangle_at(const float *v, const double xy[2], double inside, double *z)
{
    quad x[3], y[3], side[3];
    for (int k = 0; k < 3; k++) x[k] = (quad)v[3 * k] - xy[0], y[k] = (quad)v[3 * k + 1] - xy[1];
    quad area = 0;
    for (int k = 0; k < 3; k++) {
        int a = (k + 1) % 3, b = (k + 2) % 3;
        side[k] = x[a] * y[b] - x[b] * y[a];
        area += side[k];
    }
    if (area == 0) return false;
    quad sum = 0;
    for (int k = 0; k < 3; k++) {
        if (side[k] / area < inside) return false;
        sum += side[k] / area * v[3 * k + 2];
    }
    *z = (double)sum;
    return true;
}

static void test_against_brute_force(void **state)
{
    (void)state;
    uint64_t random = 1;
    int compared = 0, covered = 0;
    double worst = 0;
    for (int round = 0; round < test_size(20, 400); round++) {
        enum { PLACES = 400, TRIANGLES = 150 };
        static double xy[PLACES][2];
        struct mesh mesh = mesh_random(TRIANGLES, &random);
        for (int k = 0; k < PLACES; k++)
            for (int axis = 0; axis < 2; axis++) xy[k][axis] = test_uniform(&random, -120, 120);
        struct places *places = places_create((const double(*)[2])xy, PLACES, 1);
        assert_non_null(places);
        places_feed(mesh.vertices, mesh.count, places);
        for (int k = 0; k < PLACES; k++) {
            double low = HUGE_VAL, high = -HUGE_VAL, z, got_low, got_high;
            bool doubtful =
                false; // on an edge up to the rounding of the place (2^-49 of 100 m) over a sliver's width
            for (size_t t = 0; t < mesh.count; t++) {
                const float *v = mesh.vertices + 9 * t;
                if (triangle_at(v, xy[k], 0, &z)) low = fmin(low, z), high = fmax(high, z);
                doubtful |= triangle_at(v, xy[k], -1e-7, &z) != triangle_at(v, xy[k], 1e-7, &z);
            }
            if (doubtful) continue;
            compared++;
            bool got = places_height(places, (size_t)k, &got_low, &got_high);
            assert_int_equal(got, low <= high);
            if (!got) continue;
            covered++;
            worst = fmax(worst, fmax(fabs(got_low - low), fabs(got_high - high)));
        }
        places_destroy(places);
        free(mesh.vertices);
    }
    FIGURE("places against brute force: %d, %d covered, heights at most %.1e m apart", compared, covered,
           worst);
    assert_true(covered > compared / 2);
    // Sides err by three roundings of products of some 500 m; a triangle's narrowest share is 1e-7: heights
    // of 50 m.
    assert_true(worst < 1e-6);
}

// ---- no gaps --------------------------------------------------------------------------------------

static size_t uncovered(const struct mesh *mesh, const double (*xy)[2], size_t count, int threads)
{
    struct places *places = places_create(xy, count, threads);
    size_t missing = 0;
    double low, high;
    assert_non_null(places);
    places_feed(mesh->vertices, mesh->count, places);
    for (size_t k = 0; k < count; k++) missing += !places_height(places, k, &low, &high);
    places_destroy(places);
    return missing;
}

// The naive test: float32, edges as they run around each triangle and belonging to neither side.
static bool naive_covers(const float *v, const double xy[2])
{
    float side[3];
    for (int k = 0; k < 3; k++) {
        const float *a = v + 3 * k, *b = v + 3 * ((k + 1) % 3);
        side[k] = (b[0] - a[0]) * ((float)xy[1] - a[1]) - (b[1] - a[1]) * ((float)xy[0] - a[0]);
    }
    return side[0] > 0 && side[1] > 0 && side[2] > 0;
}

static size_t naive_uncovered(const struct mesh *mesh, const double (*xy)[2], size_t count)
{
    size_t missing = 0;
    for (size_t k = 0; k < count; k++) {
        bool covered = false;
        for (size_t t = 0; t < mesh->count && !covered; t++)
            covered = naive_covers(mesh->vertices + 9 * t, xy[k]);
        missing += !covered;
    }
    return missing;
}

// Places on vertices, on edges and within a few units in the last place of both, far from the eye and around
// it.
static void test_no_place_is_left_out(void **state)
{
    (void)state;
    uint64_t random = 2;
    size_t total = 0, missing = 0, naive = 0;
    for (int round = 0; round < test_size(20, 500); round++) {
        enum { SIZE = 24 };
        const double centres[] = {0, 1000, -54321.7, 3e6};
        struct mesh mesh = mesh_sheet(SIZE, round % 3 ? 1.7 : 90.1, centres[round % 4], &random);
        size_t count = 0;
        double(*xy)[2] = malloc(mesh.count * 12 * sizeof *xy);
        assert_non_null(xy);
        for (size_t t = 0; t < mesh.count; t++) {
            int i = (int)(t / 2 % SIZE), j = (int)(t / 2 / SIZE);
            if (i == 0 || j == 0 || i == SIZE - 1 || j == SIZE - 1)
                continue; // the sheet's own border has one side
            for (int k = 0; k < 12; k++, count++) {
                const float *a = mesh.vertices + 9 * t + 3 * (k % 3),
                            *b = mesh.vertices + 9 * t + 3 * ((k + 1) % 3);
                double s = k < 3 ? 0 : test_uniform(&random, 0, 1);
                for (int axis = 0; axis < 2; axis++) {
                    xy[count][axis] = (double)a[axis] + s * ((double)b[axis] - (double)a[axis]);
                    if (k >= 6)
                        xy[count][axis] *= 1 + 0x1p-52 * (double)((int)(test_random(&random) % 5) - 2);
                }
            }
        }
        total += count;
        missing += uncovered(&mesh, (const double(*)[2])xy, count, 1 + round % 2);
        if (round % 4 == 2)
            naive += naive_uncovered(&mesh, (const double(*)[2])xy, count < 3000 ? count : 3000);
        free(xy);
        free(mesh.vertices);
    }
    FIGURE("places on edges and vertices of sheets without gaps: %zu, left out %zu (naive form: %zu)", total,
           missing, naive);
    assert_int_equal(missing, 0);
    assert_true(naive > 0);
}

// ---- any order, any threads -----------------------------------------------------------------------

static void read_all(const struct places *places, size_t count, double (*heights)[2])
{
    for (size_t k = 0; k < count; k++)
        if (!places_height(places, k, &heights[k][0], &heights[k][1])) heights[k][0] = heights[k][1] = 1e9;
}

static void test_order_and_threads(void **state)
{
    (void)state;
    uint64_t random = 3;
    enum { PLACES = 20000, TRIANGLES = 30000 };
    struct mesh mesh = mesh_random(TRIANGLES, &random);
    double(*xy)[2] = malloc(PLACES * sizeof *xy), (*want)[2] = malloc(PLACES * sizeof *want);
    double(*got)[2] = malloc(PLACES * sizeof *got);
    assert_true(xy && want && got);
    for (int k = 0; k < PLACES; k++)
        for (int axis = 0; axis < 2; axis++) xy[k][axis] = test_uniform(&random, -120, 120);
    const int threads[] = {1, 2, 8};
    for (int round = 0; round < 6; round++) {
        struct places *places = places_create((const double(*)[2])xy, PLACES, threads[round % 3]);
        places_feed(mesh.vertices, mesh.count / 3, places); // what is cleared leaves no trace
        places_clear(places);
        size_t cut = mesh.count / (size_t)(round + 1);
        places_feed(mesh.vertices + 9 * cut, mesh.count - cut, places);
        places_feed(mesh.vertices, cut, places);
        read_all(places, PLACES, round ? got : want);
        if (round) assert_memory_equal(want, got, PLACES * sizeof *got);
        places_destroy(places);
        for (size_t t = mesh.count - 1; t > 0; t--) { // another order
            float swap[9], *a = mesh.vertices + 9 * t,
                           *b = mesh.vertices + 9 * (test_random(&random) % (t + 1));
            memcpy(swap, a, sizeof swap);
            memmove(a, b, sizeof swap);
            memcpy(b, swap, sizeof swap);
        }
    }
    free(xy), free(want), free(got), free(mesh.vertices);
}

// ---- plain cases ----------------------------------------------------------------------------------

static void test_plain_cases(void **state)
{
    (void)state;
    const double xy[3][2] = {{0.25, 0.25}, {0, 0}, {2, 2}};
    double low, high;
    const float level[9] = {0, 0, 7.3f, 1, 0, 7.3f, 0, 1, 7.3f};   // its height exactly
    const float upright[9] = {0, 0, 90, 1, 1, -90, 0.5f, 0.5f, 0}; // no area seen from above
    const float broken[9] = {NAN, 0, 1, 1, 0, 1, 0, 1, 1};         // dropped whole
    const float bottomless[9] = {0, 0, NAN, 1, 0, 1, 0, 1, 1};     // here too
    const float turned[9] = {0, 0, -3, 0, 1, -3, 1, 0, -3};        // faces down
    struct places *places = places_create(xy, 3, 2);
    for (int k = 0; k < 3; k++) assert_false(places_height(places, (size_t)k, &low, &high));
    places_feed(upright, 1, places);
    places_feed(broken, 1, places);
    places_feed(bottomless, 1, places);
    for (int k = 0; k < 3; k++) assert_false(places_height(places, (size_t)k, &low, &high));
    places_feed(level, 1, places);
    for (int k = 0; k < 2; k++) {
        assert_true(places_height(places, (size_t)k, &low, &high));
        assert_true(low == (double)7.3f && high == (double)7.3f);
    }
    assert_false(places_height(places, 2, &low, &high));
    places_feed(turned, 1, places);
    assert_true(places_height(places, 0, &low, &high));
    assert_true(low == -3 && high == (double)7.3f);
    places_destroy(places);
    places = places_create(xy, 0, 1); // no place at all
    places_feed(level, 1, places);
    places_destroy(places);
    places_destroy(NULL);
}

// Picture-like places (dense near the eye, sparse far away) under meshes of 300 k and many more triangles.
static void test_speed(void **state)
{
    (void)state;
    uint64_t random = 4;
    enum { PLACES = 300000 };
    double(*xy)[2] = malloc(PLACES * sizeof *xy);
    assert_non_null(xy);
    for (int k = 0; k < PLACES; k++) {
        double away = 4000 * exp2(-test_uniform(&random, 0, 9)), turn = test_uniform(&random, -0.5, 0.5);
        xy[k][0] = away * cos(turn), xy[k][1] = away * sin(turn);
    }
    double start = milliseconds();
    struct places *places = places_create((const double(*)[2])xy, PLACES, 1);
    FIGURE("index of 300 k places: %.0f ms on one thread", milliseconds() - start);
    for (int k = 0; k < 2; k++) {
        int size = k ? test_size(1024, 2916) : 387;
        struct mesh mesh = mesh_sheet(size, 8400.0 / size, 0, &random);
        start = milliseconds();
        places_feed(mesh.vertices, mesh.count, places);
        FIGURE("%zu triangles through them: %.0f ms", mesh.count, milliseconds() - start);
        double low, high;
        for (size_t p = 0; p < PLACES; p++) assert_true(places_height(places, p, &low, &high));
        places_clear(places);
        free(mesh.vertices);
    }
    places_destroy(places);
    free(xy);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_against_brute_force),
        cmocka_unit_test(test_no_place_is_left_out),
        cmocka_unit_test(test_order_and_threads),
        cmocka_unit_test(test_plain_cases),
        cmocka_unit_test(test_speed),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
