// Flights and views over a sphere.
// SPDX-License-Identifier: MIT
#include "common/scene/scene.h"
#include "common/view/path.h"
#include "common/view/view.h"
#include "tests/planet.h"

#include <string.h>

static struct path_key key_at(double longitude, double latitude, double height_m, double yaw, double pitch)
{
    return (struct path_key){longitude * DEGREE * RADIUS,
                             latitude * DEGREE * RADIUS,
                             height_m,
                             true,
                             yaw * DEGREE,
                             pitch * DEGREE,
                             0};
}

static double ground_m(const struct terrain *terrain, const double place[2])
{
    const struct terrain_info *info = terrain_info(terrain);
    double q = 0;
    assert_true(terrain_truth_at(terrain, place[0], place[1], &q, NULL));
    return q * info->quantum_m + info->offset_m;
}

static double apart(const double a[3], const double b[3])
{
    double sum = 0;
    for (int k = 0; k < 3; k++) sum += (a[k] - b[k]) * (a[k] - b[k]);
    return sqrt(sum);
}

// The camera's forward and up in the world.
static void world_axes(const struct view *view, double forward[3], double up[3])
{
    for (int k = 0; k < 3; k++) {
        forward[k] = up[k] = 0;
        for (int axis = 0; axis < 3; axis++) {
            forward[k] += view->forward[axis] * view->axes[axis][k];
            up[k] += view->up[axis] * view->axes[axis][k];
        }
    }
}

// Over both poles and the 180th meridian eye and orientation move evenly: no step is more than twice as large
// as those next to it make it, whatever longitude and yaw do there.
static void poles_and_seam_are_nothing_special(void **state)
{
    (void)state;
    struct terrain *terrain = test_planet(128, 4000, 7, 0);
    static const double STARTS[3][4] = {
        {40, 89.999, -140, 89.999}, {-100, -89.999, 80, -89.999}, {179.999, 10, -179.999, 10.0001}};
    static const double YAWS[3][2] = {{90, -90}, {-90, 90}, {0, 0}};
    for (int k = 0; k < 3; k++) {
        struct path_key keys[2] = {key_at(STARTS[k][0], STARTS[k][1], 5000, YAWS[k][0], -10),
                                   key_at(STARTS[k][2], STARTS[k][3], 5000, YAWS[k][1], -10)};
        struct path *path = path_from_keys(terrain, keys, 2, 201, 10, 60 * DEGREE);
        assert_non_null(path);
        double last[3], last_forward[3], last_up[3], total = 0, longest = 0, turn = 0;
        for (int frame = 0; frame < 201; frame++) {
            struct camera camera = path_camera(path, frame, 201);
            struct view view;
            double forward[3], up[3];
            view_init(&view, terrain, &camera, 64, 48, 0);
            world_axes(&view, forward, up);
            if (frame) {
                double step = apart(view.eye_m, last);
                total += step;
                longest = fmax(longest, step);
                turn = fmax(turn, fmax(apart(forward, last_forward), apart(up, last_up)));
            }
            for (int axis = 0; axis < 3; axis++)
                last[axis] = view.eye_m[axis], last_forward[axis] = forward[axis], last_up[axis] = up[axis];
        }
        assert_true(longest < 2 * total / 200);
        assert_true(turn < 1e-5); // 222 m of 6371 km are 3.5e-5 rad in 200 steps
        path_destroy(path);
    }
    terrain_destroy(terrain);
}

static void keys_are_met(void **state)
{
    (void)state;
    struct terrain *terrain = test_planet(128, 4000, 7, 10);
    struct path_key keys[] = {key_at(10.7, 45.6, 1.7, 30, -3), key_at(10.9, 45.9, 10000, -60, -20),
                              key_at(170, -20, 3 * RADIUS, 10, -90)};
    for (int k = 0; k < 3; k++) {
        struct path *path = path_from_keys(terrain, &keys[k], 1, 1, 1.2, 60 * DEGREE);
        struct camera camera = path_camera(path, 0, 1);
        struct view view;
        view_init(&view, terrain, &camera, 640, 480, 0);
        assert_true(camera.eye_m[2] - ground_m(terrain, camera.eye_m) >= 1.2);
        assert_true(fabs(camera.eye_m[0] - keys[k].x_m) < 1e-3 && fabs(camera.eye_m[1] - keys[k].y_m) < 1e-3);
        if (keys[k].pitch > -1.5) {
            assert_true(fabs(camera.pitch - keys[k].pitch) < 1e-9);
            assert_true(fabs(remainder(camera.yaw - keys[k].yaw, 2 * M_PI)) < 1e-9);
        }
        double down[3], centre[3];
        for (int axis = 0; axis < 3; axis++) down[axis] = axis == 2 ? -view.radius_m : 0;
        view_world(&view, down, centre);
        assert_true(hypot(hypot(centre[0], centre[1]), centre[2]) < 1e-7);
        path_destroy(path);
    }
    terrain_destroy(terrain);
}

