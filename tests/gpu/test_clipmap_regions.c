// What of the levels is kept and drawn, as drawn: a budget, throttled, ahead of the motion.  Watertight
// always. SPDX-License-Identifier: MIT
#include "tests/gpu/test_clipmap.h"

static const int sizes[] = {15, 31, 63, 127, 255, 511};
enum { SIZES = sizeof sizes / sizeof *sizes };

static uint64_t triangles(const struct renderer *renderer)
{
    struct renderer_stats stats;
    clipmap_renderer.stats(renderer, &stats);
    return stats.triangles;
}

enum { VIEWS_A_SIZE = 334 }; // at full size: 2,000 over the six sizes

// ---- budget: B3, B8 --------------------------------------------------------

struct tally {
    struct drops drops;
    uint64_t frames_behind, most_samples, triangles_behind, triangles_there;
};

// Teleports from view to view; every frame is looked at until the levels have caught up.
static void teleport(struct fixture *f, const struct terrain *terrain, int n, int views, struct tally *tally)
{
    int budget = n * n / 3, frame = 0; // levels are seen in part
    char settings[64];
    snprintf(settings, sizeof settings, "n=%d cull=off budget=%d", n, budget);
    struct renderer *renderer = create(f, terrain, settings);
    uint64_t seed = 8;
    for (int i = 0; i < views; i++) {
        struct view view = view_over(terrain, &seed, 2, 3000);
        uint64_t before = 0;
        for (double behind = 1; behind > 0;) {
            update_frame(renderer, frame++, &view);
            behind = counter(renderer, "levels_behind");
            // The first frame of a flight reads everything.
            assert_true(frame == 1 || counter(renderer, "samples_updated") <= budget);
            assert_true(triangles(renderer) >= before); // the finer levels add to it
            before = triangles(renderer);
            if (behind > 0) tally->triangles_behind += before, tally->frames_behind++;
            count_drops(f, renderer, terrain, &view, &tally->drops);
        }
        tally->triangles_there += before;
    }
    clipmap_renderer.destroy(renderer);
}

static void budgeted_frames_have_no_holes(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = test_terrain(&hills);
    for (int s = 0; s < SIZES; s++) {
        struct tally tally = {.frames_behind = 0};
        int views = test_size(2, VIEWS_A_SIZE);
        teleport(f, terrain, sizes[s], views, &tally);
        FIGURE(
            "budget, n=%d: %d views, %lu frames, %lu behind: %lu and %lu pixels dropped; behind, %.2f of the "
            "triangles",
            sizes[s], views, tally.drops.views, tally.frames_behind, tally.drops.position, tally.drops.depth,
            (double)tally.triangles_behind / (double)tally.frames_behind /
                ((double)tally.triangles_there / views));
        assert_int_equal(tally.drops.position + tally.drops.depth, 0);
        assert_true(tally.frames_behind > 0);
    }
    terrain_destroy(terrain);
}

// One way over the map, the faster the fewer frames.
static struct view on_the_way(const struct terrain *terrain, double t)
{
    const double *o = terrain_info(terrain)->outline_m;
    struct camera camera = {
        .eye_m = {o[0] + (o[2] - o[0]) * (0.1 + 0.8 * t), o[1] + (o[3] - o[1]) * (0.2 + 0.5 * t), 0},
        .yaw = 0.4,
        .pitch = -0.2,
        .fov_vertical = 1};
    double ground_q = 0;
    assert_true(terrain_truth_at(terrain, camera.eye_m[0], camera.eye_m[1], &ground_q, NULL));
    camera.eye_m[2] = ground_q * hills.quantum_m + 60;
    struct view view;
    view_init(&view, terrain, &camera, WIDTH, HEIGHT, 0);
    return view;
}

