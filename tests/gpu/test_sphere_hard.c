// Hard cases of a planet on the GPU: what is drawn changes evenly over a pole, what is nearer hides what is
// farther from a walk to space, and rings join.  SPDX-License-Identifier: MIT
#include "clipmap/clipmap.h"
#include "common/embedded.h"
#include "tests/gpu/settings.h"
#include "tests/planet.h"

#include <string.h>

static const struct scene_effects effects = {.shading = SCENE_SHADING_COMMON};

enum { WIDTH = 96, HEIGHT = 72, PIXELS = WIDTH * HEIGHT };

static struct gpu *gpu;

static int setup(void **state)
{
    (void)state;
    gpu = gpu_create(GPU_OFFSCREEN, 0, 0, "test", 0);
    return gpu ? 0 : -1;
}

static int teardown(void **state)
{
    (void)state;
    uint64_t errors = gpu_debug_errors(gpu);
    gpu_destroy(gpu);
    return errors ? -1 : 0;
}

static struct renderer *create(const struct terrain *terrain, const char *settings)
{
    struct renderer_desc desc = {
        .gpu = gpu, .terrain = terrain, .effects = &effects, .width = WIDTH, .height = HEIGHT};
    return create_with(&clipmap_renderer, desc, settings);
}

static void prepare(struct renderer *renderer, const struct terrain *terrain, const struct view *view,
                    int frame)
{
    clipmap_renderer.begin_frame(renderer, frame);
    assert_true(clipmap_renderer.update(renderer, view, 1));
    gpu_set_view(gpu, terrain, view);
}

// ---- D2 --------------------------------------------------------------------

enum { RING = 720 };

// The part of the ring's vertex program that finds angles, alone; 0 where it does not compile.
static GLuint angles_program(int form)
{
    static const char before[] = "in vec3 v;\nout vec2 angles;\nuniform vec4 viewer;\nuniform float polar;\n",
                      after[] = "void main() { gl_Position = vec4(0.0); angles = angles_of(v); }\n";
    static const char *const captured = "angles";
    const struct embedded_file *file = embedded_find("clipmap/sphere.vert");
    assert_non_null(file);
    const char *from = strstr((const char *)file->data, "vec2 stable_angles"),
               *to = strstr((const char *)file->data, "float texel(");
    char version[64];
    snprintf(version, sizeof version, "#version 330 core\n#define FORM %d\n", form);
    const GLchar *texts[] = {version, before, from, after};
    const GLint lengths[] = {-1, -1, (GLint)(to - from), -1};
    GLuint shader = glCreateShader(GL_VERTEX_SHADER), program = glCreateProgram();
    glShaderSource(shader, 4, texts, lengths);
    glCompileShader(shader);
    glAttachShader(program, shader);
    glTransformFeedbackVaryings(program, 1, &captured, GL_INTERLEAVED_ATTRIBS);
    glLinkProgram(program);
    glDeleteShader(shader);
    GLint good;
    glGetProgramiv(program, GL_LINK_STATUS, &good);
    assert_true(good);
    return program;
}

// The worst error on a ring, metres on the ground.
static double ring_error_m(GLuint program, const GLuint buffers[2], double polar, double reach_m)
{
    static float ring[RING][3], found[RING][2];
    double angle = reach_m / RADIUS, half = sin(angle / 2), worst = 0;
    for (int k = 0; k < RING; k++) {
        double azimuth = (k + 0.5) * 2 * M_PI / RING;
        ring[k][0] = (float)(cos(azimuth) * sin(angle));
        ring[k][1] = (float)(sin(azimuth) * sin(angle));
        ring[k][2] = (float)(2 * half * half);
    }
    glUseProgram(program);
    glUniform4f(glGetUniformLocation(program, "viewer"), (float)sin(polar), (float)cos(polar), 0, 0);
    glUniform1f(glGetUniformLocation(program, "polar"), (float)polar);
    glBindBuffer(GL_ARRAY_BUFFER, buffers[0]);
    gpu_buffer_data(gpu, GL_ARRAY_BUFFER, sizeof ring, ring, GL_STREAM_DRAW);
    GLuint at = (GLuint)glGetAttribLocation(program, "v");
    glEnableVertexAttribArray(at);
    glVertexAttribPointer(at, 3, GL_FLOAT, GL_FALSE, 12, NULL);
    glBindBufferBase(GL_TRANSFORM_FEEDBACK_BUFFER, 0, buffers[1]);
    glEnable(GL_RASTERIZER_DISCARD);
    glBeginTransformFeedback(GL_POINTS);
    glDrawArrays(GL_POINTS, 0, RING);
    glEndTransformFeedback();
    glDisable(GL_RASTERIZER_DISCARD);
    glGetBufferSubData(GL_TRANSFORM_FEEDBACK_BUFFER, 0, sizeof found, found);
    for (int k = 0; k < RING; k++) {
        double exact[2], latitude = 0.5 * M_PI - polar;
        test_exact_angles(latitude, angle, (k + 0.5) * 2 * M_PI / RING, exact);
        double east = remainder((double)found[k][0] - exact[0], 2 * M_PI) * cos(latitude + exact[1]);
        worst = fmax(worst, RADIUS * hypot(east, (double)found[k][1] - exact[1]));
    }
    return worst;
}

