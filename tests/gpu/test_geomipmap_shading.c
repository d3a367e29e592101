// The tiler's own shading as drawn: pictures of any size stand where they belong, block by block, and their
// sub-textures never exceed the ceiling.
// SPDX-License-Identifier: MIT
#include "geomipmap/geomipmap.h"
#include "tests/gpu/settings.h"
#include "tests/unit/test_geomipmap.h"

#include <string.h>

enum { WIDTH = 320, HEIGHT = 240, PIXELS = WIDTH * HEIGHT, IMAGE = 1024 };

struct fixture {
    struct gpu *gpu;
    struct gpu_target shaded, position;
    uint8_t *colours;
    float *places;
    struct scene_colour ramp, flat;
    struct terrain *terrain;
};

static const struct test_map hills = {.width = 513,
                                      .height = 401,
                                      .first = {-170, -90},
                                      .spacing_m = {30, 20},
                                      .quantum_m = 0.1,
                                      .height_m = 700,
                                      .rough = 0.5};

// Red grows eastwards, green southwards: linear, so that every filter of it gives the colour of the place.
static void paint(struct fixture *f)
{
    f->ramp = (struct scene_colour){.name = "ramp", .sha256 = "ramp", .width = IMAGE, .height = IMAGE};
    f->flat = (struct scene_colour){.name = "flat", .sha256 = "flat", .width = IMAGE, .height = IMAGE};
    f->ramp.pixels = malloc(IMAGE * IMAGE * 4);
    f->flat.pixels = malloc(IMAGE * IMAGE * 4);
    assert_true(f->ramp.pixels && f->flat.pixels);
    for (int i = 0; i < IMAGE * IMAGE; i++) {
        const uint8_t at[4] = {(uint8_t)(i % IMAGE / 4), (uint8_t)(i / IMAGE / 4), 255, 255};
        const uint8_t same[4] = {200, 100, 50, 255};
        memcpy(f->ramp.pixels + 4 * i, at, 4);
        memcpy(f->flat.pixels + 4 * i, same, 4);
    }
}

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    *state = f;
    f->gpu = gpu_create(GPU_OFFSCREEN, 0, 0, "test", 0);
    if (!f->gpu || !gpu_target_init(f->gpu, &f->shaded, WIDTH, HEIGHT, GL_RGBA8) ||
        !gpu_target_init(f->gpu, &f->position, WIDTH, HEIGHT, GL_RGBA32F))
        return -1;
    f->colours = malloc(PIXELS * 4);
    f->places = malloc(PIXELS * 4 * sizeof *f->places);
    f->terrain = test_fractal(&hills, 1);
    paint(f);
    return f->colours && f->places ? 0 : -1;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    uint64_t errors = gpu_debug_errors(f->gpu);
    gpu_target_finish(&f->shaded);
    gpu_target_finish(&f->position);
    gpu_destroy(f->gpu);
    terrain_destroy(f->terrain);
    free(f->ramp.pixels);
    free(f->flat.pixels);
    free(f->colours);
    free(f->places);
    free(f);
    return errors ? -1 : 0;
}

static struct renderer *create(const struct fixture *f, struct scene_colour *colour, const char *settings)
{
    const struct scene_effects effects = {SCENE_SHADING_OWN, colour};
    struct renderer_desc desc = {
        .gpu = f->gpu, .terrain = f->terrain, .effects = &effects, .width = WIDTH, .height = HEIGHT};
    return create_with(&geomipmap_renderer, desc, settings);
}

static struct view random_view(const struct fixture *f, uint64_t *seed)
{
    const struct terrain_info *info = terrain_info(f->terrain);
    const double *o = info->outline_m;
    double x = test_uniform(seed, o[0], o[2]), y = test_uniform(seed, o[1], o[3]), ground = 0;
    assert_true(terrain_truth_at(f->terrain, x, y, &ground, NULL));
    const struct camera camera = {{x, y, ground * info->quantum_m + exp(test_uniform(seed, 1, 8))},
                                  test_uniform(seed, -4, 4),
                                  test_uniform(seed, -1.5, 0),
                                  test_uniform(seed, -0.5, 0.5),
                                  1};
    struct view view;
    view_init(&view, f->terrain, &camera, WIDTH, HEIGHT, 0);
    return view;
}

static void draw(struct fixture *f, struct renderer *renderer, const struct view *view)
{
    gpu_set_view(f->gpu, f->terrain, view);
    gpu_target_begin(f->gpu, &f->shaded);
    geomipmap_renderer.draw(renderer, 0, PASS_SHADED);
    gpu_target_read(f->gpu, &f->shaded, f->colours);
    gpu_target_begin(f->gpu, &f->position);
    geomipmap_renderer.draw(renderer, 0, PASS_POSITION);
    gpu_target_read(f->gpu, &f->position, f->places);
}

static void update(struct renderer *renderer, const struct view *view, int frame)
{
    geomipmap_renderer.begin_frame(renderer, frame);
    assert_true(geomipmap_renderer.update(renderer, view, 1));
}

