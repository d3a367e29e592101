// Rings and levels over a sphere: numerics.md, D1 to D7 and SC1 to SC11, without GL.
// SPDX-License-Identifier: MIT
#include "clipmap/sphere_colour.h"
#include "clipmap/sphere_levels.h"
#include "clipmap/sphere_rings.h"
#include "tests/planet.h"

#include <string.h>

static struct view view_at(const struct terrain *terrain, double longitude, double latitude, double height_m)
{
    struct camera camera = {{longitude * RADIUS, latitude * RADIUS, height_m}, 0.3, -0.2, 0, 60 * DEGREE};
    struct view view;
    view_init(&view, terrain, &camera, 640, 480, 1);
    return view;
}

// ---- D1: where a vertex is ---------------------------------------------------

// Height of a vertex relative to the eye, as the vertex program finds it, against the plain difference of
// distances from the centre.
static void positions_keep_their_height(void **state)
{
    (void)state;
    uint64_t seed = 1;
    double worst_stable = 0, least_naive = HUGE_VAL;
    for (double reach_m = 1; reach_m <= 1e5; reach_m *= 10) {
        double worst_naive = 0;
        for (int k = 0; k < test_size(20000, 200000); k++) {
            double t = reach_m * test_uniform(&seed, 0.5, 1) / RADIUS, z = test_uniform(&seed, 0, 8000),
                   eye = z + 1.7, half = sin(t / 2);
            float c = (float)(2 * half * half), dz = (float)(z - eye), distance = (float)(RADIUS + eye) + dz;
            float stable = dz - distance * c;
            float naive = ((float)RADIUS + (float)z) * cosf((float)t) - ((float)RADIUS + (float)eye);
            double exact = (z - eye) - (RADIUS + z) * 2 * half * half;
            worst_stable = fmax(worst_stable, fabs((double)stable - exact));
            worst_naive = fmax(worst_naive, fabs((double)naive - exact));
        }
        least_naive = fmin(least_naive, worst_naive);
    }
    FIGURE("D1: height off by at most %.1e m within 100 km (plain form: at least %.2f m at every reach)",
           worst_stable, least_naive);
    assert_true(worst_stable <= 8.2e-4);
    assert_true(least_naive > 0.25); // half a step of float32 at the radius
}

// ---- D2: where a vertex samples ----------------------------------------------

// Worst error on a ring, metres on the ground.
static double ring_error_m(enum sphere_form form, double latitude, double reach_m)
{
    double worst = 0, angle = reach_m / RADIUS;
    for (int k = 0; k < 720; k++) {
        double azimuth = (k + 0.5) * M_PI / 360, half = sin(angle / 2), exact[2];
        float v[3] = {(float)(cos(azimuth) * sin(angle)), (float)(sin(azimuth) * sin(angle)),
                      (float)(2 * half * half)},
              found[2];
        test_exact_angles(latitude, angle, azimuth, exact);
        sphere_angles(form, latitude, v, found);
        double east = remainder((double)found[0] - exact[0], 2 * M_PI) * cos(latitude + exact[1]),
               north = (double)found[1] - exact[1];
        worst = fmax(worst, RADIUS * hypot(east, north));
    }
    return worst;
}

static void stable_angles_are_right_at_all_latitudes(void **state)
{
    (void)state;
    static const double POLAR[] = {M_PI / 2, M_PI / 4, M_PI / 48, 1e-3, 1e-5, 1e-7, 0, M_PI - 1e-3, M_PI};
    double worst = 0;
    for (size_t k = 0; k < sizeof POLAR / sizeof *POLAR; k++)
        for (double reach_m = 1; reach_m <= 1e6; reach_m *= 10) {
            double error = ring_error_m(SPHERE_STABLE, M_PI / 2 - POLAR[k], reach_m);
            worst = fmax(worst, error / reach_m);
            assert_true(error <= 3e-7 * reach_m);
        }
    FIGURE("D2: stable angles off by at most %.1e of the distance", worst);
    // Power: acos in float, its signs corrected, errs as the file says, and the printed forms far more.
    double corrected = ring_error_m(SPHERE_CORRECTED, M_PI / 2 - M_PI / 48, 1),
           pole = ring_error_m(SPHERE_CORRECTED, M_PI / 2, 100);
    double printed = ring_error_m(SPHERE_PUBLISHED, 0, 1e5),
           inner = ring_error_m(SPHERE_PUBLISHED, M_PI / 4, 100);
    FIGURE("D2: acos in float: %.1f m off on a ring of 1 m at pi/48, %.0f m on one of 100 m at the pole; as "
           "printed: %.0f km on 100 "
           "km, %.0f m on 100 m (Equation 14)",
           corrected, pole, printed / 1000, inner);
    assert_true(corrected > 1 && pole > 50);
    assert_true(printed > 1e4);                 // SC1
    assert_true(fabs(inner - 200) < 0.1 * 200); // SC2: twice the distance
}