// Triangles drawn a frame, on the mean over a flight; what each frame draws goes into *sum.
static double mean_triangles(struct fixture *f, struct renderer *renderer, const struct terrain *terrain,
                             int frames, uint64_t *sum)
{
    double mean = 0;
    for (int frame = 0; frame < frames; frame++) {
        struct view view = on_the_way(terrain, (double)frame / frames);
        for (int again = 0; again < 1 + frame % 2; again++)
            update_frame(renderer, frame, &view); // spends nothing more
        capture_chosen(f, renderer, terrain, &view, hash_triangles, sum);
        mean += (double)triangles(renderer) / frames;
    }
    return mean;
}

static void faster_flights_draw_less(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = test_terrain(&hills);
    static const int frames[] = {200, 50, 15};
    double before = INFINITY;
    struct renderer *other = create(f, terrain, "n=31 cull=off budget=400");
    for (int i = 0; i < 3; i++) {
        struct renderer *renderer = create(f, terrain, "n=31 cull=off budget=400");
        uint64_t first = 1, second = 1, elsewhere = 1;
        double mean = mean_triangles(f, renderer, terrain, frames[i], &first);
        mean_triangles(f, renderer, terrain, frames[i], &second);
        mean_triangles(f, other, terrain, frames[i], &elsewhere); // it has flown differently before
        FIGURE("budget, n=31: over the map in %d frames: %.0f triangles a frame", frames[i], mean);
        assert_int_equal(first, second);
        assert_int_equal(first, elsewhere);
        assert_true(mean < before);
        before = mean;
        clipmap_renderer.destroy(renderer);
    }
    clipmap_renderer.destroy(other);
    terrain_destroy(terrain);
}

static void budgets_that_do_not_serve_are_refused(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = test_terrain(&hills);
    struct renderer_desc desc = {
        .gpu = f->gpu, .terrain = terrain, .effects = &effects, .width = WIDTH, .height = HEIGHT};
    renderer_default_knobs(&clipmap_renderer, desc.knobs);
    desc.knobs[renderer_knob_index(&clipmap_renderer, "budget")] = 100;
    assert_null(clipmap_renderer.create(&desc));
    terrain_destroy(terrain);
}

// ---- throttled -------------------------------------------------------------

static int throttled_side(int n, double share)
{
    int side = (int)(n * sqrt(share));
    side -= side % 2 == 0;
    return side < 11 ? 11 : side;
}

// Of levels of n x n vertices: rings about the next finer level but for the finest, and at most n x n in the
// coarsest; one more for each coarse edge round a hole.
static double most_triangles(int n, double levels)
{
    return (n - 1) * (n - 1) * (2 + 1.5 * (levels - 2) + 2) + 2 * (n - 1) * levels;
}

// From just above the middle of the map, where no level is switched off and none ends at the map's edge.
static struct view view_in_the_middle(const struct terrain *terrain, uint64_t *seed)
{
    struct view view;
    do view = view_over(terrain, seed, 1, 10);
    while (fabs(view.eye_m[0] - 3360) > 1000 || fabs(view.eye_m[1] - 2475) > 1000);
    return view;
}

static double throttled(struct fixture *f, const struct terrain *terrain, int n, double share, int views,
                        double *levels, struct drops *drops)
{
    char settings[64];
    snprintf(settings, sizeof settings, "n=%d cull=off throttle=%g", n, share);
    struct renderer *renderer = create(f, terrain, settings);
    uint64_t seed = 21;
    double mean = 0;
    for (int i = 0; i < views; i++) {
        struct view view = view_in_the_middle(terrain, &seed);
        update(renderer, &view);
        mean += (double)triangles(renderer) / views;
        *levels = counter(renderer, "levels");
        count_drops(f, renderer, terrain, &view, drops);
    }
    clipmap_renderer.destroy(renderer);
    return mean;
}

