// The ray caster against brute force over all triangles in 113-bit arithmetic, and what it makes of hard
// places. SPDX-License-Identifier: MIT
#include "tests/test.h"

#include "bench/error/truth.h"

#include <string.h>
#include <time.h>

__extension__ typedef __float128 quad;

// ---- small maps -----------------------------------------------------------------------------------

struct map {
    int width, height;
    int32_t q[33 * 33];
    double spacing[2]; // metres, dyadic: cells and metres convert without rounding
    struct terrain *terrain;
    struct truth_surface *surface;
};

static void map_open(struct map *map, const int64_t first[2])
{
    struct terrain_grid grid = {.name = "map",
                                .samples = map->q,
                                .width = map->width,
                                .height = map->height,
                                .first = {first[0], first[1]},
                                .spacing_m = {map->spacing[0], map->spacing[1]},
                                .quantum_m = 1};
    map->terrain = terrain_from_grid(&grid, NULL);
    assert_non_null(map->terrain);
    map->surface = truth_surface_create(map->terrain);
    assert_non_null(map->surface);
}

static void map_close(struct map *map)
{
    truth_surface_destroy(map->surface);
    terrain_destroy(map->terrain);
}

enum shape { ROUGH, CLIFFS, NEEDLES, TERRACES, FLAT, SHAPES };

static void map_random(struct map *map, enum shape shape, uint64_t *random)
{
    map->width = 2 + (int)(test_random(random) % 16);
    map->height = 2 + (int)(test_random(random) % 16);
    map->spacing[0] = shape == ROUGH ? 0.5 : 1;
    map->spacing[1] = shape == CLIFFS ? 2 : 1;
    for (int k = 0; k < map->width * map->height; k++) {
        int r = (int)(test_random(random) % 64);
        map->q[k] = shape == ROUGH      ? r % 20
                    : shape == CLIFFS   ? (r & 1) * 1000
                    : shape == NEEDLES  ? (r == 0) * 500
                    : shape == TERRACES ? r % 3
                                        : 7;
    }
    map_open(map, (const int64_t[2]){0, 0});
}

// ---- brute force, in cells and quanta -------------------------------------------------------------

struct crossing {
    quad t;       // HUGE: sky
    int triangle; // 2 * cell, + 1: the one in the north west
    bool unclear; // the ray begins within the margin of the surface: either answer will do
};

static quad height_at(const struct map *map, quad u, quad v)
{
    int i = (int)u, j = (int)v;
    if (i > map->width - 2) i = map->width - 2;
    if (j > map->height - 2) j = map->height - 2;
    const int32_t *q = map->q + j * map->width + i;
    quad a = u - i, b = v - j, sw = q[0], se = q[1], nw = q[map->width], ne = q[map->width + 1];
    return a >= b ? sw + a * (se - sw) + b * (ne - se) : sw + a * (ne - nw) + b * (nw - sw);
}

// From where on the ray is over the map; false when it never is.
static bool entry(const struct map *map, const quad origin[3], const quad ray[3], quad *t)
{
    quad end = (quad)1e300;
    for (int k = 0; k < 2; k++) {
        quad size = (k ? map->height : map->width) - 1;
        if (ray[k] == 0) {
            if (origin[k] < 0 || origin[k] > size) return false;
            continue;
        }
        quad a = -origin[k] / ray[k], b = (size - origin[k]) / ray[k];
        if (a > b) {
            quad swap = a;
            a = b;
            b = swap;
        }
        if (a > *t) *t = a;
        if (b < end) end = b;
    }
    return *t <= end;
}