// From a walk to three radii and back, over both poles and the 180th meridian, always over ground, in steps
// that the eye sees as even.
static void the_tour_flies(void **state)
{
    (void)state;
    struct terrain *terrain = test_planet(128, 4000, 7, 12);
    struct path *path = path_for_terrain(terrain, 400, 60 * DEGREE);
    assert_non_null(path);
    double highest = 0, lowest = 1e9, north = 0, south = 0, worst = 0, last[3] = {0, 0, 0}, last_above = 0;
    for (int frame = 0; frame < 400; frame++) {
        struct camera camera = path_camera(path, frame, 400);
        double world[3], above = camera.eye_m[2] - ground_m(terrain, camera.eye_m);
        highest = fmax(highest, above);
        lowest = fmin(lowest, above);
        north = fmax(north, camera.eye_m[1]);
        south = fmin(south, camera.eye_m[1]);
        terrain_world_from_place(terrain, camera.eye_m, world);
        if (frame) worst = fmax(worst, apart(world, last) / fmin(above, last_above));
        for (int axis = 0; axis < 3; axis++) last[axis] = world[axis];
        last_above = above;
    }
    FIGURE("tour: %.2f m to %.2f radii over ground, latitude %.2f to %.2f, longest step %.2f heights over "
           "ground",
           lowest, highest / RADIUS, south / RADIUS / DEGREE, north / RADIUS / DEGREE, worst);
    assert_true(lowest >= 1.2 - 0.01 && lowest < 3 && highest > 2.9 * RADIUS);
    assert_true(north > 84 * DEGREE * RADIUS && south < -84 * DEGREE * RADIUS);
    assert_true(worst < 1.5);
    path_destroy(path);
    terrain_destroy(terrain);
}

// A segment seen along the plumb line is what view_project_vertical says; in any direction, what the ends
// project to.
static void segments_project(void **state)
{
    (void)state;
    struct terrain *terrain = test_planet(128, 4000, 7, 0);
    uint64_t seed = 3;
    for (int k = 0; k < 2000; k++) {
        struct camera camera = {{test_uniform(&seed, -1e7, 1e7), test_uniform(&seed, -9e6, 9e6), 20000},
                                test_uniform(&seed, -3, 3),
                                test_uniform(&seed, -1.5, 0.5),
                                test_uniform(&seed, -1, 1),
                                60 * DEGREE};
        struct view view;
        view_init(&view, terrain, &camera, 640, 480, 1);
        double from[3], step[3], to[3], a[2], b[2], length, vertical;
        for (int axis = 0; axis < 3; axis++) {
            from[axis] = test_uniform(&seed, -1e4, 1e4) + 1e4 * view.forward[axis];
            step[axis] = test_uniform(&seed, -100, 100);
            to[axis] = from[axis] + step[axis];
        }
        if (!view_project(&view, from, a) || !view_project(&view, to, b)) continue;
        assert_true(view_project_segment(&view, from, step, &length));
        assert_true(fabs(length - hypot(b[0] - a[0], b[1] - a[1])) <
                    1e-7 * (1 + fabs(a[0]) + fabs(a[1]) + fabs(b[0]) + fabs(b[1])));
        double up[3] = {0, 0, step[2]};
        assert_true(view_project_segment(&view, from, up, &length) ==
                    view_project_vertical(&view, from[0], from[1], from[2], from[2] + step[2], &vertical));
        assert_true(fabs(length - vertical) <= 1e-8 * (1 + vertical));
    }
    terrain_destroy(terrain);
}

// Every scene of a planet loads and its camera keeps clear of the ground.
static void scenes_load(void **state)
{
    (void)state;
    static const char *const NAMES[] = {"earth",      "earth_ground", "earth_aircraft",     "earth_space",
                                        "earth_pole", "earth_orbit",  "earth_antimeridian", "earth_dead_sea",
                                        "mars",       "mars_ground",  "mars_aircraft",      "mars_space",
                                        "mars_pole",  "mars_orbit",   "mars_antimeridian"};
    char data[1024];
    if (!test_data("earth_etopo5_4320x2161.png", data) || !test_data("mars_colour_2880x1440.png", data))
        return;
    for (size_t k = 0; k < sizeof NAMES / sizeof *NAMES; k += (size_t)test_size(3, 1)) {
        char path[256];
        snprintf(path, sizeof path, "bench/scenes/%s.json", NAMES[k]);
        struct scene *scene = scene_load(path, NULL, 0, 0);
        assert_non_null(scene);
        assert_int_equal(terrain_info(scene->terrain)->datum, TERRAIN_SPHERE);
        assert_non_null(scene->effects.colour);
        for (int frame = 0; frame < 20; frame++) {
            struct camera camera = path_camera(scene->path, frame, 20);
            assert_true(camera.eye_m[2] - ground_m(scene->terrain, camera.eye_m) > 1.19);
        }
        if (strcmp(NAMES[k], "earth_dead_sea") == 0) {
            struct camera camera = path_camera(scene->path, 0, 20);
            FIGURE("Dead Sea: the eye is at %.1f m", camera.eye_m[2]);
            assert_true(camera.eye_m[2] < -430);
        }
        scene_destroy(scene);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(poles_and_seam_are_nothing_special),
        cmocka_unit_test(keys_are_met),
        cmocka_unit_test(the_tour_flies),
        cmocka_unit_test(segments_project),
        cmocka_unit_test(scenes_load),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
