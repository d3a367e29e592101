// The OpenGL layer: what is captured, counted, cut and measured is exactly what was drawn.
// SPDX-License-Identifier: MIT
#include "common/gl/context.h"
#include "common/report.h"
#include "tests/test.h"

#include <fcntl.h>
#include <string.h>

enum { SIDE = 64, CAPACITY = 1 << 20 };

struct fixture {
    struct gpu *gpu;
    struct gpu_program programs[PASS_COUNT];
    struct gpu_target targets[PASS_COUNT];
    GLuint vertex_array, vertices, indices, offsets;
};

// ---- a context, the plain programs and one mesh ----------------------------

static int setup(void **state)
{
    static const GLenum formats[PASS_COUNT] = {GL_RGBA8, GL_RGBA32F, 0};
    static const struct scene_effects effects = {.shading = SCENE_SHADING_COMMON};
    struct fixture *f = calloc(1, sizeof *f);
    *state = f;
    f->gpu = gpu_create(GPU_OFFSCREEN, 0, 0, "test", 0);
    if (!f->gpu) return -1;
    for (int pass = 0; pass < PASS_COUNT; pass++) {
        if (!gpu_program_build(f->gpu, &f->programs[pass], "common/gl/plain.vert", NULL, &effects,
                               (enum render_pass)pass))
            return -1;
        if (!gpu_target_init(f->gpu, &f->targets[pass], SIDE, SIDE, formats[pass])) return -1;
    }
    glGenVertexArrays(1, &f->vertex_array);
    glGenBuffers(1, &f->vertices);
    glGenBuffers(1, &f->indices);
    glGenBuffers(1, &f->offsets);
    return 0;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    for (int pass = 0; pass < PASS_COUNT; pass++) {
        gpu_program_finish(&f->programs[pass]);
        gpu_target_finish(&f->targets[pass]);
    }
    glDeleteVertexArrays(1, &f->vertex_array);
    glDeleteBuffers(1, &f->vertices);
    glDeleteBuffers(1, &f->indices);
    glDeleteBuffers(1, &f->offsets);
    gpu_destroy(f->gpu);
    free(f);
    return 0;
}

static void load_mesh(struct fixture *f, float (*vertices)[3], size_t vertex_count, const void *indices,
                      size_t index_bytes)
{
    glBindVertexArray(f->vertex_array);
    glBindBuffer(GL_ARRAY_BUFFER, f->vertices);
    gpu_buffer_data(f->gpu, GL_ARRAY_BUFFER, vertex_count * sizeof *vertices, vertices, GL_STATIC_DRAW);
    glVertexAttribPointer(0, 3, GL_FLOAT, GL_FALSE, 0, NULL);
    glEnableVertexAttribArray(0);
    glDisableVertexAttribArray(1);
    glVertexAttrib3f(1, 0, 0, 0);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, f->indices);
    gpu_buffer_data(f->gpu, GL_ELEMENT_ARRAY_BUFFER, index_bytes, indices, GL_STATIC_DRAW);
}

// A frame that maps x and y in [-1, 1] and depth = -z * scale, seen from above, without perspective in x and
// y.
static struct gpu_frame flat_frame(void)
{
    return (struct gpu_frame){.clip_from_relative = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0.25f, 0, 0, 0, 0.5f, 1},
                              .outline = {-100, -100, 100, 100},
                              .shade = {-1, 0.5f}};
}

static void random_vertices(float (*vertices)[3], size_t count, uint64_t seed)
{
    for (size_t i = 0; i < count; i++)
        for (int k = 0; k < 3; k++) vertices[i][k] = (float)test_uniform(&seed, -0.9, 0.9);
}

// ---- capture ---------------------------------------------------------------

struct taken {
    float (*triangles)[3][3];
    size_t count, capacity, calls;
};

static void take(const float *triangles, size_t count, void *user)
{
    struct taken *taken = user;
    assert_true(taken->count + count <= taken->capacity);
    memcpy(taken->triangles + taken->count, triangles, count * sizeof *taken->triangles);
    taken->count += count;
    taken->calls++;
}

static struct taken taken_init(size_t capacity)
{
    struct taken taken = {.triangles = malloc(capacity * sizeof *taken.triangles), .capacity = capacity};
    assert_non_null(taken.triangles);
    return taken;
}

// Which vertex comes first in a triangle of a strip is the driver's choice; its place in the row and its
// winding are not.
static bool same_triangle(float a[3][3], const float *const b[3])
{
    for (int turn = 0; turn < 3; turn++) {
        bool same = true;
        for (int k = 0; k < 3; k++) same &= memcmp(a[k], b[(k + turn) % 3], 12) == 0;
        if (same) return true;
    }
    return false;
}

// Assembles a strip by the rule of the specification and compares it with what was captured from `at` on;
// returns the next place.
static size_t expect_strip(const struct taken *taken, size_t at, float (*vertices)[3],
                           const uint32_t *indices, size_t count, uint32_t restart)
{
    size_t start = 0;
    for (size_t i = 0; i < count; i++) {
        if (indices[i] == restart) {
            start = i + 1;
        } else if (i >= start + 2) {
            bool odd = (i - start) & 1;
            const float *const triangle[3] = {vertices[indices[i - 2 + odd]], vertices[indices[i - 1 - odd]],
                                              vertices[indices[i]]};
            assert_true(at < taken->count);
            assert_true(same_triangle(taken->triangles[at++], triangle));
        }
    }
    return at;
}