struct judged {
    uint64_t ground;
    double worst; // difference to the ramp, in its steps, away from the map's edge
    uint64_t untextured;
};

// How far the colour of each pixel is from that of its place, where blue says that it is textured at all.
static void judge_ramp(const struct fixture *f, const struct view *view, double edge_share,
                       struct judged *judged)
{
    const double *o = terrain_info(f->terrain)->outline_m;
    for (int i = 0; i < PIXELS; i++) {
        const float *place = f->places + 4 * i;
        const uint8_t *colour = f->colours + 4 * i;
        if (place[3] == 0) continue;
        judged->ground++;
        judged->untextured += colour[2] < 250;
        double u = ((double)place[0] + view->eye_m[0] - o[0]) / (o[2] - o[0]);
        double v = (o[3] - (double)place[1] - view->eye_m[1]) / (o[3] - o[1]);
        if (fmin(fmin(u, 1 - u), fmin(v, 1 - v)) < edge_share) continue;
        judged->worst = fmax(judged->worst, fmax(fabs(colour[0] - u * 256), fabs(colour[1] - v * 256)));
    }
}

// A ramp step is 4 pixels of the image.  A pixel of level 2 is as wide as a step, so that down to there,
// where every view of a map that fits ends, a place is off by rounding: one of the ramp to whole steps, one
// of each level, one of the picture.
static void pictures_stand_where_they_belong(void **state)
{
    struct fixture *f = *state;
    static const char *const settings[] = {"blend=replace", "blend=replace texture=100",
                                           "blend=replace texture=300 merge=0", "blend=replace cache=5",
                                           "blend=replace borders=regions patch=33"};
    for (int s = 0; s < 5; s++) {
        struct renderer *renderer = create(f, &f->ramp, settings[s]);
        struct judged judged = {0};
        uint64_t seed = 3;
        for (int k = 0; k < test_size(8, 80); k++) {
            struct view view = random_view(f, &seed);
            update(renderer, &view, k);
            draw(f, renderer, &view);
            judge_ramp(f, &view, 0.03, &judged);
        }
        FIGURE("%s: %llu pixels of ground, colours off by %.2f steps at most, %llu untextured", settings[s],
               (unsigned long long)judged.ground, judged.worst, (unsigned long long)judged.untextured);
        assert_true(judged.ground > 0);
        assert_int_equal(judged.untextured, 0);
        assert_true(judged.worst <= 4);
        geomipmap_renderer.destroy(renderer);
    }
}

// An image of 4 MiB, 5.6 with its mipmaps, and the light map of 0.3: an eighth, and much less.
static void ceiling_is_never_exceeded(void **state)
{
    struct fixture *f = *state;
    static const int ceilings_kib[] = {740, 200, 40, 1};
    for (int c = 0; c < 4; c++) {
        char settings[64];
        snprintf(settings, sizeof settings, "blend=replace texture=300 textures=%d", ceilings_kib[c]);
        struct renderer *renderer = create(f, &f->flat, settings);
        uint64_t seed = 4, ground = 0, wrong = 0, loads = 0;
        double most = 0, overviews = 0;
        for (int k = 0; k < test_size(40, 400); k++) {
            struct view view = random_view(f, &seed);
            update(renderer, &view, k);
            most = fmax(most, counter(renderer, "texture_bytes"));
            loads += (uint64_t)counter(renderer, "texture_loads");
            overviews += counter(renderer, "blocks_by_overview");
            if (k % 4) continue;
            draw(f, renderer, &view);
            for (int i = 0; i < PIXELS; i++) {
                const uint8_t *colour = f->colours + 4 * i;
                if (f->places[4 * i + 3] == 0) continue;
                ground++;
                wrong += abs(colour[0] - 200) > 1 || abs(colour[1] - 100) > 1 || abs(colour[2] - 50) > 1;
            }
        }
        FIGURE("ceiling %d KiB: at most %.0f bytes, %llu loads, %.0f blocks by overview; %llu of %llu pixels "
               "untextured",
               ceilings_kib[c], most, (unsigned long long)loads, overviews, (unsigned long long)wrong,
               (unsigned long long)ground);
        assert_true(most <= ceilings_kib[c] * 1024.0);
        assert_true(ground > 0);
        assert_int_equal(wrong, 0);
        assert_true(c > 0 || overviews == 0); // an eighth shows every block with a texture of its own
        geomipmap_renderer.destroy(renderer);
    }
}

