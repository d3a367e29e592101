// What the tests of persistent grid mapping start from: made terrain, a renderer by its options, one measured
// frame. SPDX-License-Identifier: MIT
#ifndef TESTS_GPU_TEST_PGM_H
#define TESTS_GPU_TEST_PGM_H

#include "tests/test.h"

#include "bench/error/error.h"
#include "bench/error/ridges.h"
#include "pgm/pgm.h"
#include "tests/gpu/settings.h"

#include <string.h>

static const double degree = 0.017453292519943295;
static const struct scene_effects common_effects = {.shading = SCENE_SHADING_COMMON};

typedef int32_t height_fn(int i, int j); // quanta; i east, j north, from the map's south-west corner

static inline struct terrain *make_terrain(int width, int height, const int64_t first[2], double spacing_m,
                                           double quantum_m, double offset_m, height_fn *height_at)
{
    int32_t *samples = malloc((size_t)width * (size_t)height * sizeof *samples);
    assert_non_null(samples);
    for (int j = 0; j < height; j++)
        for (int i = 0; i < width; i++) samples[(size_t)j * (size_t)width + (size_t)i] = height_at(i, j);
    struct terrain_grid grid = {.name = "made",
                                .samples = samples,
                                .width = width,
                                .height = height,
                                .spacing_m = {spacing_m, spacing_m},
                                .quantum_m = quantum_m,
                                .offset_m = offset_m};
    if (first) memcpy(grid.first, first, sizeof grid.first);
    struct terrain_options options = {.refine_bits = 0};
    struct terrain *terrain = terrain_from_grid(&grid, &options);
    assert_non_null(terrain);
    free(samples);
    return terrain;
}

// Options as "rows=100 law=log".
static inline struct renderer *make_shaded_pgm(struct gpu *gpu, const struct terrain *terrain,
                                               const struct scene_effects *effects, const char *options)
{
    struct renderer_desc desc = {
        .gpu = gpu, .terrain = terrain, .effects = effects, .width = 640, .height = 480};
    return create_with(&pgm_renderer, desc, options);
}

static inline struct renderer *make_pgm(struct gpu *gpu, const struct terrain *terrain, const char *options)
{
    return make_shaded_pgm(gpu, terrain, &common_effects, options);
}

static inline struct view make_view(const struct terrain *terrain, const double eye_m[3], double yaw_degrees,
                                    double pitch_degrees, double roll_degrees, double fov_degrees, int width,
                                    int height)
{
    struct camera camera = {.eye_m = {eye_m[0], eye_m[1], eye_m[2]},
                            .yaw = yaw_degrees * degree,
                            .pitch = pitch_degrees * degree,
                            .roll = roll_degrees * degree,
                            .fov_vertical = fov_degrees * degree};
    struct view view;
    view_init(&view, terrain, &camera, width, height, 0);
    return view;
}

// Draws one pass of one frame into a target and reads it: RGBA bytes or floats, or one float of depth, by the
// pass.
static inline void *draw_frame(struct gpu *gpu, struct renderer *renderer, const struct terrain *terrain,
                               const struct view *view, enum render_pass pass)
{
    struct gpu_target target;
    static const GLenum formats[PASS_COUNT] = {GL_RGBA8, GL_RGBA32F, 0};
    assert_true(gpu_target_init(gpu, &target, view->width, view->height, formats[pass]));
    void *pixels = malloc((size_t)view->width * (size_t)view->height * 4 * sizeof(float));
    assert_non_null(pixels);
    gpu_set_view(gpu, terrain, view);
    renderer->type->begin_frame(renderer, 0);
    assert_true(renderer->type->update(renderer, view, 1));
    gpu_target_begin(gpu, &target);
    renderer->type->draw(renderer, 0, pass);
    gpu_target_read(gpu, &target, pixels);
    gpu_target_finish(&target);
    return pixels;
}

// Hands the triangles of one frame to `receive`.
static inline void capture_frame(struct gpu *gpu, struct renderer *renderer, const struct terrain *terrain,
                                 const struct view *view, gpu_capture_fn *receive, void *user)
{
    gpu_set_view(gpu, terrain, view);
    renderer->type->begin_frame(renderer, 0);
    assert_true(renderer->type->update(renderer, view, 1));
    struct gpu_target target;
    assert_true(gpu_target_init(gpu, &target, view->width, view->height, GL_RGBA32F));
    gpu_target_begin(gpu, &target);
    assert_true(gpu_capture_begin(gpu, receive, user));
    renderer->type->draw(renderer, 0, PASS_POSITION);
    gpu_capture_end(gpu);
    gpu_target_finish(&target);
}

struct measured_capture {
    struct places *hits;
    struct ridges ridges;
};

static inline void receive_measured(const float *triangles, size_t count, void *user)
{
    struct measured_capture *capture = user;
    places_feed(triangles, count, capture->hits);
    ridges_feed(&capture->ridges, triangles, count);
}

// Everything that is measured of one frame; finish with frame_error_finish.  `truth` may be NULL, else it is
// kept for the caller, who finishes it.
static inline struct frame_error measure_frame(struct gpu *gpu, struct renderer *renderer,
                                               const struct terrain *terrain, const struct view *view,
                                               struct truth *truth)
{
    struct frame_error error;
    struct truth own;
    if (!truth) truth = &own;
    struct truth_surface *surface = truth_surface_create(terrain);
    assert_true(surface && truth_init(truth, view->width, view->height));
    assert_true(frame_error_init(&error, view->width, view->height));
    truth_cast(truth, surface, view, 0);
    float *positions = draw_frame(gpu, renderer, terrain, view, PASS_POSITION);
    struct measured_capture capture = {.hits = truth_places(truth, 0)};
    assert_true(capture.hits && ridges_begin(&capture.ridges, view, positions));
    struct gpu_target target; // a draw needs one, captured or not
    assert_true(gpu_target_init(gpu, &target, view->width, view->height, GL_RGBA32F));
    gpu_target_begin(gpu, &target);
    assert_true(gpu_capture_begin(gpu, receive_measured, &capture));
    renderer->type->draw(renderer, 0, PASS_POSITION);
    gpu_capture_end(gpu);
    gpu_target_finish(&target);
    frame_error_measure(&error, terrain, view, truth, positions, capture.hits, 0);
    places_destroy(capture.hits);
    ridges_finish(&capture.ridges);
    free(positions);
    truth_surface_destroy(surface);
    if (truth == &own) truth_finish(&own);
    return error;
}

static inline double largest_error_px(const struct frame_error *error)
{
    double largest = 0;
    for (size_t p = 0; p < (size_t)error->width * (size_t)error->height; p++)
        if (!isnan(error->error_px[p])) largest = fmax(largest, (double)error->error_px[p]);
    return largest;
}

static inline int start_gpu(void **state)
{
    *state = gpu_create(GPU_OFFSCREEN, 0, 0, "test", -1);
    return *state ? 0 : -1;
}

static inline int stop_gpu(void **state)
{
    gpu_destroy(*state);
    return 0;
}

#endif
