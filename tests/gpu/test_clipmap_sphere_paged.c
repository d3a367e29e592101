// A clipmap over a planet on disk, whose samples arrive late: watertight in every frame, the same for the
// same flight whatever the threads, and at rest what waiting gives. SPDX-License-Identifier: MIT
#include "tests/gpu/test_clipmap.h"

#include "common/terrain/relief/relief_pack.h"
#include "tests/folder.h"

enum { COLUMNS = 2880, ROWS = 1441 };
static const double RADIUS = 6371007;

static int pack_planet(void **state)
{
    struct heightfield field = {.name = "planet",
                                .width = COLUMNS,
                                .height = ROWS,
                                .spacing_m = {2 * M_PI * RADIUS / COLUMNS, 2 * M_PI * RADIUS / COLUMNS},
                                .quantum_m = 1,
                                .radius_m = RADIUS,
                                .samples = malloc((size_t)COLUMNS * ROWS * sizeof(int32_t))};
    const struct relief_pack_options options = {.layout = LAYOUT_BOUNDED, .max_m = 4};
    struct relief_header header;
    if (folder_create(state) || !field.samples) return -1;
    for (int k = 0; k < COLUMNS * ROWS; k++) {
        double longitude = 2 * M_PI * (k % COLUMNS) / COLUMNS,
               latitude = M_PI * (k / COLUMNS) / (ROWS - 1) - M_PI / 2;
        double x = cos(latitude) * cos(longitude), y = cos(latitude) * sin(longitude), z = sin(latitude);
        field.samples[k] = (int32_t)lrint(2500 * sin(9 * x + 2 * y) * cos(6 * z - y) +
                                          700 * sin(95 * x * y + 85 * z) * cos(78 * z - 60 * x));
    }
    bool good = relief_pack(&field, &options, in_folder("planet.relief"), &header);
    heightfield_finish(&field);
    return good ? setup(state) : -1;
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

static void next(struct renderer *renderer, int frame, const struct view *view)
{
    clipmap_renderer.begin_frame(renderer, frame);
    assert_true(clipmap_renderer.update(renderer, view, 1));
}

struct tally {
    struct drops drops;
    uint64_t frames, behind, sum; // sum: of all that is drawn
};

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
                next(renderer, frame, &view);
                next(other, frame, &view);
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

static void flight(struct fixture *f, struct renderer *renderer, const struct terrain *terrain,
                   struct tally *tally)
{
    for (int frame = 0; frame < 40; frame++) { // over the seam, then a jump
        double east = (frame < 20 ? M_PI : 1) * RADIUS + (frame - 10) * 4000;
        struct camera camera = {
            .eye_m = {east, 0.5 * RADIUS, 9000}, .yaw = 0.4, .pitch = -0.3, .fov_vertical = 1};
        struct view view;
        view_init(&view, terrain, &camera, WIDTH, HEIGHT, 0);
        next(renderer, frame, &view);
        tally->behind += counter(renderer, "levels_behind") > 0;
        capture_chosen(f, renderer, terrain, &view, hash_triangles, &tally->sum);
    }
}

static void a_flight_repeats(void **state)
{
    struct fixture *f = *state;
    struct tally tallies[3] = {{.sum = 1}, {.sum = 1}, {.sum = 1}};
    for (int workers = 1; workers <= 3; workers += 2) {
        struct terrain *terrain = load(workers, false);
        struct renderer *renderer = create(f, terrain, "n=63");
        flight(f, renderer, terrain, &tallies[workers / 2]);
        if (workers == 1) flight(f, renderer, terrain, &tallies[2]); // again
        clipmap_renderer.destroy(renderer);
        terrain_destroy(terrain);
    }
    FIGURE("a flight of 40 frames, %lu of them behind: the same again and with three workers",
           tallies[0].behind);
    assert_int_equal(tallies[0].sum, tallies[1].sum);
    assert_int_equal(tallies[0].sum, tallies[2].sum);
    assert_true(tallies[0].behind > 0 && tallies[0].behind < 40);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(late_samples_leave_no_holes),
        cmocka_unit_test(a_flight_repeats),
    };
    return cmocka_run_group_tests(tests, pack_planet, remove_planet);
}
