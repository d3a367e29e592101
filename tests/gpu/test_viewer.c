// The standalone program around a renderer: options, exit codes, snapshots, and a window that is resized and
// flown in. Each run is a process of its own, with a renderer as plain as can be: one square at the map's
// mean height. SPDX-License-Identifier: MIT
#include "common/report.h"
#include "common/viewer.h"
#include "tests/test.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>

// ---- the renderer ----------------------------------------------------------

struct square {
    struct renderer base;
    struct gpu *gpu;
    const struct terrain *terrain;
    struct gpu_program program;
    GLuint array, buffers[2];
    double reach;
    int width, height, frame;
};

static void square_destroy(struct renderer *renderer)
{
    struct square *s = (struct square *)renderer;
    if (!s) return;
    gpu_program_finish(&s->program);
    glDeleteVertexArrays(1, &s->array);
    glDeleteBuffers(2, s->buffers);
    free(s);
}

static const struct renderer_type square_renderer;

static struct renderer *square_create(const struct renderer_desc *desc)
{
    static const uint32_t indices[6] = {0, 1, 2, 0, 2, 3};
    struct square *s = calloc(1, sizeof *s);
    if (!s) return NULL;
    *s = (struct square){.base = {&square_renderer},
                         .gpu = desc->gpu,
                         .terrain = desc->terrain,
                         .reach = desc->knobs[0],
                         .width = desc->width,
                         .height = desc->height};
    printf("made: reach %g in %dx%d\n", s->reach, s->width, s->height);
    glGenVertexArrays(1, &s->array);
    glGenBuffers(2, s->buffers);
    glBindVertexArray(s->array);
    glBindBuffer(GL_ARRAY_BUFFER, s->buffers[0]);
    glVertexAttribPointer(0, 3, GL_FLOAT, GL_FALSE, 0, NULL);
    glEnableVertexAttribArray(0);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, s->buffers[1]);
    gpu_buffer_data(s->gpu, GL_ELEMENT_ARRAY_BUFFER, sizeof indices, indices, GL_STATIC_DRAW);
    if (gpu_program_build(s->gpu, &s->program, "common/gl/plain.vert", NULL, desc->effects, PASS_SHADED))
        return &s->base;
    square_destroy(&s->base);
    return NULL;
}

// What a user would do in the window, by frame number: $RELIEF_TEST_HANDS turns it on.
static void play_user(const struct square *s)
{
    GLFWwindow *window = gpu_window(s->gpu);
    if (!window || !getenv("RELIEF_TEST_HANDS")) return;
    GLFWkeyfun press = glfwSetKeyCallback(window, NULL);
    glfwSetKeyCallback(window, press);
    static const int keys[] = {GLFW_KEY_F, GLFW_KEY_P, GLFW_KEY_F12, GLFW_KEY_F, GLFW_KEY_V, GLFW_KEY_P};
    if (s->frame < 6) press(window, keys[s->frame], 0, GLFW_PRESS, 0);
    if (s->frame == 6) glfwSetWindowSize(window, 410, 330);
    if (s->width != 410) return;
    press(window, s->reach < 2000 ? GLFW_KEY_EQUAL : GLFW_KEY_ESCAPE, 0, GLFW_PRESS, 0);
}

static void square_begin_frame(struct renderer *renderer, int frame)
{
    struct square *s = (struct square *)renderer;
    s->frame = frame;
    play_user(s);
}

static bool square_update(struct renderer *renderer, const struct view *views, int count)
{
    struct square *s = (struct square *)renderer;
    const struct terrain_info *info = terrain_info(s->terrain);
    (void)count;
    float reach = (float)s->reach;
    float z = (float)(info->offset_m + info->quantum_m * 0.5 * (info->min_q + info->max_q) - views->eye_m[2]);
    const float vertices[4][3] = {
        {-reach, -reach, z}, {reach, -reach, z}, {reach, reach, z}, {-reach, reach, z}};
    glBindBuffer(GL_ARRAY_BUFFER, s->buffers[0]);
    gpu_buffer_data(s->gpu, GL_ARRAY_BUFFER, sizeof vertices, vertices, GL_STREAM_DRAW);
    return true;
}