static void test_capture_lists(void **state)
{
    struct fixture *f = *state;
    enum { VERTICES = 200, TRIANGLES = 500 };
    float vertices[VERTICES][3];
    uint16_t indices[3 * TRIANGLES];
    uint64_t seed = 7;
    random_vertices(vertices, VERTICES, 1);
    for (int i = 0; i < 3 * TRIANGLES; i++) indices[i] = (uint16_t)(test_random(&seed) % (VERTICES - 50));
    indices[30] = indices[31] = indices[32]; // a degenerate one is captured too
    load_mesh(f, vertices, VERTICES, indices, sizeof indices);
    const GLsizei counts[2] = {300, 600};
    const size_t first[2] = {0, 300};
    const GLint base[2] = {50, 3};
    struct taken taken = taken_init(2 * TRIANGLES);
    gpu_use_program(f->gpu, &f->programs[PASS_DEPTH]);
    gpu_reset_counters(f->gpu);
    assert_true(gpu_capture_begin(f->gpu, take, &taken));
    gpu_multi_draw_elements(f->gpu, GL_TRIANGLES, counts, GL_UNSIGNED_SHORT, first, base, 2, 300);
    gpu_use_program(f->gpu, &f->programs[PASS_SHADED]); // a switch inside a capture
    gpu_draw_elements(f->gpu, GL_TRIANGLES, 600, GL_UNSIGNED_SHORT, 900, 7, 200);
    gpu_capture_end(f->gpu);
    assert_int_equal(taken.count, TRIANGLES);
    for (int t = 0; t < TRIANGLES; t++)
        for (int k = 0; k < 3; k++) {
            int shift = t < 100 ? 50 : t < 300 ? 3 : 7;
            assert_memory_equal(taken.triangles[t][k], vertices[indices[3 * t + k] + shift], 12);
        }
    assert_int_equal(gpu_counters(f->gpu).draw_calls, 3);
    assert_int_equal(gpu_counters(f->gpu).triangles, TRIANGLES);
    free(taken.triangles);
}

static void test_capture_strips(void **state)
{
    struct fixture *f = *state;
    enum { VERTICES = 300, INDICES = 900 };
    const uint32_t restart = 0xffffffffu;
    float vertices[VERTICES][3];
    uint32_t indices[INDICES];
    uint64_t seed = 11;
    random_vertices(vertices, VERTICES, 2);
    for (int i = 0; i < INDICES; i++) {
        bool cut =
            i >= 400 && test_random(&seed) % 9 == 0; // the second part holds strips of 0, 1, 2 ... triangles
        indices[i] = cut ? restart : (uint32_t)(test_random(&seed) % VERTICES);
    }
    load_mesh(f, vertices, VERTICES, indices, sizeof indices);
    struct taken taken = taken_init(INDICES);
    gpu_use_program(f->gpu, &f->programs[PASS_POSITION]);
    glEnable(GL_PRIMITIVE_RESTART);
    glPrimitiveRestartIndex(restart);
    assert_true(gpu_capture_begin(f->gpu, take, &taken));
    gpu_draw_elements(f->gpu, GL_TRIANGLE_STRIP, 400, GL_UNSIGNED_INT, 0, 0, 398);
    gpu_draw_elements(f->gpu, GL_TRIANGLE_STRIP, 499, GL_UNSIGNED_INT, 401, 0, 0);
    gpu_capture_end(f->gpu);
    glDisable(GL_PRIMITIVE_RESTART);
    size_t at = expect_strip(&taken, 0, vertices, indices, 400, restart);
    assert_int_equal(at, 398);
    at = expect_strip(&taken, at, vertices, indices + 401, 499, restart);
    assert_int_equal(at, taken.count);
    free(taken.triangles);
}

static void test_capture_instances(void **state)
{
    struct fixture *f = *state;
    enum { VERTICES = 40, INDICES = 60, INSTANCES = 25 };
    float vertices[VERTICES][3], offsets[INSTANCES][3];
    uint32_t indices[INDICES];
    random_vertices(vertices, VERTICES, 3);
    random_vertices(offsets, INSTANCES, 4);
    for (uint32_t i = 0; i < INDICES; i++) indices[i] = i * 7 % VERTICES;
    load_mesh(f, vertices, VERTICES, indices, sizeof indices);
    glBindBuffer(GL_ARRAY_BUFFER, f->offsets);
    gpu_buffer_data(f->gpu, GL_ARRAY_BUFFER, sizeof offsets, offsets, GL_STATIC_DRAW);
    glVertexAttribPointer(1, 3, GL_FLOAT, GL_FALSE, 0, NULL);
    glVertexAttribDivisor(1, 1);
    glEnableVertexAttribArray(1);
    struct taken taken = taken_init(2 * INSTANCES * INDICES);
    gpu_use_program(f->gpu, &f->programs[PASS_SHADED]);
    gpu_reset_counters(f->gpu);
    assert_true(gpu_capture_begin(f->gpu, take, &taken));
    gpu_draw_elements_instanced(f->gpu, GL_TRIANGLES, INDICES, GL_UNSIGNED_INT, 0, 0, INSTANCES,
                                INSTANCES * INDICES / 3);
    gpu_draw_elements_instanced(f->gpu, GL_TRIANGLE_STRIP, INDICES, GL_UNSIGNED_INT, 0, 0, INSTANCES,
                                INSTANCES * (INDICES - 2));
    gpu_draw_elements_instanced(f->gpu, GL_TRIANGLES, INDICES, GL_UNSIGNED_INT, 0, 0, 0, 0);
    gpu_capture_end(f->gpu);
    glDisableVertexAttribArray(1);
    assert_int_equal(taken.count, gpu_counters(f->gpu).triangles);
    size_t at = INSTANCES * INDICES / 3;
    for (int instance = 0; instance < INSTANCES; instance++) {
        float moved[VERTICES][3];
        for (int i = 0; i < VERTICES; i++)
            for (int k = 0; k < 3; k++) moved[i][k] = vertices[i][k] + offsets[instance][k];
        for (int i = 0; i < INDICES; i++)
            assert_memory_equal(taken.triangles[instance * INDICES / 3 + i / 3][i % 3], moved[indices[i]],
                                12);
        at = expect_strip(&taken, at, moved, indices, INDICES, 0xffffffffu);
    }
    assert_int_equal(at, taken.count);
    free(taken.triangles);
}

