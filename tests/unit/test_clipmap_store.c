// The toroidal stores of the clipmap: contents, z_c and bounds.  The writer is memory instead of a texture.
// SPDX-License-Identifier: MIT
#include "clipmap/clipmap_store.h"
#include "tests/unit/test_clipmap.h"

#include <string.h>

static const struct test_map hills = {.width = 700,
                                      .height = 500,
                                      .first = {-301, -202},
                                      .spacing_m = {30, 25},
                                      .quantum_m = 0.1,
                                      .rough = 9,
                                      .seed = 11};

struct memory { // stands for a layer of the texture
    float (*slots)[2];
    uint16_t *writes; // since the step began
    int size;
};

static void write_memory(void *user, int slot_x, int slot_y, int width, int height, const float (*pairs)[2])
{
    struct memory *memory = user;
    assert_true(slot_x >= 0 && slot_y >= 0 && slot_x + width <= memory->size &&
                slot_y + height <= memory->size);
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            size_t slot = (size_t)(slot_y + y) * (size_t)memory->size + (size_t)(slot_x + x);
            memcpy(memory->slots[slot], pairs[y * width + x], sizeof memory->slots[slot]);
            memory->writes[slot]++;
        }
}

static void memory_init(struct memory *memory, int size)
{
    size_t count = (size_t)size * (size_t)size;
    *memory =
        (struct memory){malloc(count * sizeof *memory->slots), calloc(count, sizeof *memory->writes), size};
    assert_true(memory->slots && memory->writes);
    for (size_t i = 0; i < count; i++) memory->slots[i][0] = memory->slots[i][1] = NAN;
}

static void memory_finish(struct memory *memory)
{
    free(memory->slots);
    free(memory->writes);
}

static int32_t height_at(const struct terrain *terrain, int level, int64_t i, int64_t j)
{
    int32_t height;
    assert_true(terrain_window(terrain, level, i, j, 1, 1, &height, TERRAIN_WAIT));
    return height;
}

static struct clipmap_box square(int64_t x, int64_t y, int side)
{
    return (struct clipmap_box){{x, y}, {x + side - 1, y + side - 1}};
}

// ---- B4 --------------------------------------------------------------------

// Height of the next coarser level's surface, split along (i, j)-(i+1, j+1), from its definition, in double.
static double coarse_surface(const struct terrain *terrain, int level, int64_t i, int64_t j)
{
    int64_t a = clipmap_floor_div(i, 2), b = clipmap_floor_div(j, 2);
    double u = (double)(i - 2 * a) / 2, v = (double)(j - 2 * b) / 2;
    double z00 = height_at(terrain, level + 1, a, b), z11 = height_at(terrain, level + 1, a + 1, b + 1);
    double corner =
        u >= v ? height_at(terrain, level + 1, a + 1, b) : height_at(terrain, level + 1, a, b + 1);
    return u >= v ? z00 + u * (corner - z00) + v * (z11 - corner)
                  : z00 + v * (corner - z00) + u * (z11 - corner);
}

static void b4_z_c_is_the_coarser_surface(void **state)
{
    (void)state;
    struct terrain *terrain = test_terrain(&hills);
    const struct terrain_info *info = terrain_info(terrain);
    struct clipmap_scratch scratch;
    assert_true(clipmap_scratch_init(&scratch, 64));
    uint64_t seed = 1, differ_even = 0, checked = 0;
    for (int level = info->finest; level < info->coarsest; level++) {
        struct clipmap_store store;
        assert_true(clipmap_store_init(&store, terrain, level, true, 64));
        for (int i = 0; i < 30; i++) {
            struct clipmap_box box =
                square((int64_t)(test_random(&seed) % 400) - 200, (int64_t)(test_random(&seed) % 400) - 200,
                       1 + (int)(test_random(&seed) % 40));
            clipmap_store_read(&store, &box, &scratch);
            int side = (int)(box.hi[0] - box.lo[0] + 1);
            for (int p = 0; p < side * side; p++) {
                int64_t x = box.lo[0] + p % side, y = box.lo[1] + p / side;
                assert_true(scratch.pairs[p][0] == (float)height_at(terrain, level, x, y));
                assert_true((double)scratch.pairs[p][1] == coarse_surface(terrain, level, x, y));
                differ_even += !(x & 1) && !(y & 1) && scratch.pairs[p][0] != scratch.pairs[p][1];
                checked++;
            }
        }
        clipmap_store_finish(&store);
    }
    FIGURE("B4: %lu samples equal the coarser surface; at %lu even ones it differs from z", checked,
           differ_even);
    assert_true(differ_even > 0); // a store that took z for z_c there would fail
    clipmap_scratch_finish(&scratch);
    terrain_destroy(terrain);
}

