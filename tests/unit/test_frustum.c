// Boxes against the frustum, compared with dense samples and with an exact vertex enumeration (B15).
// SPDX-License-Identifier: MIT
#include "common/view/frustum.h"

#include "tests/test.h"

#include <string.h>

struct box {
    double low[3], high[3];
};

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static struct terrain *ground;

static int make_ground(void **state)
{
    (void)state;
    const int32_t samples[4] = {0, 0, 0, 0};
    struct terrain_grid grid = {
        .name = "flat", .samples = samples, .width = 2, .height = 2, .spacing_m = {1, 1}, .quantum_m = 1};
    ground = terrain_from_grid(&grid, &(struct terrain_options){0});
    return ground ? 0 : -1;
}

static int drop_ground(void **state)
{
    (void)state;
    terrain_destroy(ground);
    return 0;
}

static struct view random_view(uint64_t *seed)
{
    static const int windows[][2] = {{640, 480}, {16, 256}, {256, 16}, {1, 1}};
    const int *window = windows[test_random(seed) % 4];
    struct camera camera = {.eye_m = {0, 0, 0},
                            .yaw = test_uniform(seed, -M_PI, M_PI),
                            .pitch = test_uniform(seed, -M_PI / 2, M_PI / 2),
                            .roll = test_random(seed) % 2 ? test_uniform(seed, -M_PI, M_PI) : 0,
                            .fov_vertical = exp(test_uniform(seed, log(1), log(120))) * M_PI / 180};
    struct view view;
    view_init(&view, ground, &camera, window[0], window[1], exp(test_uniform(seed, log(0.05), log(50))));
    return view;
}

// Boxes of all sizes and flatness; every third holds the eye.
static struct box random_box(uint64_t *seed)
{
    struct box box;
    bool holds_eye = test_random(seed) % 3 == 0;
    double size = exp(test_uniform(seed, log(1), log(1000)));
    for (int axis = 0; axis < 3; axis++) {
        double half = size * exp(test_uniform(seed, -2, 0)),
               centre = test_uniform(seed, -1, 1) * (holds_eye ? half : 1000);
        if (axis == 2) centre *= 0.3;
        if (test_random(seed) % 8 == 0) half = 0;
        box.low[axis] = centre - half;
        box.high[axis] = centre + half;
    }
    return box;
}

static bool visible(const struct view *view, const double p[3])
{
    double depth = dot(view->forward, p);
    return depth >= view->near_m && fabs(dot(view->right, p)) <= view->tan_half[0] * depth &&
           fabs(dot(view->up, p)) <= view->tan_half[1] * depth;
}

static bool in_box(const struct box *box, const double p[3])
{
    for (int axis = 0; axis < 3; axis++)
        if (!(p[axis] >= box->low[axis] && p[axis] <= box->high[axis])) return false;
    return true;
}

// A point of the box: anywhere in it, or where a ray of the view passes through it.
static bool sample_point(const struct view *view, const struct box *box, uint64_t *seed, double p[3])
{
    if (test_random(seed) % 2) {
        for (int axis = 0; axis < 3; axis++) {
            double t = test_uniform(seed, -0.1, 1.1); // corners, edges and faces come often
            t = fmin(fmax(t, 0), 1);
            p[axis] = t == 1 ? box->high[axis] : box->low[axis] + t * (box->high[axis] - box->low[axis]);
        }
        return true;
    }
    double across = test_uniform(seed, -1, 1) * view->tan_half[0],
           along = test_uniform(seed, -1, 1) * view->tan_half[1];
    double enter = view->near_m, leave = 1e9;
    for (int axis = 0; axis < 3; axis++) {
        double d = view->forward[axis] + across * view->right[axis] + along * view->up[axis];
        double a = box->low[axis] / d, b = box->high[axis] / d;
        enter = fmax(enter, fmin(a, b));
        leave = fmin(leave, fmax(a, b));
        p[axis] = d;
    }
    if (!(enter <= leave)) return false;
    double t = test_random(seed) % 4 == 0 ? enter : test_uniform(seed, enter, leave);
    for (int axis = 0; axis < 3; axis++) p[axis] *= t;
    return in_box(box, p);
}