static void test_capture_is_split(void **state)
{
    struct fixture *f = *state;
    enum { VERTICES = 1000 };
    size_t triangles = (size_t)test_size(5 * CAPACITY / 4, 5 * CAPACITY + 1), count = 3 * triangles;
    float vertices[VERTICES][3];
    uint32_t *indices = malloc(count * sizeof *indices);
    assert_non_null(indices);
    random_vertices(vertices, VERTICES, 5);
    uint64_t seed = 13;
    for (size_t i = 0; i < count; i++) indices[i] = (uint32_t)(test_random(&seed) % VERTICES);
    load_mesh(f, vertices, VERTICES, indices, count * sizeof *indices);
    gpu_use_program(f->gpu, &f->programs[PASS_DEPTH]);
    struct taken taken = taken_init(triangles + CAPACITY + 11);
    assert_true(gpu_capture_begin(f->gpu, take, &taken));
    gpu_draw_elements(f->gpu, GL_TRIANGLES, 30, GL_UNSIGNED_INT, 0, 0, 10);
    gpu_draw_elements(f->gpu, GL_TRIANGLES, count, GL_UNSIGNED_INT, 0, 0, triangles);
    gpu_draw_elements(f->gpu, GL_TRIANGLE_STRIP, CAPACITY + 3, GL_UNSIGNED_INT, 0, 0, CAPACITY + 1);
    gpu_capture_end(f->gpu);
    assert_int_equal(taken.count, 10 + triangles + CAPACITY + 1);
    assert_true(taken.calls >= 3);
    for (size_t i = 0; i < count + 30; i++)
        if (memcmp(taken.triangles[i / 3][i % 3], vertices[indices[i < 30 ? i : i - 30]], 12) != 0)
            fail_msg("vertex %zu of the list differs", i);
    size_t at = expect_strip(&taken, 10 + triangles, vertices, indices, CAPACITY + 3, 0xffffffffu);
    assert_int_equal(at, taken.count);
    FIGURE("capture: %zu triangles in %zu pieces, all as drawn", taken.count, taken.calls);
    free(taken.triangles);
    free(indices);
}

// ---- counts ----------------------------------------------------------------

static void test_counts(void **state)
{
    struct fixture *f = *state;
    float vertices[64][3];
    uint32_t indices[192];
    random_vertices(vertices, 64, 6);
    for (uint32_t i = 0; i < 192; i++) indices[i] = i * 5 % 64;
    gpu_reset_counters(f->gpu);
    load_mesh(f, vertices, 64, indices, sizeof indices);
    assert_int_equal(gpu_counters(f->gpu).upload_bytes, sizeof vertices + sizeof indices);
    gpu_buffer_sub_data(f->gpu, GL_ELEMENT_ARRAY_BUFFER, 4, 40, indices + 1);
    gpu_buffer_data(f->gpu, GL_ARRAY_BUFFER, sizeof vertices, vertices, GL_STATIC_DRAW);
    GLuint textures[2];
    glGenTextures(2, textures);
    glBindTexture(GL_TEXTURE_2D, textures[0]);
    glTexImage2D(GL_TEXTURE_2D, 0, GL_R32F, 8, 8, 0, GL_RED, GL_FLOAT, NULL);
    gpu_texture_sub_image(f->gpu, GL_TEXTURE_2D, -1, 1, 2, 3, 5, GL_RED, GL_FLOAT, vertices); // 60 bytes
    glBindTexture(GL_TEXTURE_2D_ARRAY, textures[1]);
    glTexImage3D(GL_TEXTURE_2D_ARRAY, 0, GL_RG16I, 8, 8, 2, 0, GL_RG_INTEGER, GL_SHORT, NULL);
    gpu_texture_sub_image(f->gpu, GL_TEXTURE_2D_ARRAY, 1, 0, 0, 3, 3, GL_RG_INTEGER, GL_SHORT,
                          indices); // 36 bytes
    glDeleteTextures(2, textures);
    assert_int_equal(gpu_counters(f->gpu).upload_bytes, 2 * sizeof vertices + sizeof indices + 40 + 60 + 36);

    struct gpu_frame frame = flat_frame();
    gpu_set_frame(f->gpu, &frame);
    gpu_target_begin(f->gpu, &f->targets[PASS_SHADED]);
    gpu_use_program(f->gpu, &f->programs[PASS_SHADED]);
    GLuint query, generated;
    glGenQueries(1, &query);
    glBeginQuery(GL_PRIMITIVES_GENERATED, query);
    const GLsizei counts[3] = {3, 60, 9};
    const size_t first[3] = {3, 6, 100};
    const GLint base[3] = {0, 0, 0};
    gpu_multi_draw_elements(f->gpu, GL_TRIANGLES, counts, GL_UNSIGNED_INT, first, base, 3, 24);
    gpu_draw_elements(f->gpu, GL_TRIANGLE_STRIP, 100, GL_UNSIGNED_INT, 0, 0, 98);
    gpu_draw_elements_instanced(f->gpu, GL_TRIANGLES, 30, GL_UNSIGNED_INT, 0, 0, 4, 40);
    glEndQuery(GL_PRIMITIVES_GENERATED);
    glGetQueryObjectuiv(query, GL_QUERY_RESULT, &generated);
    glDeleteQueries(1, &query);
    assert_int_equal(generated, 24 + 98 + 40);
    assert_int_equal(gpu_counters(f->gpu).triangles, generated);
    assert_int_equal(gpu_counters(f->gpu).draw_calls, 5);
}

// ---- pictures --------------------------------------------------------------

