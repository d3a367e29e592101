// Regions, snapping, morph and dirty rectangles of the clipmap, without terrain or GL.
// SPDX-License-Identifier: MIT
#include "clipmap/clipmap_levels.h"
#include "tests/test.h"

#include <string.h>

enum { MAP_SIDE = 1 << 20 };

static const int sizes[] = {11, 15, 31, 63, 127, 255};
enum { SIZES = sizeof sizes / sizeof *sizes };

// ---- a world to stand in ---------------------------------------------------

struct world {
    struct clipmap_shape shape;
    struct view view;
    struct view_origin eyes[CLIPMAP_MAX_LEVELS];
    struct clipmap_box clips[CLIPMAP_MAX_LEVELS];
    struct clipmap_region regions[CLIPMAP_MAX_LEVELS];
};

static struct clipmap_rules rules_of(int n, enum clipmap_alpha alpha)
{
    return (struct clipmap_rules){.n = n, .transition = 0.1, .alpha = alpha, .fade = true, .throttle = 1};
}

static void world_init(struct world *world, const struct clipmap_rules *rules, int64_t x0, int64_t y0,
                       int64_t width, int64_t height)
{
    const struct terrain_extent extent = {x0, y0, x0 + width, y0 + height};
    memset(world, 0, sizeof *world);
    clipmap_shape_init(&world->shape, rules, CLIPMAP_MAX_LEVELS, &extent, 1);
    world->view.lattice_bits = world->shape.levels <= 12 ? 12 : 24 - world->shape.levels;
}

static void stand(struct world *world, double x, double y) // in cells of the finest level
{
    const double place[2] = {x, y};
    for (int axis = 0; axis < 2; axis++)
        world->view.eye_lattice[axis] = llround(ldexp(place[axis], world->view.lattice_bits));
    for (int k = 0; k < world->shape.levels; k++) world->eyes[k] = view_level_origin(&world->view, k);
}

static void stand_anywhere(struct world *world, uint64_t *seed)
{
    const struct clipmap_box *map = &world->shape.map[0];
    double place[2];
    for (int axis = 0; axis < 2; axis++) {
        double side = (double)(map->hi[axis] - map->lo[axis]);
        place[axis] = (double)map->lo[axis] + side * test_uniform(seed, -0.1, 1.1);
    }
    stand(world, place[0], place[1]);
    if (test_random(seed) % 4 == 0) stand(world, rint(place[0]), rint(place[1])); // on a snapping line
}

// Clip regions that lag behind: shifted and cut at random, the coarsest whole.
static void lag(struct world *world, uint64_t *seed)
{
    for (int k = 0; k < world->shape.levels; k++) {
        struct clipmap_box *clip = &world->clips[k];
        *clip = world->shape.map[k];
        if (k == world->shape.levels - 1) continue;
        struct clipmap_box desired = clipmap_desired(&world->shape, k, &world->eyes[k], 0, NULL);
        *clip = desired;
        int n = world->shape.rules.n;
        for (int axis = 0; axis < 2; axis++) {
            int64_t shift = (int64_t)(test_random(seed) % (uint64_t)n) - n / 2;
            clip->lo[axis] += shift;
            clip->hi[axis] += shift - (int64_t)(test_random(seed) % (uint64_t)n) / 2;
        }
    }
}

// ---- heights as any filter might leave them: levels have nothing in common -

static int32_t sample(int k, int64_t i, int64_t j)
{
    uint64_t state =
        (uint64_t)i * 0x9e3779b97f4a7c15u ^ (uint64_t)j * 0xc2b2ae3d27d4eb4fu ^ (uint64_t)k << 56;
    return (int32_t)(test_random(&state) % 65536) - 32768;
}

static float surface(int k, int64_t i, int64_t j) // level k's surface at sample (i, j) of level k - 1
{
    int64_t a = clipmap_floor_div(i, 2), b = clipmap_floor_div(j, 2);
    return (float)(sample(k, a, b) + sample(k, a + (i & 1), b + (j & 1))) / 2;
}

static float drawn(const struct world *world, int k, int64_t i, int64_t j)
{
    const struct view_origin *eye = &world->eyes[k];
    float alpha = clipmap_alpha_at(&world->regions[k], world->shape.rules.alpha, (int)(i - eye->base[0]),
                                   (int)(j - eye->base[1]));
    float z = (float)sample(k, i, j);
    return clipmap_morphed(z, k + 1 < world->shape.levels ? surface(k + 1, i, j) : z, alpha);
}

