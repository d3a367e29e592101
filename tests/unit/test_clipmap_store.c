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
// other: as if cells were split along the other diagonal.
static double coarse_surface(const struct terrain *terrain, int level, int64_t i, int64_t j, bool other)
{
    int64_t a = clipmap_floor_div(i, 2), b = clipmap_floor_div(j, 2);
    double u = (double)(i - 2 * a) / 2, v = (double)(j - 2 * b) / 2;
    double z00 = height_at(terrain, level + 1, a, b), z11 = height_at(terrain, level + 1, a + 1, b + 1);
    if (other && u == 0.5 && v == 0.5)
        return (height_at(terrain, level + 1, a + 1, b) + height_at(terrain, level + 1, a, b + 1)) / 2.0;
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
    uint64_t seed = 1, differ_even = 0, differ_diagonal = 0, checked = 0;
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
                assert_true((double)scratch.pairs[p][1] == coarse_surface(terrain, level, x, y, false));
                differ_diagonal += (double)scratch.pairs[p][1] != coarse_surface(terrain, level, x, y, true);
                differ_even += !(x & 1) && !(y & 1) && scratch.pairs[p][0] != scratch.pairs[p][1];
                checked++;
            }
        }
        clipmap_store_finish(&store);
    }
    FIGURE("B4: %lu samples equal the coarser surface; at %lu even ones it differs from z, at %lu from the "
           "surface "
           "split along the other diagonal",
           checked, differ_even, differ_diagonal);
    assert_true(differ_diagonal > 0);
    assert_true(differ_even > 0); // a store that took z for z_c there would fail
    clipmap_scratch_finish(&scratch);
    terrain_destroy(terrain);
}

// ---- B6, B5 ----------------------------------------------------------------

static uint64_t wrong_samples(const struct clipmap_store *store, const struct memory *memory,
                              const struct clipmap_scratch *scratch)
{
    const struct clipmap_box *clip = &store->clip;
    uint64_t wrong = 0;
    if (clipmap_box_is_empty(clip)) return 0;
    clipmap_store_read(store, clip, scratch);
    const float(*fresh)[2] = (const float(*)[2])scratch->pairs;
    for (int64_t y = clip->lo[1]; y <= clip->hi[1]; y++)
        for (int64_t x = clip->lo[0]; x <= clip->hi[0]; x++) {
            size_t slot = (size_t)clipmap_slot(y, store->size) * (size_t)store->size +
                          (size_t)clipmap_slot(x, store->size);
            wrong += memcmp(memory->slots[slot], fresh++, sizeof memory->slots[slot]) != 0;
        }
    return wrong;
}

static void check_contents(const struct clipmap_store *store, const struct memory *memory,
                           const struct clipmap_scratch *scratch)
{
    assert_int_equal(wrong_samples(store, memory, scratch), 0);
}

// The levels about a viewer who walks, their textures in memory.
struct levels {
    struct clipmap_shape shape;
    struct view view;
    int64_t before[2]; // the eye at the last update
    struct clipmap_store stores[CLIPMAP_MAX_LEVELS];
    struct memory memories[CLIPMAP_MAX_LEVELS];
    struct clipmap_scratch scratch;
    struct clipmap_box desired[CLIPMAP_MAX_LEVELS];
};

static void levels_init(struct levels *levels, const struct terrain *terrain, int n, int ahead)
{
    const struct terrain_info *info = terrain_info(terrain);
    const struct terrain_extent extent = terrain_level(terrain, info->finest).extent;
    const struct clipmap_rules rules = {
        .n = n, .transition = 0.1, .alpha = CLIPMAP_ALPHA_STABLE, .throttle = 1, .ahead = ahead};
    clipmap_shape_init(&levels->shape, &rules, info->coarsest - info->finest + 1, &extent, 1);
    levels->view = (struct view){.lattice_bits = 8};
    memset(levels->before, 0, sizeof levels->before);
    for (int k = 0; k < levels->shape.levels; k++) {
        memory_init(&levels->memories[k], levels->shape.size);
        assert_true(clipmap_store_init(&levels->stores[k], terrain, info->finest + k,
                                       k + 1 < levels->shape.levels, levels->shape.size));
    }
    assert_true(clipmap_scratch_init(&levels->scratch, levels->shape.size));
}

static void levels_finish(struct levels *levels)
{
    for (int k = 0; k < levels->shape.levels; k++) {
        clipmap_store_finish(&levels->stores[k]);
        memory_finish(&levels->memories[k]);
    }
    clipmap_scratch_finish(&levels->scratch);
}

static uint64_t written_once(const struct memory *memory)
{
    uint64_t written = 0;
    for (int slot = 0; slot < memory->size * memory->size; slot++) {
        assert_true(memory->writes[slot] <= 1);
        written += memory->writes[slot];
    }
    return written;
}