struct tally {
    long points, outside, beyond_rect, too_deep, crossed, wrong_inside;
};

static void sample_box(const struct view *view, const struct box *box, uint64_t *seed, int samples,
                       struct tally *tally)
{
    struct frustum frustum;
    unsigned mask = FRUSTUM_ALL;
    double rect[4], min_depth = 0;
    frustum_init(&frustum, view);
    enum frustum_side side = frustum_test_box(&frustum, box->low, box->high, &mask);
    bool kept = frustum_clip_box(view, box->low, box->high, rect, &min_depth);
    assert_true((side == FRUSTUM_INSIDE) == (side != FRUSTUM_OUTSIDE && mask == 0));
    tally->crossed += kept;
    for (int n = 0; n < samples; n++) {
        double p[3];
        if (!sample_point(view, box, seed, p)) continue;
        bool seen = visible(view, p);
        tally->wrong_inside += side == FRUSTUM_INSIDE && !seen;
        if (!seen) continue;
        tally->points++;
        tally->outside += side == FRUSTUM_OUTSIDE;
        tally->beyond_rect += !kept || p[0] < rect[0] || p[1] < rect[1] || p[0] > rect[2] || p[1] > rect[3];
        tally->too_deep += !kept || dot(view->forward, p) < min_depth * (1 - 1e-12);
    }
}

static void no_visible_point_is_lost(void **state)
{
    (void)state;
    uint64_t seed = 11;
    struct tally tally = {0};
    int boxes = test_size(20000, 400000);
    for (int n = 0; n < boxes; n++) {
        struct view view = random_view(&seed);
        struct box box = random_box(&seed);
        sample_box(&view, &box, &seed, 200, &tally);
    }
    FIGURE("frustum: %d boxes, %ld in part visible, %ld visible points: %ld culled, %ld beyond the "
           "rectangle, %ld too "
           "deep, %ld wrongly inside",
           boxes, tally.crossed, tally.points, tally.outside, tally.beyond_rect, tally.too_deep,
           tally.wrong_inside);
    assert_true(tally.points > boxes);
    assert_int_equal(tally.outside, 0);
    assert_int_equal(tally.beyond_rect, 0);
    assert_int_equal(tally.too_deep, 0);
    assert_int_equal(tally.wrong_inside, 0);
}

// ---- exactness: every vertex of box and frustum together, from all triples of their planes

struct planes {
    double normal[11][3], offset[11];
};

static struct planes all_planes(const struct view *view, const struct box *box, double guard)
{
    struct planes planes;
    struct frustum frustum;
    frustum_init(&frustum, view);
    memset(&planes, 0, sizeof planes);
    for (int i = 0; i < 5; i++) {
        memcpy(planes.normal[i], frustum.normal[i], sizeof planes.normal[i]);
        planes.offset[i] = frustum.offset[i] + guard;
    }
    for (int axis = 0; axis < 3; axis++) {
        planes.normal[5 + 2 * axis][axis] = 1;
        planes.offset[5 + 2 * axis] = -box->low[axis];
        planes.normal[6 + 2 * axis][axis] = -1;
        planes.offset[6 + 2 * axis] = box->high[axis];
    }
    return planes;
}

static bool meet(const struct planes *planes, int i, int j, int k, double p[3])
{
    const double *a = planes->normal[i], *b = planes->normal[j], *c = planes->normal[k];
    double bc[3] = {b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]};
    double ca[3] = {c[1] * a[2] - c[2] * a[1], c[2] * a[0] - c[0] * a[2], c[0] * a[1] - c[1] * a[0]};
    double ab[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
    double volume = dot(a, bc);
    if (fabs(volume) < 1e-9) return false;
    for (int axis = 0; axis < 3; axis++)
        p[axis] =
            -(planes->offset[i] * bc[axis] + planes->offset[j] * ca[axis] + planes->offset[k] * ab[axis]) /
            volume;
    return true;
}

