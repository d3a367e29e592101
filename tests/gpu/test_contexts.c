// Every way to a context draws the same picture; where there is none, one line says so.
// One backend a process: the test runs itself again for each (`test_contexts draw egl [threads]`).
// SPDX-License-Identifier: MIT
#include "common/gl/context.h"
#include "common/report.h"
#include "tests/test.h"

#include <inttypes.h>
#include <string.h>
#include <sys/wait.h>

// ---- the child: draw a scene, print its hashes -----------------------------

enum { WIDTH = 200, HEIGHT = 150, CELLS = 60 };

static uint64_t hash(const void *data, size_t size)
{
    const uint8_t *bytes = data;
    uint64_t h = 0xcbf29ce484222325u; // FNV-1a
    for (size_t i = 0; i < size; i++) h = (h ^ bytes[i]) * 0x100000001b3u;
    return h;
}

static struct gpu *open_gpu(const char *word, int threads)
{
    if (strcmp(word, "egl-device") == 0) {
        const struct context_type *const ways[] = {&context_egl_device};
        return gpu_create_by(ways, 1, "egl", 0, 0, "test", threads);
    }
    enum gpu_backend backend;
    if (!gpu_backend_parse(word, &backend)) return NULL;
    return gpu_create(backend, WIDTH, HEIGHT, "test", threads);
}

struct scene_mesh {
    GLuint array, buffers[2];
    size_t indices;
};

// Hilly ground seen at a slant, and triangles that cross it.
static struct scene_mesh load_scene(struct gpu *gpu)
{
    static float vertices[(CELLS + 1) * (CELLS + 1)][3];
    static uint32_t indices[(CELLS * CELLS * 2 + 100) * 3];
    uint64_t seed = 1;
    size_t n = 0;
    for (int v = 0; v < (CELLS + 1) * (CELLS + 1); v++) {
        vertices[v][0] = (float)(v % (CELLS + 1) - CELLS / 2) * 3.0f;
        vertices[v][1] = (float)(v / (CELLS + 1)) * 4.0f + 1.0f;
        vertices[v][2] = (float)test_uniform(&seed, -9, -3);
    }
    for (uint32_t c = 0; c < CELLS * CELLS; c++) {
        uint32_t v = c / CELLS * (CELLS + 1) + c % CELLS,
                 corner[6] = {0, 1, CELLS + 2, 0, CELLS + 2, CELLS + 1};
        for (int k = 0; k < 6; k++) indices[n++] = v + corner[k];
    }
    for (int i = 0; i < 300; i++) indices[n++] = (uint32_t)(test_random(&seed) % ((CELLS + 1) * (CELLS + 1)));
    struct scene_mesh mesh = {.indices = n};
    glGenVertexArrays(1, &mesh.array);
    glBindVertexArray(mesh.array);
    glGenBuffers(2, mesh.buffers);
    glBindBuffer(GL_ARRAY_BUFFER, mesh.buffers[0]);
    gpu_buffer_data(gpu, GL_ARRAY_BUFFER, sizeof vertices, vertices, GL_STATIC_DRAW);
    glVertexAttribPointer(0, 3, GL_FLOAT, GL_FALSE, 0, NULL);
    glEnableVertexAttribArray(0);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, mesh.buffers[1]);
    gpu_buffer_data(gpu, GL_ELEMENT_ARRAY_BUFFER, sizeof indices, indices, GL_STATIC_DRAW);
    return mesh;
}