// Where the ray comes down through one triangle; corners are in the order that is counter-clockwise from
// above.
static bool meets(quad corner[3][3], const quad origin[3], const quad ray[3], quad t0, quad *t)
{
    quad e[3], f[3], n[3];
    for (int k = 0; k < 3; k++) e[k] = corner[1][k] - corner[0][k], f[k] = corner[2][k] - corner[0][k];
    for (int k = 0; k < 3; k++) n[k] = e[(k + 1) % 3] * f[(k + 2) % 3] - e[(k + 2) % 3] * f[(k + 1) % 3];
    quad speed = n[0] * ray[0] + n[1] * ray[1] + n[2] * ray[2], above = 0;
    for (int k = 0; k < 3; k++) above += n[k] * (origin[k] - corner[0][k]);
    if (speed >= 0 || above + t0 * speed < 0) return false;
    for (int k = 0; k < 3; k++) { // all multiplied by -speed, so that nothing is divided
        const quad *a = corner[k], *b = corner[(k + 1) % 3];
        quad x = (origin[0] - a[0]) * -speed + ray[0] * above,
             y = (origin[1] - a[1]) * -speed + ray[1] * above;
        if ((b[0] - a[0]) * y - (b[1] - a[1]) * x < 0) return false;
    }
    *t = above / -speed;
    return true;
}

// Rise of a triangle over a cell eastwards and northwards, quanta.
static void rise(const struct map *map, int triangle, double out[2])
{
    const int32_t *q = map->q + triangle / 2;
    int w = map->width, north_west = triangle % 2;
    out[0] = north_west ? q[w + 1] - q[w] : q[1] - q[0];
    out[1] = north_west ? q[w] - q[0] : q[w + 1] - q[1];
}

struct question {
    const double *eye, *direction; // cells and quanta
    double t0, margin;
    bool other; // the cells' other diagonal
};

// The first place where a ray comes down through the surface, with the eye `lift` higher.  `only` (may be
// NULL): of the triangles that rise like this.
static struct crossing brute(const struct map *map, const struct question *ask, double lift,
                             const double only[2])
{
    quad origin[3] = {ask->eye[0], ask->eye[1], (quad)ask->eye[2] + lift};
    quad ray[3] = {ask->direction[0], ask->direction[1], ask->direction[2]};
    struct crossing first = {(quad)HUGE_VAL, -1, false};
    quad start = ask->t0, t;
    if (!entry(map, origin, ray, &start)) return first;
    quad u = origin[0] + start * ray[0], v = origin[1] + start * ray[1];
    quad clearance = ask->eye[2] + start * ray[2] - height_at(map, u, v);
    first.unclear = clearance > -ask->margin && clearance < ask->margin;
    if (clearance < 0) return first;
    for (int triangle = 0; triangle < 2 * map->width * (map->height - 1); triangle++) {
        static const int corners[2][2][3] = {{{0, 1, 3}, {0, 3, 2}}, {{0, 1, 2}, {1, 3, 2}}};
        int i = triangle / 2 % map->width, j = triangle / 2 / map->width;
        quad corner[3][3];
        double slope[2];
        if (i == map->width - 1) continue;
        rise(map, triangle, slope);
        if (only && (slope[0] != only[0] || slope[1] != only[1])) continue;
        for (int k = 0; k < 3; k++) {
            int c = corners[ask->other][triangle % 2][k], x = i + (c & 1), y = j + (c >> 1);
            corner[k][0] = x, corner[k][1] = y, corner[k][2] = map->q[y * map->width + x];
        }
        if (meets(corner, origin, ray, start, &t) && t < first.t) first.t = t, first.triangle = triangle;
    }
    return first;
}

// What rounding can do to the caster's clearance: heights and places are sums of a product and an origin,
// each of at most three roundings; a place errs by the steepest slope; twice that for the interpolation.
static double clearance_margin(const struct map *map, const double eye[3])
{
    double steepest = 0;
    for (int k = 0; k < map->width * map->height; k++) steepest = fmax(steepest, abs(map->q[k]));
    double place = fabs(eye[0]) + fabs(eye[1]) + map->width + map->height;
    return 0x1p-53 * 3 * 2 * (fabs(eye[2]) + steepest + 2 * steepest * place);
}

static int compared, unclear;

