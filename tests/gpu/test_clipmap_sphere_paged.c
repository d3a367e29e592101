// A clipmap over a planet on disk, whose samples arrive late: watertight in every frame, the same for the
// same flight whatever the threads, and at rest what waiting gives. SPDX-License-Identifier: MIT
#include "tests/gpu/test_clipmap_late.h"

#include "tests/planet.h"

static int pack_planet(void **state)
{
    if (folder_create(state)) return -1;
    test_planet_pack(2880, 2500, 19, 4, in_folder("planet.relief"));
    return setup(state);
}

static int remove_planet(void **state)
{
    return teardown(state) | folder_remove(state);
}

// Four blocks arrive a frame, three frames late; or all of them, when asked for.
static struct terrain *load(int workers, bool wait)
{
    const struct terrain_options options = {.cache_bytes = 16 << 20,
                                            .frame_samples = wait ? -1 : 4 * 128 * 128,
                                            .latency_frames = 3,
                                            .workers = workers,
                                            .synthesize_levels = 3,
                                            .seed = 5};
    struct terrain *terrain = terrain_load(in_folder("planet.relief"), &options);
    assert_non_null(terrain);
    assert_null(terrain_extrema(terrain)); // read on demand
    return terrain;
}

static struct terrain *load_late(int workers)
{
    return load(workers, false);
}

// Jumps from place to place, poles and the seam among them, and waits each time until all is there: in every
// frame nothing is dropped, and in the end the picture is that of a renderer that waited all along.
static void late_samples_leave_no_holes(void **state)
{
    struct fixture *f = *state;
    static const char *const settings[] = {"n=63", "n=31 budget=9000"};
    for (int s = 0; s < 2; s++) {
        struct terrain *late = load(2, false), *whole = load(1, true);
        struct renderer *renderer = create(f, late, settings[s]), *other = create(f, whole, settings[s]);
        struct tally tally = {.frames = 0};
        uint64_t seed = 61;
        int jumps = test_size(4, 100);
        for (int i = 0, frame = 0; i < jumps; i++) {
            struct camera camera = {
                .eye_m = {i % 2 ? M_PI * RADIUS : test_uniform(&seed, -M_PI, M_PI) * RADIUS,
                          (i % 4 == 2 ? M_PI / 2 : asin(test_uniform(&seed, -1, 1))) * RADIUS,
                          4000 + exp(test_uniform(&seed, log(50), log(2e6)))},
                .yaw = test_uniform(&seed, -4, 4),
                .pitch = test_uniform(&seed, -1.2, 0.1),
                .fov_vertical = 1};
            struct view view;
            view_init(&view, late, &camera, WIDTH, HEIGHT, 0);
            bool behind = true;
            for (int wait = 0; behind || wait < 2; wait++, frame++) {
                assert_true(wait < 600); // it catches up
                update_frame(renderer, frame, &view);
                update_frame(other, frame, &view);
                behind = counter(renderer, "levels_behind") > 0;
                tally.frames++;
                tally.behind += behind;
                if (wait % 8 < 2) count_drops(f, renderer, late, &view, &tally.drops);
            }
            draw_chosen(f, renderer, late, &view);
            uint64_t arrived = picture_hash(f);
            draw_chosen(f, other, whole, &view);
            assert_int_equal(arrived, picture_hash(f));
        }
        FIGURE("%s: %lu frames, %lu behind, %lu looked at: %lu and %lu pixels dropped", settings[s],
               tally.frames, tally.behind, tally.drops.views, tally.drops.position, tally.drops.depth);
        assert_int_equal(tally.drops.position + tally.drops.depth, 0);
        assert_true(tally.behind > 0);
        clipmap_renderer.destroy(renderer);
        clipmap_renderer.destroy(other);
        terrain_destroy(late);
        terrain_destroy(whole);
    }
}

// Over the seam, then a jump.
static void look(const struct terrain *terrain, int frame, struct view *view)
{
    double east = (frame < 20 ? M_PI : 1) * RADIUS + (frame - 10) * 4000;
    struct camera camera = {
        .eye_m = {east, 0.5 * RADIUS, 9000}, .yaw = 0.4, .pitch = -0.3, .fov_vertical = 1};
    view_init(view, terrain, &camera, WIDTH, HEIGHT, 0);
}

static void a_flight_repeats(void **state)
{
    assert_late_flight_repeats(
        *state, &(struct late_flight){.settings = "n=63", .load = load_late, .look = look, .frames = 40});
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(late_samples_leave_no_holes),
        cmocka_unit_test(a_flight_repeats),
    };
    return cmocka_run_group_tests(tests, pack_planet, remove_planet);
}
