// Terrain that is read on demand under persistent grid mapping: late samples show coarser ground, never none;
// what is shown follows from frame numbers; at rest it is what it would be had everything been there.
// SPDX-License-Identifier: MIT
#include "tests/folder.h"
#include "tests/gpu/test_pgm.h"

#include "common/terrain/paged.h"
#include "common/terrain/relief/relief_pack.h"

enum { WIDTH = 1100, HEIGHT = 900, FRAMES = 24 };

struct fixture {
    struct gpu *gpu;
    struct terrain *terrain;
    struct truth_surface *surface;
};

static int32_t hilly_height(int i, int j)
{
    double x = i * 0.049, y = j * 0.043;
    double hills = sin(x) * cos(1.3 * y) + 0.5 * sin(2.7 * x + 1) * sin(2.3 * y) + 0.2 * cos(7 * x - 5 * y);
    return (int32_t)lrint(1200 * hills * fabs(hills));
}

static int start(void **state)
{
    static struct fixture f;
    struct heightfield field = {.name = "made",
                                .width = WIDTH,
                                .height = HEIGHT,
                                .spacing_m = {30, 30},
                                .quantum_m = 0.5,
                                .samples = malloc((size_t)WIDTH * HEIGHT * sizeof(int32_t))};
    if (folder_create(NULL) || !field.samples) return -1;
    for (int i = 0; i < WIDTH * HEIGHT; i++) field.samples[i] = hilly_height(i % WIDTH, i / WIDTH);
    struct relief_pack_options options = {.layout = LAYOUT_BOUNDED, .max_m = 1};
    struct relief_header header;
    bool packed = relief_pack(&field, &options, in_folder("hills.relief"), &header);
    heightfield_finish(&field);
    // Two blocks a frame, three frames late, and a fraction of the map kept.
    f.terrain =
        packed ? terrain_load(in_folder("hills.relief"),
                              &(struct terrain_options){.cache_bytes = 64 * PAGED_BLOCK * PAGED_BLOCK * 4,
                                                        .frame_samples = 2 * PAGED_BLOCK * PAGED_BLOCK,
                                                        .latency_frames = 3})
               : NULL;
    f.surface = f.terrain ? truth_surface_create(f.terrain) : NULL;
    f.gpu = gpu_create(GPU_OFFSCREEN, 0, 0, "test", -1);
    *state = &f;
    return f.gpu && f.surface ? 0 : -1;
}

static int stop(void **state)
{
    struct fixture *f = *state;
    truth_surface_destroy(f->surface);
    terrain_destroy(f->terrain);
    gpu_destroy(f->gpu);
    return folder_remove(NULL);
}

static struct view view_at(const struct terrain *terrain, int frame)
{
    double along = (double)(frame % FRAMES) / FRAMES; // across the map, then a jump back
    const double eye[3] = {3000 + 26000 * along, 4000 + 16000 * along * along, 1300 + 200 * sin(9 * along)};
    return make_view(terrain, eye, 35 + 60 * along, -25, 4, 60, 160, 120);
}

static void update(struct renderer *renderer, int frame, const struct view *view)
{
    renderer->type->begin_frame(renderer, frame);
    assert_true(renderer->type->update(renderer, view, 1));
}

static void *depths(const struct fixture *f, struct renderer *renderer, const struct view *view)
{
    struct gpu_target target;
    void *pixels = malloc((size_t)view->width * (size_t)view->height * sizeof(float));
    assert_true(pixels && gpu_target_init(f->gpu, &target, view->width, view->height, 0));
    gpu_set_view(f->gpu, f->terrain, view);
    gpu_target_begin(f->gpu, &target);
    renderer->type->draw(renderer, 0, PASS_DEPTH);
    gpu_target_read(f->gpu, &target, pixels);
    gpu_target_finish(&target);
    return pixels;
}

static uint64_t hash(uint64_t so_far, const void *bytes, size_t count)
{
    for (size_t i = 0; i < count; i++) so_far = (so_far ^ ((const uint8_t *)bytes)[i]) * 0x100000001b3u;
    return so_far;
}

// Ground pixels that no triangle covers.
static uint64_t bare_pixels(const struct fixture *f, struct renderer *renderer, const struct view *view,
                            uint64_t *ground)
{
    struct truth truth;
    struct gpu_target target; // a draw needs one
    assert_true(truth_init(&truth, view->width, view->height));
    truth_cast(&truth, f->surface, view, 0);
    struct places *hits = truth_places(&truth, 0);
    assert_true(hits && gpu_target_init(f->gpu, &target, view->width, view->height, GL_RGBA32F));
    gpu_set_view(f->gpu, f->terrain, view);
    gpu_target_begin(f->gpu, &target);
    assert_true(gpu_capture_begin(f->gpu, places_feed, hits));
    renderer->type->draw(renderer, 0, PASS_POSITION);
    gpu_capture_end(f->gpu);
    gpu_target_finish(&target);
    uint64_t bare = 0;
    double low, high;
    for (uint64_t hit = 0; hit < truth.ground; hit++) bare += !places_height(hits, hit, &low, &high);
    *ground += truth.ground;
    places_destroy(hits);
    truth_finish(&truth);
    return bare;
}