// ---- B6, B5 ----------------------------------------------------------------

static void check_contents(const struct clipmap_store *store, const struct memory *memory,
                           const struct clipmap_scratch *scratch)
{
    const struct clipmap_box *clip = &store->clip;
    clipmap_store_read(store, clip, scratch);
    for (int64_t y = clip->lo[1]; y <= clip->hi[1]; y++)
        for (int64_t x = clip->lo[0]; x <= clip->hi[0]; x++) {
            size_t slot = (size_t)clipmap_slot(y, store->size) * (size_t)store->size +
                          (size_t)clipmap_slot(x, store->size);
            size_t fresh = (size_t)(y - clip->lo[1]) * (size_t)store->size + (size_t)(x - clip->lo[0]);
            assert_memory_equal(memory->slots[slot], scratch->pairs[fresh], sizeof memory->slots[slot]);
        }
}

static int64_t step_of(uint64_t *seed, int n)
{
    const int64_t steps[] = {0, 0, 1, -1, 2, -2, 3, -5, n - 1, n, n + 1, -n, -n - 1, -n + 1, 5000, -5000};
    return steps[test_random(seed) % (sizeof steps / sizeof *steps)];
}

// Each step moves the viewer by 0 .. n + 1 cells or far away; each sample is written at most once, and what
// is written is just what was not there.
static void walk(const struct terrain *terrain, int level, int n, int steps, uint64_t *seed)
{
    int size = n + CLIPMAP_MARGIN;
    struct memory memory;
    struct clipmap_store store;
    struct clipmap_scratch scratch;
    memory_init(&memory, size);
    assert_true(clipmap_store_init(&store, terrain, level, true, size) &&
                clipmap_scratch_init(&scratch, size));
    int64_t x = (int64_t)(test_random(seed) % 600) - 300, y = (int64_t)(test_random(seed) % 600) - 300;
    for (int step = 0; step < steps; step++) {
        x += step_of(seed, n);
        y += step_of(seed, n);
        struct clipmap_box before = store.clip,
                           desired = square(2 * clipmap_floor_div(x, 2), 2 * clipmap_floor_div(y, 2), n);
        memset(memory.writes, 0, (size_t)size * (size_t)size * sizeof *memory.writes);
        uint64_t samples = clipmap_store_move(&store, &desired, &scratch, write_memory, &memory), written = 0,
                 kept = 0;
        assert_true(clipmap_box_holds(&store.clip, &desired));
        for (int slot = 0; slot < size * size; slot++) {
            assert_true(memory.writes[slot] <= 1);
            written += memory.writes[slot];
        }
        if (!clipmap_box_is_empty(&before))
            for (int64_t j = store.clip.lo[1]; j <= store.clip.hi[1]; j++)
                for (int64_t i = store.clip.lo[0]; i <= store.clip.hi[0]; i++)
                    kept += i >= before.lo[0] && i <= before.hi[0] && j >= before.lo[1] && j <= before.hi[1];
        assert_int_equal(samples, written);
        assert_int_equal(written, (uint64_t)size * (uint64_t)size - kept);
    }
    check_contents(&store, &memory, &scratch);
    clipmap_store_finish(&store);
    clipmap_scratch_finish(&scratch);
    memory_finish(&memory);
}

static void b6_walks_leave_what_a_fresh_build_has(void **state)
{
    (void)state;
    struct terrain *terrain = test_terrain(&hills);
    uint64_t seed = 6;
    int walks = test_size(100, 1000);
    for (int i = 0; i < walks; i++) walk(terrain, (int)(test_random(&seed) % 4), i % 2 ? 15 : 31, 40, &seed);
    FIGURE("B6: %d walks of 40 steps, contents equal a fresh build bit for bit", walks);
    terrain_destroy(terrain);
}