// A straight flight: what is loaded ahead is not missing when it comes into view, within the same ceiling.
static void loading_ahead_spares_the_frames(void **state)
{
    struct fixture *f = *state;
    enum { FRAMES = 60 };
    const struct terrain_info *info = terrain_info(f->terrain);
    const double *o = info->outline_m;
    double missing[2] = {0, 0}, most[2] = {0, 0}, bytes = 0;
    uint64_t ahead = 0, wrong = 0, ground = 0;
    for (int on = 0; on < 2; on++) {
        struct renderer *renderer = create(f, &f->flat,
                                           on ? "blend=replace texture=100 textures=1500 ahead=8"
                                              : "blend=replace texture=100 textures=1500 ahead=0");
        for (int k = 0; k < FRAMES; k++) {
            double t = (double)k / FRAMES;
            const struct camera camera = {
                {o[0] + t * (o[2] - o[0]), o[1] + (0.1 + 0.3 * t) * (o[3] - o[1]), 800}, -0.4, -0.7, 0, 1};
            struct view view;
            view_init(&view, f->terrain, &camera, WIDTH, HEIGHT, 0);
            update(renderer, &view, k);
            double late = counter(renderer, "texture_loads") - counter(renderer, "texture_ahead");
            if (k > 0) missing[on] += late, most[on] = fmax(most[on], late);
            ahead += (uint64_t)counter(renderer, "texture_ahead");
            bytes = fmax(bytes, counter(renderer, "texture_bytes"));
            if (k % 6) continue;
            draw(f, renderer, &view);
            for (int i = 0; i < PIXELS; i++) {
                const uint8_t *colour = f->colours + 4 * i;
                if (f->places[4 * i + 3] == 0) continue;
                ground++;
                wrong += abs(colour[0] - 200) > 1 || abs(colour[1] - 100) > 1 || abs(colour[2] - 50) > 1;
            }
        }
        geomipmap_renderer.destroy(renderer);
    }
    FIGURE(
        "%d frames: %.0f sub-textures loaded when needed, at most %.0f a frame; looking ahead %.0f, at most "
        "%.0f, and %llu before; at most %.0f bytes of %d",
        FRAMES, missing[0], most[0], missing[1], most[1], (unsigned long long)ahead, bytes, 1500 * 1024);
    assert_true(ahead > 0);
    assert_true(missing[1] < missing[0]);
    assert_true(most[1] <= most[0]);
    assert_true(bytes <= 1500 * 1024);
    assert_true(ground > 0);
    assert_int_equal(wrong, 0);
}

static void static_frame_loads_nothing(void **state)
{
    struct fixture *f = *state;
    static const char *const settings[] = {"textures=65536", "textures=300", "textures=20"};
    for (int s = 0; s < 3; s++) {
        struct renderer *renderer = create(f, &f->ramp, settings[s]);
        uint64_t seed = 5;
        for (int k = 0; k < 6; k++) {
            struct view view = random_view(f, &seed);
            update(renderer, &view, 3 * k);
            assert_true(k > 0 || counter(renderer, "texture_loads") > 0);
            update(renderer, &view, 3 * k + 1); // what was finer than needed may settle
            update(renderer, &view, 3 * k + 2);
            gpu_reset_counters(f->gpu);
            update(renderer, &view, 3 * k + 3);
            draw(f, renderer, &view);
            assert_true(counter(renderer, "texture_loads") == 0);
            assert_int_equal(gpu_counters(f->gpu).upload_bytes, 0);
        }
        geomipmap_renderer.destroy(renderer);
    }
}

// Light map and colour: modulated darker than either, added and clamped; without an image the ramp by height.
static void operators_combine_light_and_colour(void **state)
{
    struct fixture *f = *state;
    static const char *const blends[] = {"blend=modulate", "blend=add", "blend=replace"};
    uint8_t *pictures[3];
    struct renderer *replace = NULL;
    uint64_t seed = 6;
    struct view view = random_view(f, &seed);
    for (int b = 0; b < 3; b++) {
        replace = create(f, &f->flat, blends[b]);
        update(replace, &view, 0);
        draw(f, replace, &view);
        pictures[b] = malloc(PIXELS * 4);
        assert_non_null(pictures[b]);
        memcpy(pictures[b], f->colours, PIXELS * 4);
        geomipmap_renderer.destroy(replace);
    }
    uint64_t ground = 0;
    for (int i = 0; i < PIXELS; i++) {
        if (f->places[4 * i + 3] == 0) continue;
        ground++;
        for (int c = 0; c < 3; c++) {
            // light follows from the modulated picture where that is not clamped
            double colour = pictures[2][4 * i + c] / 255.0, product = pictures[0][4 * i + c] / 255.0;
            double sum = pictures[1][4 * i + c] / 255.0, light = product / colour;
            if (product >= 1) continue;
            double expected = fmin(fmax(colour + light - 1, 0), 1);
            assert_true(fabs(sum - expected) <= 0.5 / 255 + 1.5 / 255 / colour);
        }
    }
    for (int b = 0; b < 3; b++) free(pictures[b]);
    assert_true(ground > 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pictures_stand_where_they_belong),   cmocka_unit_test(ceiling_is_never_exceeded),
        cmocka_unit_test(loading_ahead_spares_the_frames),    cmocka_unit_test(static_frame_loads_nothing),
        cmocka_unit_test(operators_combine_light_and_colour),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