// ---- D3: texels along a ring of a metre ----------------------------------------

static void texels_are_monotone_on_a_small_ring(void **state)
{
    (void)state;
    struct terrain *terrain = test_planet(512, 3000, 7, 14);
    struct sphere_shape shape;
    sphere_shape_init(&shape, terrain, 512, 0.5);
    double place[2] = {M_PI * 0.9999 * RADIUS, 0.2 * RADIUS};
    struct sphere_window window = sphere_window_wanted(&shape, shape.sampled, place);
    int64_t texel[2];
    float fraction[2], last = -HUGE_VALF, absolute_last = -HUGE_VALF;
    sphere_window_origin(&shape, shape.sampled, &window, place, texel, fraction);
    float scale = (float)(RADIUS / ldexp(shape.spacing_m[0], shape.sampled + window.decimation));
    int falls = 0, stays = 0, steps = 400;
    for (int k = 0; k <= steps; k++) { // the southern half, west to east
        double azimuth = M_PI + M_PI * k / steps, angle = 1 / RADIUS, half = sin(angle / 2);
        float v[3] = {(float)(cos(azimuth) * sin(angle)), (float)(sin(azimuth) * sin(angle)),
                      (float)(2 * half * half)},
              found[2];
        sphere_angles(SPHERE_STABLE, place[1] / RADIUS, v, found);
        float x = found[0] * scale + fraction[0], absolute = found[0] + (float)(place[0] / RADIUS);
        falls += x < last;
        stays += absolute == absolute_last;
        last = x, absolute_last = absolute;
    }
    FIGURE("D3: %d texel coordinates fall along a ring of 1 m; of absolute longitudes in float %d of %d stay "
           "where they were",
           falls, stays, steps);
    assert_int_equal(falls, 0);
    assert_true(stays > steps / 2);
    terrain_destroy(terrain);
}

// ---- D5: the azimuth over a pole -----------------------------------------------

static double pattern_step(const struct view *a, double turn_a, const struct view *b, double turn_b)
{
    double sum = 0;
    for (int k = 0; k < 3; k++) {
        double one = cos(turn_a) * a->axes[0][k] + sin(turn_a) * a->axes[1][k];
        double other = cos(turn_b) * b->axes[0][k] + sin(turn_b) * b->axes[1][k];
        sum += (one - other) * (one - other);
    }
    return sqrt(sum);
}

static void the_pattern_is_carried_over_a_pole(void **state)
{
    (void)state;
    struct terrain *terrain = test_planet(128, 3000, 7, 0);
    for (int pole = -1; pole <= 1; pole += 2) {
        struct view last = view_at(terrain, 0.7, pole * (M_PI / 2 - 50.5 / RADIUS), 100);
        double turn = 0.1, worst = 0, fixed = 0;
        for (int step = 1; step <= 100; step++) { // 1 m a step
            double over = 50.5 - step, longitude = over > 0 ? 0.7 : 0.7 + M_PI;
            struct view now = view_at(terrain, longitude, pole * (M_PI / 2 - fabs(over) / RADIUS), 100);
            double next = sphere_transport(&last, turn, &now);
            worst = fmax(worst, pattern_step(&last, turn, &now, next));
            fixed = fmax(fixed, pattern_step(&last, 0, &now, 0));
            turn = next;
            last = now;
        }
        FIGURE("D5: over the pole in steps of 1 m the pattern turns by at most %.1e (without transport %.1f)",
               worst, fixed);
        assert_true(worst < 2 * 1 / RADIUS); // twice a step's own angle
        assert_true(fixed > 1.9);
    }
    terrain_destroy(terrain);
}

// ---- D6: windows hold what rings sample ----------------------------------------

// Texels of a window that a vertex samples from a place: low corner of the cell.
static void texel_of(const struct sphere_shape *shape, int level, const struct sphere_window *w,
                     const double place[2], const float v[4], int64_t low[2])
{
    float angles[2], fraction[2];
    int64_t texel[2];
    sphere_window_origin(shape, level, w, place, texel, fraction);
    sphere_angles(SPHERE_STABLE, place[1] / shape->radius_m, v, angles);
    for (int axis = 0; axis < 2; axis++) {
        double scale = shape->radius_m / ldexp(sphere_spacing(shape, level, axis), axis ? 0 : w->decimation);
        low[axis] = texel[axis] + (int64_t)floor((double)angles[axis] * scale + (double)fraction[axis]);
    }
}

