// brute over a planet against the ray caster: the agreement that design.md asks for on planes holds here.
// SPDX-License-Identifier: MIT
#include "bench/error/error.h"
#include "bench/error/flat.h"
#include "bench/error/samples.h"
#include "bench/registry.h"
#include "tests/gpu/settings.h"
#include "tests/planet.h"

static const struct scene_effects effects = {.shading = SCENE_SHADING_COMMON};

struct picture { // what is needed to hold one view against the truth
    struct gpu *gpu;
    struct gpu_target target;
    struct truth truth;
    struct frame_error error;
    float *positions;
    int width, height;
};

static void picture_init(struct picture *p)
{
    p->width = test_size(160, 640);
    p->height = test_size(120, 480);
    p->gpu = gpu_create(GPU_OFFSCREEN, 0, 0, "test", 0);
    assert_non_null(p->gpu);
    assert_true(gpu_target_init(p->gpu, &p->target, p->width, p->height, GL_RGBA32F));
    assert_true(truth_init(&p->truth, p->width, p->height));
    assert_true(frame_error_init(&p->error, p->width, p->height));
    p->positions = malloc((size_t)p->width * (size_t)p->height * 4 * sizeof *p->positions);
    assert_non_null(p->positions);
}

static void picture_finish(struct picture *p)
{
    assert_int_equal(gpu_debug_errors(p->gpu), 0);
    gpu_target_finish(&p->target);
    truth_finish(&p->truth);
    frame_error_finish(&p->error);
    free(p->positions);
    gpu_destroy(p->gpu);
}

static void measure(struct picture *p, struct renderer *renderer, const struct terrain *terrain,
                    const struct truth_surface *surface, const struct view *view)
{
    const struct renderer_type *type = &brute_renderer;
    type->begin_frame(renderer, 0);
    assert_true(type->update(renderer, view, 1));
    gpu_set_view(p->gpu, terrain, view);
    gpu_target_begin(p->gpu, &p->target);
    type->draw(renderer, 0, PASS_POSITION);
    gpu_target_read(p->gpu, &p->target, p->positions);
    truth_cast(&p->truth, surface, view, 0);
    struct flat_feeding feeding = {view->radius_m, truth_places(&p->truth, 0)};
    assert_true(gpu_capture_begin(p->gpu, flat_receive, &feeding));
    type->draw(renderer, 0, PASS_POSITION);
    gpu_capture_end(p->gpu);
    frame_error_measure(&p->error, terrain, view, &p->truth, p->positions, feeding.places, 0);
    places_destroy(feeding.places);
}

static void brute_and_the_caster_agree(void **state)
{
    (void)state;
    // Longitude, latitude, height over ground, yaw, pitch: on foot, over both poles, on the 180th meridian,
    // from the air and from space; on foot beside the poles, where cells are 20 km by 3 m at the full size,
    // in the second row of cells, and on a pole.
    static const double VIEWS[][5] = {
        {10, 45, 1.7, 2, 0.02},         {180, -17, 3000, 0.3, -0.2},    {60, 89.9, 300, 1.5, -0.1},
        {-30, -89.5, 20000, -1, -0.4},  {-179.99, 60, 10000, 3, -0.3},  {100, 30, 4e5, -2, -0.5},
        {-120, 89.99, 4e5, 0.5, -1.57}, {140, 10, 2e7, 1.5, -M_PI / 2}, {60, 89.99, 1.7, 1.5, -0.1},
        {-30, -89.995, 1.7, -1, 0.02},  {-30, -89.76, 1.7, -1, 0.02},   {60, -90, 1.7, 1.5, -0.1},
    };
    enum { COUNT = sizeof VIEWS / sizeof VIEWS[0] };
    struct picture p;
    struct terrain *terrain = test_planet(test_size(512, 2048), 2500, 9, 0);
    struct truth_surface *surface = truth_surface_create(terrain);
    double worst_px = 0;
    uint64_t coverage = 0, order = 0, holes = 0, ground = 0;
    picture_init(&p);
    struct renderer_desc desc = {
        .gpu = p.gpu, .terrain = terrain, .effects = &effects, .width = p.width, .height = p.height};
    struct renderer *renderer = create_with(&brute_renderer, desc, "cull=on");
    for (int v = 0; v < COUNT; v++) {
        const double *at = VIEWS[v];
        struct camera camera = test_camera(terrain, at[0], at[1], at[2], at[3], at[4]);
        struct view view;
        view_init(&view, terrain, &camera, p.width, p.height, 0);
        measure(&p, renderer, terrain, surface, &view);
        const struct frame_error *e = &p.error;
        coverage += e->holes + e->misses + e->spills, holes += e->holes, ground += e->ground;
        order += frame_error_order_beyond_grid(e, &p.truth, surface, &view, p.positions);
        struct error_samples plane_px = {0};
        for (int i = 0; i < p.width * p.height; i++)
            if (!isnan(e->plane_px[i])) assert_true(error_samples_add(&plane_px, &e->plane_px[i], 1));
        worst_px = fmax(worst_px, error_samples_summary(&plane_px).p999);
        error_samples_finish(&plane_px);
    }
    double pixels = (double)COUNT * p.width * p.height;
    FIGURE(
        "brute on a planet: in the worst of %d views %.2e px p99.9 from the caster; of %.0f pixels %d holes, "
        "%d covered otherwise, %d other surfaces",
        COUNT, worst_px, pixels, (int)holes, (int)coverage, (int)order);
    assert_int_equal(holes, 0);
    assert_true((double)ground > 0.4 * pixels);
    assert_true(worst_px <= 1.6e-4);
    assert_true((double)coverage <= 4 * pixels / 307200 && (double)order <= 4 * pixels / 307200);
    brute_renderer.destroy(renderer);
    truth_surface_destroy(surface);
    terrain_destroy(terrain);
    picture_finish(&p);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(brute_and_the_caster_agree)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
