// The claim of `safe` over the paths of the scenes: at every tau nothing drawn is farther from the truth than
// claimed, and there are no holes.
// SPDX-License-Identifier: MIT
#include "bench/error/error.h"
#include "bench/error/ridges.h"
#include "common/scene/scene.h"
#include "geomipmap/geomipmap.h"
#include "tests/gpu/settings.h"

#include <stdlib.h>

static const double taus[] = {0.25, 0.5, 1, 2, 4, 8};
enum { TAUS = sizeof taus / sizeof taus[0] };

static const struct {
    const char *name, *data; // data: a file that it needs, or NULL
} scenes[] = {{"default", NULL},
              {"small", NULL},
              {"level", NULL},
              {"slow", NULL},
              {"laws", NULL},
              {"peers", "fbm_2049.png"},
              {"puget", "puget_1k_160m.png"},
              {"cascades", "puget_cascades_72m_2049x2817.png"}};
enum { SCENES = sizeof scenes / sizeof scenes[0] };

struct flight { // one scene, all taus
    struct gpu *gpu;
    struct gpu_target target;
    struct scene *scene;
    struct renderer *renderers[TAUS];
    struct truth_surface *surface;
    struct truth truth;
    struct frame_error error;
    struct ridges ridges;
    struct places *hits; // of the frame in hand
    float *pixels;
    int broken[TAUS];
    double tightness[TAUS], most[TAUS];
    uint64_t holes, ground;
};

static void start(struct flight *f, struct gpu *gpu, struct scene *scene)
{
    *f = (struct flight){.gpu = gpu, .scene = scene, .surface = truth_surface_create(scene->terrain)};
    assert_non_null(f->surface);
    assert_true(gpu_target_init(gpu, &f->target, scene->width, scene->height, GL_RGBA32F));
    assert_true(truth_init(&f->truth, scene->width, scene->height));
    assert_true(frame_error_init(&f->error, scene->width, scene->height));
    f->pixels = malloc((size_t)scene->width * (size_t)scene->height * 4 * sizeof *f->pixels);
    assert_non_null(f->pixels);
    for (int t = 0; t < TAUS; t++) {
        struct renderer_desc desc = {.gpu = gpu,
                                     .terrain = scene->terrain,
                                     .effects = &scene->effects,
                                     .width = scene->width,
                                     .height = scene->height};
        char text[32];
        snprintf(text, sizeof text, "tau=%g", taus[t]);
        f->renderers[t] = create_with(&geomipmap_renderer, desc, text);
    }
}

static void finish(struct flight *f)
{
    for (int t = 0; t < TAUS; t++) geomipmap_renderer.destroy(f->renderers[t]);
    gpu_target_finish(&f->target);
    truth_surface_destroy(f->surface);
    truth_finish(&f->truth);
    frame_error_finish(&f->error);
    ridges_finish(&f->ridges);
    free(f->pixels);
}

static void feed(const float *triangles, size_t count, void *user)
{
    struct flight *f = user;
    ridges_feed(&f->ridges, triangles, count);
    places_feed(triangles, count, f->hits);
}

// Holds what one renderer draws against the truth, which is cast already.
static void look(struct flight *f, int t, int frame, const struct view *view)
{
    struct renderer *renderer = f->renderers[t];
    geomipmap_renderer.begin_frame(renderer, frame);
    assert_true(geomipmap_renderer.update(renderer, view, 1));
    gpu_set_view(f->gpu, f->scene->terrain, view);
    gpu_target_begin(f->gpu, &f->target);
    geomipmap_renderer.draw(renderer, 0, PASS_POSITION);
    gpu_target_read(f->gpu, &f->target, f->pixels);
    f->hits = truth_places(&f->truth, 0);
    assert_non_null(f->hits);
    assert_true(ridges_begin(&f->ridges, view, f->pixels));
    assert_true(gpu_capture_begin(f->gpu, feed, f));
    geomipmap_renderer.draw(renderer, 0, PASS_DEPTH);
    gpu_capture_end(f->gpu);
    frame_error_measure(&f->error, f->scene->terrain, view, &f->truth, f->pixels, f->hits, 0);
    places_destroy(f->hits);
    double worst = 0;
    for (int p = 0; p < f->scene->width * f->scene->height; p++)
        if (f->error.kind[p] == PIXEL_GROUND) worst = fmax(worst, (double)f->error.error_px[p]);
    f->broken[t] += worst > taus[t] + 1e-3; // the floor of the measure
    f->most[t] = fmax(f->most[t], worst / taus[t]);
    f->tightness[t] += worst / taus[t];
    f->holes += f->error.holes;
    f->ground += f->error.ground;
}

// Returns how many claims were broken and adds the holes.
static int fly(struct gpu *gpu, const char *name, int frames, uint64_t *holes)
{
    char file[64];
    snprintf(file, sizeof file, "bench/scenes/%s.json", name);
    struct scene *scene = scene_load(file, NULL, test_size(128, 320), test_size(96, 240));
    assert_non_null(scene);
    struct flight f;
    int broken = 0, all = path_frames(scene->path);
    if (frames == 0 || frames > all) frames = all;
    start(&f, gpu, scene);
    for (int frame = 0; frame < frames; frame++) {
        struct view view;
        scene_view(scene, frame, frames, &view);
        truth_cast(&f.truth, f.surface, &view, 0);
        for (int t = 0; t < TAUS; t++) look(&f, t, frame, &view);
    }
    FIGURE(
        "%s, %d frames of each tau: claim broken in %d %d %d %d %d %d; worst of a frame over the claim, mean "
        "and most: %.2f %.2f %.2f %.2f %.2f %.2f, %.2f %.2f %.2f %.2f %.2f %.2f; %llu holes of %llu pixels",
        name, frames, f.broken[0], f.broken[1], f.broken[2], f.broken[3], f.broken[4], f.broken[5],
        f.tightness[0] / frames, f.tightness[1] / frames, f.tightness[2] / frames, f.tightness[3] / frames,
        f.tightness[4] / frames, f.tightness[5] / frames, f.most[0], f.most[1], f.most[2], f.most[3],
        f.most[4], f.most[5], (unsigned long long)f.holes, (unsigned long long)f.ground);
    for (int t = 0; t < TAUS; t++) broken += f.broken[t];
    finish(&f);
    scene_destroy(scene);
    assert_true(f.ground > 0);
    *holes += f.holes;
    return broken;
}

// Everyday: a few frames of the scenes that need no data; full: every frame of every scene on a plane.
static void claim_holds_over_every_path(void **state)
{
    (void)state;
    struct gpu *gpu = gpu_create(GPU_OFFSCREEN, 0, 0, "test", 0);
    assert_non_null(gpu);
    uint64_t holes = 0;
    int broken = 0;
    for (int s = 0; s < test_size(2, SCENES); s++) {
        char path[1024];
        if (!scenes[s].data || test_data(scenes[s].data, path))
            broken += fly(gpu, scenes[s].name, test_size(3, 0), &holes);
    }
    assert_int_equal(broken, 0); // after all scenes have told their figures
    assert_int_equal(holes, 0);
    assert_int_equal(gpu_debug_errors(gpu), 0);
    gpu_destroy(gpu);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(claim_holds_over_every_path)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