struct flight {
    uint64_t hash, bare, ground;
    int late, coarser; // frames
};

static struct flight fly(const struct fixture *f, struct renderer *renderer, bool look)
{
    struct flight flight = {.hash = 0xcbf29ce484222325u};
    for (int frame = 0; frame < test_size(1, 4) * FRAMES; frame++) {
        struct view view = view_at(f->terrain, frame);
        update(renderer, frame, &view);
        flight.late += counter(renderer, "windows_late") > 0;
        flight.coarser += counter(renderer, "rows_coarsened") > 0;
        if (look) flight.bare += bare_pixels(f, renderer, &view, &flight.ground);
        void *picture = depths(f, renderer, &view);
        flight.hash = hash(flight.hash, picture, (size_t)view.width * (size_t)view.height * sizeof(float));
        free(picture);
    }
    return flight;
}

static const char *const forms[] = {"rows=300 memory=0", "rows=300 memory=0.5",
                                    "rows=300 fetch=packed memory=6", "rows=300 textures=many memory=0.5"};
enum { FORMS = sizeof forms / sizeof *forms };

static void test_late_samples_leave_nothing_bare(void **state)
{
    const struct fixture *f = *state;
    for (int k = 0; k < FORMS; k++) {
        struct renderer *renderer = make_pgm(f->gpu, f->terrain, forms[k]);
        struct flight first = fly(f, renderer, true);
        pgm_renderer.destroy(renderer);
        renderer = make_pgm(f->gpu, f->terrain, forms[k]); // samples are decoded by now, but not due
        struct flight again = fly(f, renderer, false);
        pgm_renderer.destroy(renderer);
        FIGURE("%s: windows late in %d, rows coarser in %d of %d frames; %lu of %lu ground pixels uncovered",
               forms[k], first.late, first.coarser, test_size(1, 4) * FRAMES, first.bare, first.ground);
        assert_true(first.bare == 0 && first.ground > 10000 && first.late > 0 && first.coarser > 0);
        assert_true(again.hash == first.hash && again.late == first.late && again.coarser == first.coarser);
    }
}

static struct renderer *rest(const struct fixture *f, const char *options, const struct view *view)
{
    struct renderer *renderer = make_pgm(f->gpu, f->terrain, options);
    int quiet = 0;
    for (int frame = 0; quiet < 20; frame++) {
        assert_true(frame < 2000);
        update(renderer, frame, view);
        quiet = counter(renderer, "windows_late") + counter(renderer, "refilled_bytes") > 0 ? 0 : quiet + 1;
    }
    return renderer;
}

// Whatever the form: the same heights where tiles reach as far as rows ask, so the same picture.
static void test_at_rest_all_is_there(void **state)
{
    const struct fixture *f = *state;
    static const char *const held[] = {"rows=300 memory=0", "rows=300 memory=1.5",
                                       "rows=300 textures=many memory=1.5"};
    int compared = 0;
    for (int place = 0; place < test_size(2, 8); place++) {
        struct view view = view_at(f->terrain, 5 + 7 * place);
        void *pictures[3];
        bool reaches[3];
        for (int k = 0; k < 3; k++) {
            struct renderer *renderer = rest(f, held[k], &view);
            pictures[k] = depths(f, renderer, &view);
            reaches[k] = counter(renderer, "rows_coarsened") == 0;
            assert_true(k == 0 ? reaches[k] : counter(renderer, "tile_side") < HEIGHT);
            pgm_renderer.destroy(renderer);
        }
        for (int k = 1; k < 3; k++) {
            if (!reaches[k]) continue;
            assert_memory_equal(pictures[k], pictures[0], (size_t)view.width * (size_t)view.height * 4);
            compared++;
        }
        for (int k = 0; k < 3; k++) free(pictures[k]);
    }
    FIGURE("at rest: %d pictures from tiles are those of whole levels", compared);
    assert_true(compared >= 4 && gpu_debug_errors(f->gpu) == 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_late_samples_leave_nothing_bare),
        cmocka_unit_test(test_at_rest_all_is_there),
    };
    return cmocka_run_group_tests(tests, start, stop);
}