// 3e-5 of the distance, which the shader's own atan allows (numerics.md, section 0).
static void shaders_sample_where_they_should(void **state)
{
    (void)state;
    static const double POLAR[] = {M_PI / 2, M_PI / 4, M_PI / 48, 1e-3, 1e-5, 1e-7, 0, M_PI - 1e-3, M_PI};
    GLuint programs[3], buffers[2], array;
    struct gpu_target target; // without one nothing runs
    assert_true(gpu_target_init(gpu, &target, WIDTH, HEIGHT, GL_RGBA8));
    gpu_target_begin(gpu, &target);
    double worst = 0, acos_m = HUGE_VAL;
    for (int form = 0; form < 3; form++) programs[form] = angles_program(form);
    glGenVertexArrays(1, &array);
    glBindVertexArray(array);
    glGenBuffers(2, buffers);
    glBindBuffer(GL_TRANSFORM_FEEDBACK_BUFFER, buffers[1]);
    gpu_buffer_data(gpu, GL_TRANSFORM_FEEDBACK_BUFFER, RING * 2 * sizeof(float), NULL, GL_STREAM_READ);
    for (size_t k = 0; k < sizeof POLAR / sizeof *POLAR; k++) {
        for (double reach_m = 1; reach_m <= 1e6; reach_m *= 10)
            worst = fmax(worst, ring_error_m(programs[0], buffers, POLAR[k], reach_m) / reach_m);
        acos_m = fmin(acos_m, ring_error_m(programs[1], buffers, POLAR[k], 1));
    }
    double printed_m = ring_error_m(programs[2], buffers, M_PI / 2, 1e5);
    FIGURE("D2: shaders sample off by at most %.1e of the distance; with acos by %.2f m at least on rings of "
           "1 m; "
           "as printed by %.0f km on a ring of 100 km",
           worst, acos_m, printed_m / 1000);
    assert_true(worst <= 3e-5);
    assert_true(acos_m > 3e-5 && printed_m > 3e-5 * 1e5);
    for (int form = 0; form < 3; form++) glDeleteProgram(programs[form]);
    glDeleteBuffers(2, buffers);
    glBindVertexArray(0);
    glDeleteVertexArrays(1, &array);
    gpu_target_finish(&target);
}

// ---- D5 --------------------------------------------------------------------

// Hills that look the same along the three axes of the planet, so that the ground at the pole is that at the
// equator.  The planet is so small that a cell is a few steps wide: heights are linear in longitude and
// latitude, and with wide cells the pole would be the tip of a fan of facets, which the equator has not.
static const double SMALL_RADIUS_M = 2000;