// Whether a window holds all that rings sample of a level.
static bool window_holds(const struct sphere_shape *shape, int level, const struct sphere_window *w,
                         const double place[2])
{
    struct sphere_rings rings = sphere_rings_make(shape->azimuths / 2 - 1);
    for (int ring = 0; ring < rings.count; ring += 3) {
        double at = sphere_level_at(shape, sphere_ring_angle(&rings, ring));
        bool sampled = at <= level + 1 && (at > level - 0.5 || level == shape->finest);
        if (level == shape->coarsest) sampled = at > level - 0.5;
        for (int azimuth = 0; sampled && azimuth < rings.azimuths; azimuth += 7) {
            float v[4];
            int64_t low[2];
            sphere_ring_vertex(&rings, ring, azimuth, v);
            texel_of(shape, level, w, place, v, low);
            for (int axis = w->around ? 1 : 0; axis < 2; axis++)
                if (low[axis] < w->box.lo[axis] || low[axis] + 1 > w->box.hi[axis]) return false;
        }
    }
    return true;
}

static void check_windows(const struct sphere_shape *shape, double longitude, double latitude)
{
    double place[2] = {longitude * shape->radius_m, latitude * shape->radius_m};
    for (int level = shape->finest; level <= shape->coarsest; level++) {
        struct sphere_window w = sphere_window_wanted(shape, level, place);
        int size = sphere_level_size(shape, level);
        assert_true(w.box.hi[0] - w.box.lo[0] < size && w.box.hi[1] - w.box.lo[1] < size);
        assert_true(window_holds(shape, level, &w, place) && sphere_window_serves(shape, level, &w, place));
    }
}

// A window that the viewer has left serves no longer than it holds what is sampled.
static void windows_serve_while_they_hold(void **state)
{
    (void)state;
    struct terrain *terrain = test_planet(512, 3000, 7, 8);
    struct sphere_shape shape;
    sphere_shape_init(&shape, terrain, 128, 0.5);
    uint64_t seed = 15;
    int served = 0, refused = 0;
    for (int k = 0; k < test_size(150, 5000); k++) {
        int level = shape.finest + (int)(test_random(&seed) % (uint64_t)(shape.coarsest - shape.finest + 1));
        double place[2] = {test_uniform(&seed, -4, 4) * RADIUS, asin(test_uniform(&seed, -1, 1)) * RADIUS};
        struct sphere_window w = sphere_window_wanted(&shape, level, place);
        place[0] +=
            test_uniform(&seed, -9, 9) * ldexp(sphere_spacing(&shape, level, 0), w.around ? 0 : w.decimation);
        place[1] += test_uniform(&seed, -9, 9) * sphere_spacing(&shape, level, 1);
        if (fabs(place[1]) > M_PI / 2 * RADIUS) continue;
        bool serves = sphere_window_serves(&shape, level, &w, place);
        served += serves, refused += !serves;
        assert_true(!serves || window_holds(&shape, level, &w, place));
    }
    FIGURE("windows left behind: %d of %d still serve, and hold all that is sampled", served,
           served + refused);
    assert_true(served > 0 && refused > 0);
    terrain_destroy(terrain);
}

// From the equator towards a pole every level takes more columns together, again and again, and is read anew
// for it: eighths of the levels at a time.
static void levels_are_not_read_anew_together(void **state)
{
    (void)state;
    struct terrain *terrain = test_planet(512, 3000, 7, 14);
    struct sphere_shape shape;
    sphere_shape_init(&shape, terrain, 512, 0.5);
    int levels = shape.coarsest - shape.finest + 1, before[SPHERE_MAX_LEVELS] = {0}, most = 0, sum = 0;
    for (double latitude = 0; latitude < 85; latitude += 0.05) {
        double place[2] = {0.3 * RADIUS, latitude * DEGREE * RADIUS};
        int changed = 0;
        for (int k = 0; k < levels; k++) {
            struct sphere_window w = sphere_window_wanted(&shape, shape.finest + k, place);
            int now = w.around ? -1 : w.decimation;
            changed += latitude > 0 && now != before[k];
            before[k] = now;
        }
        most = changed > most ? changed : most;
        sum += changed;
    }
    FIGURE("on the way to 85 degrees %d levels are read anew %d times, at most %d of them at once", levels,
           sum, most);
    assert_true(sum > levels && most <= (levels + 7) / 8);
    terrain_destroy(terrain);
}