// The caster's hit lies between those of brute force with the eye a margin lower and higher (the higher the
// eye, the later a ray comes down; sky is latest of all), and on a triangle of its slope.
static bool agrees(const struct map *map, struct question *ask, bool hit, double t, const float slope[2])
{
    ask->margin = clearance_margin(map, ask->eye);
    struct crossing low = brute(map, ask, -ask->margin, NULL), high = brute(map, ask, ask->margin, NULL);
    compared++;
    if (low.unclear) {
        unclear++;
        return true;
    }
    quad at = hit ? (quad)t : (quad)HUGE_VAL, rounding = hit ? (quad)(t * 0x1p-50) : 0;
    if (!(at >= low.t - rounding && at <= high.t + rounding)) return false;
    if (!hit || low.triangle != high.triangle) return true;
    const double only[2] = {(double)slope[0] * map->spacing[0], (double)slope[1] * map->spacing[1]};
    struct crossing same = brute(map, ask, 0, only);
    return same.t >= low.t - rounding && same.t <= high.t + rounding;
}

static bool ray_agrees(const struct map *map, const double eye[3], const double direction[3], bool other)
{
    double t = 0, eye_m[3], direction_m[3];
    float slope[2] = {0, 0};
    for (int k = 0; k < 3; k++) {
        double unit = k < 2 ? map->spacing[k] : 1;
        eye_m[k] = eye[k] * unit;
        direction_m[k] = direction[k] * unit;
    }
    bool hit = truth_cast_ray(map->surface, eye_m, direction_m, &t, slope);
    struct question ask = {eye, direction, 0, 0, other};
    return agrees(map, &ask, hit, t, slope);
}

// ---- rays -----------------------------------------------------------------------------------------

static double eighth(uint64_t *random, double low, double high)
{
    return floor(8 * test_uniform(random, low, high)) / 8;
}

// Anywhere around the map, to anywhere on it.
static void free_ray(const struct map *map, uint64_t *random, double eye[3], double ray[3])
{
    double top = test_uniform(random, 0, 1) < 0.5 ? 30 : 1100;
    for (int k = 0; k < 3; k++) {
        double size = k == 0 ? map->width : k == 1 ? map->height : top;
        eye[k] = test_uniform(random, k < 2 ? -0.5 * size : -5, 1.5 * size);
        ray[k] = test_uniform(random, 0, size) - eye[k];
    }
    if (test_random(random) % 2) ray[2] *= 1e-3; // nearly level
}

// From a lattice point exactly through a vertex, the middle of an edge or of a diagonal; some rays run
// straight up, straight down, along a grid line or along a diagonal.
static void exact_ray(const struct map *map, uint64_t *random, double eye[3], double ray[3])
{
    int i = (int)(test_random(random) % (uint64_t)(map->width - 1));
    int j = (int)(test_random(random) % (uint64_t)(map->height - 1));
    int east = (int)(test_random(random) % 2), north = (int)(test_random(random) % 2);
    double target[3] = {i + 0.5 * east, j + 0.5 * north, 0};
    target[2] = 0.5 * (map->q[j * map->width + i] + map->q[(j + north) * map->width + i + east]);
    eye[0] = eighth(random, -3, map->width + 3);
    eye[1] = eighth(random, -3, map->height + 3);
    eye[2] = target[2] + eighth(random, -2, 40);
    switch (test_random(random) % 8) {
    case 0:
        eye[0] = target[0], eye[1] = target[1];
        break;
    case 1:
        eye[0] = target[0];
        break;
    case 2:
        eye[1] = target[1];
        break;
    case 3:
        eye[1] = target[1] + (eye[0] - target[0]);
        break;
    case 4:
        eye[2] = target[2];
        break;
    }
    for (int k = 0; k < 3; k++) ray[k] = target[k] - eye[k];
}

static void test_against_brute_force(void **state)
{
    (void)state;
    uint64_t random = 1;
    int mismatches = 0, power = 0, maps = test_size(150, 4000);
    compared = unclear = 0;
    for (int m = 0; m < maps; m++) {
        struct map map;
        map_random(&map, (enum shape)(m % SHAPES), &random);
        for (int r = 0; r < 60; r++) {
            double eye[3], ray[3];
            (r % 2 ? exact_ray : free_ray)(&map, &random, eye, ray);
            mismatches += !ray_agrees(&map, eye, ray, false);
            if (r < 4) power += !ray_agrees(&map, eye, ray, true);
        }
        map_close(&map);
    }
    FIGURE("rays against brute force: %d, %d of them begin on the surface, mismatches %d", compared, unclear,
           mismatches);
    assert_int_equal(mismatches, 0);
    assert_true(unclear < compared / 10);
    assert_true(power > maps / 4); // the same test, against the other diagonal, fails
}