static struct terrain *turned_planet(void)
{
    enum { COLUMNS = 2048, ROWS = 1025 };
    static int32_t samples[COLUMNS * ROWS];
    for (int k = 0; k < COLUMNS * ROWS; k++) {
        double longitude = 2 * M_PI * (k % COLUMNS) / COLUMNS - M_PI,
               latitude = M_PI * (k / COLUMNS) / (ROWS - 1) - M_PI / 2;
        double p[3] = {cos(latitude) * cos(longitude), cos(latitude) * sin(longitude), sin(latitude)},
               sum = 0;
        for (int a = 0; a < 3; a++) sum += sin(9 * p[a] + 5 * p[(a + 1) % 3]) * cos(7 * p[(a + 2) % 3]);
        samples[k] = (int32_t)lrint(1e4 * sum);
    }
    struct terrain_grid grid = {.name = "turned",
                                .samples = samples,
                                .width = COLUMNS,
                                .height = ROWS,
                                .first = {-COLUMNS / 2, 0},
                                .spacing_m = {1, 1},
                                .quantum_m = 1e-3};
    struct terrain *terrain = terrain_from_grid(&grid, &(struct terrain_options){.radius_m = SMALL_RADIUS_M});
    assert_non_null(terrain);
    return terrain;
}

// By how much a picture differs from the next, in pixels: each pixel's drawn points, along the plumb line at
// the eye, as seen in the picture; the median, for along skylines pixels show other ground.
static int compare_floats(const void *a, const void *b)
{
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

static double change_px(const struct view *view, float (*a)[4], float (*b)[4])
{
    static float changes[PIXELS];
    int count = 0;
    for (int p = 0; p < PIXELS; p++) {
        if (a[p][3] == 0 || b[p][3] == 0) continue;
        double depth = 0;
        for (int k = 0; k < 3; k++) depth += view->forward[k] * (double)b[p][k];
        changes[count++] =
            (float)(view->pixels_per_tangent * fabs((double)b[p][2] - (double)a[p][2]) / depth);
    }
    assert_true(count > PIXELS / 4);
    qsort(changes, (size_t)count, sizeof *changes, compare_floats);
    return (double)changes[count / 2];
}

// The same of colours: the mean difference of a channel, of 255.
static double change_of_colour(uint8_t (*a)[4], uint8_t (*b)[4])
{
    double sum = 0;
    for (int p = 0; p < PIXELS; p++)
        for (int k = 0; k < 3; k++) sum += abs(b[p][k] - a[p][k]);
    return sum / (3 * PIXELS);
}

struct change {
    double worst, mean;
};

struct walk_change {
    struct change px, colour;
};

static void add_change(struct change *change, double value, int steps)
{
    change->worst = fmax(change->worst, value);
    change->mean += value / steps;
}

enum walk_place { EQUATOR, NORTH_POLE, SOUTH_POLE };

// Over a pole along the meridian of 0 degrees, or westwards over the meridian of 0 along the equator:
// turned_planet() has the same ground at the equator and at the north pole.
static struct camera walker(const struct terrain *terrain, enum walk_place place, double along_m,
                            double eye_m)
{
    double pole_m = 0.5 * M_PI * terrain_info(terrain)->radius_m, side = place == SOUTH_POLE ? -1 : 1;
    bool over = place != EQUATOR && along_m > 0; // away from the pole, on the meridian of 180 degrees
    struct camera camera = {{-along_m, 0, eye_m}, M_PI, -0.35, 0, 60 * DEGREE};
    if (place == EQUATOR) return camera;
    camera.eye_m[0] = over ? 2 * pole_m : 0;
    camera.eye_m[1] = side * (pole_m - fabs(along_m));
    camera.yaw = side * (over ? -M_PI / 2 : M_PI / 2);
    return camera;
}

// 20 m over the highest ground under the walk.
static double walker_height(const struct terrain *terrain, enum walk_place place, int steps)
{
    const struct terrain_info *info = terrain_info(terrain);
    double most_q = -HUGE_VAL;
    for (int step = 0; step <= steps; step++) {
        double q = 0;
        struct camera camera = walker(terrain, place, step - 0.5 * steps, 0);
        assert_true(terrain_truth_at(terrain, camera.eye_m[0], camera.eye_m[1], &q, NULL));
        most_q = fmax(most_q, q);
    }
    return most_q * info->quantum_m + info->offset_m + 20;
}

// The change from one frame to the next, the largest and the mean over the walk.
static struct walk_change walk(const struct terrain *terrain, enum walk_place place, int steps)
{
    static float places[2][PIXELS][4];
    static uint8_t colours[2][PIXELS][4];
    struct walk_change change = {0};
    struct gpu_target target, colour_target;
    struct renderer *renderer = create(terrain, "n=127");
    assert_true(gpu_target_init(gpu, &target, WIDTH, HEIGHT, GL_RGBA32F));
    assert_true(gpu_target_init(gpu, &colour_target, WIDTH, HEIGHT, GL_RGBA8));
    double eye_m = walker_height(terrain, place, steps);
    for (int step = 0; step <= steps; step++) {
        struct camera camera = walker(terrain, place, step - 0.5 * steps, eye_m);
        struct view view;
        view_init(&view, terrain, &camera, WIDTH, HEIGHT, 1);
        prepare(renderer, terrain, &view, step);
        gpu_target_begin(gpu, &target);
        clipmap_renderer.draw(renderer, 0, PASS_POSITION);
        gpu_target_read(gpu, &target, places[step % 2]);
        gpu_target_begin(gpu, &colour_target);
        clipmap_renderer.draw(renderer, 0, PASS_SHADED);
        gpu_target_read(gpu, &colour_target, colours[step % 2]);
        if (step == 0) continue;
        add_change(&change.px, change_px(&view, places[0], places[1]), steps);
        add_change(&change.colour, change_of_colour(colours[0], colours[1]), steps);
    }
    clipmap_renderer.destroy(renderer);
    gpu_target_finish(&target);
    gpu_target_finish(&colour_target);
    return change;
}

// D5: at most twice the change over the equator.
static void hold_even(const char *planet, const char *where, const struct walk_change *pole,
                      const struct walk_change *equator)
{
    FIGURE("D5, %s: a step of 1 m changes places by %.2e px at most, %.2e in the mean over the %s pole; %.2e "
           "and "
           "%.2e over the equator",
           planet, pole->px.worst, pole->px.mean, where, equator->px.worst, equator->px.mean);
    FIGURE("D5, %s: and colours by %.2f of 255 at most, %.2f in the mean; %.2f and %.2f over the equator",
           planet, pole->colour.worst, pole->colour.mean, equator->colour.worst, equator->colour.mean);
    assert_true(equator->px.mean > 0 && equator->colour.mean > 0);
    assert_true(pole->px.worst <= 2 * equator->px.worst && pole->px.mean <= 2 * equator->px.mean);
    assert_true(pole->colour.worst <= 2 * equator->colour.worst);
    assert_true(pole->colour.mean <= 2 * equator->colour.mean);
}

static void pictures_change_evenly_over_a_pole(void **state)
{
    (void)state;
    struct terrain *terrain = turned_planet();
    int steps = test_size(20, 400);
    struct walk_change pole = walk(terrain, NORTH_POLE, steps), equator = walk(terrain, EQUATOR, steps);
    hold_even("hills the same at both", "north", &pole, &equator);
    terrain_destroy(terrain);
}

// Earth as scenes have it: stored cells of 9 km, detail of 0.6 m.
static void earth_changes_evenly_over_its_poles(void **state)
{
    (void)state;
    char path[1024];
    if (!test_data("earth_etopo5_4320x2161.png", path)) skip();
    struct terrain *terrain =
        terrain_load(path, &(struct terrain_options){.synthesize_levels = 14, .seed = 1});
    assert_non_null(terrain);
    int steps = test_size(20, 400);
    struct walk_change north = walk(terrain, NORTH_POLE, steps), south = walk(terrain, SOUTH_POLE, steps),
                       equator = walk(terrain, EQUATOR, steps);
    hold_even("Earth", "north", &north, &equator);
    hold_even("Earth", "south", &south, &equator);
    terrain_destroy(terrain);
}

// ---- D8 --------------------------------------------------------------------

// Two surfaces of two slanted triangles each, one `apart` times farther; the farther one shows its back.
static void surfaces(const struct view *view, double distance_m, double apart, float corners[12][3])
{
    static const int ORDER[2][6] = {{0, 1, 2, 0, 2, 3}, {0, 2, 1, 0, 3, 2}};
    static const double ACROSS[4][2] = {{-1, -1}, {1, -1}, {1, 1}, {-1, 1}}, DEPTHS[4] = {0.7, 1, 1.3, 0.9};
    for (int far = 0; far < 2; far++)
        for (int k = 0; k < 6; k++) {
            int c = ORDER[far][k];
            double depth_m = distance_m * DEPTHS[c] * (far ? 1 + apart : 1);
            for (int axis = 0; axis < 3; axis++)
                corners[6 * far + k][axis] =
                    (float)(depth_m * (view->forward[axis] +
                                       0.9 * ACROSS[c][0] * view->tan_half[0] * view->right[axis] +
                                       0.9 * ACROSS[c][1] * view->tan_half[1] * view->up[axis]));
        }
}

// Pixels that show the nearer surface, drawn before the farther one and after it.
static int right_pixels(const struct gpu_target *target, const struct gpu_program *program,
                        const struct view *view, double distance_m, double apart)
{
    static float corners[12][3], pixels[PIXELS][4];
    GLuint names[2], array;
    const uint16_t indices[12] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11};
    int right = 0;
    surfaces(view, distance_m, apart, corners);
    glGenVertexArrays(1, &array);
    glGenBuffers(2, names);
    glBindVertexArray(array);
    glBindBuffer(GL_ARRAY_BUFFER, names[0]);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, names[1]);
    gpu_buffer_data(gpu, GL_ARRAY_BUFFER, sizeof corners, corners, GL_STATIC_DRAW);
    gpu_buffer_data(gpu, GL_ELEMENT_ARRAY_BUFFER, sizeof indices, indices, GL_STATIC_DRAW);
    glEnableVertexAttribArray(0);
    glVertexAttribPointer(0, 3, GL_FLOAT, GL_FALSE, 12, NULL);
    for (int order = 0; order < 2; order++) {
        gpu_target_begin(gpu, target);
        gpu_use_program(gpu, program);
        gpu_draw_elements(gpu, GL_TRIANGLES, 6, GL_UNSIGNED_SHORT, order ? 6 : 0, 0, 2);
        gpu_draw_elements(gpu, GL_TRIANGLES, 6, GL_UNSIGNED_SHORT, order ? 0 : 6, 0, 2);
        gpu_target_read(gpu, target, pixels);
        for (int p = 0; p < PIXELS; p++) right += pixels[p][3] > 0;
    }
    glBindVertexArray(0);
    glDeleteVertexArrays(1, &array);
    glDeleteBuffers(2, names);
    return right;
}