static void square_draw(struct renderer *renderer, int view_index, enum render_pass pass)
{
    struct square *s = (struct square *)renderer;
    (void)view_index, (void)pass;
    glBindVertexArray(s->array);
    gpu_use_program(s->gpu, &s->program);
    gpu_draw_elements(s->gpu, GL_TRIANGLES, 6, GL_UNSIGNED_INT, 0, 0, 2);
}

static void square_stats(const struct renderer *renderer, struct renderer_stats *stats)
{
    (void)renderer;
    *stats = (struct renderer_stats){.triangles = 2, .claimed_error_px = (double)NAN};
}

static const struct renderer_knob square_knobs[] = {
    {.name = "reach", .help = "half the square's side, m", .fallback = 500, .min = 1, .max = 1e6},
    {.name = "mood", .help = "changes nothing", .fallback = 1, .choices = "bad|good"},
    {.name = NULL},
};
static const double square_values[] = {500, 1000, 2000, (double)NAN};

static const struct renderer_type square_renderer = {
    .name = "square",
    .summary = "one square",
    .knobs = square_knobs,
    .quality_knob = "reach",
    .quick = square_values,
    .full = square_values,
    .create = square_create,
    .begin_frame = square_begin_frame,
    .update = square_update,
    .draw = square_draw,
    .stats = square_stats,
    .destroy = square_destroy,
};

// ---- runs ------------------------------------------------------------------

struct fixture {
    char folder[64], self[1024], scene[128];
};

static const char scene_text[] = "{ \"name\": \"test\", \"terrain\": { \"builtin\": \"jacksboro\" },"
                                 " \"path\": { \"keys\": [ { \"x\": 9000, \"y\": 9000, \"height\": 3000, "
                                 "\"above_ground\": true, \"yaw\": 30,"
                                 " \"pitch\": -60, \"roll\": 0 } ], \"clearance\": 5, \"frames\": 3 },"
                                 " \"view\": { \"width\": 160, \"height\": 120, \"fov_vertical\": 60 } }";

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    *state = f;
    snprintf(f->folder, sizeof f->folder, "/tmp/relief-viewer-XXXXXX");
    if (!mkdtemp(f->folder) || readlink("/proc/self/exe", f->self, sizeof f->self - 1) < 0) return -1;
    snprintf(f->scene, sizeof f->scene, "%s/scene.json", f->folder);
    FILE *file = fopen(f->scene, "w");
    if (!file) return -1;
    fputs(scene_text, file);
    return fclose(file);
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    char command[128];
    snprintf(command, sizeof command, "rm -r '%s'", f->folder);
    int code = system(command); // NOLINT
    free(f);
    return code;
}

