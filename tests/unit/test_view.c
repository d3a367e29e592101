// The camera: lattice, axes, projection.  Bounds are those of numerics.md: B2, B5, B14, A9, E6, E7, E11.
// SPDX-License-Identifier: MIT
#include "common/view/view.h"

#include "tests/test.h"

#include <string.h>

static const double degree = M_PI / 180;

static struct terrain *flat_terrain(int64_t width, int64_t height, const int64_t first[2], double spacing_x,
                                    double spacing_y, int32_t q, int finer)
{
    int32_t *samples = malloc((size_t)(width * height) * sizeof *samples);
    for (int64_t i = 0; i < width * height; i++) samples[i] = q;
    struct terrain_grid grid = {.name = "flat",
                                .samples = samples,
                                .width = width,
                                .height = height,
                                .first = {first[0], first[1]},
                                .spacing_m = {spacing_x, spacing_y},
                                .quantum_m = 0.1,
                                .offset_m = -7};
    struct terrain *terrain = terrain_from_grid(&grid, &(struct terrain_options){.synthesize_levels = finer});
    free(samples);
    assert_non_null(terrain);
    return terrain;
}

static struct terrain *small_terrain(void)
{
    return flat_terrain(65, 33, (int64_t[2]){-32, -16}, 30, 50, 100, 0);
}

static struct camera camera_at(double x, double y, double z, double yaw, double pitch, double roll,
                               double fov)
{
    return (struct camera){{x, y, z}, yaw * degree, pitch * degree, roll * degree, fov * degree};
}

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static bool all_finite(const struct view *view)
{
    const double *values[] = {view->eye_m, view->right, view->up, view->forward};
    bool good = isfinite(view->near_m) && view->near_m > 0 && isfinite(view->pixels_per_tangent);
    for (int i = 0; i < 4; i++)
        for (int axis = 0; axis < 3; axis++) good = good && isfinite(values[i][axis]);
    for (int i = 0; i < 16; i++) good = good && isfinite(view->clip_from_relative[i]);
    return good;
}

// ---- the lattice -----------------------------------------------------------

// A vertex relative to the eye as a vertex program forms it.
static float relative_place(const struct view *view, const struct terrain_info *info, int level, int axis,
                            int64_t i)
{
    struct view_origin origin = view_level_origin(view, level);
    float cell = (float)(i - origin.base[axis]);
    return (cell - origin.fraction[axis]) * (float)ldexp(info->spacing_m[axis], level);
}

// The same from float origins by level (published): must disagree, or the test proves nothing.
static float published_place(const struct view *view, const struct terrain_info *info, int level, int axis,
                             int64_t i, const double eye[2])
{
    double g = ldexp(info->spacing_m[axis], level);
    float origin = (float)(floor(eye[axis] / g) * g - eye[axis]);
    return origin + (float)(i - view_level_origin(view, level).base[axis]) * (float)g;
}

static void check_origins(const struct view *view, const struct terrain_info *info)
{
    for (int level = info->finest; level <= info->coarsest; level++) {
        struct view_origin origin = view_level_origin(view, level);
        int bits = view->lattice_bits + level - view->finest;
        assert_in_range(bits, 0, 23);
        for (int axis = 0; axis < 2; axis++) {
            float steps = ldexpf(origin.fraction[axis], bits);
            assert_true(origin.fraction[axis] >= 0 && origin.fraction[axis] < 1);
            assert_true(steps == floorf(steps));
            assert_true(origin.base[axis] * ((int64_t)1 << bits) + (int64_t)steps == view->eye_lattice[axis]);
        }
    }
}