// Vertices of level k's open sides whose height is not that of the surface that level k + 1 draws there.
static uint64_t cracks_of_side(const struct world *world, int k, int side)
{
    const struct clipmap_box *active = &world->regions[k].active;
    int across = side & 1, along = 1 - across;
    uint64_t cracks = 0;
    int64_t at[2];
    at[across] = side < CLIPMAP_EAST ? active->lo[across] : active->hi[across];
    for (at[along] = active->lo[along]; at[along] <= active->hi[along]; at[along]++) {
        int64_t to[2] = {clipmap_floor_div(at[0], 2), clipmap_floor_div(at[1], 2)};
        float coarse = drawn(world, k + 1, to[0], to[1]);
        if (at[along] & 1) {
            to[along]++;
            coarse = (coarse + drawn(world, k + 1, to[0], to[1])) / 2;
        }
        float fine = drawn(world, k, at[0], at[1]);
        cracks += memcmp(&fine, &coarse, sizeof fine) != 0;
    }
    return cracks;
}

static uint64_t cracks(const struct world *world, uint64_t *sides)
{
    uint64_t count = 0;
    for (int k = 0; k + 1 < world->shape.levels; k++)
        for (int side = 0; side < CLIPMAP_SIDES && !clipmap_box_is_empty(&world->regions[k].active); side++)
            if (world->regions[k].open[side]) {
                count += cracks_of_side(world, k, side);
                ++*sides;
            }
    return count;
}

static uint64_t hole_vertices_morphed(const struct world *world)
{
    uint64_t count = 0;
    for (int k = 1; k < world->shape.levels; k++) {
        const struct clipmap_region *region = &world->regions[k];
        const struct clipmap_box *hole = &region->hole;
        if (clipmap_box_is_empty(hole)) continue;
        for (int64_t y = hole->lo[1]; y <= hole->hi[1]; y++)
            for (int64_t x = hole->lo[0]; x <= hole->hi[0];
                 x += y == hole->lo[1] || y == hole->hi[1] ? 1 : hole->hi[0] - hole->lo[0])
                count += clipmap_alpha_at(region, world->shape.rules.alpha, (int)(x - world->eyes[k].base[0]),
                                          (int)(y - world->eyes[k].base[1])) != 0;
    }
    return count;
}

// ---- B1 --------------------------------------------------------------------

enum variety { WHOLE, CROPPED, VARIED };

// Throttled, a size for each level,
static void vary_sizes(struct world *world, uint64_t *seed)
{
    double error_m[CLIPMAP_MAX_LEVELS];
    for (int k = 0; k < world->shape.available; k++)
        error_m[k] = world->shape.spacing_m[k] * test_uniform(seed, 0, 1);
    clipmap_shape_by_error(&world->shape, test_random(seed) % 2 ? CLIPMAP_SIZES_ERROR : CLIPMAP_SIZES_MEAN,
                           error_m);
}

// regions that are any part of larger squares.
static void vary_fits(const struct world *world, struct clipmap_fit fits[CLIPMAP_MAX_LEVELS], uint64_t *seed)
{
    for (int k = 0; k < world->shape.levels; k++) {
        int side = world->shape.drawn[k];
        fits[k].n = side + 2 * (int)(test_random(seed) % (uint64_t)(side / 2));
        fits[k].seen = clipmap_square(fits[k].n, &world->eyes[k]);
        for (int axis = 0; axis < 2; axis++) {
            int64_t spare = (fits[k].n - side) / 2,
                    skip = 2 * (int64_t)(test_random(seed) % (uint64_t)(spare + 1));
            fits[k].seen.lo[axis] += skip;
            fits[k].seen.hi[axis] = fits[k].seen.lo[axis] + side - 1;
        }
    }
}

static void check_nesting(const struct world *world, const struct clipmap_box *clips);