static void the_nearer_hides_the_farther(void **state)
{
    (void)state;
    static const double DISTANCES[] = {1, 1e2, 1e4, 1e6, 1e7};
    struct terrain *terrain = test_planet(64, 1000, 5, 0);
    struct camera camera = test_camera(terrain, 20, 40, 3 * RADIUS, 0.3, -1.2);
    struct view view;
    struct gpu_target target;
    struct gpu_program program;
    view_init(&view, terrain, &camera, WIDTH, HEIGHT, 0.1);
    assert_true(gpu_target_init(gpu, &target, WIDTH, HEIGHT, GL_RGBA32F));
    assert_true(
        gpu_program_build(gpu, &program, "common/gl/plain.vert", GPU_SPHERE, &effects, PASS_POSITION));
    gpu_set_view(gpu, terrain, &view);
    if (!gpu_info(gpu)->clip_control) {
        printf("skipped: no clip control, so no reversed depth\n");
        skip();
    }
    int all = 0, least = INT32_MAX, fixed = 0;
    for (int d = 0; d < 5; d++) {
        int far_apart = right_pixels(&target, &program, &view, DISTANCES[d], 0.5);
        int right = right_pixels(&target, &program, &view, DISTANCES[d], 1e-6);
        all = far_apart > all ? far_apart : all;
        least = right < least ? right : least;
    }
    assert_true(all > PIXELS && least >= 0.999 * all);
    // The same with 24 bits of fixed point fails from 10 km on.
    glBindRenderbuffer(GL_RENDERBUFFER, target.depth);
    glRenderbufferStorage(GL_RENDERBUFFER, GL_DEPTH_COMPONENT24, WIDTH, HEIGHT);
    for (int d = 2; d < 5; d++) {
        int right = right_pixels(&target, &program, &view, DISTANCES[d], 1e-6);
        fixed = right > fixed ? right : fixed;
    }
    FIGURE("D8: 1e-6 apart from 1 m to 1e7 m, %d of %d pixels right at least; with 24 fixed bits at most %d "
           "from "
           "10 km on",
           least, all, fixed);
    assert_true(fixed < 0.999 * all);
    gpu_program_finish(&program);
    gpu_target_finish(&target);
    terrain_destroy(terrain);
}

