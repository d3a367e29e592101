// The ray caster on a sphere, against a march along the ray and against the sphere itself.
// SPDX-License-Identifier: MIT
#include "bench/error/truth.h"
#include "bench/error/truth_sphere.h"
#include "common/scene/scene.h"
#include "common/terrain/detail.h"
#include "tests/folder.h"
#include "tests/planet.h"

#include <string.h>
#include <time.h>

enum { W = 96, H = 49 };

// Height of the ray over the surface, metres.
static double over_ground(const struct terrain *terrain, const double origin[3], const double direction[3],
                          double t)
{
    const struct terrain_info *info = terrain_info(terrain);
    double world[3], place[3], q = 0;
    for (int k = 0; k < 3; k++) world[k] = origin[k] + t * direction[k];
    terrain_place_from_world(terrain, world, place);
    assert_true(terrain_truth_at(terrain, place[0], place[1], &q, NULL));
    return place[2] - (q * info->quantum_m + info->offset_m);
}

// An origin over ground and a unit direction, of many kinds: over poles, in meridian planes, along parallels,
// near the seam, grazing.
static void random_ray(const struct terrain *terrain, uint64_t *seed, int kind, double top_m,
                       double origin[3], double direction[3])
{
    double place[3] = {test_uniform(seed, -M_PI, M_PI) * RADIUS, asin(test_uniform(seed, -1, 1)) * RADIUS,
                       top_m * exp(test_uniform(seed, 0, 4))};
    double axes[3][3], length = 0;
    if (kind % 6 == 1) place[1] = (kind % 4 < 2 ? 1 : -1) * (M_PI / 2 - test_uniform(seed, 0, 1e-3)) * RADIUS;
    if (kind % 6 == 2) place[0] = M_PI * RADIUS + test_uniform(seed, -1e4, 1e4);
    terrain_world_from_place(terrain, place, origin);
    terrain_axes(terrain, place, axes);
    double yaw = test_uniform(seed, -M_PI, M_PI), pitch = -exp(test_uniform(seed, log(1e-3), log(1.5)));
    if (kind % 6 == 3) yaw = kind % 4 < 2 ? M_PI / 2 : -M_PI / 2; // over a pole
    if (kind % 6 == 4) yaw = kind % 4 < 2 ? 0 : M_PI;
    if (kind % 6 == 5) { // just over the horizon of the lowest ground
        double dip = acos(RADIUS / (RADIUS + place[2]));
        pitch = -dip - test_uniform(seed, -2e-3, 2e-2);
    }
    double local[3] = {cos(yaw) * cos(pitch), sin(yaw) * cos(pitch), sin(pitch)};
    for (int k = 0; k < 3; k++) {
        direction[k] = local[0] * axes[0][k] + local[1] * axes[1][k] + local[2] * axes[2][k];
        length += direction[k] * direction[k];
    }
    for (int k = 0; k < 3; k++) direction[k] /= sqrt(length);
}

// From over one end of a cell's diagonal to under or over its other end.  Both ends lie on that side of the
// diagonal from which a great circle bends over it and back.
static void diagonal_ray(const struct terrain *terrain, uint64_t *seed, double top_m, double origin[3],
                         double direction[3])
{
    const double *spacing_m = terrain_info(terrain)->spacing_m;
    int64_t columns = terrain_level(terrain, 0).extent.x1 - terrain_level(terrain, 0).extent.x0;
    double column = floor(test_uniform(seed, 0, (double)columns)), row = floor(test_uniform(seed, -20, 20));
    double aside = (row < 0 ? -1 : 1) * test_uniform(seed, 0, 0.005), end[3], length = 0;
    const double from[3] = {(column + aside) * spacing_m[0], row * spacing_m[1],
                            test_uniform(seed, 5e4, 3e5)};
    const double to[3] = {(column + 1 + aside) * spacing_m[0], (row + 1) * spacing_m[1],
                          test_uniform(seed, -1, 1) * top_m};
    terrain_world_from_place(terrain, from, origin);
    terrain_world_from_place(terrain, to, end);
    for (int k = 0; k < 3; k++) direction[k] = end[k] - origin[k], length += direction[k] * direction[k];
    for (int k = 0; k < 3; k++) direction[k] /= sqrt(length);
}

// Place and time are rounded at 2^-52 of the planet's radius and some of its multiples (1.4e-9 m each);
// slopes of up to 1 and the radius' own rounding add as much.
static const double ROUNDED_M = 1e-6;

// Marches from 0 to `end`: the first time below ground, or -1.  `closing`: steps get smaller towards the end.
static double march(const struct terrain *terrain, const double origin[3], const double direction[3],
                    double end, bool closing)
{
    for (int k = 0; k < 400; k++) {
        double t = end * (closing ? 1 - pow(0.93, k) : k / 400.0);
        if (over_ground(terrain, origin, direction, t) < -ROUNDED_M) return t;
    }
    return -1;
}