static void b1_count(enum clipmap_alpha alpha, enum variety variety, uint64_t bad[2], uint64_t *sides,
                     uint64_t *viewers)
{
    static const double shares[] = {1, 0.5, 0.25};
    uint64_t seed = 1;
    for (int s = 0; s < SIZES; s++) {
        int count = test_size(20000 / sizes[s], 100000 / SIZES);
        for (int i = 0; i < count; i++, ++*viewers) {
            struct clipmap_rules rules = rules_of(sizes[s], alpha);
            struct clipmap_fit fits[CLIPMAP_MAX_LEVELS];
            struct world world;
            rules.throttle = variety == VARIED ? shares[i % 3] : 1;
            world_init(&world, &rules, -MAP_SIDE / 3, -7, MAP_SIDE, MAP_SIDE + 5);
            if (variety == VARIED) vary_sizes(&world, &seed);
            stand_anywhere(&world, &seed);
            lag(&world, &seed);
            if (variety == VARIED) vary_fits(&world, fits, &seed);
            const struct clipmap_box *clips =
                variety == CROPPED || (variety == VARIED && i % 4 == 0) ? world.clips : NULL;
            clipmap_regions(&world.shape, world.eyes, 0, variety == VARIED && i % 2 ? fits : NULL, clips,
                            world.regions);
            check_nesting(&world, clips);
            bad[0] += cracks(&world, sides);
            bad[1] += hole_vertices_morphed(&world);
        }
    }
}

static void b1_levels_meet_bit_for_bit(void **state)
{
    (void)state;
    static const char *const names[] = {"whole", "cropped", "varied"};
    for (int variety = WHOLE; variety <= VARIED; variety++) {
        uint64_t bad[2] = {0, 0}, sides = 0, viewers = 0;
        b1_count(CLIPMAP_ALPHA_STABLE, (enum variety)variety, bad, &sides, &viewers);
        FIGURE(
            "B1 %s: %lu viewers, %lu open sides, %lu vertices off the coarser surface, %lu morphed at a hole",
            names[variety], viewers, sides, bad[0], bad[1]);
        assert_true(sides > viewers);
        assert_int_equal(bad[0], 0);
        assert_int_equal(bad[1], 0);
    }
}

static void b1_published_alpha_cracks(void **state)
{
    (void)state;
    uint64_t bad[2] = {0, 0}, sides = 0, viewers = 0;
    b1_count(CLIPMAP_ALPHA_PUBLISHED, CROPPED, bad, &sides, &viewers);
    FIGURE("B1 published, cropped: %lu vertices off the coarser surface, %lu morphed at a hole", bad[0],
           bad[1]);
    assert_true(bad[0] > 0);
    assert_true(bad[1] > 0);
}

// ---- B2 --------------------------------------------------------------------

// A shared coordinate as the vertex program computes it (relative_place), at level k and at level k + 1.
static float relative(const struct view_origin *eye, int axis, int64_t index, float spacing)
{
    return ((float)(index - eye->base[axis]) - eye->fraction[axis]) * spacing;
}

// "The local coordinate system of each level": vertices from the level's corner, the corner from the eye.
static float relative_by_level_origin(int64_t corner, int64_t index, double eye, double spacing)
{
    return (float)(index - corner) * (float)spacing + (float)((double)corner * spacing - eye);
}

static void b2_count(int levels, int bits, uint64_t differs[2], uint64_t *shared)
{
    const double g0 = 1.0 / 1024;
    uint64_t seed = 2;
    struct view view = {.lattice_bits = bits};
    for (int i = 0; i < test_size(400, 4000); i++) {
        double v = 1e7 + test_uniform(&seed, 0, 5000);
        view.eye_lattice[0] = llround(v / g0 * ldexp(1, bits));
        double v_q = (double)view.eye_lattice[0] * g0 / ldexp(1, bits);
        for (int k = 0; k + 1 < levels; k++) {
            struct view_origin fine = view_level_origin(&view, k), coarse = view_level_origin(&view, k + 1);
            double g = g0 * ldexp(1, k);
            int64_t fine_corner = fine.base[0] - 127, coarse_corner = coarse.base[0] - 127;
            for (int e = 0; e < 6; e++, ++*shared) {
                int64_t c = coarse.base[0] - 64 + (int64_t)(test_random(&seed) % 128);
                differs[0] += relative(&fine, 0, 2 * c, (float)g) != relative(&coarse, 0, c, (float)(2 * g));
                differs[1] += relative_by_level_origin(fine_corner, 2 * c, v_q, g) !=
                              relative_by_level_origin(coarse_corner, c, v_q, 2 * g);
            }
        }
    }
}

static void b2_shared_vertices_are_bitwise_equal(void **state)
{
    (void)state;
    static const int forms[][2] = {{11, 12}, {20, 3}};
    for (int f = 0; f < 2; f++) {
        uint64_t differs[2] = {0, 0}, shared = 0;
        b2_count(forms[f][0], forms[f][1], differs, &shared);
        FIGURE("B2 m=%d b=%d: %lu of %lu shared coordinates differ (%lu with an origin for each level)",
               forms[f][0], forms[f][1], differs[0], shared, differs[1]);
        assert_int_equal(differs[0], 0);
        assert_true(differs[1] > shared / 100);
    }
}