// ---- D9 --------------------------------------------------------------------

struct edge {
    float ends[2][3];
};

struct edges {
    struct edge *there, *back;
    size_t count, room;
};

static void list_edges(const float *triangles, size_t count, void *user)
{
    struct edges *edges = user;
    if (edges->count + 3 * count > edges->room) {
        edges->room = 2 * (edges->count + 3 * count);
        edges->there = realloc(edges->there, edges->room * sizeof *edges->there);
        edges->back = realloc(edges->back, edges->room * sizeof *edges->back);
        assert_true(edges->there && edges->back);
    }
    for (size_t k = 0; k < 3 * count; k++) {
        const float *from = triangles + 9 * (k / 3) + 3 * (k % 3),
                    *to = triangles + 9 * (k / 3) + 3 * ((k + 1) % 3);
        size_t size = 3 * sizeof *from;
        if (memcmp(from, to, size) == 0) continue;
        memcpy(edges->there[edges->count].ends[0], from, size),
            memcpy(edges->there[edges->count].ends[1], to, size);
        memcpy(edges->back[edges->count].ends[0], to, size),
            memcpy(edges->back[edges->count].ends[1], from, size);
        edges->count++;
    }
}

static int compare_edges(const void *a, const void *b)
{
    return memcmp(a, b, sizeof(struct edge));
}

