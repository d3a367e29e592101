// Tiles about the viewer: what they hold is at its texel, moves load what they expose and no more, budgets
// hold.  SPDX-License-Identifier: MIT
#include "tests/test.h"

#include "pgm/pgm_windows.h"

#include <string.h>

enum { MOST = 96 };

struct memory { // a tile's texels, each with the sample that was put there
    struct pgm_window *window;
    int64_t texels[MOST][MOST][2];
    uint64_t loaded;
    int64_t late_x; // samples from here on are not there yet
};

static bool is_there(void *user, const struct terrain_extent *samples)
{
    const struct memory *memory = user;
    return samples->x1 <= memory->late_x;
}

static void load(void *user, const struct terrain_extent *samples, int x, int y)
{
    struct memory *memory = user;
    assert_true(samples->x1 <= memory->late_x);
    const struct terrain_extent *held = &memory->window->held;
    assert_true(x >= 0 && y >= 0 && x + (samples->x1 - samples->x0) <= memory->window->width &&
                y + (samples->y1 - samples->y0) <= memory->window->height);
    bool apart = samples->x1 <= held->x0 || samples->x0 >= held->x1 || samples->y1 <= held->y0 ||
                 samples->y0 >= held->y1;
    assert_true(apart); // nothing is loaded twice
    for (int64_t j = samples->y0; j < samples->y1; j++)
        for (int64_t i = samples->x0; i < samples->x1; i++) {
            int64_t *texel = memory->texels[y + (j - samples->y0)][x + (i - samples->x0)];
            texel[0] = i, texel[1] = j;
            memory->loaded++;
        }
}

static void follow(struct memory *memory, const int64_t eye[2], uint64_t *budget)
{
    const struct pgm_loader loader = {memory, is_there, load};
    pgm_window_follow(memory->window, eye, budget, &loader);
}

static struct memory *make_memory(struct pgm_window *window, int64_t first, int64_t extent, int side)
{
    struct memory *memory = calloc(1, sizeof *memory);
    assert_non_null(memory);
    *window = (struct pgm_window){.extent = {first, -first, first + extent, -first + extent / 2 + 1}};
    window->width = extent < side ? (int)extent : side;
    window->height = extent / 2 + 1 < side ? (int)(extent / 2 + 1) : side;
    memory->window = window;
    memory->late_x = INT64_MAX;
    return memory;
}

static int64_t area(const struct terrain_extent *box)
{
    return box->x1 <= box->x0 || box->y1 <= box->y0 ? 0 : (box->x1 - box->x0) * (box->y1 - box->y0);
}

// Every held sample is where the vertex program looks for it.
static void check_texels(const struct memory *memory)
{
    const struct pgm_window *window = memory->window;
    int64_t origin[2];
    pgm_window_origin(window, origin);
    for (int64_t j = window->held.y0; j < window->held.y1; j++)
        for (int64_t i = window->held.x0; i < window->held.x1; i++) {
            int64_t x = i - origin[0], y = j - origin[1];
            assert_true(x >= 0 && x < 2 * window->width && y >= 0 && y < 2 * window->height);
            if (x >= window->width) x -= window->width;
            if (y >= window->height) y -= window->height;
            assert_true(memory->texels[y][x][0] == i && memory->texels[y][x][1] == j);
        }
}

static void step_eye(uint64_t *seed, const struct terrain_extent *extent, int64_t eye[2])
{
    for (int axis = 0; axis < 2; axis++) eye[axis] += (int64_t)(test_random(seed) % 7) - 3;
    if (test_random(seed) % 50 == 0) { // teleport, also off the map
        eye[0] = extent->x0 + (int64_t)(test_random(seed) % 600) - 100;
        eye[1] = extent->y0 + (int64_t)(test_random(seed) % 400) - 100;
    }
}

static void test_walks_keep_texels_and_budgets(void **state)
{
    (void)state;
    uint64_t seed = 21;
    static const int64_t firsts[] = {0, -777, 10000000000};
    static const int sides[] = {1, 16, 61, 96};
    for (size_t f = 0; f < 3; f++)
        for (size_t s = 0; s < 4; s++) {
            struct pgm_window window;
            struct memory *memory = make_memory(&window, firsts[f], 400, sides[s]);
            int64_t eye[2] = {firsts[f] + 200, -firsts[f] + 100};
            for (int step = 0; step < test_size(400, 20000); step++) {
                uint64_t granted = (uint64_t)sides[s] + test_random(&seed) % 500, budget = granted;
                memory->loaded = 0;
                step_eye(&seed, &window.extent, eye);
                bool late = test_random(&seed) % 3 == 0;
                memory->late_x = late ? eye[0] + (int64_t)(test_random(&seed) % 100) - 50 : INT64_MAX;
                follow(memory, eye, &budget);
                assert_true(memory->loaded <= granted && budget == granted - memory->loaded);
                assert_true(area(&window.held) == 0 ||
                            (window.held.x0 >= window.tile.x0 && window.held.x1 <= window.tile.x1 &&
                             window.held.y0 >= window.tile.y0 && window.held.y1 <= window.tile.y1));
                check_texels(memory);
            }
            memory->late_x = INT64_MAX;
            // At rest, each frame that is granted a line of the tile brings at least one sample.
            int64_t frames = 0, missing = area(&window.tile) - area(&window.held);
            for (; area(&window.held) < area(&window.tile); frames++) {
                uint64_t budget = (uint64_t)sides[s];
                assert_true(frames <= missing);
                follow(memory, eye, &budget);
            }
            check_texels(memory);
            free(memory);
        }
}