// A ray that begins above the surface and ends below it inside the map has met it, whatever it ran along.
static void test_nothing_leaks(void **state)
{
    (void)state;
    uint64_t random = 2;
    int leaks = 0, cast = 0;
    for (int m = 0; m < test_size(300, 10000); m++) {
        struct map map;
        map_random(&map, (enum shape)(m % SHAPES), &random);
        for (int r = 0; r < 200; r++) {
            double eye[3], ray[3], t, q;
            float slope[2];
            exact_ray(&map, &random, eye, ray);
            for (int k = 0; k < 2; k++) { // to a vertex
                double size = k ? map.height - 1 : map.width - 1, target = round(eye[k] + ray[k]);
                eye[k] = fmin(fmax(eye[k], 0), size);
                ray[k] = target - eye[k];
            }
            eye[2] += 1001;
            ray[2] = -eye[2] - 1; // ends under everything
            if (!terrain_truth_at(map.terrain, eye[0] * map.spacing[0], eye[1] * map.spacing[1], &q, NULL))
                continue;
            double eye_m[3] = {eye[0] * map.spacing[0], eye[1] * map.spacing[1], eye[2]};
            double ray_m[3] = {ray[0] * map.spacing[0], ray[1] * map.spacing[1], ray[2]};
            cast++;
            leaks +=
                eye[2] > q && (!truth_cast_ray(map.surface, eye_m, ray_m, &t, slope) || !(t > 0 && t <= 1));
        }
        map_close(&map);
    }
    FIGURE("rays that end under the ground: %d, leaks %d", cast, leaks);
    assert_int_equal(leaks, 0);
}

// ---- pictures -------------------------------------------------------------------------------------

static struct view look(const struct terrain *terrain, const double eye_m[3], double yaw, double pitch,
                        int width, int height, double near_m)
{
    struct view view;
    struct camera camera = {{eye_m[0], eye_m[1], eye_m[2]}, yaw, pitch, 0, 1.0471975511965976};
    view_init(&view, terrain, &camera, width, height, near_m);
    return view;
}

static void test_picture_against_brute_force(void **state)
{
    (void)state;
    uint64_t random = 3;
    int mismatches = 0, ground = 0;
    enum { WIDTH = 20, HEIGHT = 15 };
    compared = unclear = 0;
    for (int m = 0; m < test_size(40, 1000); m++) {
        struct map map;
        struct truth truth;
        map_random(&map, (enum shape)(m % SHAPES), &random);
        int column = map.width / 2, row = map.height / 2; // over the middle, or outside the map
        double eye[3] = {(m % 4 ? column : -2) * map.spacing[0], (row + 0.25) * map.spacing[1],
                         map.q[row * map.width + column] + eighth(&random, 0, 8)};
        struct view view =
            look(map.terrain, eye, m % 4 ? test_uniform(&random, -4, 4) : 0,
                 test_uniform(&random, -1.5, -0.2), WIDTH, HEIGHT, test_uniform(&random, 0.05, 2));
        assert_true(truth_init(&truth, WIDTH, HEIGHT));
        truth_cast(&truth, map.surface, &view, 1);
        double cells[3] = {view.eye_m[0] / map.spacing[0], view.eye_m[1] / map.spacing[1], view.eye_m[2]};
        for (int y = 0; y < HEIGHT; y++)
            for (int x = 0; x < WIDTH; x++) {
                const struct truth_pixel *pixel = &truth.pixels[y * WIDTH + x];
                double ray[3];
                view_ray(&view, x, y, ray);
                for (int k = 0; k < 2; k++) ray[k] /= map.spacing[k];
                struct question ask = {cells, ray, view.near_m, 0, false};
                mismatches += !agrees(&map, &ask, pixel->depth > 0, pixel->depth, pixel->slope);
                ground += pixel->depth > 0;
            }
        assert_int_equal(truth.row_first[HEIGHT], truth.ground);
        truth_finish(&truth);
        map_close(&map);
    }
    FIGURE("pixels against brute force: %d, %d see ground, mismatches %d", compared, ground, mismatches);
    assert_int_equal(mismatches, 0);
    assert_true(ground > compared / 10);
}