static bool feasible(const struct planes *planes, const double p[3], double slack)
{
    for (int i = 0; i < 11; i++)
        if (dot(planes->normal[i], p) + planes->offset[i] < -slack) return false;
    return true;
}

static bool exact_rect(const struct planes *planes, double slack, double rect[4])
{
    bool any = false;
    rect[0] = rect[1] = INFINITY;
    rect[2] = rect[3] = -INFINITY;
    for (int i = 0; i < 11; i++)
        for (int j = i + 1; j < 11; j++)
            for (int k = j + 1; k < 11; k++) {
                double p[3];
                if (!meet(planes, i, j, k, p) || !feasible(planes, p, slack)) continue;
                any = true;
                for (int axis = 0; axis < 2; axis++) {
                    rect[axis] = fmin(rect[axis], p[axis]);
                    rect[axis + 2] = fmax(rect[axis + 2], p[axis]);
                }
            }
    return any;
}

// The published crop: corners of the box that are visible, and where its edges meet the planes.
static bool naive_rect(const struct view *view, const struct box *box, double rect[4])
{
    struct frustum frustum;
    bool any = false;
    frustum_init(&frustum, view);
    rect[0] = rect[1] = INFINITY;
    rect[2] = rect[3] = -INFINITY;
    for (int corner = 0; corner < 8; corner++)
        for (int axis = 0; axis < 3; axis++) {
            if (corner & 1 << axis) continue;
            double a[3], b[3];
            for (int k = 0; k < 3; k++) a[k] = b[k] = corner & 1 << k ? box->high[k] : box->low[k];
            b[axis] = box->high[axis];
            double enter = 0, leave = 1;
            for (int plane = 0; plane < FRUSTUM_PLANES; plane++) {
                double da = dot(frustum.normal[plane], a) + frustum.offset[plane];
                double db = dot(frustum.normal[plane], b) + frustum.offset[plane];
                if (da < 0 && db < 0) leave = -1;
                if (da < 0 && db >= 0) enter = fmax(enter, da / (da - db));
                if (da >= 0 && db < 0) leave = fmin(leave, da / (da - db));
            }
            if (enter > leave) continue;
            any = true;
            for (int k = 0; k < 2; k++) {
                double from = a[k] + enter * (b[k] - a[k]), to = a[k] + leave * (b[k] - a[k]);
                rect[k] = fmin(rect[k], fmin(from, to));
                rect[k + 2] = fmax(rect[k + 2], fmax(from, to));
            }
        }
    return any;
}

static bool holds(const double outer[4], const double inner[4], double slack)
{
    return outer[0] <= inner[0] + slack && outer[1] <= inner[1] + slack && outer[2] >= inner[2] - slack &&
           outer[3] >= inner[3] - slack;
}

static double area(const double rect[4])
{
    return (rect[2] - rect[0]) * (rect[3] - rect[1]);
}