static long shared_mismatches(const struct view *view, const struct terrain_info *info, const double eye[2],
                              long *published)
{
    long wrong = 0;
    for (int level = info->finest; level < info->coarsest; level++)
        for (int axis = 0; axis < 2; axis++)
            for (int k = -127; k <= 127; k += 2) {
                int64_t i = view_level_origin(view, level + 1).base[axis] + k;
                wrong += relative_place(view, info, level, axis, 2 * i) !=
                         relative_place(view, info, level + 1, axis, i);
                *published += published_place(view, info, level, axis, 2 * i, eye) !=
                              published_place(view, info, level + 1, axis, i, eye);
            }
    return wrong;
}

static void lattice_case(int64_t width, double spacing_x, double spacing_y, int finer, double far_m,
                         uint64_t seed)
{
    int64_t first[2] = {(int64_t)(far_m / spacing_x), -(int64_t)(far_m / spacing_y)};
    struct terrain *terrain = flat_terrain(width, 1, first, spacing_x, spacing_y, 0, finer);
    const struct terrain_info *info = terrain_info(terrain);
    long wrong = 0, published = 0, views = test_size(200, 20000);
    int bits = 0;
    for (long n = 0; n < views; n++) {
        double eye[2], reach = (double)width * spacing_x;
        for (int axis = 0; axis < 2; axis++)
            eye[axis] = (double)first[axis] * info->spacing_m[axis] + test_uniform(&seed, -reach, reach);
        struct camera camera = camera_at(eye[0], eye[1], test_uniform(&seed, -10, 10), 0, 0, 0, 60);
        struct view view;
        view_init(&view, terrain, &camera, 640, 480, 0);
        for (int axis = 0; axis < 2; axis++) {
            double unit = ldexp(info->spacing_m[axis], info->finest - view.lattice_bits);
            assert_true(fabs(view.eye_m[axis] - eye[axis]) <=
                        unit / 2 * (1 + 1e-9) + 1e-15 * fabs(eye[axis]));
            assert_true(view.eye_m[axis] == (double)view.eye_lattice[axis] * unit);
        }
        check_origins(&view, info);
        wrong += shared_mismatches(&view, info, eye, &published);
        bits = view.lattice_bits;
    }
    FIGURE("lattice: %d levels, b = %d, %g m out: %ld of %ld views' shared vertices differ (published form: "
           "%ld)",
           info->coarsest - info->finest + 1, bits, far_m, wrong, views, published);
    assert_int_equal(wrong, 0);
    assert_true(published > 0);
    terrain_destroy(terrain);
}

static void shared_vertices_agree_bitwise(void **state)
{
    (void)state;
    lattice_case(1025, 160, 160, 0, 0, 1);
    lattice_case(403, 74.21, 92.66, 3, 0, 2);
    lattice_case(8193, 0x1p-10, 0x1p-10, 0, 1e7, 3);
    lattice_case(test_size(1 << 17, 1 << 22) + 1, 0x1p-10, 0x1p-10, 0, 1e7, 4);
}

static void lattice_bits_follow_the_levels(void **state)
{
    (void)state;
    int64_t widths[] = {1, 2, 9, 1025, 1 << 14, (1 << 20) + 1};
    for (int i = 0; i < 6; i++) {
        struct terrain *terrain = flat_terrain(widths[i], 1, (int64_t[2]){0, 0}, 1, 1, 0, 0);
        const struct terrain_info *info = terrain_info(terrain);
        struct camera camera = camera_at(0.3, 0.7, 1, 0, 0, 0, 60);
        struct view view;
        view_init(&view, terrain, &camera, 4, 4, 0);
        int levels = info->coarsest - info->finest + 1;
        assert_in_range(view.lattice_bits, 0, 12);
        assert_true(view.lattice_bits + levels - 1 <= 23);
        assert_true(view.lattice_bits == 12 || view.lattice_bits + levels - 1 == 23); // as fine as it may be
        terrain_destroy(terrain);
    }
}