// Every hit is on the surface, the ray is over ground before it, and a march finds no earlier one.
static void hits_are_the_first(void **state)
{
    (void)state;
    static const int FINER[] = {0, 0, 3, 8};
    for (int i = 0; i < 4; i++) {
        int finer = FINER[i];
        bool diagonals = i == 1;
        struct terrain *terrain = test_planet(W, 3e4, 9, finer);
        struct truth_sphere *sphere = truth_sphere_create(terrain);
        struct truth_tiles *tiles = truth_tiles_take(sphere);
        uint64_t seed = 7 + (uint64_t)finer;
        int hits = 0, missed = 0, count = test_size(900, 60000);
        double worst_m = 0, highest = terrain_level(terrain, terrain_info(terrain)->finest).max_q *
                                          terrain_info(terrain)->quantum_m +
                                      terrain_info(terrain)->offset_m;
        for (int k = 0; k < count; k++) {
            double origin[3], direction[3];
            struct truth_sphere_hit hit = {0};
            if (diagonals)
                diagonal_ray(terrain, &seed, highest, origin, direction);
            else
                random_ray(terrain, &seed, k, highest, origin, direction);
            bool ground = truth_sphere_cast(sphere, tiles, origin, direction, 0, &hit);
            double reach = 2 * sqrt(origin[0] * origin[0] + origin[1] * origin[1] + origin[2] * origin[2]);
            missed += march(terrain, origin, direction, ground ? hit.t : reach, ground && k % 2 == 0) >= 0;
            if (!ground) continue;
            hits++;
            worst_m = fmax(worst_m, fabs(over_ground(terrain, origin, direction, hit.t)));
            double facing = 0;
            for (int axis = 0; axis < 3; axis++) facing += hit.normal[axis] * direction[axis];
            assert_true(facing <= 1e-6); // it comes down through the surface
        }
        FIGURE("sphere caster, %d finer levels%s: %d of %d rays hit, at most %.1e m off the surface, "
               "%d came too late",
               finer, diagonals ? ", along diagonals" : "", hits, count, worst_m, missed);
        assert_true(hits > count / 5);
        assert_int_equal(missed, 0);
        assert_true(worst_m < ROUNDED_M);
        truth_tiles_give(sphere, tiles);
        truth_sphere_destroy(sphere);
        terrain_destroy(terrain);
    }
}

// On a planet without relief, every facet is the sphere.
static void a_flat_planet_is_a_sphere(void **state)
{
    (void)state;
    struct terrain *terrain = test_planet(W, 0, 9, 0);
    struct truth_sphere *sphere = truth_sphere_create(terrain);
    struct truth_tiles *tiles = truth_tiles_take(sphere);
    uint64_t seed = 11;
    int wrong = 0, close = 0;
    double worst_m = 0;
    for (int k = 0; k < test_size(20000, 1000000); k++) {
        double origin[3], direction[3], p = 0, e = 0;
        struct truth_sphere_hit hit;
        random_ray(terrain, &seed, k, k % 3 ? 1.7 : 1e6, origin, direction);
        bool ground = truth_sphere_cast(sphere, tiles, origin, direction, 0, &hit);
        for (int axis = 0; axis < 3; axis++)
            p += origin[axis] * direction[axis], e += origin[axis] * origin[axis];
        double least = sqrt(e - p * p);
        if (fabs(least - RADIUS) < 1e-6) {
            close++;
            continue;
        }
        bool meets = least < RADIUS && p < 0;
        wrong += meets != ground;
        if (!ground || !meets) continue;
        double radius = 0;
        for (int axis = 0; axis < 3; axis++) radius += pow(origin[axis] + hit.t * direction[axis], 2);
        worst_m = fmax(worst_m, fabs(sqrt(radius) - RADIUS));
    }
    FIGURE("sphere caster on a flat planet: %d wrong, at most %.1e m off, %d too close to call", wrong,
           worst_m, close);
    assert_int_equal(wrong, 0);
    assert_true(worst_m < 1e-7); // some 100 roundings of the radius
    truth_tiles_give(sphere, tiles);
    truth_sphere_destroy(sphere);
    terrain_destroy(terrain);
}

// Packed without loss and opened to be read on demand.
static struct terrain *on_disk(int columns, double waves, int finer)
{
    test_planet_pack(columns, 1e4, waves, 0, in_folder("planet.relief"));
    const struct terrain_options options = {.cache_bytes = 2 << 20, .synthesize_levels = finer, .seed = 2};
    struct terrain *disk = terrain_load(in_folder("planet.relief"), &options);
    assert_non_null(disk);
    assert_null(terrain_extrema(disk)); // read on demand
    return disk;
}