static void test_moves_load_an_l(void **state)
{
    (void)state;
    struct pgm_window window;
    struct memory *memory = make_memory(&window, -50, 500, 64);
    int64_t eye[2] = {150, 170};
    uint64_t budget = UINT64_MAX;
    follow(memory, eye, &budget);
    assert_true(memory->loaded == 64 * 64);
    eye[0] += 40, eye[1] -= 30; // the slack is used up once
    follow(memory, eye, &budget);
    for (int move = 1; move < 8; move++) {
        memory->loaded = 0;
        eye[0] += move, eye[1] -= 3;
        follow(memory, eye, &budget);
        assert_true(memory->loaded == (uint64_t)(64 * 64 - (64 - move) * (64 - 3)));
    }
    memory->loaded = 0;
    for (int swing = 0; swing < 100; swing++) { // about a sample, by less than the slack
        int64_t there[2] = {eye[0] - swing % 3, eye[1] + swing % 2};
        follow(memory, there, &budget);
    }
    assert_true(memory->loaded == 0);
    free(memory);
}

// What is there is loaded though more, nearer to the viewer, is not.
static void test_late_samples_hold_nothing_else_up(void **state)
{
    (void)state;
    struct pgm_window window;
    struct memory *memory = make_memory(&window, 0, 500, 64);
    const int64_t eye[2] = {200, 0};
    memory->late_x = 201; // the tile is 168 .. 232, against the south edge
    for (int frame = 0; frame < 3; frame++) {
        uint64_t budget = UINT64_MAX;
        follow(memory, eye, &budget);
        assert_true(window.held.x0 == window.tile.x0 && window.held.x1 == 201);
        assert_true(area(&window.held) == 33 * 64 && memory->loaded == 33 * 64);
    }
    memory->late_x = INT64_MAX;
    uint64_t budget = UINT64_MAX;
    follow(memory, eye, &budget);
    assert_true(memory->loaded == 64 * 64);
    check_texels(memory);
    free(memory);
}

static void test_whole_levels_are_loaded_once(void **state)
{
    (void)state;
    struct pgm_window window;
    struct memory *memory = make_memory(&window, 7, 60, 64);
    assert_true(pgm_window_is_whole(&window));
    for (int64_t step = 0; step < 50; step++) {
        uint64_t budget = UINT64_MAX;
        const int64_t eye[2] = {7 * step - 100, 31 - step * step};
        follow(memory, eye, &budget);
        assert_true(memory->loaded == 60 * 31 && area(&window.held) == 60 * 31 &&
                    pgm_window_is_full(&window));
    }
    check_texels(memory);
    // Whatever lies off the map repeats its edge, which is there.
    const int64_t from[2] = {-1000000, -1000000}, to[2] = {1000000, 1000000};
    assert_true(pgm_window_holds(&window, from, to));
    free(memory);
}

static void test_holds_what_is_held(void **state)
{
    (void)state;
    struct pgm_window window;
    struct memory *memory = make_memory(&window, 0, 300, 32);
    uint64_t budget = UINT64_MAX, seed = 4, held = 0;
    const int64_t eye[2] = {5, 80};
    const int64_t anywhere[2] = {5, 80};
    assert_false(pgm_window_holds(&window, anywhere, anywhere));
    follow(memory, eye, &budget); // against the west edge of the map
    for (int k = 0; k < 20000; k++) {
        int64_t from[2], to[2];
        bool expected = true;
        for (int axis = 0; axis < 2; axis++) {
            from[axis] = (int64_t)(test_random(&seed) % 200) - 40;
            to[axis] = from[axis] + (int64_t)(test_random(&seed) % 30);
        }
        for (int64_t j = from[1]; j <= to[1]; j++)
            for (int64_t i = from[0]; i <= to[0]; i++) {
                int64_t x = i < 0 ? 0 : i > 299 ? 299 : i, y = j < 0 ? 0 : j > 150 ? 150 : j;
                expected = expected && x >= window.held.x0 && x < window.held.x1 && y >= window.held.y0 &&
                           y < window.held.y1;
            }
        assert_true(pgm_window_holds(&window, from, to) == expected);
        held += expected;
    }
    assert_true(held > 100);
    free(memory);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_walks_keep_texels_and_budgets),
        cmocka_unit_test(test_moves_load_an_l),
        cmocka_unit_test(test_late_samples_hold_nothing_else_up),
        cmocka_unit_test(test_whole_levels_are_loaded_once),
        cmocka_unit_test(test_holds_what_is_held),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