// A mesh whose vertices stand on pixel centres: every pixel must hold its vertex.  Interpolation evaluates
// a + x dx + y dy with |x|, |y| <= 64 pixels and slopes of at most 1 a pixel: terms of at most 129, four
// roundings of 2^-24 each.
static void test_position_pass(void **state)
{
    struct fixture *f = *state;
    static float vertices[SIDE * SIDE][3], pixels[SIDE * SIDE][4];
    static uint32_t indices[(SIDE - 1) * (SIDE - 1) * 6];
    const double bound = 4 * 129 * 0x1p-24;
    uint64_t seed = 17;
    for (int v = 0; v < SIDE * SIDE; v++) {
        vertices[v][0] = (float)(v % SIDE * 2 + 1) / SIDE - 1;
        vertices[v][1] = (float)(v / SIDE * 2 + 1) / SIDE - 1;
        vertices[v][2] = (float)test_uniform(&seed, 0, 1);
    }
    size_t n = 0;
    for (uint32_t y = 0; y < SIDE - 1; y++)
        for (uint32_t x = 0; x < SIDE - 1; x++) {
            uint32_t v = y * SIDE + x, corner[6] = {v, v + 1, v + SIDE + 1, v, v + SIDE + 1, v + SIDE};
            for (int k = 0; k < 6; k++) indices[n++] = corner[k];
        }
    load_mesh(f, vertices, SIDE * SIDE, indices, sizeof indices);
    struct gpu_frame frame = flat_frame();
    gpu_set_frame(f->gpu, &frame);
    gpu_target_begin(f->gpu, &f->targets[PASS_POSITION]);
    gpu_use_program(f->gpu, &f->programs[PASS_POSITION]);
    gpu_draw_elements(f->gpu, GL_TRIANGLES, n, GL_UNSIGNED_INT, 0, 0, n / 3);
    gpu_target_read(f->gpu, &f->targets[PASS_POSITION], pixels);
    double worst = 0;
    for (int y = 1; y < SIDE - 1; y++)
        for (int x = 1; x < SIDE - 1; x++) {
            int p = y * SIDE + x;
            for (int k = 0; k < 3; k++)
                worst = fmax(worst, fabs((double)pixels[p][k] - (double)vertices[p][k]));
        }
    FIGURE("position pass: worst difference from the vertices %.2e (bound %.2e)", worst, bound);
    assert_true(worst <= bound);
}

// Seen from above, ground is +1; a piece turned over is -1, but for pixels whose centre is within the
// sub-pixel grid of its edge.
static void test_position_side(void **state)
{
    struct fixture *f = *state;
    static float pixels[SIDE * SIDE][4];
    static float vertices[8][3] = {{-1, -1, -1}, {0, -1, -1}, {0, 1, -1}, {-1, 1, -1},
                                   {0, -1, -1},  {1, -1, -1}, {1, 1, -1}, {0, 1, -1}};
    const uint32_t indices[12] = {0, 1, 2, 0, 2, 3, 4, 6, 5, 4, 7, 6}; // the eastern half is turned over
    load_mesh(f, vertices, 8, indices, sizeof indices);
    struct gpu_frame frame = flat_frame();
    memset(frame.clip_from_relative, 0, sizeof frame.clip_from_relative);
    frame.clip_from_relative[0] = frame.clip_from_relative[5] = 1; // straight down at 90 degrees: w = -z
    frame.clip_from_relative[11] = -1;
    frame.clip_from_relative[14] = 0.5f;
    frame.shade[2] = frame.shade[3] = SIDE;
    gpu_set_frame(f->gpu, &frame);
    gpu_target_begin(f->gpu, &f->targets[PASS_POSITION]);
    gpu_use_program(f->gpu, &f->programs[PASS_POSITION]);
    gpu_draw_elements(f->gpu, GL_TRIANGLES, 12, GL_UNSIGNED_INT, 0, 0, 4);
    gpu_target_read(f->gpu, &f->targets[PASS_POSITION], pixels);
    int above = 0, below = 0;
    for (int y = 0; y < SIDE; y++)
        for (int x = 0; x < SIDE; x++) {
            float side = pixels[y * SIDE + x][3];
            bool on_diagonal =
                y == 2 * x || y == 2 * x + 1 || y == 2 * (x - SIDE / 2) || y == 2 * (x - SIDE / 2) - 1;
            if (x == SIDE / 2 || (x > SIDE / 2 && on_diagonal)) continue;
            assert_true(side == (x < SIDE / 2 ? 1.0f : -1.0f));
            above += side > 0;
            below += side < 0;
        }
    FIGURE("position pass: %d pixels seen from above, %d from below, all as drawn", above, below);
}

// Two crossing planes, drawn in both orders: the same picture, the nearer wins, depth = near / distance.
static void draw_planes(struct fixture *f, bool swapped, float *depth)
{
    gpu_target_begin(f->gpu, &f->targets[PASS_DEPTH]);
    gpu_use_program(f->gpu, &f->programs[PASS_DEPTH]);
    gpu_draw_elements(f->gpu, GL_TRIANGLES, 6, GL_UNSIGNED_INT, swapped ? 6 : 0, 0, 2);
    gpu_draw_elements(f->gpu, GL_TRIANGLES, 6, GL_UNSIGNED_INT, swapped ? 0 : 6, 0, 2);
    gpu_target_read(f->gpu, &f->targets[PASS_DEPTH], depth);
}