// Near the viewer single columns are sampled wherever columns crowd, but at the poles themselves.
static void columns_stand_alone_near_the_viewer(void **state)
{
    (void)state;
    struct terrain *terrain = test_planet(512, 3000, 7, 10);
    struct sphere_shape shape;
    sphere_shape_init(&shape, terrain, 512, 0.5);
    for (double latitude = 0; latitude <= 88; latitude += 1) {
        double place[2] = {0.3 * RADIUS, latitude * DEGREE * RADIUS};
        int finest = sphere_finest_wanted(&shape, place, 0);
        struct sphere_window w = sphere_window_wanted(&shape, finest, place),
                             last = sphere_window_wanted(&shape, shape.sampled, place);
        assert_int_equal(w.decimation, 0);
        assert_true((last.decimation > 0) == (finest < shape.sampled)); // and no more than is needed
        assert_true(finest >= shape.sampled - last.decimation - 1); // levels differ in when they take more
        // Rings that are wide on the screen need none of them.
        double wide = 0.25 * 512 * sphere_spacing(&shape, 0, 1) / RADIUS;
        assert_true(sphere_finest_wanted(&shape, place, wide) >= 0);
    }
    terrain_destroy(terrain);
}

static void windows_hold_what_rings_sample(void **state)
{
    (void)state;
    static const int COLUMNS[] = {512, 4320 / 4};
    for (int c = 0; c < 2; c++) {
        struct terrain *terrain = test_planet(COLUMNS[c], 3000, 7, 10);
        struct sphere_shape shape;
        int azimuths = c ? 128 : 256;
        sphere_shape_init(&shape, terrain, azimuths, 0.5);
        uint64_t seed = 5;
        for (int k = 0; k < test_size(6, 300); k++)
            check_windows(&shape, test_uniform(&seed, -4, 4), asin(test_uniform(&seed, -1, 1)));
        for (int level = shape.finest; level < shape.coarsest;
             level += test_size(4, 1)) { // a ring that just reaches the pole
            double angle = 0.25 * azimuths * ldexp(shape.spacing_m[1], level) / RADIUS;
            if (angle >= M_PI / 2) break;
            for (int side = -1; side <= 1; side++) {
                check_windows(&shape, 1, M_PI / 2 - angle * (1 + side * 1e-6));
                check_windows(&shape, 2, -(M_PI / 2 - angle * (1 + side * 1e-6)));
            }
        }
        check_windows(&shape, 0, M_PI / 2);
        check_windows(&shape, M_PI, -M_PI / 2);
        terrain_destroy(terrain);
    }
}

// ---- D7: the horizon -------------------------------------------------------------

static void horizons_are_exact(void **state)
{
    (void)state;
    double worst = 0, worst_acos = 0;
    for (double h = 1e-3; h <= 1e8; h *= 1.7) {
        long double exact = acosl((long double)RADIUS / ((long double)RADIUS + h));
        worst = fmax(worst, fabs(sphere_horizon(h, RADIUS) / (double)exact - 1));
        float r = (float)RADIUS;
        worst_acos = fmax(worst_acos, fabs((double)acosf(r / (r + (float)h)) / (double)exact - 1));
    }
    FIGURE("D7: horizon off by at most %.1e (acos in float: %.2f)", worst, worst_acos);
    assert_true(worst < 3e-7 && worst_acos > 0.02);
    assert_true(sphere_horizon(0, RADIUS) == 0 && sphere_horizon(-430, RADIUS) == 0);
    float r = (float)RADIUS; // acos in float sees nothing from 0.2 m, and is no number below the datum
    assert_true(acosf(r / (r + 0.2f)) == 0 && isnan(acosf(r / (r - 430))));
    // SC11: a peak is seen beyond the horizon of its foot.
    double two = RADIUS * sphere_horizon(2, RADIUS),
           peak = RADIUS * (sphere_horizon(2, RADIUS) + sphere_horizon(4000, RADIUS));
    assert_true(fabs(two - 5050) < 5 && fabs(peak - 230800) < 100);
    // An eye below the datum, in the Dead Sea, sees rings all the same.
    struct terrain *terrain = test_planet(128, 3000, 7, 0);
    struct sphere_rings rings = sphere_rings_make(127);
    struct view view = view_at(terrain, 0.5, 0.5, -430);
    struct sphere_ring_range range = sphere_ring_visible(&rings, terrain, &view, 1.7);
    assert_true(range.outer >= 0 && range.outer < range.inner && range.inner < rings.count);
    terrain_destroy(terrain);
}

// SC8, SC9: the innermost ring's triangles are a pixel wide straight below.
static void rings_end_at_a_pixel(void **state)
{
    (void)state;
    struct terrain *terrain = test_planet(128, 3000, 7, 0);
    const struct terrain_info *info = terrain_info(terrain);
    struct sphere_rings rings = sphere_rings_make(255);
    double radius_m = info->radius_m + info->offset_m + info->quantum_m * info->min_q;
    for (double above_m = 10; above_m < 2e7; above_m *= 3) {
        struct view view = view_at(terrain, 0.1, 0.2, 9000 + above_m);
        struct sphere_ring_range range = sphere_ring_visible(&rings, terrain, &view, above_m);
        double side_m = sphere_ring_angle(&rings, range.inner) * 2 * M_PI / rings.azimuths * radius_m;
        double pixels = side_m * view.pixels_per_tangent / above_m;
        if (sphere_ring_angle(&rings, range.inner) < 0.49)
            assert_true(pixels >= 1 && pixels < exp2(1.0 / rings.an_octave) * 1.001);
    }
    terrain_destroy(terrain);
}

