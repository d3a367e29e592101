// The triangles of brute over a planet: closed, and as near to the truth as they say.
// SPDX-License-Identifier: MIT
#include "bench/facets.h"
#include "tests/planet.h"

#include <string.h>

enum { COLUMNS = 32 };

static struct view view_from(const struct terrain *terrain, const double at[4])
{
    struct camera camera =
        test_camera(terrain, at[0], at[1], at[2], at[3] * DEGREE, at[2] > 1e5 ? -1.2 : -0.1);
    struct view view;
    view_init(&view, terrain, &camera, 320, 240, 0);
    return view;
}

// On the ground, high up and in space; on the 180th meridian, beside and on a pole, and elsewhere.
static const double PLACES[][4] = {
    // longitude, latitude, height over ground, yaw
    {10, 45, 1.7, 30},  {180, -17, 1.7, 0},  {-179.9999, 20, 10000, 90}, {70, 89.99, 1.7, 90},
    {0, -90, 3000, 10}, {33, 89.2, 4e5, 90}, {-120, 5, 2e7, 0},          {160, -89.9999, 50, -90},
};
enum { PLACES_COUNT = sizeof PLACES / sizeof PLACES[0] };

struct edge {
    float ends[2][3];
};

static int compare_edges(const void *a, const void *b)
{
    return memcmp(a, b, sizeof(struct edge));
}

// Edges of no length, as a pole's rows have, join nothing.
static size_t list_edges(const struct facets *facets, bool turned, struct edge *edges)
{
    size_t count = 0;
    for (size_t t = 0; t < facets->triangles; t++)
        for (int k = 0; k < 3; k++) {
            const float *from = facets->corners[3 * t + (size_t)k],
                        *to = facets->corners[3 * t + (size_t)(k + 1) % 3];
            if (memcmp(from, to, sizeof edges->ends[0]) == 0) continue;
            memcpy(edges[count].ends[turned], from, sizeof edges->ends[0]);
            memcpy(edges[count++].ends[!turned], to, sizeof edges->ends[0]);
        }
    qsort(edges, count, sizeof *edges, compare_edges);
    return count;
}

// Whether the sphere of the lowest ground hides a place: no height over it is seen from farther round.
static bool is_hidden(const struct terrain *terrain, const struct view *view, const float at[3])
{
    const struct terrain_info *info = terrain_info(terrain);
    double lowest_m = info->radius_m + info->offset_m + info->quantum_m * info->min_q;
    double across = hypot((double)at[0], (double)at[1]), up = view->radius_m + (double)at[2];
    double horizon = acos(lowest_m / view->radius_m) + acos(fmin(lowest_m / hypot(across, up), 1));
    return atan2(across, up) > horizon;
}

// Edges that are gone along one way only; hidden ones border blocks that are left out.
static size_t count_open(const struct terrain *terrain, const struct view *view, const struct edge *there,
                         const struct edge *back, size_t count)
{
    size_t open = 0;
    for (size_t i = 0, j = 0; i < count || j < count;) {
        int order = i == count ? 1 : j == count ? -1 : compare_edges(&there[i], &back[j]);
        const struct edge *alone = order < 0 ? &there[i] : &back[j];
        open += order != 0 &&
                !(is_hidden(terrain, view, alone->ends[0]) && is_hidden(terrain, view, alone->ends[1]));
        i += order <= 0;
        j += order >= 0;
    }
    return open;
}