static void test_depth(void **state)
{
    struct fixture *f = *state;
    // The eye looks down; distances run over five decades.  Depth d is met at (x, y) = d * (pixel's tangent).
    static const float near_m = 0.5f;
    float vertices[8][3];
    const float west[2] = {2, 50000}, east[2] = {30000, 3};
    for (int v = 0; v < 8; v++) {
        float d = (v & 1) ? east[v / 4] : west[v / 4];
        vertices[v][0] = ((v & 1) ? 2.0f : -2.0f) * d;
        vertices[v][1] = ((v & 2) ? 2.0f : -2.0f) * d;
        vertices[v][2] = -d;
    }
    static const uint32_t indices[12] = {0, 1, 3, 0, 3, 2, 4, 5, 7, 4, 7, 6};
    load_mesh(f, vertices, 8, indices, sizeof indices);
    struct gpu_frame frame = {.clip_from_relative = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, -1, 0, 0, near_m, 0},
                              .outline = {-1e9f, -1e9f, 1e9f, 1e9f}};
    gpu_set_frame(f->gpu, &frame);
    static float depth[SIDE * SIDE], swapped[SIDE * SIDE], fallback[SIDE * SIDE];
    draw_planes(f, false, depth);
    draw_planes(f, true, swapped);
    assert_memory_equal(depth, swapped, sizeof depth);
    double worst = 0;
    for (int p = 0; p < SIDE * SIDE; p++) {
        // 1/d is linear on the screen: at tangent t in [-1, 1] the edges stand at tangents -2 and 2.
        double t = (p % SIDE + 0.5) * 2 / SIDE - 1, s = (t + 2) / 4, inverse[2];
        for (int k = 0; k < 2; k++) inverse[k] = (1 - s) / (double)west[k] + s / (double)east[k];
        double expected = (double)near_m * fmax(inverse[0], inverse[1]);
        worst = fmax(worst, fabs((double)depth[p] / expected - 1));
    }
    FIGURE("reversed depth: worst relative error %.1e", worst);
    // Vertices snap to 1/256 pixel: 0.5/256 pixel of 128 moves 1/d by at most slope * snap; the slope per
    // pixel relative to the smallest value shown (3/4 of one plane's far end + 1/4 of its near end) is below
    // 1/32.
    if (gpu_info(f->gpu)->clip_control) assert_true(worst <= 1.0 / 32 / 512 + 1e-6);
    if (!gpu_info(f->gpu)->clip_control) return;

    // The fall-back for OpenGL 3.3 gives the same depths, to the precision of z in [-1, 1].
    glClipControl(GL_LOWER_LEFT, GL_NEGATIVE_ONE_TO_ONE);
    gpu_frame_without_clip_control(&frame);
    gpu_set_frame(f->gpu, &frame);
    draw_planes(f, false, fallback);
    glClipControl(GL_LOWER_LEFT, GL_ZERO_TO_ONE);
    worst = 0;
    for (int p = 0; p < SIDE * SIDE; p++) worst = fmax(worst, fabs((double)fallback[p] - (double)depth[p]));
    FIGURE("depth without clip control: worst difference %.1e", worst);
    assert_true(worst <= 4 * 0x1p-23);
}

// Pixels of a sliver drawn over nothing; returns how many.
static int draw_sliver(struct fixture *f, bool depth_test, bool *drawn)
{
    static float positions[SIDE * SIDE][4];
    int count = 0;
    gpu_target_begin(f->gpu, &f->targets[PASS_POSITION]);
    if (!depth_test) glDisable(GL_DEPTH_TEST);
    gpu_use_program(f->gpu, &f->programs[PASS_POSITION]);
    gpu_draw_elements(f->gpu, GL_TRIANGLES, 3, GL_UNSIGNED_INT, 0, 0, 1);
    gpu_target_read(f->gpu, &f->targets[PASS_POSITION], positions);
    for (int p = 0; p < SIDE * SIDE; p++) count += drawn[p] = positions[p][3] != 0;
    return count;
}

// A triangle `part` of the sub-pixel grid's spacing g high that covers a centre outside itself.  In pixels
// from that centre its corners are A (-6, -.6 g), B (10, .6 g) and D (-2, part g - .3 g), and y is snapped to
// -g, g and 0: at the centre the snapped triangle reaches from -.25 g to .17 g, the true one's edge AB runs
// .15 g below.  So the depth there is A's and B's, near 0, less .15 / part times what it falls from AB to D:
// where depth follows the true triangle it is far below 0, and clamped.  What is covered is drawn all the
// same.
static void test_slivers_at_the_depth_of_the_sky(void **state)
{
    struct fixture *f = *state;
    static const uint32_t indices[3] = {0, 1, 2};
    static const double x_px[3] = {-6, 10, -2};
    static bool covered[SIDE * SIDE], drawn[SIDE * SIDE];
    struct gpu_frame frame = flat_frame();
    gpu_set_frame(f->gpu, &frame);
    GLint bits;
    glGetIntegerv(GL_SUBPIXEL_BITS, &bits);
    int centres = 0;
    for (int n = 0; n < 24; n++) { // thinner ones go under in window coordinates of 24 bits
        double g = ldexp(1, -bits), part = exp2(-1 - n % 6), near_px = 8.5 + 12 * (n / 6);
        const double y_g[3] = {-0.6, 0.6, part - 0.3}, depth[3] = {1e-4, 1e-4, 1e-6};
        float vertices[3][3];
        for (int v = 0; v < 3; v++) {
            vertices[v][0] = (float)((near_px + x_px[v]) / (SIDE / 2) - 1);
            vertices[v][1] = (float)((near_px + y_g[v] * g) / (SIDE / 2) - 1);
            vertices[v][2] = (float)((depth[v] - 0.5) / 0.25);
        }
        load_mesh(f, vertices, 3, indices, sizeof indices);
        centres += draw_sliver(f, false, covered);
        draw_sliver(f, true, drawn);
        assert_memory_equal(covered, drawn, sizeof covered);
    }
    FIGURE("slivers below the sub-pixel grid cover %d centres, and all are drawn", centres);
    if (gpu_info(f->gpu)->software) assert_true(centres > 0); // which grid others have is theirs
}

// ---- shading ---------------------------------------------------------------

// What the fragment program is to show of ground with this upward normal, `share` of the map's relief high.
static void expected_colour(const double normal[3], double share, double colour[3])
{
    static const double pure[5][3] = {
        {0.34, 0.52, 0.38}, {0.66, 0.70, 0.46}, {0.82, 0.70, 0.50}, {0.66, 0.58, 0.53}, {1, 1, 1}};
    static const double at[6] = {0, 0.0977, 0.3136, 0.5776, 0.8587, 2}, sun[3] = {-0.58, 0.58, 0.57};
    static const double shadow[3] = {0.30, 0.35, 0.44}, light[3] = {1.05, 0.99, 0.88};
    double cosine = 0, length = 0;
    for (int k = 0; k < 3; k++) cosine += normal[k] * sun[k], length += normal[k] * normal[k];
    cosine = fmax(cosine / sqrt(length), 0);
    int i = 0;
    while (i < 4 && share > at[i + 1]) i++;
    double part = i == 4 ? 0 : fmax(share - at[i], 0) / (at[i + 1] - at[i]);
    for (int k = 0; k < 3; k++) {
        double ground = pure[i][k] + (i == 4 ? 0 : part * (pure[i + 1][k] - pure[i][k]));
        colour[k] = fmin(ground * (shadow[k] + light[k] * cosine), 1);
    }
}