static void b2_too_fine_a_lattice_fails(void **state)
{
    (void)state;
    uint64_t differs[2] = {0, 0}, shared = 0;
    b2_count(11, 16, differs, &shared); // b + m - 1 = 26 bits do not fit a float
    assert_true(differs[0] > 0);
}

// ---- regions ---------------------------------------------------------------

static void check_nesting(const struct world *world, const struct clipmap_box *clips)
{
    for (int k = 0; k < world->shape.levels; k++) {
        const struct clipmap_region *region = &world->regions[k];
        if (clipmap_box_is_empty(&region->active)) continue;
        const struct clipmap_region *coarser = k + 1 < world->shape.levels ? region + 1 : NULL;
        if (clips) assert_true(clipmap_box_holds(&clips[k], &region->active)); // constraint 2
        assert_true(clipmap_box_holds(&world->shape.map[k], &region->active));
        if (!coarser) continue;
        assert_false(clipmap_box_is_empty(&coarser->active));
        for (int axis = 0; axis < 2; axis++) {
            int64_t lo = region->active.lo[axis], hi = region->active.hi[axis];
            assert_int_equal(lo & 1, 0); // constraint 3
            assert_int_equal(hi & 1, 0);
            if (coarser->open[axis]) assert_true(lo / 2 >= coarser->active.lo[axis] + 2); // constraint 4
            if (coarser->open[axis + 2]) assert_true(hi / 2 <= coarser->active.hi[axis] - 2);
            assert_true(lo / 2 >= coarser->active.lo[axis] && hi / 2 <= coarser->active.hi[axis]);
        }
    }
}

static void regions_nest(void **state)
{
    (void)state;
    uint64_t seed = 3;
    for (int s = 0; s < SIZES; s++)
        for (int i = 0; i < test_size(500, 20000); i++) {
            struct clipmap_rules rules = rules_of(sizes[s], CLIPMAP_ALPHA_STABLE);
            struct world world;
            int64_t width = 2 + (int64_t)(test_random(&seed) % 5000),
                    height = 2 + (int64_t)(test_random(&seed) % 900);
            world_init(&world, &rules, (int64_t)(test_random(&seed) % 99) - 50,
                       (int64_t)(test_random(&seed) % 99) - 50, width, height);
            stand_anywhere(&world, &seed);
            lag(&world, &seed);
            clipmap_regions(&world.shape, world.eyes, 0, NULL, NULL, world.regions);
            check_nesting(&world, NULL);
            clipmap_regions(&world.shape, world.eyes, 0, NULL, world.clips, world.regions);
            check_nesting(&world, world.clips);
            const struct clipmap_box *coarsest = &world.regions[world.shape.levels - 1].active;
            assert_true(clipmap_box_equal(coarsest, &world.shape.map[world.shape.levels - 1]));
        }
}

static void sizes_follow_the_error_and_the_throttle(void **state)
{
    (void)state;
    struct clipmap_rules rules = rules_of(127, CLIPMAP_ALPHA_STABLE);
    struct world world;
    world_init(&world, &rules, 0, 0, 5000, 5000);
    const struct clipmap_shape *shape = &world.shape;
    const int levels = shape->levels;
    double error_m[CLIPMAP_MAX_LEVELS] = {0};
    clipmap_shape_by_error(&world.shape, CLIPMAP_SIZES_ERROR, error_m);
    for (int k = 0; k < levels; k++) assert_int_equal(shape->kept[k], 127);
    for (int k = 1; k < shape->available; k++) error_m[k] = shape->spacing_m[k] * (k == 3 ? 1 : 0.6);
    clipmap_shape_by_error(&world.shape, CLIPMAP_SIZES_ERROR, error_m);
    for (int k = 0; k < levels; k++) // 0.6 of 127 is 76.2, 0.7 of 127 is 88.9
        assert_int_equal(shape->kept[k], k == 2 ? 127 : k == 3 ? 87 : 75);
    rules.throttle = 0.25;
    world_init(&world, &rules, 0, 0, 5000, 5000);
    assert_int_equal(shape->levels, levels + 1); // the level that holds the whole map is throttled too
    for (int k = 0; k <= levels; k++) {
        assert_int_equal(shape->kept[k], 127);
        assert_int_equal(shape->drawn[k], 63);
    }
}