// A walk through zero is the translated walk of one far from it (B5): same fractions, bases apart by the
// shift.
static void walk_through_zero(void **state)
{
    (void)state;
    struct terrain *terrain = flat_terrain(1025, 9, (int64_t[2]){-512, -4}, 1, 1, 0, 0);
    const struct terrain_info *info = terrain_info(terrain);
    const int64_t shift = (int64_t)1 << 20;
    for (int step = -3000; step <= 3000; step++) {
        struct view here, there;
        struct camera camera = camera_at(step * 0x1p-10, -step * 0x1p-9, 0, 0, 0, 0, 60);
        view_init(&here, terrain, &camera, 4, 4, 1);
        camera.eye_m[0] += (double)shift;
        camera.eye_m[1] += (double)shift;
        view_init(&there, terrain, &camera, 4, 4, 1);
        for (int level = info->finest; level <= info->coarsest; level++) {
            struct view_origin a = view_level_origin(&here, level), b = view_level_origin(&there, level);
            for (int axis = 0; axis < 2; axis++) {
                assert_true(a.fraction[axis] == b.fraction[axis]);
                assert_true(a.base[axis] + (shift >> level) == b.base[axis]);
            }
        }
    }
    terrain_destroy(terrain);
}

static void eye_height_splits_exactly(void **state)
{
    (void)state;
    struct terrain *terrain = small_terrain();
    const struct terrain_info *info = terrain_info(terrain);
    uint64_t seed = 5;
    for (int n = 0; n < 10000; n++) {
        double z = test_uniform(&seed, -9000, 9000);
        struct camera camera = camera_at(0, 0, z, 0, 0, 0, 60);
        struct view view;
        int32_t base;
        float fraction;
        view_init(&view, terrain, &camera, 4, 4, 0);
        view_eye_quanta(&view, &base, &fraction);
        assert_true(fraction >= 0 && fraction < 1);
        assert_true(ldexpf(fraction, VIEW_HEIGHT_BITS) == floorf(ldexpf(fraction, VIEW_HEIGHT_BITS)));
        double height_m = ((double)base + (double)fraction) * info->quantum_m + info->offset_m;
        assert_true(fabs(height_m - view.eye_m[2]) <= 1e-12 * 9000);
        assert_true(fabs(view.eye_m[2] - z) <=
                    ldexp(info->quantum_m, -VIEW_HEIGHT_BITS) / 2 * (1 + 1e-9) + 1e-12);
    }
    terrain_destroy(terrain);
}

// ---- axes ------------------------------------------------------------------

static void axes_are_orthonormal_everywhere(void **state)
{
    (void)state;
    struct terrain *terrain = small_terrain();
    double worst = 0;
    for (int pitch = -900; pitch <= 900; pitch += test_size(5, 1))
        for (int roll = 0; roll <= 180; roll += 5) {
            struct camera camera = camera_at(0, 0, 100, pitch * 0.7, pitch * 0.1, roll, 60);
            struct view view;
            view_init(&view, terrain, &camera, 640, 480, 0);
            assert_true(all_finite(&view));
            double *axes[] = {view.right, view.up, view.forward};
            for (int a = 0; a < 3; a++)
                for (int b = 0; b < 3; b++) worst = fmax(worst, fabs(dot(axes[a], axes[b]) - (a == b)));
            double *r = view.right, *f = view.forward; // up = right x forward
            double cross[3] = {r[1] * f[2] - r[2] * f[1], r[2] * f[0] - r[0] * f[2],
                               r[0] * f[1] - r[1] * f[0]};
            for (int axis = 0; axis < 3; axis++) worst = fmax(worst, fabs(cross[axis] - view.up[axis]));
        }
    FIGURE("axes: worst deviation from orthonormal %.3g", worst);
    assert_true(worst <= 1e-6); // E6
    terrain_destroy(terrain);
}

