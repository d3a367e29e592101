// A clipmap drawn off screen: fixture, settings by name, views over the hills, dropped pixels counted.
// SPDX-License-Identifier: MIT
#ifndef TESTS_GPU_TEST_CLIPMAP_H
#define TESTS_GPU_TEST_CLIPMAP_H

#include "clipmap/clipmap.h"
#include "tests/gpu/settings.h"
#include "tests/unit/test_clipmap.h"

#include <string.h>

enum { WIDTH = 640, HEIGHT = 480, PIXELS = WIDTH * HEIGHT };

static const struct scene_effects effects = {.shading = SCENE_SHADING_COMMON};

struct fixture {
    struct gpu *gpu;
    struct gpu_target target, depth_target;
    float (*pixels)[4], *depths;
    uint8_t *marks, *drawn;
    int *stack;
};

static inline int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    *state = f;
    f->gpu = gpu_create(GPU_OFFSCREEN, 0, 0, "test", 0);
    if (!f->gpu || !gpu_target_init(f->gpu, &f->target, WIDTH, HEIGHT, GL_RGBA32F) ||
        !gpu_target_init(f->gpu, &f->depth_target, WIDTH, HEIGHT, 0))
        return -1;
    f->depths = malloc(PIXELS * sizeof *f->depths);
    f->pixels = malloc(PIXELS * sizeof *f->pixels);
    f->marks = malloc(PIXELS);
    f->drawn = malloc(PIXELS);
    f->stack = malloc(PIXELS * sizeof *f->stack);
    return f->pixels && f->depths && f->marks && f->drawn && f->stack ? 0 : -1;
}

static inline int teardown(void **state)
{
    struct fixture *f = *state;
    uint64_t errors = gpu_debug_errors(f->gpu);
    gpu_target_finish(&f->target);
    gpu_target_finish(&f->depth_target);
    gpu_destroy(f->gpu);
    free(f->pixels);
    free(f->depths);
    free(f->marks);
    free(f->drawn);
    free(f->stack);
    free(f);
    return errors ? -1 : 0;
}

// settings: "n=31 stitch=none"; the rest as by default.
static inline struct renderer *create(const struct fixture *f, const struct terrain *terrain,
                                      const char *settings)
{
    struct renderer_desc desc = {
        .gpu = f->gpu, .terrain = terrain, .effects = &effects, .width = WIDTH, .height = HEIGHT};
    return create_with(&clipmap_renderer, desc, settings);
}

static inline void update_frame(struct renderer *renderer, int frame, const struct view *view)
{
    clipmap_renderer.begin_frame(renderer, frame);
    assert_true(clipmap_renderer.update(renderer, view, 1));
}

static inline void update(struct renderer *renderer, const struct view *view)
{
    update_frame(renderer, 0, view);
}

// Draws the positions of what the last update chose to f->pixels.
static inline void draw_chosen(struct fixture *f, struct renderer *renderer, const struct terrain *terrain,
                               const struct view *view)
{
    gpu_set_view(f->gpu, terrain, view);
    gpu_target_begin(f->gpu, &f->target);
    clipmap_renderer.draw(renderer, 0, PASS_POSITION);
    gpu_target_read(f->gpu, &f->target, f->pixels);
}

static inline void draw(struct fixture *f, struct renderer *renderer, const struct terrain *terrain,
                        const struct view *view)
{
    update(renderer, view);
    draw_chosen(f, renderer, terrain, view);
}

static inline uint64_t hash(uint64_t seed, const void *data, size_t size) // FNV-1a over words
{
    const uint32_t *words = data;
    for (size_t i = 0; i < size / 4; i++) seed = (seed ^ words[i]) * 0x100000001b3u;
    return seed;
}

static inline uint64_t picture_hash(const struct fixture *f)
{
    return hash(1, f->pixels, PIXELS * sizeof *f->pixels);
}

static inline void hash_triangles(const float *triangles, size_t count, void *user)
{
    uint64_t *sum = user;
    *sum = hash(*sum, triangles, count * 9 * sizeof *triangles);
}

static inline void capture_chosen(struct fixture *f, struct renderer *renderer, const struct terrain *terrain,
                                  const struct view *view, gpu_capture_fn *receive, void *user)
{
    gpu_set_view(f->gpu, terrain, view);
    assert_true(gpu_capture_begin(f->gpu, receive, user));
    clipmap_renderer.draw(renderer, 0, PASS_POSITION);
    gpu_capture_end(f->gpu);
}