// Sum of (e_{k+1} - e_k) / R_k^2 over the levels below the coarsest, for shares of a side, and of the squares
// of the shares.
static double mean_error(const double *share, const double *error_m, const double *spacing_m, int levels,
                         double *samples)
{
    double sum = *samples = 0;
    for (int k = 0; k < levels; k++) {
        sum += (error_m[k + 1] - error_m[k]) / pow(share[k] * spacing_m[k], 2);
        *samples += share[k] * share[k];
    }
    return sum;
}

// Sizes for the mean error: no others of as many samples have a smaller sum.  The sum falls as the samples.
static void sizes_have_the_least_mean_error(void **state)
{
    (void)state;
    struct clipmap_rules rules = rules_of(1023, CLIPMAP_ALPHA_STABLE); // sides are rounded to odd numbers
    struct world world;
    uint64_t seed = 12;
    double error_m[CLIPMAP_MAX_LEVELS], share[CLIPMAP_MAX_LEVELS], samples[2];
    world_init(&world, &rules, 0, 0, 5000, 5000);
    const struct clipmap_shape *shape = &world.shape;
    for (int k = 0; k < shape->available; k++) error_m[k] = k ? shape->spacing_m[k] : 0;
    clipmap_shape_by_error(&world.shape, CLIPMAP_SIZES_MEAN, error_m);
    const int levels = 3; // where neither half of n nor 0.7 of the finer level's side is in the way
    for (int k = 0; k < levels; k++) share[k] = shape->kept[k] / 1023.0;
    assert_true(share[0] == 1 && fabs(share[2] / share[1] - pow(2, -0.25)) < 2 / 1023.0);
    double least = mean_error(share, error_m, shape->spacing_m, levels, &samples[0]) * samples[0];
    for (int i = 0; i < 1000; i++) {
        double others[3];
        for (int k = 0; k < levels; k++) others[k] = share[k] * test_uniform(&seed, 0.5, 2);
        double more = mean_error(others, error_m, shape->spacing_m, levels, &samples[1]) * samples[1];
        assert_true(more > least * (1 - 4 / 1023.0));
    }
    const double equal[3] = {1, 1, 1}; // (2 + 1/2 + 1/4) 3 = 8.25 against (2^(1/2) + 2^(-1/2) + 1/2)^2 = 6.87
    assert_true(mean_error(equal, error_m, shape->spacing_m, levels, &samples[1]) * samples[1] >
                1.19 * least);
}

static void what_cannot_be_smaller_is_left_out(void **state)
{
    (void)state;
    static const double shares[] = {1, 0.9, 0.5, 0.25, 0.1, 0.01};
    for (int n = 15; n <= 255; n += 16) {
        int before = 0;
        for (size_t s = 0; s < sizeof shares / sizeof *shares; s++) {
            struct clipmap_rules rules = rules_of(n, CLIPMAP_ALPHA_STABLE);
            struct world world;
            rules.throttle = shares[s];
            world_init(&world, &rules, 0, 0, 5000, 5000);
            const struct clipmap_shape *shape = &world.shape;
            int last = shape->levels - 1, side = shape->drawn[0];
            double most = shares[s] * shape->levels * n * n, all = side * side;
            assert_true((last - shape->finest + 1) * all <= most || shape->finest == last);
            assert_true(shape->finest == 0 ||
                        (last - shape->finest + 2) * all > most); // and no more than need be
            assert_true(shape->finest == 0 || side == 11);
            assert_true(shape->finest >= before);
            before = shape->finest;
            stand(&world, 2500, 2500);
            clipmap_regions(shape, world.eyes, 0, NULL, NULL, world.regions);
            for (int k = 0; k <= last; k++)
                assert_true(clipmap_box_is_empty(&world.regions[k].active) == (k < shape->finest));
            check_nesting(&world, NULL);
        }
    }
}