static struct terrain *hills(int size, const int64_t first[2], double spacing_m, double quantum_m)
{
    int32_t *q = malloc((size_t)size * (size_t)size * sizeof *q);
    assert_non_null(q);
    for (int j = 0; j < size; j++)
        for (int i = 0; i < size; i++) {
            double x = 40.0 * i / size, y = 40.0 * j / size, z = 0;
            for (int k = 0; k < 6; k++, x = 2.1 * x + 1, y = 2.1 * y + 2)
                z += ldexp(sin(x + cos(y)) * cos(y - 0.7 * sin(x)), -k);
            q[(size_t)j * (size_t)size + (size_t)i] = (int32_t)lround(z * 20 * spacing_m / quantum_m);
        }
    struct terrain_grid grid = {.name = "hills",
                                .samples = q,
                                .width = size,
                                .height = size,
                                .first = {first[0], first[1]},
                                .spacing_m = {spacing_m, spacing_m},
                                .quantum_m = quantum_m};
    struct terrain *terrain = terrain_from_grid(&grid, NULL);
    free(q);
    assert_non_null(terrain);
    return terrain;
}

static double milliseconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec * 1e3 + (double)now.tv_nsec * 1e-6;
}

static void test_threads_and_heights(void **state)
{
    (void)state;
    int size = test_size(1025, 2917);
    struct terrain *terrain = hills(size, (const int64_t[2]){0, 0}, 16, 0.125);
    struct truth_surface *surface = truth_surface_create(terrain);
    struct truth truth[3];
    const int threads[3] = {1, 2, 8};
    struct view view = look(terrain, (const double[3]){size * 8.0, size * 8.0, 700}, 0.6, -0.2, 640, 480, 0);
    for (int k = 0; k < 3; k++) {
        assert_true(truth_init(&truth[k], 640, 480));
        double start = milliseconds();
        truth_cast(&truth[k], surface, &view, threads[k]);
        FIGURE("cast of 640 x 480 over %d x %d samples, threads %d: %.0f ms", size, size, threads[k],
               milliseconds() - start);
    }
    assert_true(truth[0].ground > 100000);
    for (int k = 1; k < 3; k++)
        assert_memory_equal(truth[0].pixels, truth[k].pixels, 640 * 480 * sizeof *truth->pixels);
    double worst = 0;
    for (int k = 0; k < 640 * 480; k++) {
        const struct truth_pixel *p = &truth[0].pixels[k];
        double q, z = 0;
        if (p->depth == 0) continue;
        assert_true(terrain_truth_at(terrain, view.eye_m[0] + p->relative[0], view.eye_m[1] + p->relative[1],
                                     &q, NULL));
        z = q * 0.125 - view.eye_m[2];
        worst = fmax(worst, fabs(z - p->relative[2]));
        double ray[3]; // the hit is on its ray: places err by 2^-52 of some 5e4 m, heights by that times the
                       // slope
        view_ray(&view, k % 640, k / 640, ray);
        assert_true(fabs(p->relative[2] - p->depth * ray[2]) < 1e-9);
    }
    FIGURE("height of the hits against terrain_truth_at: at most %.1e m apart", worst);
    assert_true(worst < 1e-9);
    for (int k = 0; k < 3; k++) truth_finish(&truth[k]);
    truth_surface_destroy(surface);
    terrain_destroy(terrain);
}

