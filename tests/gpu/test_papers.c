// What the tables of the papers time is what the tests verify: the same ground as brute, the same picture
// whether levels are refilled in part or whole, the samples of a pixel averaged. SPDX-License-Identifier: MIT
#include "bench/papers/papers.h"
#include "bench/registry.h"
#include "clipmap/clipmap.h"
#include "tests/test.h"

#include <string.h>

enum { WIDTH = 320, HEIGHT = 240, PIXELS = WIDTH * HEIGHT };

static int setup(void **state)
{
    struct papers *papers = calloc(1, sizeof *papers);
    *state = papers;
    *papers = (struct papers){.repeats = 1, .width = WIDTH, .height = HEIGHT};
    papers->gpu = gpu_create(GPU_OFFSCREEN, 0, 0, "test", 0);
    return papers->gpu ? 0 : -1;
}

static int teardown(void **state)
{
    struct papers *papers = *state;
    uint64_t errors = gpu_debug_errors(papers->gpu);
    gpu_destroy(papers->gpu);
    free(papers);
    return errors ? -1 : 0;
}

static struct renderer *create(const struct papers *papers, const struct scene *scene,
                               const struct renderer_type *type, const char *knob, const char *value)
{
    struct renderer_desc desc = {.gpu = papers->gpu,
                                 .terrain = scene->terrain,
                                 .effects = &scene->effects,
                                 .width = WIDTH,
                                 .height = HEIGHT};
    renderer_default_knobs(type, desc.knobs);
    if (knob) assert_true(renderer_parse_knob(type, knob, value, desc.knobs));
    struct renderer *renderer = type->create(&desc);
    assert_non_null(renderer);
    return renderer;
}

static void draw(const struct papers *papers, const struct scene *scene, struct renderer *renderer,
                 const struct view *view, const struct gpu_target *target, enum render_pass pass,
                 void *pixels)
{
    renderer->type->begin_frame(renderer, 0);
    assert_true(renderer->type->update(renderer, view, 1));
    gpu_set_view(papers->gpu, scene->terrain, view);
    gpu_target_begin(papers->gpu, target);
    renderer->type->draw(renderer, 0, pass);
    if (pixels) gpu_target_read(papers->gpu, target, pixels);
}

// Both draw every triangle; strips and lists interpolate from other corners, within the rasteriser's
// sub-pixel grid (numerics.md, section 0): coverage may differ on outlines alone, and so may which of two
// surfaces is nearer.
static void immediate_draws_what_brute_draws(void **state)
{
    struct papers *papers = *state;
    struct scene *scene = papers_scene(papers, terrain_builtin(NULL));
    assert_non_null(scene);
    struct renderer *immediate = create(papers, scene, &immediate_renderer, NULL, NULL);
    struct renderer *brute = create(papers, scene, &brute_renderer, NULL, NULL);
    struct gpu_target target;
    assert_true(gpu_target_init(papers->gpu, &target, WIDTH, HEIGHT, GL_RGBA32F));
    float(*a)[4] = malloc(PIXELS * sizeof *a), (*b)[4] = malloc(PIXELS * sizeof *b);
    int frames = test_size(6, 60);
    for (int frame = 0; frame < frames; frame++) {
        struct view view;
        int different = 0, covered = 0;
        scene_view(scene, frame, frames, &view);
        draw(papers, scene, immediate, &view, &target, PASS_POSITION, a);
        draw(papers, scene, brute, &view, &target, PASS_POSITION, b);
        for (int i = 0; i < PIXELS; i++) {
            bool both = a[i][3] != 0 && b[i][3] != 0;
            covered += both;
            double far = sqrt((double)(a[i][0] * a[i][0] + a[i][1] * a[i][1] + a[i][2] * a[i][2])), apart = 0;
            for (int k = 0; k < 3; k++) apart = fmax(apart, fabs((double)(a[i][k] - b[i][k])));
            different += both ? apart > 1e-4 * far : (a[i][3] != 0) != (b[i][3] != 0);
        }
        assert_true(covered > PIXELS / 10);
        assert_in_range(different, 0, 4);
    }
    struct renderer_stats stats;
    immediate_renderer.stats(immediate, &stats);
    assert_int_equal(stats.triangles, 2 * 402 * 343);
    free(a);
    free(b);
    gpu_target_finish(&target);
    immediate_renderer.destroy(immediate);
    brute_renderer.destroy(brute);
    scene_destroy(scene);
}

