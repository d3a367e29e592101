// The paper's large map: terrain on disk with a colour image as wide, flown within 2.5 bytes a sample and an
// eighth of the image.
// SPDX-License-Identifier: MIT
#include "common/terrain/relief/relief_pack.h"
#include "common/view/path.h"
#include "geomipmap/geomipmap.h"
#include "tests/folder.h"
#include "tests/gpu/settings.h"

#include <string.h>
#include <time.h>

enum { WIDTH = 320, HEIGHT = 240, PIXELS = WIDTH * HEIGHT, CELLS = 1024 };

static double now_s(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
}

// Packs the Puget set with `levels` synthesised levels: 1025 << levels samples a side, less the corners.
static void pack(const char *path, int levels)
{
    struct terrain_options options = {.synthesize_levels = levels, .seed = 1, .refine_bits = 1};
    struct terrain *terrain = terrain_load(path, &options);
    assert_non_null(terrain);
    const struct terrain_info *info = terrain_info(terrain);
    struct terrain_level level = terrain_level(terrain, info->finest);
    int side = (CELLS << levels) + 1;
    struct heightfield field = {.name = "large",
                                .width = side,
                                .height = side,
                                .spacing_m = {level.spacing_m[0], level.spacing_m[1]},
                                .quantum_m = info->quantum_m,
                                .offset_m = info->offset_m,
                                .samples = malloc((size_t)side * (size_t)side * sizeof(int32_t))};
    assert_non_null(field.samples);
    assert_int_equal(level.extent.x1 - level.extent.x0, side);
    terrain_window(terrain, info->finest, level.extent.x0, level.extent.y0, side, side, field.samples,
                   TERRAIN_WAIT);
    terrain_destroy(terrain);
    struct relief_pack_options how = {.layout = LAYOUT_BOUNDED, .max_m = 1};
    struct relief_header header;
    assert_true(relief_pack(&field, &how, in_folder("large.relief"), &header));
    heightfield_finish(&field);
}

// One colour all over: a pixel of another one is not textured.
static struct scene_colour paint(int side)
{
    struct scene_colour colour = {.name = "flat", .sha256 = "flat", .width = side, .height = side};
    colour.pixels = malloc((size_t)side * (size_t)side * 4);
    assert_non_null(colour.pixels);
    for (size_t i = 0; i < (size_t)side * (size_t)side; i++)
        memcpy(colour.pixels + 4 * i, (uint8_t[4]){200, 100, 50, 255}, 4);
    return colour;
}

struct flight {
    struct gpu *gpu;
    struct gpu_target shaded, position;
    uint8_t *colours;
    float *places;
    uint64_t ground, wrong;
};

static void look(struct flight *f, struct renderer *renderer, const struct terrain *terrain,
                 const struct view *view)
{
    gpu_set_view(f->gpu, terrain, view);
    gpu_target_begin(f->gpu, &f->shaded);
    geomipmap_renderer.draw(renderer, 0, PASS_SHADED);
    gpu_target_read(f->gpu, &f->shaded, f->colours);
    gpu_target_begin(f->gpu, &f->position);
    geomipmap_renderer.draw(renderer, 0, PASS_POSITION);
    gpu_target_read(f->gpu, &f->position, f->places);
    for (int i = 0; i < PIXELS; i++) {
        const uint8_t *c = f->colours + 4 * i;
        if (f->places[4 * i + 3] == 0) continue;
        f->ground++;
        f->wrong += abs(c[0] - 200) > 1 || abs(c[1] - 100) > 1 || abs(c[2] - 50) > 1;
    }
}

static void large_map_flies_within_its_bytes(void **state)
{
    (void)state;
    int levels = test_size(1, 3), side = CELLS << levels, frames = test_size(24, 96);
    char path[1024], settings[96];
    if (!test_data("puget_1k_160m.png", path)) return;
    assert_int_equal(folder_create(NULL), 0);
    pack(path, levels);
    // The ceiling of decoded samples: three quarters of a byte for each sample of the map.
    struct terrain_options options = {.cache_bytes = (uint64_t)side * (uint64_t)side * 3 / 4};
    struct terrain *terrain = terrain_load(in_folder("large.relief"), &options);
    assert_non_null(terrain);
    struct scene_colour colour = paint(side);
    struct scene_effects effects = {.shading = SCENE_SHADING_OWN, .colour = &colour};
    struct flight f = {.gpu = gpu_create(GPU_OFFSCREEN, 0, 0, "test", 0)};
    assert_non_null(f.gpu);
    assert_true(gpu_target_init(f.gpu, &f.shaded, WIDTH, HEIGHT, GL_RGBA8) &&
                gpu_target_init(f.gpu, &f.position, WIDTH, HEIGHT, GL_RGBA32F));
    f.colours = malloc(PIXELS * 4);
    f.places = malloc(PIXELS * 4 * sizeof *f.places);
    double ceiling_kib = floor((double)side * side * 4 / 8 / 1024), textures = 0, bytes = 0, late = 0;
    snprintf(settings, sizeof settings, "tau=%d blend=replace textures=%.0f", test_size(2, 1), ceiling_kib);
    struct renderer_desc desc = {
        .gpu = f.gpu, .terrain = terrain, .effects = &effects, .width = WIDTH, .height = HEIGHT};
    double start = now_s();
    struct renderer *renderer = create_with(&geomipmap_renderer, desc, settings);
    double made_s = now_s() - start;
    struct path *flown = path_for_terrain(terrain, frames, 1);
    assert_non_null(flown);
    for (int frame = 0; frame < frames; frame++) {
        struct camera camera = path_camera(flown, frame, frames);
        struct view view;
        view_init(&view, terrain, &camera, WIDTH, HEIGHT, 0);
        geomipmap_renderer.begin_frame(renderer, frame);
        assert_true(geomipmap_renderer.update(renderer, &view, 1));
        bytes = fmax(bytes, counter(renderer, "bytes_a_sample"));
        textures = fmax(textures, counter(renderer, "texture_bytes"));
        late += counter(renderer, "late") > 0;
        if (frame % test_size(3, 2) == 0) look(&f, renderer, terrain, &view);
    }
    struct renderer_stats stats;
    geomipmap_renderer.stats(renderer, &stats);
    FIGURE("%d x %d samples: at most %.3f bytes a sample, %.3f of them tiles; textures at most %.0f KiB of "
           "%.0f; %llu of %llu "
           "pixels "
           "untextured; tiles late in %.0f of %d frames; made ready in %.1f s, %.2f s of them the light map",
           side + 1, side + 1, bytes, counter(renderer, "tile_bytes_a_sample"), textures / 1024, ceiling_kib,
           (unsigned long long)f.wrong, (unsigned long long)f.ground, late, frames, made_s,
           stats.prepare_ms / 1000);
    assert_true(stats.prepare_ms > 0 && bytes < 2.5);
    assert_true(textures <= ceiling_kib * 1024);
    assert_true(f.ground > 0);
    assert_int_equal(f.wrong, 0);
    path_destroy(flown);
    geomipmap_renderer.destroy(renderer);
    gpu_target_finish(&f.shaded);
    gpu_target_finish(&f.position);
    assert_int_equal(gpu_debug_errors(f.gpu), 0);
    gpu_destroy(f.gpu);
    free(f.colours);
    free(f.places);
    free(colour.pixels);
    terrain_destroy(terrain);
    folder_remove(NULL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(large_map_flies_within_its_bytes)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