// All rings, blocks and levels join with the same bits: each edge is met from both sides, but those of the
// outermost ring, one an azimuth.
static void rings_join_bit_for_bit(void **state)
{
    (void)state;
    static const double PLACES[][3] = {
        {10, 45, 1.7}, {180, -17, 500}, {70, 89.99, 1.7}, {0, -90, 2e4}, {-60, 5, 4e5}};
    enum { AZIMUTHS = 128 };
    struct terrain *terrain = test_planet(256, 2500, 9, 10);
    int places = 5, worst = 0;
    struct gpu_target target;
    assert_true(gpu_target_init(gpu, &target, WIDTH, HEIGHT, GL_RGBA8));
    gpu_target_begin(gpu, &target);
    for (int k = 0; k < places; k++) {
        struct renderer *renderer = create(terrain, "n=63 cull=off");
        struct camera camera = test_camera(terrain, PLACES[k][0], PLACES[k][1], PLACES[k][2], 1, -0.2);
        struct edges edges = {0};
        struct view view;
        size_t open = 0;
        view_init(&view, terrain, &camera, WIDTH, HEIGHT, 0);
        prepare(renderer, terrain, &view, 0);
        assert_true(gpu_capture_begin(gpu, list_edges, &edges));
        clipmap_renderer.draw(renderer, 0, PASS_DEPTH);
        gpu_capture_end(gpu);
        qsort(edges.there, edges.count, sizeof *edges.there, compare_edges);
        qsort(edges.back, edges.count, sizeof *edges.back, compare_edges);
        for (size_t a = 0, b = 0; a < edges.count;) {
            int order = b < edges.count ? compare_edges(&edges.there[a], &edges.back[b]) : -1;
            open += order < 0;
            a += order <= 0, b += order >= 0;
        }
        assert_true(edges.count > 10000);
        if ((int)open > worst) worst = (int)open;
        free(edges.there);
        free(edges.back);
        clipmap_renderer.destroy(renderer);
    }
    FIGURE("D9: at most %d edges of a picture are met from one side; the outermost ring has %d", worst,
           AZIMUTHS);
    assert_int_equal(worst, AZIMUTHS);
    gpu_target_finish(&target);
    terrain_destroy(terrain);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(shaders_sample_where_they_should),
        cmocka_unit_test(the_nearer_hides_the_farther),
        cmocka_unit_test(rings_join_bit_for_bit),
        cmocka_unit_test(pictures_change_evenly_over_a_pole),
        cmocka_unit_test(earth_changes_evenly_over_its_poles),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