static void rectangle_is_the_exact_one(void **state)
{
    (void)state;
    uint64_t seed = 12;
    long crossing = 0, lost = 0, loose = 0, naive_lost = 0;
    double ratio = 0;
    for (int n = 0; n < test_size(20000, 500000); n++) {
        struct view view = random_view(&seed);
        struct box box = random_box(&seed);
        double far = 0, rect[4], inner[4], outer[4], naive[4];
        for (int axis = 0; axis < 3; axis++)
            far = hypot(far, fmax(fabs(box.low[axis]), fabs(box.high[axis])));
        struct planes tight = all_planes(&view, &box, 0), wide = all_planes(&view, &box, 2e-6 * far);
        bool kept = frustum_clip_box(&view, box.low, box.high, rect, NULL);
        bool is_visible = exact_rect(&tight, 1e-12 * far, inner),
             may_be = exact_rect(&wide, 1e-12 * far, outer);
        if (in_box(&box, (double[3]){0, 0, 0})) { // the apex counts
            may_be = true;
            for (int axis = 0; axis < 2; axis++) {
                outer[axis] = fmin(outer[axis], 0);
                outer[axis + 2] = fmax(outer[axis + 2], 0);
            }
        }
        loose += kept && (!may_be || !holds(outer, rect, 1e-9 * far));
        if (!is_visible) continue;
        crossing++;
        lost += !kept || !holds(rect, inner, 1e-9 * far);
        naive_lost += !naive_rect(&view, &box, naive) || !holds(naive, inner, 1e-6 * far);
        if (area(inner) > 1e-4 * far * far && !in_box(&box, (double[3]){0, 0, 0}))
            ratio = fmax(ratio, area(rect) / area(inner));
    }
    FIGURE("crop: %ld boxes, %ld lose ground, %ld looser than twice the guard, largest area ratio %.4f where "
           "the eye is outside; "
           "corners and "
           "edges alone lose ground in %.1f %%",
           crossing, lost, loose, ratio, 100.0 * (double)naive_lost / (double)crossing);
    assert_int_equal(lost, 0);
    assert_int_equal(loose, 0);
    assert_true(naive_lost > crossing / 100); // the test has power
}

// A parent's mask, handed to its children, changes no verdict.
static void masks_change_nothing(void **state)
{
    (void)state;
    uint64_t seed = 13;
    long saved = 0, tests = 0;
    for (int n = 0; n < test_size(20000, 200000); n++) {
        struct view view = random_view(&seed);
        struct box parent = random_box(&seed), child = parent;
        struct frustum frustum;
        unsigned mask = FRUSTUM_ALL, all = FRUSTUM_ALL;
        frustum_init(&frustum, &view);
        if (frustum_test_box(&frustum, parent.low, parent.high, &mask) == FRUSTUM_OUTSIDE) continue;
        for (int axis = 0; axis < 3; axis++) {
            double middle = 0.5 * (parent.low[axis] + parent.high[axis]);
            (*(test_random(&seed) % 2 ? &child.low : &child.high))[axis] = middle;
        }
        unsigned inherited = mask;
        enum frustum_side with = frustum_test_box(&frustum, child.low, child.high, &inherited);
        enum frustum_side without = frustum_test_box(&frustum, child.low, child.high, &all);
        assert_int_equal(with == FRUSTUM_OUTSIDE, without == FRUSTUM_OUTSIDE);
        for (int plane = 0; plane < FRUSTUM_PLANES; plane++) saved += !(mask & 1u << plane);
        tests += FRUSTUM_PLANES;
    }
    FIGURE("masks: %.0f %% of the planes need no test in the children",
           100.0 * (double)saved / (double)tests);
    assert_true(saved > 0);
}

static void eye_in_box_reaches_the_apex(void **state)
{
    (void)state;
    uint64_t seed = 14;
    for (int n = 0; n < 2000; n++) {
        struct view view = random_view(&seed);
        struct box box = {{-100, -100, -100}, {100, 100, 100}};
        double rect[4], min_depth;
        assert_true(frustum_clip_box(&view, box.low, box.high, rect, &min_depth));
        assert_true(rect[0] <= 0 && rect[1] <= 0 && rect[2] >= 0 && rect[3] >= 0);
        assert_true(min_depth == view.near_m);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(no_visible_point_is_lost),
        cmocka_unit_test(rectangle_is_the_exact_one),
        cmocka_unit_test(masks_change_nothing),
        cmocka_unit_test(eye_in_box_reaches_the_apex),
    };
    return cmocka_run_group_tests(tests, make_ground, drop_ground);
}