static void throttled_levels_draw_less(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = test_terrain(&hills);
    static const double shares[] = {1, 0.5, 0.25};
    for (int s = 0; s < SIZES; s++) {
        int n = sizes[s], views = test_size(n < 100 ? 3 : 1, VIEWS_A_SIZE);
        double mean[3], levels[3];
        struct drops drops = {0, 0, 0};
        for (int t = 0; t < 3; t++) mean[t] = throttled(f, terrain, n, shares[t], views, &levels[t], &drops);
        FIGURE(
            "throttle, n=%d: 1/2 of the samples: %.2f of the triangles, 1/4: %.2f (levels: %g, %g, %g); %lu "
            "pixels dropped in %lu views",
            n, mean[1] / mean[0], mean[2] / mean[0], levels[0], levels[1], levels[2],
            drops.position + drops.depth, drops.views);
        assert_int_equal(drops.position + drops.depth, 0);
        for (int t = 1; t < 3; t++) {
            assert_true(mean[t] < mean[t - 1]);
            assert_true(mean[t] <= most_triangles(throttled_side(n, shares[t]), levels[t]));
        }
    }
    terrain_destroy(terrain);
}

// ---- ahead, fitted, a size for each level ----------------------------------

static void ahead_draws_the_same(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = test_terrain(&hills);
    struct renderer *renderers[] = {create(f, terrain, "n=31"), create(f, terrain, "n=31 ahead=16")};
    double read[2] = {0, 0};
    for (int frame = 0; frame < 200; frame++) {
        struct view view = on_the_way(terrain, frame / 200.0);
        uint64_t sums[2] = {1, 1};
        for (int r = 0; r < 2; r++) {
            update_frame(renderers[r], frame, &view);
            read[r] += counter(renderers[r], "levels_read");
            capture_chosen(f, renderers[r], terrain, &view, hash_triangles, &sums[r]);
        }
        assert_int_equal(sums[0], sums[1]);
    }
    FIGURE("ahead: %g refills in 200 frames, %g with 16 lines ahead; the same triangles", read[0], read[1]);
    assert_true(read[1] < read[0] / 2);
    for (int r = 0; r < 2; r++) clipmap_renderer.destroy(renderers[r]);
    terrain_destroy(terrain);
}

static void options_have_no_holes_and_cull_without_a_trace(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = test_terrain(&hills);
    static const char *const options[] = {"regions=frustum",
                                          "sizes=error",
                                          "sizes=mean",
                                          "ahead=8 throttle=0.5",
                                          "regions=frustum sizes=error throttle=0.5 ahead=4 stitch=zero-area",
                                          "regions=frustum sizes=mean throttle=0.5 ahead=4 layout=strips"};
    for (int o = 0; o < 6; o++) {
        struct drops drops = {0, 0, 0};
        int views = test_size(2, 125); // of each size
        for (int s = 0; s < 4; s++) {
            char settings[2][128];
            snprintf(settings[0], sizeof settings[0], "n=%d cull=on %s", sizes[s], options[o]);
            snprintf(settings[1], sizeof settings[1], "n=%d cull=off %s", sizes[s], options[o]);
            struct renderer *culled = create(f, terrain, settings[0]),
                            *whole = create(f, terrain, settings[1]);
            uint64_t seed = 33;
            for (int i = 0; i < views; i++) {
                struct view view = view_through(terrain, &seed, 2, 3000, 0.05, 1.2);
                draw(f, whole, terrain, &view);
                uint64_t without = picture_hash(f);
                update(culled, &view);
                count_drops(f, culled, terrain, &view, &drops);
                assert_int_equal(without, picture_hash(f));
            }
            clipmap_renderer.destroy(culled);
            clipmap_renderer.destroy(whole);
        }
        FIGURE("%s: %lu views alike with and without culling, %lu and %lu pixels dropped", options[o],
               drops.views, drops.position, drops.depth);
        assert_int_equal(drops.position, 0);
        if (!strstr(options[o], "zero-area")) assert_int_equal(drops.depth, 0);
    }
    terrain_destroy(terrain);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(budgeted_frames_have_no_holes),
        cmocka_unit_test(faster_flights_draw_less),
        cmocka_unit_test(throttled_levels_draw_less),
        cmocka_unit_test(ahead_draws_the_same),
        cmocka_unit_test(options_have_no_holes_and_cull_without_a_trace),
        cmocka_unit_test(budgets_that_do_not_serve_are_refused),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