static void viewer_is_within_a_cell_of_the_centre(void **state)
{
    (void)state;
    uint64_t seed = 4;
    struct clipmap_rules rules = rules_of(63, CLIPMAP_ALPHA_STABLE);
    struct world world;
    world_init(&world, &rules, -MAP_SIDE / 2, -MAP_SIDE / 2, MAP_SIDE, MAP_SIDE);
    for (int i = 0; i < 10000; i++) {
        stand(&world, test_uniform(&seed, -1000, 1000), test_uniform(&seed, -1000, 1000));
        for (int k = 0; k + 6 < world.shape.levels; k++) {
            struct clipmap_box box = clipmap_desired(&world.shape, k, &world.eyes[k], 0, NULL);
            for (int axis = 0; axis < 2; axis++) {
                double centre = (double)(box.lo[axis] + box.hi[axis]) / 2;
                double eye = (double)world.eyes[k].base[axis] + (double)world.eyes[k].fraction[axis];
                assert_true(fabs(eye - centre) <= 1);
                assert_int_equal(box.hi[axis] - box.lo[axis] + 1, rules.n);
            }
        }
    }
}

// Maps as small as they come, seen from on and off them: covered by the coarsest level, nothing beyond its
// rounding.
static void small_maps_are_covered(void **state)
{
    (void)state;
    static const int64_t maps[][2] = {{2, 2},   {3, 3},    {2, 17},    {17, 2},
                                      {16, 16}, {18, 675}, {675, 675}, {9, 300}};
    uint64_t seed = 5;
    for (size_t m = 0; m < sizeof maps / sizeof *maps; m++)
        for (int i = 0; i < 400; i++) {
            struct clipmap_rules rules = rules_of(31, CLIPMAP_ALPHA_STABLE);
            struct world world;
            int64_t x0 = (int64_t)(test_random(&seed) % 9) - 4, y0 = (int64_t)(test_random(&seed) % 9) - 4;
            world_init(&world, &rules, x0, y0, maps[m][0], maps[m][1]);
            stand(&world, test_uniform(&seed, -3000, 3000), test_uniform(&seed, -3000, 3000));
            clipmap_regions(&world.shape, world.eyes, test_uniform(&seed, 0, 50), NULL, NULL, world.regions);
            int k = world.shape.levels - 1;
            const struct clipmap_box *drawn_box = &world.regions[k].active;
            assert_true(drawn_box->lo[0] * (1 << k) <= x0 &&
                        drawn_box->hi[0] * (1 << k) >= x0 + maps[m][0] - 1);
            assert_true(drawn_box->lo[1] * (1 << k) <= y0 &&
                        drawn_box->hi[1] * (1 << k) >= y0 + maps[m][1] - 1);
            assert_true(drawn_box->hi[0] - drawn_box->lo[0] < world.shape.size);
        }
}

// ---- height: CM6, B16 ------------------------------------------------------

// Largest change of a height in the fine level when the viewer climbs by 0.01 n g a frame, as a share of |z_c
// - z|: what the fade moves, or, where the level vanishes, what is left to go to z_c.
static double largest_step(bool fade)
{
    struct clipmap_rules rules = rules_of(63, CLIPMAP_ALPHA_STABLE);
    rules.fade = fade;
    struct world world;
    world_init(&world, &rules, 0, 0, 5000, 5000);
    stand(&world, 2500, 2500);
    double largest = 0, before = 0;
    for (int frame = 0; frame <= 60; frame++) {
        double height = 0.01 * frame * rules.n;
        clipmap_regions(&world.shape, world.eyes, height, NULL, NULL, world.regions);
        bool gone = clipmap_box_is_empty(&world.regions[0].active);
        double now = gone ? 1 : (double)world.regions[0].fade;
        largest = fmax(largest, now - before);
        before = now;
    }
    assert_true(before == 1);
    return largest;
}

static void cm6_levels_fade_with_height(void **state)
{
    (void)state;
    double stable = largest_step(true), published = largest_step(false);
    FIGURE("B16 climb of 0.01 n g a frame: largest vertex move %.3f |z_c - z| (published %.3f)", stable,
           published);
    assert_true(stable <= 0.11);
    assert_true(published == 1);
}

// Section 4 rounds 3.14 to 3; numerics.md, B17, gives 359 for 1 degree.
static void b17_spacing_on_the_screen(void **state)
{
    (void)state;
    double wide = clipmap_spacing_px(255, 640, 1),
           narrow = clipmap_spacing_px(255, 640, tan(0.5 * M_PI / 180));
    FIGURE("B17 spacing on the screen, n = 255, 640 pixels: %.2f px at 90 degrees, %.0f px at 1 degree", wide,
           narrow);
    assert_true(fabs(wide - 1.25 * 640 / 255) < 1e-12);
    assert_true(fabs(narrow - 359) < 1);
    assert_true(clipmap_spacing_px(511, 640, 1) < wide && clipmap_spacing_px(255, 1280, 1) == 2 * wide);
}