static bool draw_hash(struct gpu *gpu, size_t count, enum render_pass pass, uint64_t *picture,
                      uint64_t *depth)
{
    static float pixels[WIDTH * HEIGHT * 4];
    const GLenum format = pass == PASS_SHADED ? GL_RGBA8 : pass == PASS_POSITION ? GL_RGBA32F : 0;
    const struct scene_effects effects = {.shading = SCENE_SHADING_COMMON};
    struct gpu_program program;
    struct gpu_target target;
    if (!gpu_program_build(gpu, &program, "common/gl/plain.vert", NULL, &effects, pass)) return false;
    if (!gpu_target_init(gpu, &target, WIDTH, HEIGHT, format)) return false;
    gpu_target_begin(gpu, &target);
    gpu_use_program(gpu, &program);
    gpu_draw_elements(gpu, GL_TRIANGLES, count, GL_UNSIGNED_INT, 0, 0, count / 3);
    if (format) gpu_target_read(gpu, &target, pixels);
    *picture = hash(pixels, (size_t)WIDTH * HEIGHT * (pass == PASS_SHADED ? 4 : 16));
    gpu_target_read_depth(gpu, &target, pixels);
    *depth = hash(pixels, (size_t)WIDTH * HEIGHT * 4);
    gpu_target_finish(&target);
    gpu_program_finish(&program);
    return true;
}

static int draw(const char *word, int threads)
{
    struct gpu *gpu = open_gpu(word, threads);
    if (!gpu) return EXIT_WORLD;
    // The eye looks north, a little down: x to the right, z up, depth along y.
    const struct gpu_frame frame = {
        .clip_from_relative = {1.2f, 0, 0, 0, 0, 0.4f, 0, 1, 0, 1.5f, 0, 0, 0, 0.5f, 0.5f, 0},
        .outline = {-70.0f / 6, 5.0f / 6, 66.0f / 6, 190.0f / 6},
        .shade = {-9.0f / 6, 1.0f / 6}};
    uint64_t colour, position, nothing, depth, depth_again, depth_of_position;
    struct scene_mesh mesh = load_scene(gpu);
    gpu_set_frame(gpu, &frame);
    if (!draw_hash(gpu, mesh.indices, PASS_SHADED, &colour, &depth) ||
        !draw_hash(gpu, mesh.indices, PASS_POSITION, &position, &depth_of_position) ||
        !draw_hash(gpu, mesh.indices, PASS_DEPTH, &nothing, &depth_again))
        return EXIT_WORLD;
    gpu_finish(gpu);
    printf("%s %d %016" PRIx64 " %016" PRIx64 " %016" PRIx64 " %d %d\n", gpu_info(gpu)->backend,
           gpu_info(gpu)->software, colour, depth, position, depth == depth_again,
           (int)gpu_debug_errors(gpu));
    printf("%s\n%s\n", gpu_info(gpu)->renderer, gpu_info(gpu)->version);
    glDeleteVertexArrays(1, &mesh.array);
    glDeleteBuffers(2, mesh.buffers);
    gpu_destroy(gpu);
    return EXIT_GOOD;
}

// ---- the parent ------------------------------------------------------------