// Section 5, constraint 1: within the coarser clip region less one cell, but at the map's edge.
static void check_nested(const struct levels *levels, int k)
{
    const struct clipmap_box *clip = &levels->stores[k].clip, *coarser = &levels->stores[k + 1].clip,
                             *map = &levels->shape.map[k + 1];
    if (clipmap_box_is_empty(clip)) return;
    for (int axis = 0; axis < 2; axis++) {
        assert_true(clip->lo[axis] >= 2 * (coarser->lo[axis] + (coarser->lo[axis] > map->lo[axis])));
        assert_true(clip->hi[axis] <= 2 * (coarser->hi[axis] - (coarser->hi[axis] < map->hi[axis])));
    }
}

// One update, as the renderer does it.  Each sample is written at most once, what is written is just what was
// not there, and no more than the budget; the levels stay nested.  Returns the samples read, but for those of
// the coarsest level, which has no budget.
static uint64_t update(struct levels *levels, uint64_t budget)
{
    uint64_t left = budget;
    int heading[2];
    for (int axis = 0; axis < 2; axis++) {
        int64_t moved = levels->view.eye_lattice[axis] - levels->before[axis];
        heading[axis] = (moved > 0) - (moved < 0);
        levels->before[axis] += moved;
    }
    int coarsest = levels->shape.levels - 1;
    for (int k = coarsest; k >= 0; k--) {
        struct clipmap_store *store = &levels->stores[k];
        struct memory *memory = &levels->memories[k];
        struct view_origin eye = view_level_origin(&levels->view, k);
        levels->desired[k] = clipmap_desired(&levels->shape, k, &eye, 0, NULL);
        struct clipmap_box before = store->clip,
                           target = clipmap_target(&levels->shape, k, &store->clip, &store[1].clip,
                                                   &levels->desired[k], heading);
        memset(memory->writes, 0, (size_t)memory->size * (size_t)memory->size * sizeof *memory->writes);
        uint64_t samples = clipmap_store_move(store, &target, k < coarsest ? left : UINT64_MAX,
                                              &levels->scratch, write_memory, memory);
        struct clipmap_box kept = clipmap_box_common(&before, &store->clip);
        assert_int_equal(samples, written_once(memory));
        assert_int_equal(samples, clipmap_box_samples(&store->clip) - clipmap_box_samples(&kept));
        assert_true(clipmap_box_holds(&target, &store->clip));
        if (k == coarsest) continue;
        assert_true(samples <= left);
        left -= samples;
        check_nested(levels, k);
    }
    return budget - left;
}

static int levels_behind(const struct levels *levels)
{
    int behind = 0;
    for (int k = 0; k < levels->shape.levels; k++)
        behind += !clipmap_box_holds(&levels->stores[k].clip, &levels->desired[k]);
    return behind;
}

static void step(struct levels *levels, uint64_t *seed)
{
    const int64_t n = levels->shape.rules.n;
    const int64_t steps[] = {0, 0, 1, -1, 2, -2, 3, -5, n - 1, n, n + 1, -n, -n - 1, -n + 1, 700, -700};
    for (int axis = 0; axis < 2; axis++) {
        int64_t cells = steps[test_random(seed) % (sizeof steps / sizeof *steps)];
        levels->view.eye_lattice[axis] += cells * 256 + (int64_t)(test_random(seed) % 512) - 256;
    }
    if (test_random(seed) % 16 == 0) // a teleport, mostly onto the map
        for (int axis = 0; axis < 2; axis++)
            levels->view.eye_lattice[axis] = (int64_t)(test_random(seed) % (900 * 256)) - 400 * 256;
}

// Each step with another budget, at times none.
static void walk(const struct terrain *terrain, int n, int steps, uint64_t *seed, uint64_t *behind)
{
    struct levels levels;
    levels_init(&levels, terrain, n, (int)(test_random(seed) % 3 * 6));
    uint64_t least = 4 * (uint64_t)levels.shape.size;
    for (int i = 0; i < steps; i++) {
        step(&levels, seed);
        bool free = test_random(seed) % 4 == 0;
        update(&levels, free ? UINT64_MAX : least + test_random(seed) % (uint64_t)(n * n));
        *behind += (uint64_t)levels_behind(&levels);
        if (free) assert_int_equal(levels_behind(&levels), 0);
    }
    for (int k = 0; k < levels.shape.levels; k++)
        check_contents(&levels.stores[k], &levels.memories[k], &levels.scratch);
    levels_finish(&levels);
}