static void morph_stays_between_z_and_z_c(void **state)
{
    (void)state;
    uint64_t seed = 6;
    for (int i = 0; i < 1000000; i++) {
        float z = (float)((int)(test_random(&seed) % 8388607) - 4194303);
        float z_c = (float)((int)(test_random(&seed) % 16777213) - 8388606) / 2;
        float alpha = (float)test_uniform(&seed, 0, 1), morphed = clipmap_morphed(z, z_c, alpha);
        assert_true(morphed >= fminf(z, z_c) && morphed <= fmaxf(z, z_c));
        assert_true(clipmap_morphed(z, z, alpha) == z);
        assert_true(clipmap_morphed(z, z_c, 1) == z_c);
    }
}

// ---- clip regions: B5, B6, B7 ----------------------------------------------

static void slots_of_negative_indices(void **state)
{
    (void)state;
    for (int size = 1; size < 70; size += 3)
        for (int64_t i = -300; i < 300; i++) {
            int slot = clipmap_slot(i, size);
            assert_in_range(slot, 0, size - 1);
            assert_int_equal(clipmap_slot(i + 1, size), (slot + 1) % size);
        }
    assert_int_equal(clipmap_floor_div(-1, 2), -1);
    assert_int_equal(clipmap_floor_div(-255, 255), -1);
}

static bool holds(const struct clipmap_box *box, int64_t x, int64_t y)
{
    return x >= box->lo[0] && x <= box->hi[0] && y >= box->lo[1] && y <= box->hi[1];
}

// Each sample of `now` that is not in `before` is in exactly one box, whose slots are a plain rectangle.
static void exposed_boxes_cover_what_is_new(void **state)
{
    (void)state;
    enum { SIZE = 13 };
    static const int64_t shifts[] = {0, 1, 2, SIZE - 1, SIZE, SIZE + 1, -1, -2, -SIZE, 1000};
    for (size_t a = 0; a < 10; a++)
        for (size_t b = 0; b < 10; b++)
            for (int64_t at = -40; at < 40; at += 7) {
                struct clipmap_box before = {{at, -at}, {at + SIZE - 1, -at + SIZE - 1}}, now = before,
                                   exposed[4];
                now.lo[0] += shifts[a], now.hi[0] += shifts[a], now.lo[1] += shifts[b],
                    now.hi[1] += shifts[b];
                int count = clipmap_exposed(&before, &now, exposed), covered[SIZE][SIZE] = {{0}};
                for (int e = 0; e < count; e++) {
                    struct clipmap_box pieces[4];
                    int piece_count = clipmap_unwrap(&exposed[e], SIZE, pieces);
                    for (int p = 0; p < piece_count; p++) {
                        int64_t width = pieces[p].hi[0] - pieces[p].lo[0],
                                height = pieces[p].hi[1] - pieces[p].lo[1];
                        assert_int_equal(
                            clipmap_slot(pieces[p].hi[0], SIZE) - clipmap_slot(pieces[p].lo[0], SIZE), width);
                        assert_int_equal(clipmap_slot(pieces[p].hi[1], SIZE) -
                                             clipmap_slot(pieces[p].lo[1], SIZE),
                                         height);
                        for (int64_t y = pieces[p].lo[1]; y <= pieces[p].hi[1]; y++)
                            for (int64_t x = pieces[p].lo[0]; x <= pieces[p].hi[0]; x++)
                                covered[y - now.lo[1]][x - now.lo[0]]++;
                    }
                }
                for (int64_t y = 0; y < SIZE; y++)
                    for (int64_t x = 0; x < SIZE; x++)
                        assert_int_equal(covered[y][x], !holds(&before, now.lo[0] + x, now.lo[1] + y));
            }
}