// ---- blocks ------------------------------------------------------------------------

// A block's reach is that of its farthest point: none goes farther, and on a grid of places within it one
// goes as far but for what an arc bends between two of them.
static void blocks_reach_as_far_as_they_do(void **state)
{
    enum { STEPS = 8 };
    static const double HEIGHTS_M[2] = {-500, 4000};
    (void)state;
    struct terrain *terrain = test_planet(128, 3000, 7, 0);
    struct sphere_rings rings = sphere_rings_make(127);
    uint64_t seed = 8;
    for (int k = 0; k < test_size(3000, 100000); k++) {
        struct view view = view_at(terrain, test_uniform(&seed, -3, 3), test_uniform(&seed, -1.5, 1.5),
                                   exp(test_uniform(&seed, 1, 16)));
        int ring[2] = {(int)(test_random(&seed) % (uint64_t)(rings.count - 1)), 0},
            azimuth[2] = {(int)(test_random(&seed) % 256), 0};
        ring[1] = ring[0] + 1 + (int)(test_random(&seed) % 24);
        if (ring[1] > rings.count - 1) ring[1] = rings.count - 1;
        azimuth[1] = azimuth[0] + 1 + (int)(test_random(&seed) % 64);
        double turn = test_uniform(&seed, -4, 4), direction[3], length = 0, most = -HUGE_VAL, distance = 0;
        for (int axis = 0; axis < 3; axis++) direction[axis] = test_uniform(&seed, -1, 1);
        for (int axis = 0; axis < 3; axis++) length = hypot(length, direction[axis]);
        struct sphere_block block;
        sphere_block_make(&block, &rings, &view, turn, ring, azimuth, HEIGHTS_M[0], HEIGHTS_M[1]);
        double reach = sphere_block_reach(&block, direction);
        double outer = sphere_ring_angle(&rings, ring[0]), inner = sphere_ring_angle(&rings, ring[1]);
        double from = turn + 2 * M_PI * azimuth[0] / rings.azimuths,
               to = turn + 2 * M_PI * azimuth[1] / rings.azimuths;
        for (int p = 0; p < 2 * (STEPS + 1) * (STEPS + 1); p++) {
            double r = inner + (outer - inner) * (p / 2 % (STEPS + 1)) / STEPS, half = sin(r / 2);
            double a = from + (to - from) * (p / 2 / (STEPS + 1)) / STEPS, z = HEIGHTS_M[p % 2];
            double at[3] = {(RADIUS + z) * sin(r) * cos(a), (RADIUS + z) * sin(r) * sin(a),
                            z - view.eye_place[2] - (RADIUS + z) * 2 * half * half};
            double along = at[0] * direction[0] + at[1] * direction[1] + at[2] * direction[2];
            assert_true(along <= reach);
            most = fmax(most, along);
            distance = fmax(distance, fabs(at[0]) + fabs(at[1]) + fabs(at[2]));
        }
        // An arc of radius R goes R (step / 2)^2 / 2 beyond the nearer of two places; the guard is 2e-6 of
        // the distance at most, for the sum of three coordinates is up to sqrt(3) of it.
        double bend =
            ((outer - inner) * (outer - inner) + (to - from) * (to - from) * sin(fmin(outer, M_PI / 2))) /
            (8.0 * STEPS * STEPS);
        assert_true(reach - most <= length * ((RADIUS + HEIGHTS_M[1]) * bend + 4e-6 * distance));
    }
    terrain_destroy(terrain);
}

// ---- stores ------------------------------------------------------------------------

struct memory {
    int size;
    float *texels, *heights;
    int32_t *columns;
    const struct sphere_shape *shape;
    const struct terrain *terrain;
    struct sphere_ranges *ranges; // NULL: not kept
};

static void read_memory(void *user, int level, int decimation, const struct clipmap_box *box, int slot_x,
                        int slot_y)
{
    struct memory *memory = user;
    const float *heights_q = memory->heights;
    int width = (int)(box->hi[0] - box->lo[0] + 1), height = (int)(box->hi[1] - box->lo[1] + 1);
    sphere_read_texels(memory->shape, memory->terrain, level, decimation, box, memory->heights,
                       memory->columns);
    if (memory->ranges) sphere_ranges_add(memory->ranges, box, heights_q);
    assert_true(slot_x >= 0 && slot_y >= 0 && slot_x + width <= memory->size &&
                slot_y + height <= memory->size);
    for (int j = 0; j < height; j++)
        memcpy(memory->texels + (size_t)(slot_y + j) * (size_t)memory->size + slot_x,
               heights_q + (size_t)j * (size_t)width, (size_t)width * sizeof *heights_q);
}