static void b6_walks_leave_what_a_fresh_build_has(void **state)
{
    (void)state;
    struct terrain *terrain = test_terrain(&hills);
    uint64_t seed = 6, behind = 0;
    const int walks = 1000;
    for (int i = 0; i < walks; i++) walk(terrain, i % 2 ? 15 : 31, 40, &seed, &behind);
    FIGURE("B6: %d walks of 40 steps, every level equals a fresh build bit for bit (%lu levels behind on the "
           "way)",
           walks, behind);
    assert_true(behind > 0);
    terrain_destroy(terrain);
}

// B8: after a teleport one level a frame is filled, coarse levels first, with a budget of n x n samples, and
// with any budget of four lines all are in the end.
static void b8_a_teleport_fills_coarse_to_fine(void **state)
{
    (void)state;
    struct terrain *terrain = test_terrain(&hills);
    static const int sizes[] = {15, 31, 63};
    for (int s = 0; s < 3; s++) {
        int n = sizes[s];
        struct levels levels;
        levels_init(&levels, terrain, n, 0);
        int followers = levels.shape.levels - 1;
        for (int frame = 1; frame <= followers; frame++) {
            update(&levels, (uint64_t)(n * n));
            for (int k = 0; k < levels.shape.levels; k++)
                assert_int_equal(clipmap_box_holds(&levels.stores[k].clip, &levels.desired[k]),
                                 k >= followers - frame);
        }
        assert_int_equal(update(&levels, (uint64_t)(n * n)), 0);
        for (int axis = 0; axis < 2; axis++) levels.view.eye_lattice[axis] = 120 * 256;
        uint64_t frames = 0, samples = (uint64_t)(n * n * followers);
        do {
            uint64_t read = update(&levels, 4 * (uint64_t)levels.shape.size);
            if (levels_behind(&levels)) assert_true(read > 0);
            assert_true(++frames <= samples);
        } while (levels_behind(&levels));
        for (int k = 0; k < levels.shape.levels; k++)
            check_contents(&levels.stores[k], &levels.memories[k], &levels.scratch);
        levels_finish(&levels);
    }
    terrain_destroy(terrain);
}

// Refills of each level on a straight way: a side moves `ahead` + 2 lines at a time instead of 2.
static void ahead_of_the_motion_refills_are_fewer(void **state)
{
    (void)state;
    struct terrain *terrain = test_terrain(&hills);
    enum { N = 31, WAY = 256, AHEAD = 6 };
    for (int turns = 0; turns < 2; turns++) {
        int64_t direction = turns ? -1 : 1;
        uint64_t refills[2][CLIPMAP_MAX_LEVELS] = {{0}};
        for (int with = 0; with < 2; with++) {
            struct levels levels;
            levels_init(&levels, terrain, N, with ? AHEAD : 0);
            for (int cell = 0; cell <= WAY; cell++) {
                levels.view.eye_lattice[0] = direction * (cell - WAY / 2) * 256;
                struct clipmap_box before[CLIPMAP_MAX_LEVELS];
                for (int k = 0; k < levels.shape.levels; k++) before[k] = levels.stores[k].clip;
                update(&levels, UINT64_MAX);
                assert_int_equal(levels_behind(&levels), 0);
                for (int k = 0; k < levels.shape.levels; k++)
                    refills[with][k] += !clipmap_box_equal(&before[k], &levels.stores[k].clip);
            }
            for (int k = 0; k < levels.shape.levels; k++)
                check_contents(&levels.stores[k], &levels.memories[k], &levels.scratch);
            levels_finish(&levels);
        }
        for (int k = 0; k < 3; k++) { // coarser levels reach the map's edge
            uint64_t lines = WAY >> k;
            FIGURE("ahead, level %d: %lu refills on a way of %lu lines, %lu with %d lines ahead", k,
                   refills[0][k], lines, refills[1][k], AHEAD);
            assert_true(refills[0][k] >= lines / 2); // the first is the fill
            assert_true(refills[1][k] <= lines / (AHEAD + 2) + 2);
        }
    }
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
    clipmap_store_move(&store, &desired, UINT64_MAX, &scratch, write_memory, &memory);
    desired = square(4, 0, 15);
    clipmap_store_move(&store, &desired, UINT64_MAX, &scratch, slip, &memory);
    assert_true(wrong_samples(&store, &memory, &scratch) > 0);
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
        clipmap_store_move(&store, &desired, UINT64_MAX, &scratch, write_memory, &memory);
        assert_true(clipmap_store_init(&fresh, terrain, 1, true, SIZE));
        clipmap_store_move(&fresh, &desired, UINT64_MAX, &scratch, write_memory, &memory);
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
        cmocka_unit_test(b8_a_teleport_fills_coarse_to_fine),
        cmocka_unit_test(ahead_of_the_motion_refills_are_fewer),
        cmocka_unit_test(b6_sees_a_slip),
        cmocka_unit_test(bounds_hold_and_do_not_depend_on_the_way),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