struct plane {
    double middle, slope[2]; // z relative to the eye, under the eye and per metre
};

static void draw_plane(struct fixture *f, const struct plane *plane, uint8_t (*colour)[4])
{
    static const uint32_t indices[6] = {0, 1, 2, 0, 2, 3};
    float vertices[4][3];
    for (int k = 0; k < 4; k++) {
        double x = k == 0 || k == 3 ? -190 : 190, y = k < 2 ? -190 : 190;
        vertices[k][0] = (float)x, vertices[k][1] = (float)y;
        vertices[k][2] = (float)(plane->middle + plane->slope[0] * x + plane->slope[1] * y);
    }
    load_mesh(f, vertices, 4, indices, sizeof indices);
    gpu_target_begin(f->gpu, &f->targets[PASS_SHADED]);
    gpu_use_program(f->gpu, &f->programs[PASS_SHADED]);
    gpu_draw_elements(f->gpu, GL_TRIANGLES, 6, GL_UNSIGNED_INT, 0, 0, 2);
    gpu_target_read(f->gpu, &f->targets[PASS_SHADED], colour);
}

// The largest difference to what is expected, in steps of 8 bits, over the pixels within 150 m.
static double shading_off(const struct view *view, const struct plane *plane, uint8_t (*colour)[4],
                          uint64_t *pixels)
{
    const double normal[3] = {-plane->slope[0], -plane->slope[1], 1};
    double worst = 0;
    for (int p = 0; p < SIDE * SIDE; p++) {
        double ray[3], expected[3];
        view_ray(view, p % SIDE, p / SIDE, ray);
        double t = plane->middle / (ray[2] - plane->slope[0] * ray[0] - plane->slope[1] * ray[1]);
        if (!(t > 0) || fabs(t * ray[0]) > 150 || fabs(t * ray[1]) > 150) continue;
        expected_colour(normal, (t * ray[2] + view->eye_m[2] + 3) / 250, expected);
        for (int k = 0; k < 3; k++) worst = fmax(worst, fabs(colour[p][k] - 255 * expected[k]));
        ++*pixels;
    }
    return worst;
}

// Planes through the middle of a map of 250 m of relief: each pixel shows the colour of its height, lit by
// the plane's slope, to a step of 8 bits.
static void test_shading(void **state)
{
    struct fixture *f = *state;
    static int32_t samples[41 * 41];
    samples[1] = 1000; // quanta: the relief
    const struct terrain_grid grid = {.name = "relief",
                                      .samples = samples,
                                      .width = 41,
                                      .height = 41,
                                      .spacing_m = {10, 10},
                                      .quantum_m = 0.25,
                                      .offset_m = -3};
    struct terrain *terrain = terrain_from_grid(&grid, &(struct terrain_options){0});
    static uint8_t colour[SIDE * SIDE][4];
    uint64_t seed = 35, pixels = 0, views = (uint64_t)test_size(200, 5000);
    double worst = 0;
    for (uint64_t v = 0; v < views; v++) {
        struct camera camera = {.eye_m = {200, 200, 400},
                                .yaw = test_uniform(&seed, -4, 4),
                                .pitch = test_uniform(&seed, -1.5, -1),
                                .roll = test_uniform(&seed, -1, 1),
                                .fov_vertical = 0.6};
        struct view view;
        view_init(&view, terrain, &camera, SIDE, SIDE, 0);
        gpu_set_view(f->gpu, terrain, &view);
        const struct plane plane = {test_uniform(&seed, 20, 220) - view.eye_m[2],
                                    {test_uniform(&seed, -1, 1), test_uniform(&seed, -1, 1)}};
        draw_plane(f, &plane, colour);
        worst = fmax(worst, shading_off(&view, &plane, colour, &pixels));
    }
    FIGURE("shading: %lu pixels of %lu planes, at most %.2f steps of 8 bits off", pixels, views, worst);
    assert_true(pixels > 500 * views);
    assert_true(worst <= 1);
    terrain_destroy(terrain);
}

// ---- the map's outline -----------------------------------------------------

static struct terrain *small_terrain(int64_t first)
{
    enum { W = 41, H = 33 };
    static int32_t samples[W * H];
    for (int i = 0; i < W * H; i++) samples[i] = 100;
    const struct terrain_grid grid = {.name = "flat",
                                      .samples = samples,
                                      .width = W,
                                      .height = H,
                                      .first = {first, -first},
                                      .spacing_m = {10.1, 7.3},
                                      .quantum_m = 0.25,
                                      .offset_m = -3};
    const struct terrain_options options = {0};
    return terrain_from_grid(&grid, &options);
}