static float texel_at(const struct memory *memory, int64_t x, int64_t y)
{
    return memory->texels[clipmap_slot(y, memory->size) * memory->size + clipmap_slot(x, memory->size)];
}

// Ranges hold the heights of every vertex within an angle, and are no wider than what is held.
static void check_ranges(const struct memory *memory, int level, const struct sphere_window *held,
                         const double place[2], uint64_t *seed)
{
    const struct sphere_shape *shape = memory->shape;
    float low = HUGE_VALF, high = -HUGE_VALF, least = HUGE_VALF, most = -HUGE_VALF;
    double reach = 0.25 * shape->azimuths * ldexp(shape->spacing_m[1], level) / RADIUS,
           angle = fmin(reach, 3) * test_uniform(seed, 0.01, 1);
    sphere_ranges_within(memory->ranges, shape, level, held, place, angle, &low, &high);
    for (int azimuth = 0; azimuth < 64; azimuth++) {
        double turn = azimuth * M_PI / 32, at = angle * test_uniform(seed, 0, 1), half = sin(at / 2);
        float v[4] = {(float)(cos(turn) * sin(at)), (float)(sin(turn) * sin(at)), (float)(2 * half * half),
                      0};
        int64_t cell[2];
        texel_of(shape, level, held, place, v, cell);
        for (int corner = 0; corner < 4; corner++) {
            int64_t x = cell[0] + corner % 2;
            if (held->around) x = clipmap_slot(x, held->period);
            float z = texel_at(memory, x, cell[1] + corner / 2);
            assert_true(z >= low && z <= high);
        }
    }
    for (int64_t y = held->box.lo[1]; y <= held->box.hi[1]; y++)
        for (int64_t x = held->box.lo[0]; x <= held->box.hi[0]; x++) {
            least = fminf(least, texel_at(memory, x, y));
            most = fmaxf(most, texel_at(memory, x, y));
        }
    low = HUGE_VALF, high = -HUGE_VALF;
    sphere_ranges_within(memory->ranges, shape, level, held, place, 4, &low, &high);
    assert_true(low <= least && high >= most);
}

// After any walk a level holds what a fresh one holds, and a small step reads little.
static void walks_leave_levels_whole(void **state)
{
    (void)state;
    struct terrain *terrain = test_planet(512, 3000, 7, 4);
    struct sphere_shape shape;
    sphere_shape_init(&shape, terrain, 64, 0.5);
    int side = shape.size > shape.whole ? shape.size : shape.whole;
    size_t count = (size_t)side * (size_t)side;
    float *heights = malloc(count * sizeof *heights);
    int32_t *columns = malloc((count + 1) * sizeof *columns);
    struct memory walked = {shape.size, calloc(count, sizeof(float)), heights, columns, &shape, terrain,
                            NULL},
                  fresh = {shape.size, calloc(count, sizeof(float)), heights, columns, &shape, terrain, NULL};
    struct sphere_ranges ranges;
    assert_true(sphere_ranges_init(&ranges, side));
    walked.ranges = &ranges;
    const struct sphere_source into_walked = {read_memory, NULL, &walked},
                               into_fresh = {read_memory, NULL, &fresh};
    uint64_t seed = 3, steady = 0, steps = 0;
    for (int level = shape.finest; level <= shape.coarsest; level++) {
        int size = walked.size = fresh.size = sphere_level_size(&shape, level);
        struct sphere_store store = {.held.box = {{0, 0}, {-1, -1}}};
        double place[2] = {1.2 * RADIUS, 1.3 * RADIUS}, cell = ldexp(shape.spacing_m[1], level);
        for (int step = 0; step < test_size(12, 400); step++) {
            bool jump = step % 6 == 5;
            place[0] += cell * test_uniform(&seed, -1, 3);
            place[1] += cell * test_uniform(&seed, -1, 1);
            if (jump) place[1] = asin(test_uniform(&seed, -1, 1)) * RADIUS;
            place[1] = fmin(fmax(place[1], -M_PI / 2 * RADIUS), M_PI / 2 * RADIUS);
            struct sphere_window wanted = sphere_window_wanted(&shape, level, place);
            bool kept = wanted.decimation == store.held.decimation && wanted.around == store.held.around;
            if (!kept || step == 0) sphere_ranges_clear(&ranges);
            uint64_t read = sphere_store_move(&store, size, level, &wanted, UINT64_MAX, false, &into_walked);
            assert_true(clipmap_box_equal(&store.held.box, &wanted.box));
            check_ranges(&walked, level, &store.held, place, &seed);
            if (step && !jump && kept) steady += read, steps++;
        }
        struct sphere_store other = {.held.box = {{0, 0}, {-1, -1}}};
        sphere_store_move(&other, size, level, &store.held, UINT64_MAX, false, &into_fresh);
        for (int64_t y = store.held.box.lo[1]; y <= store.held.box.hi[1]; y++)
            for (int64_t x = store.held.box.lo[0]; x <= store.held.box.hi[0]; x++) {
                size_t at = (size_t)clipmap_slot(y, size) * (size_t)size + (size_t)clipmap_slot(x, size);
                assert_true(walked.texels[at] == fresh.texels[at]);
            }
    }
    double share = steps ? (double)steady / (double)steps / (double)count : 0;
    FIGURE("stores: a step of a cell or three reads %.3f of a level on average", share);
    assert_true(share < 0.15); // 4 of 64 columns and 4 of 64 rows at most once a step: 0.125
    sphere_ranges_finish(&ranges);
    free(walked.texels), free(fresh.texels), free(heights), free(columns);
    terrain_destroy(terrain);
}