// Runs `<before> test_contexts draw <word>`; returns its exit code, and its output, stderr included, in text.
static int run(const char *before, const char *word, char text[4096])
{
    char self[1024], command[2048];
    ssize_t length = readlink("/proc/self/exe", self, sizeof self - 1);
    assert_true(length > 0);
    self[length] = 0;
    snprintf(command, sizeof command, "%s '%s' draw %s 2>&1", before, self, word);
    FILE *pipe = popen(command, "r"); // NOLINT
    assert_non_null(pipe);
    size_t used = fread(text, 1, 4095, pipe);
    text[used] = 0;
    int status = pclose(pipe);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

struct picture {
    char backend[32], colour[32], depth[32], position[32];
    int software;
};

static const char *const off_screen = "env -u DISPLAY -u WAYLAND_DISPLAY";

static struct picture picture_of(const char *before, const char *word)
{
    char text[4096];
    int code = run(before, word, text), depths_agree, errors;
    if (code != 0) fail_msg("%s: exit code %d: %s", word, code, text);
    struct picture p;
    if (sscanf(text, "%31s %d %31s %31s %31s %d %d", p.backend, &p.software, p.colour, p.depth, p.position,
               &depths_agree, &errors) != 7)
        fail_msg("%s: %s", word, text);
    FIGURE("%-15s colour %s depth %s position %s", p.backend, p.colour, p.depth, p.position);
    assert_true(
        depths_agree); // gl_Position is invariant: the shaded and the depth pass meet the same depths bitwise
    assert_int_equal(errors, 0);
    return p;
}

static void expect_same(const struct picture *a, const struct picture *b)
{
    if (a->software != b->software) {
        printf("skipped: %s and %s are not the same rasteriser\n", a->backend, b->backend);
        return;
    }
    assert_string_equal(a->colour, b->colour);
    assert_string_equal(a->depth, b->depth);
    assert_string_equal(a->position, b->position);
}

static void test_backends_agree(void **state)
{
    (void)state;
    struct picture egl = picture_of(off_screen, "egl"), osmesa = picture_of(off_screen, "osmesa");
    struct picture device = picture_of(off_screen, "egl-device"), automatic = picture_of(off_screen, "auto");
    assert_string_equal(osmesa.backend, "osmesa");
    assert_string_equal(device.backend, "egl-device");
    assert_string_equal(automatic.backend, egl.backend);
    expect_same(&egl, &osmesa);
    expect_same(&egl, &device);
    expect_same(&egl, &automatic);
}

static bool have_xvfb(void)
{
    return system("command -v xvfb-run >/dev/null 2>&1") == 0; // NOLINT
}

static void test_window(void **state)
{
    (void)state;
    if (!have_xvfb()) {
        printf("skipped: xvfb-run is not installed, no window was opened\n");
        return;
    }
    const char *under_xvfb = "env -u WAYLAND_DISPLAY -u DISPLAY xvfb-run -a";
    struct picture window = picture_of(under_xvfb, "glfw"), automatic = picture_of(under_xvfb, "auto");
    assert_string_equal(window.backend, "glfw");
    assert_string_equal(automatic.backend, "glfw");
    struct picture egl = picture_of(off_screen, "egl");
    expect_same(&window, &automatic);
    expect_same(&window, &egl);
}

// The rasteriser's threads never change a picture.
static void test_threads(void **state)
{
    (void)state;
    struct picture none = picture_of(off_screen, "egl 0");
    for (int threads = 1; threads <= 4; threads++) {
        char word[16];
        snprintf(word, sizeof word, "egl %d", threads);
        struct picture some = picture_of(off_screen, word);
        expect_same(&none, &some);
    }
}

static void test_no_usable_gl(void **state)
{
    (void)state;
    static const struct {
        const char *before, *word;
    } cases[] = {
        {"env -u DISPLAY -u WAYLAND_DISPLAY", "glfw"},
        {"env -u WAYLAND_DISPLAY DISPLAY=:4711", "glfw"},
        {"env -u DISPLAY __EGL_VENDOR_LIBRARY_FILENAMES=/nonexistent", "egl"},
        {"env -u DISPLAY LIBGL_DRIVERS_PATH=/nonexistent", "egl"},
        {"xvfb-run -a env LIBGL_DRIVERS_PATH=/nonexistent", "glfw"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        if (strstr(cases[i].before, "xvfb") && !have_xvfb()) continue;
        char text[4096];
        int code = run(cases[i].before, cases[i].word, text);
        if (code != EXIT_WORLD)
            fail_msg("%s %s: exit code %d: %s", cases[i].before, cases[i].word, code, text);
        char *line = strstr(text, "relief: ");
        assert_non_null(line);
        assert_non_null(strstr(line, cases[i].word));
        assert_ptr_equal(strchr(line, '\n'), line + strlen(line) - 1); // one line, the last
        assert_null(strstr(line + 1, "relief: "));
        if (!strstr(cases[i].before, "xvfb"))
            assert_ptr_equal(line, text); // Mesa's GLX adds a line of its own
    }
    // A display that is named but does not answer: auto goes on without a window.
    struct picture automatic = picture_of("env -u WAYLAND_DISPLAY DISPLAY=:4711", "auto");
    assert_string_not_equal(automatic.backend, "glfw");
}

int main(int argc, char **argv)
{
    if (argc >= 3 && strcmp(argv[1], "draw") == 0) return draw(argv[2], argc > 3 ? atoi(argv[3]) : 0);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_backends_agree),
        cmocka_unit_test(test_window),
        cmocka_unit_test(test_threads),
        cmocka_unit_test(test_no_usable_gl),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