// A plane far larger than the map, at the map's height, under an oblique camera: what is drawn is the map and
// nothing else, in every pass, on the near side and on the far side of the world.
static void check_outline(struct fixture *f, int64_t first)
{
    struct terrain *terrain = small_terrain(first);
    assert_non_null(terrain);
    const struct terrain_info *info = terrain_info(terrain);
    const double *outline = info->outline_m, ground = 0.25 * 100 - 3;
    struct camera camera = {
        .eye_m = {0.7 * outline[0] + 0.3 * outline[2], 0.9 * outline[1] + 0.1 * outline[3], ground + 210},
        .yaw = 1.2,
        .pitch = -1.0,
        .roll = 0.3,
        .fov_vertical = 1.3};
    struct view view;
    view_init(&view, terrain, &camera, SIDE, SIDE, 0);
    gpu_set_view(f->gpu, terrain, &view);
    float z = (float)(ground - view.eye_m[2]);
    float vertices[4][3] = {{-4000, -4000, z}, {4000, -4000, z}, {4000, 4000, z}, {-4000, 4000, z}};
    static const uint32_t indices[6] = {0, 1, 2, 0, 2, 3};
    load_mesh(f, vertices, 4, indices, sizeof indices);
    static float position[SIDE * SIDE][4], depth[SIDE * SIDE];
    static uint8_t colour[SIDE * SIDE][4];
    void *const pictures[PASS_COUNT] = {colour, position, depth};
    for (int pass = 0; pass < PASS_COUNT; pass++) {
        gpu_target_begin(f->gpu, &f->targets[pass]);
        gpu_use_program(f->gpu, &f->programs[pass]);
        gpu_draw_elements(f->gpu, GL_TRIANGLES, 6, GL_UNSIGNED_INT, 0, 0, 2);
        gpu_target_read(f->gpu, &f->targets[pass], pictures[pass]);
    }
    int drawn = 0, cut = 0;
    for (int p = 0; p < SIDE * SIDE; p++) {
        double ray[3];
        view_ray(&view, p % SIDE, p / SIDE, ray);
        bool inside = ray[2] < 0, close = false;
        for (int k = 0; k < 4 && ray[2] < 0; k++) {
            double place = ray[k & 1] * (double)z / ray[2] + view.eye_m[k & 1];
            double margin = k < 2 ? place - outline[k] : outline[k] - place;
            inside &= margin >= 0;
            close |= fabs(margin) < 4000 * 0x1p-20; // interpolation between vertices 4000 m away
        }
        bool is_drawn = position[p][3] != 0;
        static const uint8_t sky[4] = {163, 196, 230, 255};
        assert_int_equal(is_drawn, depth[p] > 0);
        assert_int_equal(is_drawn, memcmp(colour[p], sky, 4) != 0);
        if (!close) assert_int_equal(is_drawn, inside);
        if (is_drawn)
            drawn++;
        else
            cut++;
    }
    assert_true(drawn > 400 && cut > 400); // the test sees both
    terrain_destroy(terrain);
}

static void test_outline(void **state)
{
    check_outline(*state, 0);
    check_outline(*state, -20);
    check_outline(*state, 10000000000);
}

enum { PATCH = 24, PATCH_CELLS = (PATCH - 1) * (PATCH - 1) }; // vertices on a side

// Rough ground over a rectangle relative to the eye.
static void load_patch(struct fixture *f, const double low[2], const double high[2], double z, uint64_t *seed)
{
    static uint32_t indices[6 * PATCH_CELLS];
    float vertices[PATCH * PATCH][3];
    for (uint32_t i = 0; i < PATCH_CELLS; i++) {
        uint32_t a = i / (PATCH - 1) * PATCH + i % (PATCH - 1);
        const uint32_t corners[6] = {a, a + 1, a + PATCH + 1, a, a + PATCH + 1, a + PATCH};
        memcpy(indices + 6 * (size_t)i, corners, sizeof corners);
    }
    for (int i = 0; i < PATCH * PATCH; i++) {
        const int at[2] = {i % PATCH, i / PATCH};
        for (int axis = 0; axis < 2; axis++)
            vertices[i][axis] = (float)(low[axis] + (high[axis] - low[axis]) * at[axis] / (PATCH - 1));
        vertices[i][2] = (float)(z + test_uniform(seed, -8, 8));
    }
    load_mesh(f, vertices, (size_t)PATCH * PATCH, indices, sizeof indices);
}

// Draws the patch by both programs of each pass.  Returns how many pixels it covers.
static int patch_pixels_alike(struct fixture *f, const struct gpu_program *inside)
{
    static float pictures[2][SIDE * SIDE * 4];
    int drawn = 0;
    for (int pass = 0; pass < PASS_COUNT; pass++) {
        for (int k = 0; k < 2; k++) {
            gpu_target_begin(f->gpu, &f->targets[pass]);
            gpu_use_program(f->gpu, k ? &inside[pass] : &f->programs[pass]);
            gpu_draw_elements(f->gpu, GL_TRIANGLES, 6 * PATCH_CELLS, GL_UNSIGNED_INT, 0, 0, 2 * PATCH_CELLS);
            gpu_target_read(f->gpu, &f->targets[pass], pictures[k]);
        }
        assert_memory_equal(pictures[0], pictures[1], sizeof pictures[0]);
    }
    for (int p = 0; p < SIDE * SIDE; p++) drawn += pictures[1][p] > 0; // of the depth pass
    return drawn;
}

// The rectangle that keeps 0.1 m away from the outline, which is enough, as 0 m are not.
static void inner_rectangle(const struct view *view, const struct terrain *terrain, double low[2],
                            double high[2])
{
    const double *outline = terrain_info(terrain)->outline_m, away = 0.1;
    for (int axis = 0; axis < 2; axis++) {
        low[axis] = outline[axis] - view->eye_m[axis] + away;
        high[axis] = outline[axis + 2] - view->eye_m[axis] - away;
    }
    assert_true(view_inside_outline(view, terrain, low, high));
    for (int axis = 0; axis < 2; axis++) {
        low[axis] -= away;
        assert_false(view_inside_outline(view, terrain, low, high));
        low[axis] += away, high[axis] += away;
        assert_false(view_inside_outline(view, terrain, low, high));
        high[axis] -= away;
    }
}