static void angles_mean_what_they_say(void **state)
{
    (void)state;
    struct terrain *terrain = small_terrain();
    struct camera north = camera_at(0, 0, 100, 90, 30, 0, 60);
    struct view view;
    view_init(&view, terrain, &north, 640, 480, 0);
    assert_true(fabs(view.forward[1] - cos(30 * degree)) < 1e-15 && fabs(view.forward[2] - 0.5) < 1e-15);
    assert_true(fabs(view.right[0] - 1) < 1e-15); // looking north, east is at the right
    struct camera rolled = camera_at(0, 0, 100, 90, 0, 20, 60);
    view_init(&view, terrain, &rolled, 640, 480, 0);
    assert_true(view.right[2] < 0); // roll > 0 lowers the right side
    terrain_destroy(terrain);
}

static void straight_down_is_nothing_special(void **state)
{
    (void)state;
    struct terrain *terrain = small_terrain();
    double worst = 0;
    for (int sign = -1; sign <= 1; sign += 2)
        for (int yaw = 0; yaw < 360; yaw += 7) {
            struct camera exact = camera_at(0, 0, 100, yaw, sign * 90, 0, 60), near = exact;
            near.pitch = sign * 89.999 * degree;
            struct view a, b;
            view_init(&a, terrain, &exact, 640, 480, 0);
            view_init(&b, terrain, &near, 640, 480, 0);
            for (int y = 0; y < 480; y += 53)
                for (int x = 0; x < 640; x += 71) {
                    double ray[3], pixel[2];
                    view_ray(&a, x, y, ray);
                    for (int axis = 0; axis < 3; axis++) ray[axis] *= 1000;
                    assert_true(view_project(&b, ray, pixel));
                    worst = fmax(worst, hypot(pixel[0] - x - 0.5, pixel[1] - y - 0.5));
                }
        }
    FIGURE("straight down: pitch 90 against 89.999 moves %.4f px", worst);
    assert_true(worst <= 0.1); // A9
    terrain_destroy(terrain);
}

// ---- projection ------------------------------------------------------------

static void field_of_view_is_vertical(void **state)
{
    (void)state;
    struct terrain *terrain = small_terrain();
    struct view view;
    struct camera camera = camera_at(0, 0, 100, 0, 0, 0, 60);
    view_init(&view, terrain, &camera, 640, 480, 0);
    assert_true(fabs(view.pixels_per_tangent - 415.692193816531) < 1e-9);
    camera.fov_vertical = 2 * atan(tan(45 * degree) * 480 / 640); // 90 degrees across
    view_init(&view, terrain, &camera, 640, 480, 0);
    assert_true(fabs(view.pixels_per_tangent - 320) < 1e-9);
    terrain_destroy(terrain);
}

static void rays_projection_and_matrix_agree(void **state)
{
    (void)state;
    struct terrain *terrain = small_terrain();
    uint64_t seed = 6;
    double worst_px = 0, worst_clip_px = 0, worst_depth = 0;
    for (int n = 0; n < test_size(20000, 1000000); n++) {
        struct camera camera =
            camera_at(0, 0, 100, test_uniform(&seed, -720, 720), test_uniform(&seed, -90, 90),
                      test_uniform(&seed, -180, 180), test_uniform(&seed, 20, 120));
        struct view view;
        view_init(&view, terrain, &camera, 640, 480, 0.1);
        int x = (int)(test_random(&seed) % 640), y = (int)(test_random(&seed) % 480);
        double p[3], pixel[2], depth = exp(test_uniform(&seed, log(0.1), log(1e6)));
        view_ray(&view, x, y, p);
        assert_true(fabs(dot(p, view.forward) - 1) < 1e-12);
        for (int axis = 0; axis < 3; axis++) p[axis] *= depth * 1.001;
        assert_true(view_project(&view, p, pixel));
        worst_px = fmax(worst_px, hypot(pixel[0] - x - 0.5, pixel[1] - y - 0.5));
        double clip[4] = {0};
        for (int row = 0; row < 4; row++)
            for (int column = 0; column < 4; column++)
                clip[row] += (double)view.clip_from_relative[column * 4 + row] * (column < 3 ? p[column] : 1);
        worst_clip_px = fmax(worst_clip_px, hypot((clip[0] / clip[3] + 1) * 320 - pixel[0],
                                                  (clip[1] / clip[3] + 1) * 240 - pixel[1]));
        worst_depth = fmax(worst_depth, fabs(view.near_m / (clip[2] / clip[3]) / (depth * 1.001) - 1));
    }
    FIGURE("projection: ray and back %.3g px, float matrix %.3g px, depth %.3g relative", worst_px,
           worst_clip_px, worst_depth);
    assert_true(worst_px <= 1e-9);
    // A rounded entry (2^-24) moves a row's sum by 2^-24 |row||p|; with |p| <= 3.1 w, |row| <= 1/tan(10 deg)
    // = 5.7 across and 4 rounded terms in the quotient: 320 px * 4 * 2^-24 * 5.7 * 3.1 = 1.3e-3.
    assert_true(worst_clip_px <= 1.3e-3);
    assert_true(worst_depth <= 1e-6);
    terrain_destroy(terrain);
}