// ---- late texels -------------------------------------------------------------------

// Columns of 16 x 16 texels arrive one every few questions.
struct late {
    struct memory memory;
    uint8_t arrived[64 * 64];
    int asked;
};

static bool is_there(void *user, int level, int decimation, const struct clipmap_box *box)
{
    struct late *late = user;
    bool there = true;
    (void)level, (void)decimation;
    for (int64_t y = box->lo[1] >> 4; y <= box->hi[1] >> 4; y++)
        for (int64_t x = box->lo[0] >> 4; x <= box->hi[0] >> 4; x++) {
            uint8_t *block = &late->arrived[(y & 63) * 64 + (x & 63)];
            if (!*block && ++late->asked % 7 == 0) *block = 1;
            there = there && *block;
        }
    return there;
}

static void read_late(void *user, int level, int decimation, const struct clipmap_box *box, int slot_x,
                      int slot_y)
{
    struct late *late = user;
    for (int64_t y = box->lo[1] >> 4; y <= box->hi[1] >> 4; y++)
        for (int64_t x = box->lo[0] >> 4; x <= box->hi[0] >> 4; x++)
            assert_true(late->arrived[(y & 63) * 64 + (x & 63)]); // nothing is waited for
    read_memory(&late->memory, level, decimation, box, slot_x, slot_y);
}

// A level that waits for its texels holds none that is not there, grows frame by frame, and in the end holds
// what a waiting one does.
static void late_texels_are_not_waited_for(void **state)
{
    (void)state;
    struct terrain *terrain = test_planet(512, 3000, 7, 2);
    struct sphere_shape shape;
    sphere_shape_init(&shape, terrain, 128, 0.5);
    size_t count = (size_t)shape.size * (size_t)shape.size;
    float *heights = malloc(count * sizeof *heights);
    int32_t *columns = malloc((count + 1) * sizeof *columns);
    struct late late = {
        .memory = {shape.size, calloc(count, sizeof(float)), heights, columns, &shape, terrain, NULL}};
    struct memory fresh = {shape.size, calloc(count, sizeof(float)), heights, columns, &shape, terrain, NULL};
    const struct sphere_source into_late = {read_late, is_there, &late},
                               into_fresh = {read_memory, NULL, &fresh};
    struct sphere_store store = {.held.box = clipmap_empty}, other = {.held.box = clipmap_empty};
    double place[2] = {0.4 * RADIUS, 0.9 * RADIUS};
    struct sphere_window wanted = sphere_window_wanted(&shape, 0, place);
    int frames = 0, serving = 0;
    uint64_t held = 0;
    for (; !clipmap_box_equal(&store.held.box, &wanted.box); frames++) {
        sphere_store_move(&store, shape.size, 0, &wanted, UINT64_MAX, false, &into_late);
        assert_true(clipmap_box_samples(&store.held.box) >= held && frames < 1000);
        held = clipmap_box_samples(&store.held.box);
        serving += sphere_window_serves(&shape, 0, &store.held, place);
    }
    sphere_store_move(&other, shape.size, 0, &wanted, UINT64_MAX, true, &into_fresh);
    assert_memory_equal(late.memory.texels, fresh.texels, count * sizeof(float));
    FIGURE("late texels: a level is whole after %d frames, and serves in the last %d of them", frames,
           serving);
    assert_true(frames > 2 && serving > 0 && serving < frames);
    free(late.memory.texels), free(fresh.texels), free(heights), free(columns);
    terrain_destroy(terrain);
}

// ---- colours -----------------------------------------------------------------------