// Runs the viewer in the fixture's folder; its exit code, and stdout and stderr in `text`.
static int run(const struct fixture *f, const char *before, const char *arguments, char text[8192])
{
    char command[4096];
    snprintf(command, sizeof command, "cd '%s' && %s '%s' view --scene scene.json %s 2>&1", f->folder, before,
             f->self, arguments);
    FILE *pipe = popen(command, "r"); // NOLINT
    assert_non_null(pipe);
    size_t used = fread(text, 1, 8191, pipe);
    text[used] = 0;
    int status = pclose(pipe);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

static const char *const off_screen = "env -u DISPLAY -u WAYLAND_DISPLAY";
static const char *const under_xvfb = "env -u DISPLAY -u WAYLAND_DISPLAY xvfb-run -a env RELIEF_TEST_HANDS=1";

static size_t read_file(const struct fixture *f, const char *name, uint8_t *bytes, size_t size)
{
    char path[256];
    snprintf(path, sizeof path, "%s/%s", f->folder, name);
    FILE *file = fopen(path, "rb");
    if (!file) return 0;
    size_t used = fread(bytes, 1, size, file);
    fclose(file);
    return used;
}

static void test_snapshots(void **state)
{
    const struct fixture *f = *state;
    static uint8_t egl[1 << 18], osmesa[1 << 18], wide[1 << 18];
    char text[8192];
    assert_int_equal(run(f, off_screen, "--headless --snapshot egl.png", text), EXIT_GOOD);
    assert_non_null(strstr(text, "square: 3 frames of 160x120"));
    assert_int_equal(run(f, off_screen, "--backend osmesa --frames 7 --snapshot osmesa.png", text),
                     EXIT_GOOD);
    assert_non_null(strstr(text, "square: 7 frames of 160x120"));
    assert_int_equal(
        run(f, off_screen, "--headless --size 300x20 --reach=900 --mood bad --snapshot wide.png", text),
        EXIT_GOOD);
    assert_non_null(strstr(text, "of 300x20"));
    size_t egl_size = read_file(f, "egl.png", egl, sizeof egl);
    assert_true(egl_size > 100);
    assert_int_equal(read_file(f, "osmesa.png", osmesa, sizeof osmesa), egl_size);
    assert_memory_equal(egl, osmesa, egl_size);
    assert_true(read_file(f, "wide.png", wide, sizeof wide) > 24);
    assert_memory_equal(wide + 16, "\0\0\x01\x2c\0\0\0\x14", 8); // the header says 300 x 20
}

static void test_help(void **state)
{
    const struct fixture *f = *state;
    char text[8192];
    assert_int_equal(run(f, "", "--help", text), EXIT_GOOD);
    static const char *const words[] = {"--scene",    "--terrain", "--backend",  "--size",
                                        "--headless", "--frames",  "--snapshot", "--version",
                                        "--reach",    "--mood",    "bad|good"};
    for (size_t i = 0; i < sizeof words / sizeof *words; i++) assert_non_null(strstr(text, words[i]));
    assert_int_equal(run(f, "", "--version", text), EXIT_GOOD);
    assert_non_null(strstr(text, "0."));
}

static void test_refusals(void **state)
{
    const struct fixture *f = *state;
    static const struct {
        const char *arguments, *named;
        int code;
    } cases[] = {
        {"--size 0x0", "--size", EXIT_COMMAND_LINE},
        {"--reach 0", "--reach", EXIT_COMMAND_LINE},
        {"--reach nan", "--reach", EXIT_COMMAND_LINE},
        {"--reach 12x", "--reach", EXIT_COMMAND_LINE},
        {"--mood goo", "--mood", EXIT_COMMAND_LINE},
        {"--nonsense 1", "--nonsense", EXIT_COMMAND_LINE},
        {"--frames 0", "--frames", EXIT_COMMAND_LINE},
        {"--backend vulkan", "--backend", EXIT_COMMAND_LINE},
        {"--scene no.json", "no.json", EXIT_WORLD},
        {"--terrain no.png", "no.png", EXIT_WORLD},
        {"--headless --snapshot no/such/folder.png", "no/such/folder.png", EXIT_WORLD},
        {"--backend glfw", "--backend glfw", EXIT_WORLD},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[8192];
        int code = run(f, off_screen, cases[i].arguments, text);
        const char *line = strstr(text, "relief: ");
        if (code != cases[i].code || !line || !strstr(line, cases[i].named) || strstr(line + 1, "relief: "))
            fail_msg("%s: exit code %d: %s", cases[i].arguments, code, text);
    }
}

// By hand, under Xvfb: wireframe, the path, a picture, a larger window, more quality, and out.
static void test_window(void **state)
{
    const struct fixture *f = *state;
    static uint8_t picture[1 << 20];
    char text[8192];
    if (system("command -v xvfb-run >/dev/null 2>&1") != 0) { // NOLINT
        printf("skipped: xvfb-run is not installed, no window was opened\n");
        return;
    }
    int code = run(f, under_xvfb, "--snapshot last.png", text);
    assert_int_equal(code, EXIT_GOOD);
    assert_non_null(strstr(text, "reach 500 in 410x330"));
    assert_non_null(strstr(text, "reach 1000 in 410x330"));
    assert_non_null(strstr(text, "reach 2000 in 410x330"));
    assert_true(read_file(f, "square-0001.png", picture, sizeof picture) > 24);
    assert_memory_equal(picture + 16, "\0\0\0\xa0\0\0\0\x78", 8); // 160 x 120
    assert_true(read_file(f, "last.png", picture, sizeof picture) > 24);
    assert_memory_equal(picture + 16, "\0\0\x01\x9a\0\0\x01\x4a", 8); // 410 x 330
}

int main(int argc, char **argv)
{
    if (argc >= 2 && strcmp(argv[1], "view") == 0) return viewer_main(argc - 1, argv + 1, &square_renderer);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_snapshots),
        cmocka_unit_test(test_help),
        cmocka_unit_test(test_refusals),
        cmocka_unit_test(test_window),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