static bool dense_vertical(const struct view *view, double x, double y, double z0, double z1, double *length)
{
    // The same by bisection on the visible part and view_project at its ends.
    double ends[2] = {z0, z1}, pixel[2][2];
    for (int end = 0; end < 2; end++) {
        double p[3] = {x, y, ends[end]};
        if (dot(p, view->forward) >= view->near_m) continue;
        double hidden = ends[end], seen = ends[1 - end], other[3] = {x, y, seen};
        if (dot(other, view->forward) < view->near_m) return false;
        for (int k = 0; k < 200; k++) {
            double middle = 0.5 * (hidden + seen), q[3] = {x, y, middle};
            *(dot(q, view->forward) >= view->near_m ? &seen : &hidden) = middle;
        }
        ends[end] = seen;
    }
    for (int end = 0; end < 2; end++) {
        double p[3] = {x, y, ends[end]};
        if (!view_project(view, p, pixel[end])) return false;
    }
    *length = hypot(pixel[1][0] - pixel[0][0], pixel[1][1] - pixel[0][1]);
    return true;
}

static void vertical_segments(void **state)
{
    (void)state;
    struct terrain *terrain = small_terrain();
    uint64_t seed = 7;
    int clipped = 0, hidden = 0;
    double worst = 0;
    for (int n = 0; n < test_size(50000, 1000000); n++) {
        struct camera camera = camera_at(0, 0, 100, test_uniform(&seed, 0, 360), test_uniform(&seed, -90, 90),
                                         test_uniform(&seed, -180, 180), 60);
        struct view view;
        view_init(&view, terrain, &camera, 640, 480, 1);
        double x = test_uniform(&seed, -9, 9), y = test_uniform(&seed, -9, 9),
               z0 = test_uniform(&seed, -9, 9);
        double z1 = test_uniform(&seed, -9, 9), length, expected = 0;
        bool seen = view_project_vertical(&view, x, y, z0, z1, &length);
        assert_int_equal(seen, dense_vertical(&view, x, y, z0, z1, &expected));
        hidden += !seen;
        clipped += seen && (dot((double[3]){x, y, z0}, view.forward) < 1 ||
                            dot((double[3]){x, y, z1}, view.forward) < 1);
        worst = fmax(worst, fabs(length - expected) / (1 + expected));
    }
    FIGURE("vertical segments: worst difference %.3g px (relative above 1), %d clipped, %d hidden", worst,
           clipped, hidden);
    assert_true(worst <= 1e-7);
    assert_true(clipped > 100 && hidden > 100);
    terrain_destroy(terrain);
}