static inline void capture(struct fixture *f, struct renderer *renderer, const struct terrain *terrain,
                           const struct view *view, gpu_capture_fn *receive, void *user)
{
    update(renderer, view);
    capture_chosen(f, renderer, terrain, view, receive, user);
}

static inline uint64_t capture_hash(struct fixture *f, struct renderer *renderer,
                                    const struct terrain *terrain, const struct view *view)
{
    uint64_t sum = 1;
    capture(f, renderer, terrain, view, hash_triangles, &sum);
    return sum;
}

// Above the ground of the map by `low` .. `high` metres, looking anywhere, rolled.
static inline struct view view_through(const struct terrain *terrain, uint64_t *seed, double low, double high,
                                       double narrow, double wide)
{
    const struct terrain_info *info = terrain_info(terrain);
    const double *o = info->outline_m;
    struct camera camera = {.eye_m = {test_uniform(seed, o[0], o[2]), test_uniform(seed, o[1], o[3]), 0},
                            .yaw = test_uniform(seed, -4, 4),
                            .pitch = test_uniform(seed, -1.5, 0.3),
                            .roll = test_uniform(seed, -0.5, 0.5),
                            .fov_vertical = test_uniform(seed, narrow, wide)};
    double ground_q = 0;
    assert_true(terrain_truth_at(terrain, camera.eye_m[0], camera.eye_m[1], &ground_q, NULL));
    camera.eye_m[2] =
        ground_q * info->quantum_m + info->offset_m + low * pow(high / low, test_uniform(seed, 0, 1));
    struct view view;
    view_init(&view, terrain, &camera, WIDTH, HEIGHT, 0);
    return view;
}

static inline struct view view_over(const struct terrain *terrain, uint64_t *seed, double low, double high)
{
    return view_through(terrain, seed, low, high, 0.5, 1.6);
}

static const struct test_map hills = {.width = 1025,
                                      .height = 801,
                                      .first = {-400, -301},
                                      .spacing_m = {30, 25},
                                      .quantum_m = 0.1,
                                      .rough = 60,
                                      .seed = 11};

static inline bool ground(const struct fixture *f, int pixel)
{
    return f->pixels[pixel][3] == 1;
}

// Marks what is not drawn and joined to `pixel`.  Whether it reaches the picture's border.
static inline bool flood(struct fixture *f, const uint8_t *drawn, int pixel, uint64_t *size)
{
    bool border = false;
    int count = 0;
    f->stack[count++] = pixel;
    f->marks[pixel] = 1;
    for (*size = 0; count > 0; ++*size) {
        int at = f->stack[--count], x = at % WIDTH, y = at / WIDTH;
        for (int dy = -1; dy <= 1; dy++)
            for (int dx = -1; dx <= 1; dx++) {
                if (x + dx < 0 || x + dx >= WIDTH || y + dy < 0 || y + dy >= HEIGHT) {
                    border = true;
                    continue;
                }
                int next = at + dy * WIDTH + dx;
                if (f->marks[next] || drawn[next]) continue;
                f->marks[next] = 1;
                f->stack[count++] = next;
            }
    }
    return border;
}

// From a place over a height field every sky pixel leads up to the border: an enclosed undrawn region is
// dropped.
static inline uint64_t dropped(struct fixture *f, const uint8_t *drawn)
{
    uint64_t count = 0, size;
    memset(f->marks, 0, PIXELS);
    for (int pixel = 0; pixel < PIXELS; pixel++)
        if (!f->marks[pixel] && !drawn[pixel] && !flood(f, drawn, pixel, &size)) count += size;
    return count;
}

struct drops {
    uint64_t views, position,
        depth; // pixels dropped in the position pass, both faces drawn, and in the depth pass
};

// Of what the last update chose.
static inline void count_drops(struct fixture *f, struct renderer *renderer, const struct terrain *terrain,
                               const struct view *view, struct drops *drops)
{
    uint8_t *drawn = f->drawn;
    draw_chosen(f, renderer, terrain, view);
    for (int pixel = 0; pixel < PIXELS; pixel++) drawn[pixel] = f->pixels[pixel][3] != 0;
    drops->position += dropped(f, drawn);
    gpu_target_begin(f->gpu, &f->depth_target);
    clipmap_renderer.draw(renderer, 0, PASS_DEPTH);
    gpu_target_read(f->gpu, &f->depth_target, f->depths);
    for (int pixel = 0; pixel < PIXELS; pixel++) drawn[pixel] = f->depths[pixel] > 0;
    drops->depth += dropped(f, drawn);
    drops->views++;
}

#endif