// The test sees a slip: one sample written to the slot of its neighbour.
static void slip(void *user, int slot_x, int slot_y, int width, int height, const float (*pairs)[2])
{
    struct memory *memory = user;
    int slipped = (slot_x + 1) % memory->size;
    write_memory(user, slipped + width <= memory->size ? slipped : slot_x, slot_y, width, height, pairs);
}

static void b6_sees_a_slip(void **state)
{
    (void)state;
    struct terrain *terrain = test_terrain(&hills);
    struct memory memory;
    struct clipmap_store store;
    struct clipmap_scratch scratch;
    memory_init(&memory, 17);
    assert_true(clipmap_store_init(&store, terrain, 0, true, 17) && clipmap_scratch_init(&scratch, 17));
    struct clipmap_box desired = square(0, 0, 15);
    clipmap_store_move(&store, &desired, &scratch, write_memory, &memory);
    desired = square(4, 0, 15);
    clipmap_store_move(&store, &desired, &scratch, slip, &memory);
    int wrong = 0;
    clipmap_store_read(&store, &store.clip, &scratch);
    for (int i = 0; i < 17 * 17; i++) {
        int slot =
            clipmap_slot(store.clip.lo[1] + i / 17, 17) * 17 + clipmap_slot(store.clip.lo[0] + i % 17, 17);
        wrong += memcmp(memory.slots[slot], scratch.pairs[i], sizeof memory.slots[slot]) != 0;
    }
    assert_true(wrong > 0);
    clipmap_store_finish(&store);
    clipmap_scratch_finish(&scratch);
    memory_finish(&memory);
    terrain_destroy(terrain);
}

// ---- bounds ----------------------------------------------------------------

static void bounds_hold_and_do_not_depend_on_the_way(void **state)
{
    (void)state;
    struct terrain *terrain = test_terrain(&hills);
    enum { N = 63, SIZE = N + CLIPMAP_MARGIN };
    struct memory memory;
    struct clipmap_store store, fresh;
    struct clipmap_scratch scratch;
    memory_init(&memory, SIZE);
    assert_true(clipmap_store_init(&store, terrain, 1, true, SIZE) && clipmap_scratch_init(&scratch, SIZE));
    uint64_t seed = 7;
    for (int step = 0; step < 60; step++) {
        struct clipmap_box desired =
            square((int64_t)(test_random(&seed) % 120) - 60, (int64_t)(test_random(&seed) % 90) - 60, N);
        clipmap_store_move(&store, &desired, &scratch, write_memory, &memory);
        assert_true(clipmap_store_init(&fresh, terrain, 1, true, SIZE));
        clipmap_store_move(&fresh, &desired, &scratch, write_memory, &memory);
        for (int b = 0; b < 20; b++) {
            int side = 1 + (int)(test_random(&seed) % 17);
            struct clipmap_box box = square(desired.lo[0] + (int64_t)(test_random(&seed) % (N - 17)),
                                            desired.lo[1] + (int64_t)(test_random(&seed) % (N - 17)), side);
            struct clipmap_range range = clipmap_store_range(&store, &box),
                                 again = clipmap_store_range(&fresh, &box);
            assert_int_equal(range.low, again.low);
            assert_int_equal(range.high, again.high);
            clipmap_store_read(&store, &box, &scratch);
            for (int i = 0; i < side * side; i++)
                for (int c = 0; c < 2; c++)
                    assert_true(scratch.pairs[i][c] >= (float)range.low &&
                                scratch.pairs[i][c] <= (float)range.high);
        }
        clipmap_store_finish(&fresh);
    }
    clipmap_store_finish(&store);
    clipmap_scratch_finish(&scratch);
    memory_finish(&memory);
    terrain_destroy(terrain);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(b4_z_c_is_the_coarser_surface),
        cmocka_unit_test(b6_walks_leave_what_a_fresh_build_has),
        cmocka_unit_test(b6_sees_a_slip),
        cmocka_unit_test(bounds_hold_and_do_not_depend_on_the_way),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