// A smooth colour of the place: what linear filters keep.
static double smooth(double longitude, double latitude, int channel)
{
    double world[3] = {cos(latitude) * cos(longitude), cos(latitude) * sin(longitude), sin(latitude)};
    return channel < 3 ? 127.5 + 127 * world[channel] : 255;
}

// Texels of any level, any window, over seam and poles, are the image's colour at their place: off by the
// rounding of each level and of the mean, and by what a square of their size is off by.
static void colours_are_those_of_their_place(void **state)
{
    enum { W = 256, H = 128 };
    (void)state;
    static uint8_t pixels[H][W][4];
    for (int j = 0; j < H; j++)
        for (int i = 0; i < W; i++)
            for (int k = 0; k < 4; k++)
                pixels[j][i][k] =
                    (uint8_t)lrint(smooth((i + 0.5 - W / 2) * 2 * M_PI / W, (H / 2 - j - 0.5) * M_PI / H, k));
    struct scene_colour colour = {.name = "smooth", .width = W, .height = H, .pixels = &pixels[0][0][0]};
    struct sphere_image image;
    assert_true(sphere_image_init(&image, &colour));
    assert_true(image.count == 7);
    uint64_t seed = 16;
    double worst = 0;
    for (int n = 0; n < test_size(4000, 400000); n++) {
        int level = (int)(test_random(&seed) % 4), p = (int)(test_random(&seed) % 3);
        int64_t i = (int64_t)test_uniform(&seed, -600, 600), j = (int64_t)test_uniform(&seed, -200, 200);
        struct clipmap_box box = {{i, j}, {i, j}};
        uint8_t texel[4];
        sphere_image_read(&image, level, p, &box, &texel);
        double step = ldexp(2 * M_PI / W, level), wide = ldexp(step, p);
        double bound = 0.5 * (level + 2) + 127 * (wide * wide + step * step * level) / 24;
        for (int k = 0; k < 4; k++) { // beyond a pole cos(latitude) < 0 leads on to the other side
            double off = fabs(texel[k] - smooth((i + 0.5) * wide, (j + 0.5) * step, k));
            worst = fmax(worst, off / bound);
            assert_true(off <= bound);
        }
    }
    FIGURE("colours: off by at most %.2f of what rounding and size allow", worst);
    sphere_image_finish(&image);
}

// D10: what the chords of rings leave out of the sphere, as seen from the ground up to the farthest peak that
// shows there; a triangle is off by at most what half its diagonal is.
static void chords_of_rings_do_not_show(void **state)
{
    (void)state;
    double worst = 0, farthest = sphere_horizon(1.7, 6371007) + sphere_horizon(8848, 6371007);
    for (int n = 127; n <= 511; n = 2 * n + 1) {
        struct sphere_rings rings = sphere_rings_make(n);
        for (int ring = 0; ring < rings.count - 2; ring++) {
            double angle = sphere_ring_angle(&rings, ring);
            if (angle > farthest) continue;
            float a[4], b[4];
            double middle[3], squares = 0;
            sphere_ring_vertex(&rings, ring, 0, a);
            sphere_ring_vertex(&rings, ring + 1, 1, b);
            for (int k = 0; k < 3; k++) middle[k] = 0.5 * ((double)a[k] + (double)b[k]);
            for (int k = 0; k < 2; k++) squares += middle[k] * middle[k];
            // 1 - |middle| over the sphere's centre, without cancellation: c is 1 - cos(angle).
            double sag = middle[2] - (squares + middle[2] * middle[2]) / 2;
            worst = fmax(worst, 640 / 2 * fabs(sag) / angle); // 90 degrees over 640 pixels
        }
    }
    FIGURE("D10: chords of rings leave out at most %.1e px as seen from the ground", worst);
    assert_true(worst > 0 && worst <= 0.01);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(positions_keep_their_height),
        cmocka_unit_test(stable_angles_are_right_at_all_latitudes),
        cmocka_unit_test(texels_are_monotone_on_a_small_ring),
        cmocka_unit_test(the_pattern_is_carried_over_a_pole),
        cmocka_unit_test(windows_hold_what_rings_sample),
        cmocka_unit_test(windows_serve_while_they_hold),
        cmocka_unit_test(levels_are_not_read_anew_together),
        cmocka_unit_test(columns_stand_alone_near_the_viewer),
        cmocka_unit_test(horizons_are_exact),
        cmocka_unit_test(rings_end_at_a_pixel),
        cmocka_unit_test(chords_of_rings_do_not_show),
        cmocka_unit_test(blocks_reach_as_far_as_they_do),
        cmocka_unit_test(walks_leave_levels_whole),
        cmocka_unit_test(colours_are_those_of_their_place),
        cmocka_unit_test(late_texels_are_not_waited_for),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
