// A clipmap over samples that arrive late: what both test programs of it, of a plane and of a planet, share.
// SPDX-License-Identifier: MIT
#ifndef TESTS_GPU_TEST_CLIPMAP_LATE_H
#define TESTS_GPU_TEST_CLIPMAP_LATE_H

#include "tests/folder.h"
#include "tests/gpu/test_clipmap.h"

struct tally {
    struct drops drops;
    uint64_t frames, behind, sum; // sum: of all that is drawn
};

struct late_flight {
    const char *settings;
    struct terrain *(*load)(int workers);
    void (*look)(const struct terrain *terrain, int frame, struct view *view);
    int frames;
};

static inline void fly_late(struct fixture *f, const struct late_flight *flight, struct renderer *renderer,
                            const struct terrain *terrain, struct tally *tally)
{
    gpu_target_begin(f->gpu, &f->target);
    for (int frame = 0; frame < flight->frames; frame++) {
        struct view view;
        flight->look(terrain, frame, &view);
        update_frame(renderer, frame, &view);
        tally->behind += counter(renderer, "levels_behind") > 0;
        capture_chosen(f, renderer, terrain, &view, hash_triangles, &tally->sum);
    }
}

// Flown twice with one worker and once with three: the same triangles, some of the frames behind.
static inline void assert_late_flight_repeats(struct fixture *f, const struct late_flight *flight)
{
    struct tally tallies[3] = {{.sum = 1}, {.sum = 1}, {.sum = 1}};
    for (int workers = 1; workers <= 3; workers += 2) {
        struct terrain *terrain = flight->load(workers);
        struct renderer *renderer = create(f, terrain, flight->settings);
        fly_late(f, flight, renderer, terrain, &tallies[workers / 2]);
        if (workers == 1) fly_late(f, flight, renderer, terrain, &tallies[2]); // again
        clipmap_renderer.destroy(renderer);
        terrain_destroy(terrain);
    }
    FIGURE("a flight of %d frames, %lu of them behind: the same again and with three workers", flight->frames,
           tallies[0].behind);
    assert_int_equal(tallies[0].sum, tallies[1].sum);
    assert_int_equal(tallies[0].sum, tallies[2].sum);
    assert_true(tallies[0].behind > 0 && tallies[0].behind < (uint64_t)flight->frames);
}

#endif