// B5: a walk through x = 0 and y = 0 makes the same decisions as the same walk elsewhere.
static void walks_through_zero_are_like_any_other(void **state)
{
    (void)state;
    const int64_t shift = (int64_t)3 << 40;
    struct clipmap_rules rules = rules_of(31, CLIPMAP_ALPHA_STABLE);
    struct world here, there;
    world_init(&here, &rules, -400, -300, 900, 700);
    world_init(&there, &rules, shift - 400, shift - 300, 900, 700);
    there.view.lattice_bits = here.view.lattice_bits = 8;
    for (int step = 0; step < 2000; step++) {
        double x = -35 + 0.035 * step, y = 20 - 0.02 * step;
        stand(&here, x, y);
        for (int axis = 0; axis < 2; axis++)
            there.view.eye_lattice[axis] = here.view.eye_lattice[axis] + (shift << 8);
        for (int k = 0; k < there.shape.levels; k++) there.eyes[k] = view_level_origin(&there.view, k);
        clipmap_regions(&here.shape, here.eyes, 0, NULL, NULL, here.regions);
        clipmap_regions(&there.shape, there.eyes, 0, NULL, NULL, there.regions);
        for (int k = 0; k < here.shape.levels; k++) {
            const struct clipmap_region *a = &here.regions[k], *b = &there.regions[k];
            for (int axis = 0; axis < 2; axis++) {
                assert_int_equal(a->active.lo[axis], b->active.lo[axis] - (shift >> k));
                assert_int_equal(a->active.hi[axis], b->active.hi[axis] - (shift >> k));
                assert_true(a->low[axis] == b->low[axis] && a->high[axis] == b->high[axis]);
            }
            assert_true(a->width == b->width);
        }
    }
}

// B7: a viewer that swings about a line where every level snaps makes each level read two rows and columns
// once.
static void b7_jitter_reads_once(void **state)
{
    (void)state;
    struct clipmap_rules rules = rules_of(63, CLIPMAP_ALPHA_STABLE);
    struct world world;
    world_init(&world, &rules, -5000, -5000, 10000, 10000);
    uint64_t first[CLIPMAP_MAX_LEVELS] = {0}, later = 0, without = 0;
    for (int k = 0; k < world.shape.levels; k++) world.clips[k] = clipmap_empty;
    struct clipmap_box bare[CLIPMAP_MAX_LEVELS]; // clip regions without a margin
    for (int swing = 0; swing < 200; swing++) {
        double off = (swing & 1 ? 1 : -1) * ldexp(1, -world.view.lattice_bits); // the lattice swallows 1e-6
        stand(&world, 2048 + off, 2048 + off);
        const int heading[2] = {swing & 1 ? 1 : -1, swing & 1 ? 1 : -1};
        world.clips[world.shape.levels - 1] = world.shape.map[world.shape.levels - 1];
        for (int k = world.shape.levels - 2; k >= 0; k--) {
            struct clipmap_box desired = clipmap_desired(&world.shape, k, &world.eyes[k], 0, NULL),
                               exposed[4];
            struct clipmap_box now =
                clipmap_target(&world.shape, k, &world.clips[k], &world.clips[k + 1], &desired, heading);
            uint64_t samples = 0;
            int count = clipmap_exposed(&world.clips[k], &now, exposed);
            for (int e = 0; e < count; e++) samples += clipmap_box_samples(&exposed[e]);
            if (swing == 1) first[k] = samples;
            if (swing > 1) later += samples;
            world.clips[k] = now;
            assert_true(clipmap_box_holds(&now, &desired));
            if (swing > 0) without += !clipmap_box_equal(&bare[k], &desired);
            bare[k] = desired;
        }
    }
    uint64_t two_rows_and_columns = 4 * (uint64_t)world.shape.size;
    for (int k = 0; k + 1 < world.shape.levels; k++) assert_true(first[k] <= two_rows_and_columns);
    FIGURE("B7: %lu samples read after the first swing (without a margin: %lu moves)", later, without);
    assert_int_equal(later, 0);
    assert_true(without > 100);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(b1_levels_meet_bit_for_bit),
        cmocka_unit_test(b1_published_alpha_cracks),
        cmocka_unit_test(b2_shared_vertices_are_bitwise_equal),
        cmocka_unit_test(b2_too_fine_a_lattice_fails),
        cmocka_unit_test(regions_nest),
        cmocka_unit_test(sizes_follow_the_error_and_the_throttle),
        cmocka_unit_test(sizes_have_the_least_mean_error),
        cmocka_unit_test(what_cannot_be_smaller_is_left_out),
        cmocka_unit_test(viewer_is_within_a_cell_of_the_centre),
        cmocka_unit_test(small_maps_are_covered),
        cmocka_unit_test(cm6_levels_fade_with_height),
        cmocka_unit_test(b17_spacing_on_the_screen),
        cmocka_unit_test(morph_stays_between_z_and_z_c),
        cmocka_unit_test(slots_of_negative_indices),
        cmocka_unit_test(exposed_boxes_cover_what_is_new),
        cmocka_unit_test(walks_through_zero_are_like_any_other),
        cmocka_unit_test(b7_jitter_reads_once),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
