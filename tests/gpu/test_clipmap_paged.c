// A clipmap over a map on disk, whose samples arrive late: watertight in every frame, the same for the same
// flight whatever the threads, and at rest what waiting gives.  SPDX-License-Identifier: MIT
#include "tests/gpu/test_clipmap_late.h"

#include "common/terrain/relief/relief_pack.h"

static const struct scene_effects own_effects = {.shading = SCENE_SHADING_OWN};

static int pack_hills(void **state)
{
    struct heightfield field = {.name = "hills",
                                .width = (int)hills.width,
                                .height = (int)hills.height,
                                .spacing_m = {hills.spacing_m[0], hills.spacing_m[1]},
                                .quantum_m = hills.quantum_m,
                                .samples = malloc((size_t)(hills.width * hills.height) * sizeof(int32_t))};
    const struct relief_pack_options options = {.layout = LAYOUT_BOUNDED, .max_m = 1};
    struct relief_header header;
    if (folder_create(state) || !field.samples) return -1;
    for (int64_t i = 0; i < hills.width * hills.height; i++)
        field.samples[i] = test_fractal(i % hills.width, i / hills.width, hills.rough, hills.seed);
    bool good = relief_pack(&field, &options, in_folder("hills.relief"), &header);
    heightfield_finish(&field);
    return good ? setup(state) : -1;
}

static int remove_hills(void **state)
{
    return teardown(state) | folder_remove(state);
}

// One or two blocks arrive a frame, three frames late.
static struct terrain *load(int workers)
{
    const struct terrain_options options = {
        .cache_bytes = 4 << 20, .frame_samples = 2 * 128 * 128, .latency_frames = 3, .workers = workers};
    struct terrain *terrain = terrain_load(in_folder("hills.relief"), &options);
    assert_non_null(terrain);
    assert_null(terrain_extrema(terrain)); // read on demand
    return terrain;
}

static struct renderer *create_shading(const struct fixture *f, const struct terrain *terrain, bool own,
                                       const char *settings)
{
    struct renderer_desc desc = {.gpu = f->gpu,
                                 .terrain = terrain,
                                 .effects = own ? &own_effects : &effects,
                                 .width = WIDTH,
                                 .height = HEIGHT};
    return create_with(&clipmap_renderer, desc, settings);
}

static uint64_t shaded_hash(struct fixture *f, struct gpu_target *target, struct renderer *renderer,
                            const struct terrain *terrain, const struct view *view)
{
    gpu_set_view(f->gpu, terrain, view);
    gpu_target_begin(f->gpu, target);
    clipmap_renderer.draw(renderer, 0, PASS_SHADED);
    gpu_target_read(f->gpu, target, f->pixels);
    return hash(1, f->pixels, PIXELS * 4);
}

// Jumps over the map, waits each time until all is there, and compares with a flight that begins there.
static void jumps(struct fixture *f, bool own, const char *settings, int count, struct tally *tally)
{
    struct terrain *terrain = load(2);
    struct renderer *renderer = create_shading(f, terrain, own, settings);
    struct gpu_target target;
    assert_true(gpu_target_init(f->gpu, &target, WIDTH, HEIGHT, GL_RGBA8));
    uint64_t seed = 51;
    for (int i = 0, frame = 0; i < count; i++) {
        struct view view = view_over(terrain, &seed, 2, 2000);
        bool behind = true;
        for (int wait = 0; behind || wait < 2; wait++) {
            assert_true(wait < 300); // it catches up
            update_frame(renderer, frame++, &view);
            behind = counter(renderer, "levels_behind") > 0;
            tally->frames++;
            tally->behind += behind;
            count_drops(f, renderer, terrain, &view, &tally->drops);
        }
        struct renderer *fresh = create_shading(f, terrain, own, settings);
        update_frame(fresh, 0, &view);
        assert_true(counter(fresh, "levels_behind") == 0); // the first frame waits
        assert_int_equal(shaded_hash(f, &target, renderer, terrain, &view),
                         shaded_hash(f, &target, fresh, terrain, &view));
        clipmap_renderer.destroy(fresh);
    }
    gpu_target_finish(&target);
    clipmap_renderer.destroy(renderer);
    terrain_destroy(terrain);
}

static void late_samples_leave_no_holes(void **state)
{
    struct fixture *f = *state;
    static const char *const settings[] = {"n=31", "n=127", "n=63 budget=3000", "n=63 regions=frustum"};
    for (int s = 0; s < 8; s++) {
        struct tally tally = {.frames = 0};
        jumps(f, s >= 4, settings[s % 4], test_size(2, 100), &tally);
        FIGURE("%s, shading %s: %lu frames, %lu behind: %lu and %lu pixels dropped; at rest as if waited for",
               settings[s % 4], s >= 4 ? "own" : "common", tally.frames, tally.behind, tally.drops.position,
               tally.drops.depth);
        assert_int_equal(tally.drops.position + tally.drops.depth, 0);
        assert_true(tally.behind > 0);
    }
}

// What is read ahead serves but for the jump.
static void look(const struct terrain *terrain, int frame, struct view *view)
{
    const struct camera camera = {.eye_m = {-9000, 5000, 300}, .yaw = 0.4, .pitch = -0.3, .fov_vertical = 1};
    int64_t cells = 3 * (frame + 1) + (frame < 30 ? 0 : 397);
    view_init(view, terrain, &camera, WIDTH, HEIGHT, 0);
    view->eye_lattice[0] += cells << view->lattice_bits;
    view->eye_m[0] += (double)cells * hills.spacing_m[0];
}

static void a_flight_repeats(void **state)
{
    assert_late_flight_repeats(
        *state, &(struct late_flight){.settings = "n=127", .load = load, .look = look, .frames = 60});
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(late_samples_leave_no_holes),
        cmocka_unit_test(a_flight_repeats),
    };
    return cmocka_run_group_tests(tests, pack_hills, remove_hills);
}