// Over a planet on disk and the same in memory every ray meets the same place, bit for bit, though the one's
// bounds are looser and the other's are of single cells.
static void on_disk_as_in_memory(void **state)
{
    static const struct {
        int columns, finer;
    } KINDS[] = {{1440, 0}, {36, 0}, {1440, 3}};
    (void)state;
    for (int kind = 0; kind < 3; kind++) {
        int columns = KINDS[kind].columns, finer = KINDS[kind].finer, count = test_size(1000, 200000);
        double waves = columns > W ? 40 : 9;
        struct terrain *memory = test_planet(columns, 1e4, waves, finer);
        struct terrain *disk = on_disk(columns, waves, finer);
        // Noise is fitted to a file's own coarse levels: for the same planet it is given.
        memcpy(((struct detail *)(uintptr_t)terrain_detail(memory))->sigma_q, terrain_detail(disk)->sigma_q,
               sizeof terrain_detail(disk)->sigma_q);
        const struct terrain_info *info = terrain_info(disk);
        struct truth_sphere *spheres[2] = {truth_sphere_create(memory), truth_sphere_create(disk)};
        struct truth_tiles *tiles[2] = {truth_tiles_take(spheres[0]), truth_tiles_take(spheres[1])};
        uint64_t seed = 23;
        int hits = 0, differ = 0;
        double highest_m = terrain_level(disk, 0).max_q * info->quantum_m + info->offset_m;
        for (int k = 0; k < count; k++) {
            double origin[3], direction[3];
            struct truth_sphere_hit hit[2];
            memset(hit, 0, sizeof hit);
            random_ray(memory, &seed, k, highest_m, origin, direction);
            bool ground[2];
            for (int i = 0; i < 2; i++)
                ground[i] = truth_sphere_cast(spheres[i], tiles[i], origin, direction, 0, &hit[i]);
            differ += ground[0] != ground[1] || memcmp(&hit[0], &hit[1], sizeof hit[0]) != 0;
            hits += ground[0];
        }
        FIGURE("sphere caster over %d columns on disk, %d finer levels: %d of %d rays hit, %d differ from "
               "memory",
               columns, finer, hits, count, differ);
        assert_true(hits > count / 5);
        assert_int_equal(differ, 0);
        assert_false(terrain_failed(disk));
        for (int i = 0; i < 2; i++) {
            truth_tiles_give(spheres[i], tiles[i]);
            truth_sphere_destroy(spheres[i]);
        }
        terrain_destroy(disk);
        terrain_destroy(memory);
    }
}

// Tiles are a cache: a picture is the same with any number of threads, and detail under the eye is seen.
static void pictures_of_a_walk(void **state)
{
    (void)state;
    struct terrain *terrain = test_planet(W, 5e3, 9, 14);
    struct truth_surface *surface = truth_surface_create(terrain);
    struct truth one, two;
    int width = test_size(48, 80), height = width * 3 / 4, pixels = width * height;
    truth_init(&one, width, height);
    truth_init(&two, width, height);
    static const double PLACES[4][2] = {{10, 45}, {0, 89.9}, {179.99999, -20}, {-30, -89.9}};
    for (int k = 0; k < 4; k++) {
        double q, place[3] = {PLACES[k][0] * DEGREE * RADIUS, PLACES[k][1] * DEGREE * RADIUS, 0};
        terrain_truth_at(terrain, place[0], place[1], &q, NULL);
        const struct terrain_info *info = terrain_info(terrain);
        struct camera camera = {
            {place[0], place[1], q * info->quantum_m + info->offset_m + 1.7}, 0.6 + k, -0.1, 0, 60 * DEGREE};
        struct view view;
        view_init(&view, terrain, &camera, width, height, 0);
        clock_t start = clock();
        truth_cast(&one, surface, &view, 1);
        double us = (double)(clock() - start) / CLOCKS_PER_SEC * 1e6 / pixels;
        truth_cast(&two, surface, &view, 3);
        assert_memory_equal(one.pixels, two.pixels, (size_t)pixels * sizeof *one.pixels);
        double worst = 0;
        for (int p = 0; p < pixels; p++) {
            const struct truth_pixel *pixel = &one.pixels[p];
            if (!(pixel->depth > 0)) continue;
            double world[3], at[3], ground = 0;
            view_world(&view, pixel->relative, world);
            terrain_place_from_world(terrain, world, at);
            terrain_truth_at(terrain, at[0], at[1], &ground, NULL);
            worst = fmax(worst, fabs(at[2] - (ground * info->quantum_m + info->offset_m)));
        }
        FIGURE("a walk at %g, %g: %d of %d pixels see ground, %.1f us a pixel, at most %.1e m off",
               PLACES[k][0], PLACES[k][1], (int)one.ground, pixels, us, worst);
        assert_true((int)one.ground > pixels / 5 &&
                    worst < 1e-5); // steep noise makes much of a nanometre aside
    }
    truth_finish(&one);
    truth_finish(&two);
    truth_surface_destroy(surface);
    terrain_destroy(terrain);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_flat_planet_is_a_sphere),
        cmocka_unit_test(hits_are_the_first),
        cmocka_unit_test(on_disk_as_in_memory),
        cmocka_unit_test(pictures_of_a_walk),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