// Ground inside the outline, drawn without looking at it, is the same picture, bit for bit, in every pass.
static void test_inside_outline(void **state)
{
    static const struct scene_effects effects = {.shading = SCENE_SHADING_COMMON};
    struct fixture *f = *state;
    struct terrain *terrain = small_terrain(-20);
    const double *outline = terrain_info(terrain)->outline_m, ground = 0.25 * 100 - 3;
    struct gpu_program inside[PASS_COUNT];
    for (int pass = 0; pass < PASS_COUNT; pass++)
        assert_true(gpu_program_build(f->gpu, &inside[pass], "common/gl/plain.vert", GPU_INSIDE_OUTLINE,
                                      &effects, (enum render_pass)pass));
    uint64_t seed = 77;
    int views = test_size(200, 5000), drawn = 0;
    for (int i = 0; i < views; i++) {
        struct camera camera = {.yaw = test_uniform(&seed, -4, 4),
                                .pitch = test_uniform(&seed, -1.5, 0.2),
                                .roll = test_uniform(&seed, -1, 1),
                                .fov_vertical = test_uniform(&seed, 0.3, 2)};
        for (int axis = 0; axis < 2; axis++)
            camera.eye_m[axis] = test_uniform(&seed, outline[axis], outline[axis + 2]);
        camera.eye_m[2] = ground + 5 * pow(40, test_uniform(&seed, 0, 1));
        struct view view;
        view_init(&view, terrain, &camera, SIDE, SIDE, 0);
        double low[2], high[2];
        inner_rectangle(&view, terrain, low, high);
        load_patch(f, low, high, ground - view.eye_m[2], &seed);
        gpu_set_view(f->gpu, terrain, &view);
        drawn += patch_pixels_alike(f, inside);
    }
    FIGURE("%d views from within a map, %d pixels drawn: alike without a look at the outline", views, drawn);
    assert_true(drawn > 400 * views);
    for (int pass = 0; pass < PASS_COUNT; pass++) gpu_program_finish(&inside[pass]);
    terrain_destroy(terrain);
}

// Vertices on the map's last sample lines are at the outline bitwise, so that no sliver between them is cut
// or let through.
static void test_outline_meets_vertices(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = small_terrain(5);
    assert_non_null(terrain);
    struct terrain_level level = terrain_level(terrain, 0);
    uint64_t seed = 23;
    int count = test_size(2000, 100000);
    for (int i = 0; i < count; i++) {
        struct camera camera = {
            .eye_m = {test_uniform(&seed, -500, 900), test_uniform(&seed, -500, 900), 400},
            .fov_vertical = 1};
        struct view view;
        view_init(&view, terrain, &camera, SIDE, SIDE, 0);
        gpu_set_view(f->gpu, terrain, &view);
        struct gpu_frame frame;
        glGetBufferSubData(GL_UNIFORM_BUFFER, 0, sizeof frame, &frame);
        struct view_origin eye = view_level_origin(&view, 0);
        const int64_t edges[4] = {level.extent.x0, level.extent.y0, level.extent.x1 - 1, level.extent.y1 - 1};
        for (int k = 0; k < 4; k++) {
            float vertex =
                ((float)(edges[k] - eye.base[k & 1]) - eye.fraction[k & 1]) * (float)level.spacing_m[k & 1];
            assert_true(vertex * frame.shade[1] == frame.outline[k]); // in reliefs, as fragments see it
        }
    }
    terrain_destroy(terrain);
}

// ---- failures --------------------------------------------------------------

// Runs `step`, returns what it wrote on stderr.
static void stderr_of(void (*step)(struct fixture *), struct fixture *f, char text[1024])
{
    char name[] = "/tmp/relief-stderr-XXXXXX";
    int file = mkstemp(name), saved = dup(2);
    assert_true(file >= 0 && saved >= 0);
    unlink(name);
    dup2(file, 2);
    step(f);
    dup2(saved, 2);
    close(saved);
    ssize_t length = pread(file, text, 1023, 0);
    text[length < 0 ? 0 : length] = 0;
    close(file);
}

static void build_bad_program(struct fixture *f)
{
    struct gpu_program bad;
    assert_false(
        gpu_program_build(f->gpu, &bad, "common/gl/plain.vert", "#define position 1 +\n", NULL, PASS_DEPTH));
    assert_int_equal(bad.name, 0);
}

static void build_missing_program(struct fixture *f)
{
    struct gpu_program bad;
    assert_false(gpu_program_build(f->gpu, &bad, "no/such.vert", NULL, NULL, PASS_DEPTH));
}

static void init_bad_target(struct fixture *f)
{
    struct gpu_target bad;
    assert_false(gpu_target_init(f->gpu, &bad, 0, 0, GL_RGBA8));
}

static void raise_error(struct fixture *f)
{
    glEnable(0xdead);
    gpu_finish(f->gpu);
}

static void test_failures(void **state)
{
    struct fixture *f = *state;
    char text[1024];
    uint64_t errors = gpu_debug_errors(f->gpu);
    stderr_of(build_bad_program, f, text);
    assert_non_null(strstr(text, "common/gl/plain.vert:2: "));
    assert_ptr_equal(strchr(text, '\n'), text + strlen(text) - 1); // one line
    stderr_of(build_missing_program, f, text);
    assert_non_null(strstr(text, "no/such.vert"));
    stderr_of(init_bad_target, f, text);
    assert_non_null(strstr(text, "0x0"));
    assert_int_equal(gpu_debug_errors(f->gpu), errors);
    assert_int_equal(errors, 0); // none in all the tests above
    stderr_of(raise_error, f, text);
    assert_int_equal(gpu_debug_errors(f->gpu), 1); // and the count is alive
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_capture_lists),
        cmocka_unit_test(test_capture_strips),
        cmocka_unit_test(test_capture_instances),
        cmocka_unit_test(test_capture_is_split),
        cmocka_unit_test(test_counts),
        cmocka_unit_test(test_position_pass),
        cmocka_unit_test(test_position_side),
        cmocka_unit_test(test_depth),
        cmocka_unit_test(test_slivers_at_the_depth_of_the_sky),
        cmocka_unit_test(test_shading),
        cmocka_unit_test(test_outline),
        cmocka_unit_test(test_inside_outline),
        cmocka_unit_test(test_outline_meets_vertices),
        cmocka_unit_test(test_failures),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