// Ten thousand million samples from the origin the picture is bitwise the same: the lattice carries the eye.
static void test_far_from_the_origin(void **state)
{
    (void)state;
    enum { WIDTH = 160, HEIGHT = 120 };
    const int64_t first[2][2] = {{0, 0}, {(int64_t)10000 << 20, -((int64_t)10000 << 20)}};
    struct truth truth[2];
    for (int k = 0; k < 2; k++) {
        struct terrain *terrain = hills(257, first[k], 0x1p-10, 0x1p-17);
        struct truth_surface *surface = truth_surface_create(terrain);
        double eye[3] = {((double)first[k][0] + 100.5) / 1024, ((double)first[k][1] + 90.25) / 1024, 0.1};
        struct view view = look(terrain, eye, 0.6, -0.9, WIDTH, HEIGHT, 0.005);
        assert_true(truth_init(&truth[k], WIDTH, HEIGHT));
        truth_cast(&truth[k], surface, &view, 2);
        truth_surface_destroy(surface);
        terrain_destroy(terrain);
    }
    assert_true(truth[0].ground > 0);
    assert_memory_equal(truth[0].pixels, truth[1].pixels, WIDTH * HEIGHT * sizeof *truth->pixels);
    truth_finish(&truth[0]);
    truth_finish(&truth[1]);
}

// Heights of a flat map come out exact, under the ground all is sky, and maps of one sample or one row have
// no ground.
static void test_plain_cases(void **state)
{
    (void)state;
    enum { WIDTH = 64, HEIGHT = 48 };
    const int32_t flat[] = {0, 100000, 884886};
    struct truth truth;
    assert_true(truth_init(&truth, WIDTH, HEIGHT));
    for (int k = 0; k < 3; k++) {
        int32_t q[25];
        for (int i = 0; i < 25; i++) q[i] = flat[k];
        struct terrain_grid grid = {
            .name = "flat", .samples = q, .width = 5, .height = 5, .spacing_m = {30, 31}, .quantum_m = 0.01};
        struct terrain *terrain = terrain_from_grid(&grid, NULL);
        struct truth_surface *surface = truth_surface_create(terrain);
        double ground_m = flat[k] * 0.01;
        struct view view =
            look(terrain, (const double[3]){40, 50, ground_m + 25}, 0.3, -0.9, WIDTH, HEIGHT, 0);
        truth_cast(&truth, surface, &view, 1);
        assert_true(truth.ground > WIDTH * HEIGHT / 2);
        double z = (flat[k] - ldexp((double)view.eye_height, -VIEW_HEIGHT_BITS)) * 0.01;
        for (int p = 0; p < WIDTH * HEIGHT; p++)
            assert_true(truth.pixels[p].depth == 0 || truth.pixels[p].relative[2] == z);
        for (double pitch = -1.5; pitch < 1.6; pitch += 0.5) {
            view = look(terrain, (const double[3]){40, 50, ground_m - 5}, 0.3, pitch, WIDTH, HEIGHT, 0);
            truth_cast(&truth, surface, &view, 1);
            assert_int_equal(truth.ground, 0);
        }
        truth_surface_destroy(surface);
        terrain_destroy(terrain);
    }
    const int sizes[][2] = {{1, 1}, {1, 17}, {17, 1}, {2, 2}, {3, 3}, {16, 16}};
    for (int k = 0; k < 6; k++) {
        struct map map = {.width = sizes[k][0], .height = sizes[k][1], .spacing = {1, 1}};
        map_open(&map, (const int64_t[2]){0, 0});
        struct view view =
            look(map.terrain, (const double[3]){0.5, 0.5, 1}, 0, -1.5707963267948966, WIDTH, HEIGHT, 0.1);
        truth_cast(&truth, map.surface, &view, 1);
        assert_true((truth.ground > 0) == (map.width > 1 && map.height > 1));
        map_close(&map);
    }
    truth_finish(&truth);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_against_brute_force),         cmocka_unit_test(test_nothing_leaks),
        cmocka_unit_test(test_picture_against_brute_force), cmocka_unit_test(test_threads_and_heights),
        cmocka_unit_test(test_far_from_the_origin),         cmocka_unit_test(test_plain_cases),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