// Every edge that can be seen is gone along as often one way as the other, with the same bits at its ends.
static void expect_closed(int finer)
{
    struct terrain *terrain = test_planet(COLUMNS >> finer, 4000, 5, finer);
    struct facets facets = {0};
    struct facet_rises rises = {0};
    assert_true(facet_rises_init(&rises, terrain));
    size_t most = 0, open = 0;
    for (int p = 0; p < PLACES_COUNT; p++) {
        struct view view = view_from(terrain, PLACES[p]);
        assert_true(facets_make(&facets, &rises, terrain, &view, false, test_size(10, 1) * 1e-2, 1u << 31));
        struct edge *there = malloc(3 * facets.triangles * sizeof *there),
                    *back = malloc(3 * facets.triangles * sizeof *back);
        size_t count = list_edges(&facets, false, there);
        assert_int_equal(count, list_edges(&facets, true, back));
        open += count_open(terrain, &view, there, back, count);
        if (facets.triangles > most) most = facets.triangles;
        free(there);
        free(back);
    }
    FIGURE("facets of %d views, %d finer levels, up to %zu triangles: %zu open edges", PLACES_COUNT, finer,
           most, open);
    assert_int_equal(open, 0);
    assert_true(most > 10 * COLUMNS * COLUMNS); // they were split
    facets_finish(&facets);
    facet_rises_finish(&rises);
    terrain_destroy(terrain);
}

static void the_mesh_is_closed(void **state)
{
    (void)state;
    expect_closed(0);
    expect_closed(2); // cells of several columns beside cells half as wide
}

// Somewhere in a triangle, against the truth at that place.
static double off_px(const struct terrain *terrain, const struct view *view, float (*corners)[3],
                     uint64_t *seed)
{
    const struct terrain_info *info = terrain_info(terrain);
    double a = test_uniform(seed, 0, 1), b = test_uniform(seed, 0, 1), relative[3], world[3], place[3], q;
    if (a + b > 1) a = 1 - a, b = 1 - b;
    double distance = 0;
    for (int k = 0; k < 3; k++) {
        relative[k] = (double)corners[0][k] + a * ((double)corners[1][k] - (double)corners[0][k]) +
                      b * ((double)corners[2][k] - (double)corners[0][k]);
        distance += relative[k] * relative[k];
    }
    view_world(view, relative, world);
    terrain_place_from_world(terrain, world, place);
    assert_true(terrain_truth_at(terrain, place[0], place[1], &q, NULL));
    double off_m = fabs(place[2] - (q * info->quantum_m + info->offset_m));
    return view->pixels_per_tangent * off_m / fmax(sqrt(distance), view->near_m);
}

static void facets_are_near_the_truth(void **state)
{
    (void)state;
    struct facets facets = {0};
    struct facet_rises rises = {0};
    for (int finer = 0; finer <= 2; finer += 2) {
        struct terrain *terrain = test_planet(COLUMNS, 4000, 5, finer);
        assert_true(facet_rises_init(&rises, terrain));
        double worst = 0, sag_px = 1e-2;
        uint64_t seed = 3;
        // Corners are float32 (2^-24 of their distance along each axis), and slopes of up to 0.1 lie between
        // what is missed along the plumb line and what is missed at all.
        for (int p = 0; p < PLACES_COUNT; p++) {
            struct view view = view_from(terrain, PLACES[p]);
            assert_true(facets_make(&facets, &rises, terrain, &view, true, sag_px, 1u << 31));
            assert_true(facets.triangles > 0 && facets.blocks_drawn > 0);
            for (int k = 0; k < test_size(20000, 2000000); k++) {
                size_t t = test_random(&seed) % facets.triangles;
                worst = fmax(worst, off_px(terrain, &view, facets.corners + 3 * t, &seed));
            }
        }
        FIGURE("facets, %d finer levels: at most %.2e px from the truth, %.0e allowed", finer, worst, sag_px);
        assert_true(worst <= 1.01 * sag_px + 1e-4);
        facet_rises_finish(&rises);
        terrain_destroy(terrain);
    }
    facets_finish(&facets);
}

static void a_ceiling_is_said(void **state)
{
    (void)state;
    struct terrain *terrain = test_planet(COLUMNS, 4000, 5, 0);
    struct facets facets = {0};
    struct facet_rises rises = {0};
    assert_true(facet_rises_init(&rises, terrain));
    struct view view = view_from(terrain, PLACES[0]);
    assert_false(facets_make(&facets, &rises, terrain, &view, false, 1e-2, 36 * 100));
    facets_finish(&facets);
    facet_rises_finish(&rises);
    terrain_destroy(terrain);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_mesh_is_closed),
        cmocka_unit_test(facets_are_near_the_truth),
        cmocka_unit_test(a_ceiling_is_said),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
