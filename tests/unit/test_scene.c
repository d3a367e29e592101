// Scenes: what the project's own ones fly, strictness, and where files are sought.
// SPDX-License-Identifier: MIT
#include "common/scene/scene.h"

#include "common/image.h"
#include "tests/folder.h"

#include <errno.h>
#include <glob.h>
#include <string.h>
#include <sys/stat.h>

// Loads a scene with that text; what is said on stderr lands in said[].
static struct scene *load(const char *text, const char *terrain_file, char said[2048])
{
    const char *path = in_folder("scene.json");
    if (text) write_text("scene.json", text);
    fflush(stderr);
    int saved = dup(2);
    FILE *file = tmpfile();
    dup2(fileno(file), 2);
    struct scene *scene = scene_load(path, terrain_file, 0, 0);
    fflush(stderr);
    dup2(saved, 2);
    close(saved);
    rewind(file);
    said[fread(said, 1, 2047, file)] = '\0';
    fclose(file);
    return scene;
}

// FIPS 180-4 examples and the lengths where the padding turns over.
static void sha256_knows_its_vectors(void **state)
{
    (void)state;
    char hex[65], *million = malloc(1000000);
    memset(million, 'a', 1000000);
    const struct {
        const char *text, *hex;
    } vectors[] = {
        {"", "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"},
        {"abc", "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"},
        {"abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq",
         "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1"},
        {"abcdefghbcdefghicdefghijdefghijkefghijklfghijklmghijklmnhijklmnoijklmnopjklmnopqklmnopqrlmnopqrsmno"
         "pqrst"
         "nopqrstu",
         "cf5b16a778af8380036ce59e7b0492370b249b11e8f07a51afac45037afee9d1"},
    };
    for (int i = 0; i < 4; i++) {
        sha256_hex(vectors[i].text, strlen(vectors[i].text), hex);
        assert_string_equal(hex, vectors[i].hex);
    }
    sha256_hex(million, 1000000, hex);
    assert_string_equal(hex, "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
    sha256_hex(million, 55, hex);
    assert_string_equal(hex, "9f4390f8d30c2dd92ec9f095b65e2b9ae9b0a925a5258e241c9f1e910f734318");
    sha256_hex(million, 56, hex);
    assert_string_equal(hex, "b35439a4ac6f0948b6d6f9e3c6af0f5f590ce20f1bde7090ef7970686ec6738a");
    sha256_hex(million, 64, hex);
    assert_string_equal(hex, "ffe054fe7ae0cb6dc65c3af9b61d5209f439851db43d0ba5997337df154668eb");
    free(million);
}

// ---- the project's own scenes ----------------------------------------------

static double turn_between(const struct view *a, const struct view *b)
{
    double trace = 0;
    for (int axis = 0; axis < 3; axis++)
        trace +=
            a->right[axis] * b->right[axis] + a->up[axis] * b->up[axis] + a->forward[axis] * b->forward[axis];
    return acos(fmin(fmax((trace - 1) / 2, -1), 1)) * 180 / M_PI;
}

static double over_ground(const struct scene *scene, const struct camera *camera)
{
    const struct terrain_info *info = terrain_info(scene->terrain);
    const double *outline = info->outline_m;
    double q, x = fmin(fmax(camera->eye_m[0], outline[0]), outline[2]);
    double y = fmin(fmax(camera->eye_m[1], outline[1]), outline[3]);
    assert_true(terrain_truth_at(scene->terrain, x, y, &q, NULL));
    return camera->eye_m[2] - (q * info->quantum_m + info->offset_m);
}

static void check_flight(const struct scene *scene)
{
    int fine = test_size(20000, 400000), frames = 96;
    double low = INFINITY, high = -INFINITY, turn = 0;
    struct view last;
    for (int frame = 0; frame < fine; frame++) {
        struct camera camera = path_camera(scene->path, frame, fine);
        double height = over_ground(scene, &camera);
        low = fmin(low, height);
        high = fmax(high, height);
    }
    for (int frame = 0; frame < frames; frame++) {
        struct view view;
        scene_view(scene, frame, frames, &view);
        if (frame) turn = fmax(turn, turn_between(&last, &view));
        last = view;
    }
    FIGURE("scene %s: %d frames, %.1f..%.1f m over ground, turns %.2f degrees a frame at most", scene->name,
           path_frames(scene->path), low, high, turn);
    assert_true(low >= 2);
    if (strcmp(scene->name, "peers") != 0) assert_true(turn < 6); // the field's path is as it was measured
}

static void own_scenes_fly_well(void **state)
{
    (void)state;
    glob_t found;
    char path[1024];
    assert_int_equal(glob("bench/scenes/*.json", 0, NULL, &found), 0);
    const struct {
        const char *scene, *data;
    } needs[] = {{"bench/scenes/puget.json", "puget_1k_160m.png"},
                 {"bench/scenes/cascades.json", "puget_cascades_72m_2049x2817.png"},
                 {"bench/scenes/peers.json", "fbm_2049.png"}};
    for (size_t i = 0; i < found.gl_pathc; i++) {
        bool skip = false;
        for (int k = 0; k < 3; k++)
            if (strcmp(found.gl_pathv[i], needs[k].scene) == 0) skip = !test_data(needs[k].data, path);
        // Planets have a test of their own (test_path_sphere.c).
        if (strstr(found.gl_pathv[i], "/earth") || strstr(found.gl_pathv[i], "/mars")) skip = true;
        if (skip) continue;
        struct scene *scene = scene_load(found.gl_pathv[i], NULL, 0, 0);
        assert_non_null(scene);
        check_flight(scene);
        scene_destroy(scene);
    }
    globfree(&found);
}

static void default_scene_is_carried(void **state)
{
    (void)state;
    struct scene *scene = scene_load(NULL, NULL, 320, 200),
                 *file = scene_load("bench/scenes/default.json", NULL, 0, 0);
    assert_non_null(scene);
    assert_non_null(file);
    assert_string_equal(scene->name, "default");
    assert_string_equal(scene->sha256, file->sha256);
    assert_true(scene->width == 320 && scene->height == 200 && file->width == 640 && file->height == 480);
    assert_true(terrain_info(scene->terrain)->samples > 8000000);
    assert_int_equal(path_frames(scene->path), 32);
    scene_destroy(scene);
    scene_destroy(file);
}

static void level_scene_is_level(void **state)
{
    (void)state;
    struct scene *scene = scene_load("bench/scenes/level.json", NULL, 0, 0);
    assert_non_null(scene);
    double sum = 0, squares = 0, shortest = INFINITY, longest = 0;
    struct camera before = path_camera(scene->path, 0, 96);
    for (int frame = 0; frame < 96; frame++) {
        struct camera camera = path_camera(scene->path, frame, 96);
        double height = over_ground(scene, &camera), step[3];
        sum += height / 96;
        squares += height * height / 96;
        assert_true(camera.pitch == 0 && camera.roll == 0);
        for (int axis = 0; axis < 3; axis++) step[axis] = camera.eye_m[axis] - before.eye_m[axis];
        double length = hypot(hypot(step[0], step[1]), step[2]);
        if (frame) shortest = fmin(shortest, length), longest = fmax(longest, length);
        before = camera;
    }
    FIGURE("scene level: %.1f m over ground, standard deviation %.1f m, steps %.1f..%.1f m", sum,
           sqrt(squares - sum * sum), shortest, longest);
    assert_true(fabs(sum - 30) < 5);
    scene_destroy(scene);
}

static void terrain_replaces_the_scenes(void **state)
{
    (void)state;
    char path[1024], said[2048];
    if (!test_data("jacksboro_403x344.png", path)) return;
    struct scene *scene =
        load("{\"name\": \"x\", \"terrain\": \"not there.png\", \"view\": {\"near\": 7}}", path, said);
    assert_non_null(scene);
    assert_string_equal(scene->name, "jacksboro_403x344");
    assert_string_equal(scene->terrain_name, "jacksboro_403x344.png");
    assert_true(scene->near_m == 0 && path_frames(scene->path) == 96);
    scene_destroy(scene);
}

// ---- poses -----------------------------------------------------------------

static void poses_stand_where_they_say(void **state)
{
    (void)state;
    char said[2048];
    write_text("poses.txt",
               "# u v z yaw\n0.25 0.5 0.1 0\n\n9 9 9 9\n0.5 0.25 0.2 1.5707963267948966\n9 9 9 9\n");
    struct scene *scene = load("{\"name\": \"p\", \"terrain\": {\"builtin\": \"jacksboro\"},"
                               "\"path\": {\"poses\": \"poses.txt\", \"every\": 2, \"pitch\": -12}}",
                               NULL, said);
    assert_non_null(scene);
    assert_int_equal(path_frames(scene->path), 2);
    const double *outline = terrain_info(scene->terrain)->outline_m, width = outline[2] - outline[0];
    struct camera first = path_camera(scene->path, 0, 2), second = path_camera(scene->path, 1, 2);
    assert_true(fabs(first.eye_m[0] - (outline[0] + 0.25 * width)) < 1e-6);
    assert_true(fabs(first.eye_m[1] - (outline[3] - 0.5 * width)) < 1e-6);
    assert_true(fabs(first.eye_m[2] - 0.1 * width) < 1e-6);
    assert_true(fabs(first.yaw) < 1e-12 && fabs(first.pitch + 12 * M_PI / 180) < 1e-12);
    struct view view; // yaw pi/2 in (u, v) looks down the rows: south
    view_init(&view, scene->terrain, &second, 640, 480, 0);
    assert_true(view.forward[1] < -0.9);
    scene_destroy(scene);
}

// ---- strictness ------------------------------------------------------------

#define SCENE(rest) "{\"name\": \"t\", \"terrain\": {\"builtin\": \"jacksboro\"}" rest "}"
#define KEY "{\"x\": 1, \"y\": 1, \"height\": 2}"

static void refuses_in_one_line(void **state)
{
    (void)state;
    write_text("empty.txt", "# nothing\n");
    write_text("bad.txt", "0 0 0 0\n0 0 zero 0\n");
    const struct {
        const char *text, *says, *accepted;
    } cases[] = {
        {"", "line 1", "JSON"},
        {"{\n\n\"name\": }", "line 3", "JSON"},
        {"{} x", "JSON", "JSON"},
        {"[]", "the scene", "name|terrain|path|view|renderers|effects"},
        {"{}", "name", "letters"},
        {"{\"name\": \"../x\"}", "name", "letters"},
        {"{\"name\": 3}", "name", "letters"},
        {"{\"name\": \"t\"}", "terrain is missing", "file name"},
        {SCENE(", \"renderers\": 1"), "renderers", "a text in quotes"},
        {SCENE(", \"pathe\": 1"), "pathe", "name|terrain|path|view|renderers|effects"},
        {SCENE(", \"name\": \"u\""), "\"name\" twice", "once"},
        {"{\"name\": \"t\", \"terrain\": {\"built\": \"x\"}}", "built",
         "file|builtin|synthesize_levels|seed|filter"},
        {"{\"name\": \"t\", \"terrain\": {\"builtin\": \"mars\"}}", "builtin", "jacksboro"},
        {"{\"name\": \"t\", \"terrain\": {}}", "terrain", "\"file\" and \"builtin\""},
        {"{\"name\": \"t\", \"terrain\": {\"builtin\": \"jacksboro\", \"noise\": \"perlin\"}}", "noise",
         "hash|table"},
        {"{\"name\": \"t\", \"terrain\": {\"builtin\": \"jacksboro\", \"synthesize_levels\": 9}}",
         "synthesize_levels", "0..8"},
        {"{\"name\": \"t\", \"terrain\": {\"builtin\": \"jacksboro\", \"synthesize_levels\": 1.5}}",
         "synthesize_levels", "whole"},
        {"{\"name\": \"t\", \"terrain\": {\"builtin\": \"jacksboro\", \"seed\": -1}}", "seed", "0.."},
        {"{\"name\": \"t\", \"terrain\": {\"builtin\": \"jacksboro\", \"cache_mib\": 0}}", "cache_mib",
         "0.001"},
        {"{\"name\": \"t\", \"terrain\": {\"builtin\": \"jacksboro\", \"latency_frames\": 0}}",
         "latency_frames", "1.."},
        {"{\"name\": \"t\", \"terrain\": {\"builtin\": \"jacksboro\", \"filter\": \"box\"}}", "filter",
         "linear|halfband|tent|decimate|optimal"},
        {"{\"name\": \"t\", \"terrain\": \"no such.png\"}", "no such.png", "beside the scene"},
        {"{\"name\": \"t\", \"terrain\": \"/no such.png\"}", "/no such.png", "No such file"},
        {SCENE(", \"path\": \"fly\""), "fly", "\"auto\""},
        {SCENE(", \"path\": 3"), "path", "keys|"},
        {SCENE(", \"path\": {}"), "no key frames", "\"keys\""},
        {SCENE(", \"path\": {\"keys\": []}"), "no key frames", "at least one"},
        {SCENE(", \"path\": {\"keys\": {}}"), "no key frames", "at least one"},
        {SCENE(", \"path\": {\"keys\": [{\"x\": 1, \"y\": 2}]}"), "height", "needed"},
        {SCENE(", \"path\": {\"keys\": [{\"x\": 1, \"y\": 2, \"height\": 3, \"z\": 4}]}"), "\"z\"",
         "x|y|height"},
        {SCENE(", \"path\": {\"keys\": [{\"x\": \"1\", \"y\": 2, \"height\": 3}]}"), "\"x\" of key frame 1",
         "number"},
        {SCENE(", \"path\": {\"keys\": [{\"x\": 1e999, \"y\": 2, \"height\": 3}]}"), "\"x\"", "number"},
        {SCENE(", \"path\": {\"keys\": [" KEY ", 5]}"), "key frame 2", "object"},
        {SCENE(", \"path\": {\"keys\": [" KEY "], \"every\": 5}"), "every", "keys|clearance|frames"},
        {SCENE(", \"path\": {\"keys\": [" KEY "], \"clearance\": -1}"), "clearance", "0.."},
        {SCENE(", \"path\": {\"keys\": [" KEY "], \"frames\": 0}"), "frames", "1.."},
        {SCENE(", \"path\": {\"keys\": [{\"x\": 1, \"y\": 1, \"height\": 2, \"above_ground\": 1}]}"),
         "above_ground", "true or false"},
        {SCENE(", \"path\": {\"poses\": \"none.txt\"}"), "none.txt", "beside the scene"},
        {SCENE(", \"path\": {\"poses\": \"empty.txt\"}"), "no key frames", "u v z yaw"},
        {SCENE(", \"path\": {\"poses\": \"bad.txt\"}"), "line 2", "u v z yaw"},
        {SCENE(", \"path\": {\"poses\": \"bad.txt\", \"every\": 0}"), "every", "1.."},
        {SCENE(", \"path\": {\"auto\": false}"), "auto", "true"},
        {SCENE(", \"path\": {\"auto\": true, \"every\": 2}"), "every", "auto|frames"},
        {SCENE(", \"view\": {\"fov\": 60}"), "fov", "width|height|fov_vertical|near"},
        {SCENE(", \"view\": {\"width\": 0}"), "width", "1..16384"},
        {SCENE(", \"view\": {\"fov_vertical\": 180}"), "fov_vertical", "1..170"},
        {SCENE(", \"view\": {\"near\": 0}"), "near", "number"},
        {SCENE(", \"effects\": {\"fog\": true}"), "fog", "shading"},
        {SCENE(", \"effects\": {\"shading\": \"toon\"}"), "shading", "common|own"},
        {SCENE(", \"effects\": {\"colour\": true}"), "colour", "text"},
        {SCENE(", \"effects\": {\"colour\": \"none.png\"}"), "none.png", "beside the scene"},
        {SCENE(", \"effects\": {\"colour\": \"bad.txt\"}"), "bad.txt", "PNG"},
    };
    size_t count = sizeof cases / sizeof cases[0];
    for (size_t i = 0; i < count; i++) {
        char said[2048];
        struct scene *scene = load(cases[i].text, NULL, said);
        if (scene) fail_msg("taken: %s", cases[i].text);
        bool names_file = strstr(said, "scene.json") || strstr(said, ".txt");
        if (!names_file || !strstr(said, cases[i].says) || !strstr(said, cases[i].accepted))
            fail_msg("%s: %s", cases[i].text, said);
        assert_true(*said && strchr(said, '\n') == said + strlen(said) - 1);
    }
    FIGURE("scenes: %zu bad ones, one line each", count);
}

// The image is there until the first who hold it have let go, and then whenever it is held again, as long as
// it is the same one.
static void colours_are_held_while_they_are_needed(void **state)
{
    (void)state;
    enum { SIDE = 6, BYTES = 4 * SIDE * SIDE };
    uint8_t painted[BYTES], first[BYTES];
    char said[2048];
    for (int k = 0; k < BYTES; k++) painted[k] = (uint8_t)(5 * k);
    assert_true(image_write_png(in_folder("colour.png"), SIDE, SIDE, 4, painted));
    struct scene *scene = load(SCENE(", \"effects\": {\"colour\": \"colour.png\"}"), NULL, said);
    assert_non_null(scene);
    struct scene_colour *colour = scene->effects.colour;
    assert_non_null(colour->pixels);
    memcpy(first, colour->pixels, BYTES);
    for (int turn = 0; turn < 2; turn++) {
        assert_true(scene_colour_hold(colour) && scene_colour_hold(colour));
        scene_colour_release(colour);
        assert_memory_equal(colour->pixels, first, BYTES);
        scene_colour_release(colour);
        assert_null(colour->pixels);
    }
    painted[0]++;
    assert_true(image_write_png(in_folder("colour.png"), SIDE, SIDE, 4, painted));
    assert_false(scene_colour_hold(colour));
    unlink(in_folder("colour.png"));
    assert_false(scene_colour_hold(colour));
    scene_destroy(scene);
}

static void missing_scene_and_unreadable_scene(void **state)
{
    (void)state;
    char said[2048], path[256];
    snprintf(path, sizeof path, "%s/scene.json", folder);
    unlink(path);
    assert_null(load(NULL, NULL, said));
    assert_non_null(strstr(said, "scene.json"));
    assert_int_equal(mkdir(path, 0700), 0);
    assert_null(load(NULL, NULL, said));
    assert_true(strchr(said, '\n') == said + strlen(said) - 1);
    assert_int_equal(rmdir(path), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sha256_knows_its_vectors),
        cmocka_unit_test(own_scenes_fly_well),
        cmocka_unit_test(default_scene_is_carried),
        cmocka_unit_test(level_scene_is_level),
        cmocka_unit_test(terrain_replaces_the_scenes),
        cmocka_unit_test(poses_stand_where_they_say),
        cmocka_unit_test(refuses_in_one_line),
        cmocka_unit_test(missing_scene_and_unreadable_scene),
        cmocka_unit_test(colours_are_held_while_they_are_needed),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