// A known bump: 1 m at 100 m, seen level through K = 415.7, is 4.157 px; a millionth of it keeps its digits.
static void vertical_error_of_a_known_bump(void **state)
{
    (void)state;
    struct terrain *terrain = small_terrain();
    struct camera camera = camera_at(0, 0, 100, 0, 0, 0, 60);
    struct view view;
    double length;
    view_init(&view, terrain, &camera, 640, 480, 0.1);
    assert_true(view_project_vertical(&view, 100, 0, -20, -19, &length));
    assert_true(fabs(length - view.pixels_per_tangent / 100) < 1e-12);
    assert_true(view_project_vertical(&view, 100, 0, -20, -20 + 0x1p-40, &length));
    assert_true(fabs(length / (view.pixels_per_tangent / 100 * 0x1p-40) - 1) < 1e-12);
    terrain_destroy(terrain);
}

// ---- near and extremes -----------------------------------------------------

static void near_by_height_over_ground(void **state)
{
    (void)state;
    struct terrain *terrain = small_terrain(); // ground at 3 m: 100 quanta of 0.1 m above -7 m
    const struct {
        double x, y, z, near;
    } cases[] = {{0, 0, 103, 10},    {0, 0, 3.1, 0.05}, {0, 0, -50, 0.05},
                 {1e6, -1e6, 23, 2}, {960, 800, 13, 1}, {0, 0, 1e6 + 3, 1e5}};
    for (int i = 0; i < 6; i++) {
        struct camera camera = camera_at(cases[i].x, cases[i].y, cases[i].z, 0, 0, 0, 60);
        struct view view;
        view_init(&view, terrain, &camera, 640, 480, 0);
        assert_true(fabs(view.near_m - cases[i].near) <=
                    0.1 * ldexp(0.1, -VIEW_HEIGHT_BITS)); // the eye snaps
        view_init(&view, terrain, &camera, 640, 480, 0.25);
        assert_true(view.near_m == 0.25);
    }
    terrain_destroy(terrain);
}

static void extremes_stay_finite(void **state)
{
    (void)state;
    struct terrain *terrain = small_terrain();
    const int windows[][2] = {{1, 1},    {1, 480},   {640, 1},   {16, 256},
                              {256, 16}, {1, 16384}, {16384, 1}, {640, 480}};
    const double fovs[] = {1, 10, 60, 120, 170},
                 places[][3] = {{0, 0, 4}, {0, 0, -1e4}, {1e9, -1e9, 1e8}, {0, 0, 1e300}};
    int cases = 0;
    for (int w = 0; w < 8; w++)
        for (int f = 0; f < 5; f++)
            for (int p = 0; p < 4; p++)
                for (int pitch = -90; pitch <= 90; pitch += 45, cases++) {
                    struct camera camera =
                        camera_at(places[p][0], places[p][1], places[p][2], 13, pitch, 71, fovs[f]);
                    struct view view;
                    double ray[3];
                    view_init(&view, terrain, &camera, windows[w][0], windows[w][1], 0);
                    view_ray(&view, windows[w][0] - 1, windows[w][1] - 1, ray);
                    assert_true(all_finite(&view) && isfinite(dot(ray, ray)));
                    for (int level = 0; level <= 3; level++)
                        for (int axis = 0; axis < 2; axis++) {
                            float fraction = view_level_origin(&view, level).fraction[axis];
                            assert_true(fraction >= 0 && fraction < 1);
                        }
                }
    FIGURE("extremes: %d cameras, all finite", cases);
    terrain_destroy(terrain);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(shared_vertices_agree_bitwise),
        cmocka_unit_test(lattice_bits_follow_the_levels),
        cmocka_unit_test(walk_through_zero),
        cmocka_unit_test(eye_height_splits_exactly),
        cmocka_unit_test(axes_are_orthonormal_everywhere),
        cmocka_unit_test(angles_mean_what_they_say),
        cmocka_unit_test(straight_down_is_nothing_special),
        cmocka_unit_test(field_of_view_is_vertical),
        cmocka_unit_test(rays_projection_and_matrix_agree),
        cmocka_unit_test(vertical_segments),
        cmocka_unit_test(vertical_error_of_a_known_bump),
        cmocka_unit_test(near_by_height_over_ground),
        cmocka_unit_test(extremes_stay_finite),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