static void whole_refills_draw_the_same_picture(void **state)
{
    struct papers *papers = *state;
    struct scene *scene =
        papers_scene(papers, terrain_builtin(&(struct terrain_options){.synthesize_levels = 1}));
    assert_non_null(scene);
    struct renderer *exposed = create(papers, scene, &clipmap_renderer, "refill", "exposed");
    struct renderer *whole = create(papers, scene, &clipmap_renderer, "refill", "whole");
    struct gpu_target target;
    assert_true(gpu_target_init(papers->gpu, &target, WIDTH, HEIGHT, GL_RGBA32F));
    float(*a)[4] = malloc(PIXELS * sizeof *a), (*b)[4] = malloc(PIXELS * sizeof *b);
    int frames = test_size(24, 240);
    double read[2] = {0};
    for (int frame = 0; frame < frames; frame++) {
        struct view view;
        struct renderer_stats stats[2];
        scene_view(scene, frame, frames, &view);
        draw(papers, scene, exposed, &view, &target, PASS_POSITION, a);
        draw(papers, scene, whole, &view, &target, PASS_POSITION, b);
        assert_memory_equal(a, b, PIXELS * sizeof *a);
        clipmap_renderer.stats(exposed, &stats[0]);
        clipmap_renderer.stats(whole, &stats[1]);
        for (int k = 0; k < 2; k++) {
            assert_string_equal(stats[k].counters[1].name, "samples_updated");
            read[k] += stats[k].counters[1].value;
        }
    }
    FIGURE("samples read over the path: %.3g in part, %.3g whole", read[0], read[1]);
    assert_true(read[0] < read[1]);
    free(a);
    free(b);
    gpu_target_finish(&target);
    clipmap_renderer.destroy(exposed);
    clipmap_renderer.destroy(whole);
    scene_destroy(scene);
}

// Away from edges all samples of a pixel agree, so the picture is that of one sample; along them it is a
// mean.
static void multisampling_smooths_edges_only(void **state)
{
    struct papers *papers = *state;
    struct scene *scene = papers_scene(papers, terrain_builtin(NULL));
    struct renderer *null = create(papers, scene, &null_renderer, NULL, NULL);
    struct renderer *clipmap = create(papers, scene, &clipmap_renderer, NULL, NULL);
    struct gpu_target plain, many, resolved;
    uint8_t(*a)[4] = malloc(PIXELS * sizeof *a), (*b)[4] = malloc(PIXELS * sizeof *b);
    assert_true(gpu_target_init(papers->gpu, &plain, WIDTH, HEIGHT, GL_RGBA8));
    assert_true(gpu_target_init(papers->gpu, &resolved, WIDTH, HEIGHT, GL_RGBA8));
    assert_true(gpu_target_init_multisampled(papers->gpu, &many, WIDTH, HEIGHT, GL_RGBA8, 4));
    for (int k = 0; k < 2; k++) {
        struct renderer *renderer = k ? clipmap : null;
        struct view view;
        scene_view(scene, 0, 2, &view);
        draw(papers, scene, renderer, &view, &plain, PASS_SHADED, a);
        draw(papers, scene, renderer, &view, &many, PASS_SHADED, NULL);
        gpu_target_resolve(papers->gpu, &many, &resolved);
        gpu_target_read(papers->gpu, &resolved, b);
        int changed = 0;
        for (int i = 0; i < PIXELS; i++) changed += memcmp(a[i], b[i], 4) != 0;
        FIGURE("%s: %.1f %% of pixels change under 4x multisampling", renderer->type->name,
               100.0 * changed / PIXELS);
        assert_true(k ? changed > 0 && changed < PIXELS : changed == 0);
    }
    gpu_target_finish(&plain);
    gpu_target_finish(&many);
    gpu_target_finish(&resolved);
    free(a);
    free(b);
    null_renderer.destroy(null);
    clipmap_renderer.destroy(clipmap);
    scene_destroy(scene);
}

static void too_many_samples_are_refused(void **state)
{
    struct papers *papers = *state;
    struct gpu_target target;
    assert_false(gpu_target_init_multisampled(papers->gpu, &target, 16, 16, GL_RGBA8, 1024));
    assert_int_equal(target.framebuffer, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(immediate_draws_what_brute_draws),
        cmocka_unit_test(whole_refills_draw_the_same_picture),
        cmocka_unit_test(multisampling_smooths_edges_only),
        cmocka_unit_test(too_many_samples_are_refused),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
