// The error measures against pictures whose errors are known: drawn by an exact renderer of a few triangles,
// with planted bumps, cracks, missing tiles, skipped ridges, skylines that are too low or too high.
// SPDX-License-Identifier: MIT
#include "tests/test.h"

#include "bench/error/error.h"
#include "bench/error/samples.h"

#include <string.h>
#include <time.h>

// ---- an exact renderer ----------------------------------------------------------------------------

enum { SIDE_MAX = 49 };

struct mesh { // a square of samples, drawn with the truth's diagonal
    int side;
    double spacing_m, quantum_m;
    int32_t q[SIDE_MAX * SIDE_MAX];
    int skip[4]; // cells x0 <= i < x1, y0 <= j < y1 that are not drawn
};

static struct terrain *mesh_terrain(const struct mesh *mesh)
{
    struct terrain_grid grid = {.name = "mesh",
                                .samples = mesh->q,
                                .width = mesh->side,
                                .height = mesh->side,
                                .spacing_m = {mesh->spacing_m, mesh->spacing_m},
                                .quantum_m = mesh->quantum_m};
    struct terrain *terrain = terrain_from_grid(&grid, NULL);
    assert_non_null(terrain);
    return terrain;
}

static bool is_skipped(const struct mesh *mesh, int i, int j)
{
    return i >= mesh->skip[0] && i < mesh->skip[2] && j >= mesh->skip[1] && j < mesh->skip[3];
}

// Triangles relative to the eye, as a renderer's capture gives them.
static size_t mesh_triangles(const struct mesh *mesh, const struct view *view, float *out)
{
    static const int corners[6] = {0, 1, 3, 0, 3, 2};
    double eye_q = ldexp((double)view->eye_height, -VIEW_HEIGHT_BITS);
    size_t count = 0;
    for (int j = 0; j + 1 < mesh->side; j++)
        for (int i = 0; i + 1 < mesh->side; i++) {
            if (is_skipped(mesh, i, j)) continue;
            for (int k = 0; k < 6; k++) {
                int x = i + (corners[k] & 1), y = j + (corners[k] >> 1);
                *out++ = (float)(x * mesh->spacing_m - view->eye_m[0]);
                *out++ = (float)(y * mesh->spacing_m - view->eye_m[1]);
                *out++ = (float)((mesh->q[y * mesh->side + x] - eye_q) * mesh->quantum_m);
            }
            count += 2;
        }
    return count;
}

static void cross(const double a[3], const double b[3], double out[3])
{
    for (int k = 0; k < 3; k++) out[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// Columns and rows that a triangle may cover.
static void pixel_bounds(const struct view *view, double v[3][3], int bounds[4])
{
    int all[4] = {0, 0, view->width - 1, view->height - 1};
    double low[2] = {1e9, 1e9}, high[2] = {-1e9, -1e9}, pixel[2];
    memcpy(bounds, all, sizeof all);
    for (int k = 0; k < 3; k++) {
        if (!view_project(view, v[k], pixel)) return;
        for (int axis = 0; axis < 2; axis++) {
            low[axis] = fmin(low[axis], pixel[axis] - 1);
            high[axis] = fmax(high[axis], pixel[axis] + 1);
        }
    }
    for (int axis = 0; axis < 2; axis++) {
        bounds[axis] = (int)fmin(fmax(low[axis], 0), all[axis + 2] + 1);
        bounds[axis + 2] = (int)fmax(fmin(high[axis], all[axis + 2]), -1);
    }
}

// Rays through pixel centres; the sides of an edge are exact opposites, so there are no cracks.  Heights come
// from the vertices' weights, so what is level stays level.
static void draw_triangle(const float *vertices, const struct view *view, double *depths, float *positions)
{
    double v[3][3], edge[3][3], e[3], f[3], normal[3];
    int bounds[4];
    for (int k = 0; k < 9; k++) v[k / 3][k % 3] = (double)vertices[k];
    for (int k = 0; k < 3; k++) cross(v[(k + 1) % 3], v[(k + 2) % 3], edge[k]);
    for (int k = 0; k < 3; k++) e[k] = v[1][k] - v[0][k], f[k] = v[2][k] - v[0][k];
    cross(e, f, normal);
    double plane = dot(normal, v[0]); // below 0: the eye is above
    pixel_bounds(view, v, bounds);
    for (int y = bounds[1]; y <= bounds[3]; y++)
        for (int x = bounds[0]; x <= bounds[2]; x++) {
            double ray[3], side[3];
            view_ray(view, x, y, ray);
            for (int k = 0; k < 3; k++) side[k] = dot(ray, edge[k]);
            bool all_up = side[0] >= 0 && side[1] >= 0 && side[2] >= 0;
            bool all_down = side[0] <= 0 && side[1] <= 0 && side[2] <= 0;
            double sum = side[0] + side[1] + side[2], depth = plane / dot(normal, ray);
            size_t pixel = (size_t)y * (size_t)view->width + (size_t)x;
            if (!(all_up || all_down) || sum == 0 || !(depth >= view->near_m && depth < depths[pixel]))
                continue;
            depths[pixel] = depth;
            float *out = positions + 4 * pixel;
            out[0] = (float)(depth * ray[0]), out[1] = (float)(depth * ray[1]);
            out[2] = (float)(v[0][2] + (side[1] * e[2] + side[2] * f[2]) / sum);
            out[3] = plane < 0 ? 1.0f : -1.0f;
        }
}

// ---- a frame --------------------------------------------------------------------------------------

struct frame {
    struct terrain *terrain;
    struct truth_surface *surface;
    struct view view;
    struct truth truth;
    struct places *hits;
    float *positions, *triangles;
    size_t count;
    struct frame_error error;
};

static void frame_open(struct frame *frame, const struct mesh *truth, const struct camera *camera, int width,
                       int height, double near_m)
{
    *frame = (struct frame){.terrain = mesh_terrain(truth)};
    frame->surface = truth_surface_create(frame->terrain);
    view_init(&frame->view, frame->terrain, camera, width, height, near_m);
    assert_true(truth_init(&frame->truth, width, height));
    assert_true(frame_error_init(&frame->error, width, height));
    truth_cast(&frame->truth, frame->surface, &frame->view, 2);
    frame->hits = truth_places(&frame->truth, 2);
    frame->positions = malloc((size_t)width * (size_t)height * 4 * sizeof(float));
    frame->triangles = malloc((size_t)2 * SIDE_MAX * SIDE_MAX * 9 * sizeof(float));
    assert_true(frame->hits && frame->positions && frame->triangles);
}

static void frame_draw(struct frame *frame, const struct mesh *drawn)
{
    size_t pixels = (size_t)frame->view.width * (size_t)frame->view.height;
    double *depths = malloc(pixels * sizeof *depths);
    assert_non_null(depths);
    for (size_t k = 0; k < pixels; k++) depths[k] = HUGE_VAL;
    memset(frame->positions, 0, pixels * 4 * sizeof(float));
    frame->count = mesh_triangles(drawn, &frame->view, frame->triangles);
    for (size_t t = 0; t < frame->count; t++)
        draw_triangle(frame->triangles + 9 * t, &frame->view, depths, frame->positions);
    free(depths);
    places_clear(frame->hits);
    places_feed(frame->triangles, frame->count, frame->hits);
}

static void frame_measure(struct frame *frame, int threads)
{
    frame_error_measure(&frame->error, frame->terrain, &frame->view, &frame->truth, frame->positions,
                        frame->hits, threads);
}

static void frame_close(struct frame *frame)
{
    places_destroy(frame->hits);
    frame_error_finish(&frame->error);
    truth_finish(&frame->truth);
    truth_surface_destroy(frame->surface);
    terrain_destroy(frame->terrain);
    free(frame->positions);
    free(frame->triangles);
}

static struct error_summary summary_of(const float *values, size_t count)
{
    struct error_samples samples = {0};
    assert_true(error_samples_add(&samples, values, count));
    struct error_summary summary = error_samples_summary(&samples);
    error_samples_finish(&samples);
    return summary;
}

static struct error_summary frame_summary(const struct frame *frame)
{
    return summary_of(frame->error.error_px, (size_t)frame->view.width * (size_t)frame->view.height);
}

static struct mesh flat_mesh(int side, double spacing_m, double quantum_m, int32_t q)
{
    struct mesh mesh = {.side = side, .spacing_m = spacing_m, .quantum_m = quantum_m};
    for (int k = 0; k < side * side; k++) mesh.q[k] = q;
    return mesh;
}

static struct mesh rough_mesh(int side, uint64_t *random)
{
    struct mesh mesh = flat_mesh(side, 30, 0.1, 0);
    for (int j = 0; j < side; j++)
        for (int i = 0; i < side; i++)
            mesh.q[j * side + i] =
                (int32_t)lround(400 * sin(0.5 * i) * cos(0.4 * j) + test_uniform(random, -100, 100));
    return mesh;
}

#define DEGREES 0.017453292519943295

// ---- exact zeros ----------------------------------------------------------------------------------

static void test_flat_is_exactly_zero(void **state)
{
    (void)state;
    const int32_t heights[] = {0, 100000, 884886}; // centimetres
    for (int k = 0; k < 3; k++) {
        struct mesh mesh = flat_mesh(17, 37.5, 0.01, heights[k]);
        for (int turn = 0; turn < test_size(4, 40); turn++) {
            struct frame frame;
            struct camera camera = {{311 + turn, 290.5, heights[k] * 0.01 + 12.345 * (turn % 4 + 1)},
                                    turn * 0.7,
                                    -0.2 * (turn % 8),
                                    turn * 0.3,
                                    60 * DEGREES};
            frame_open(&frame, &mesh, &camera, 160, 120, 0);
            frame_draw(&frame, &mesh);
            frame_measure(&frame, 1);
            struct error_summary error = frame_summary(&frame);
            struct error_summary plane = summary_of(frame.error.plane_px, 160 * 120);
            assert_true(frame.truth.ground > 1000);
            assert_int_equal(frame.error.ground, frame.truth.ground);
            assert_int_equal(error.samples, frame.truth.ground);
            assert_true(error.max == 0 && plane.max == 0);
            assert_int_equal(
                frame.error.holes + frame.error.misses + frame.error.spills + frame.error.uncovered, 0);
            frame_close(&frame);
        }
    }
}

// The truth drawn as it is: nothing but the rounding of the position target, 2^-24 of coordinates that a
// steep view may see at any share of the depth; steepest slope here 45 m over 30 m.
static void test_truth_drawn_as_it_is(void **state)
{
    (void)state;
    uint64_t random = 1;
    double worst = 0, worst_plane = 0;
    for (int round = 0; round < test_size(8, 200); round++) {
        struct frame frame;
        struct mesh mesh = rough_mesh(33, &random);
        struct camera camera = {{480, 500, 150}, round, -0.15 * (round % 8), 0, 60 * DEGREES};
        frame_open(&frame, &mesh, &camera, 160, 120, 10);
        frame_draw(&frame, &mesh);
        frame_measure(&frame, 2);
        worst = fmax(worst, frame_summary(&frame).max);
        worst_plane = fmax(worst_plane, summary_of(frame.error.plane_px, 160 * 120).max);
        assert_true(frame.truth.ground > 1000);
        assert_int_equal(frame.error.holes + frame.error.misses + frame.error.spills, 0);
        assert_int_equal(frame.error.order_mismatches, 0);
        frame_close(&frame);
    }
    FIGURE("the truth itself: error_px max %.1e, plane_px max %.1e", worst, worst_plane);
    // K = 104; a coordinate is at most 1.3 depths; rounding of x, y (times the slope 2) and z, on both sides.
    assert_true(worst < 104 * 1.3 * 0x1p-24 * (2 + 2 + 1) * 2);
    assert_true(worst_plane < 104 * 1.3 * 0x1p-24 * (2 + 2 + 1) * 2);
}

// ---- planted errors -------------------------------------------------------------------------------

// A block of H = 50 m on flat ground that is drawn flat: with a level camera a vertical of H at depth w is K
// H / w long.
static void test_known_bump(void **state)
{
    (void)state;
    const double bump_m = 50, spacing_m = 20;
    struct mesh flat = flat_mesh(49, spacing_m, 0.5, 0), bump = flat;
    for (int j = 10; j <= 38; j++)
        for (int i = 24; i <= 30; i++) bump.q[j * 49 + i] = 100;
    struct frame frame;
    struct camera camera = {{40, 480, 150}, 0, 0, 0, 60 * DEGREES};
    frame_open(&frame, &bump, &camera, 640, 480, 0.1);
    frame_draw(&frame, &flat);
    frame_measure(&frame, 2);
    double pixels_per_tangent = 480 / (2 * tan(30 * DEGREES)), worst = 0;
    int tops = 0;
    for (int k = 0; k < 640 * 480; k++) {
        const struct truth_pixel *hit = &frame.truth.pixels[k];
        if (hit->depth == 0 || fabs(hit->relative[2] - (bump_m - frame.view.eye_m[2])) > 1e-9) continue;
        double want = pixels_per_tangent * bump_m / hit->depth;
        if (frame.error.kind[k] != PIXEL_GROUND) continue;
        worst = fmax(worst, fabs((double)frame.error.error_px[k] / want - 1));
        tops++;
    }
    double highest = pixels_per_tangent * bump_m / (24 * spacing_m - frame.view.eye_m[0]); // at its near edge
    double got = frame_summary(&frame).max;
    FIGURE("bump of %.1f px: measured %.1f px; over its top at most %.1e off", highest, got, worst);
    assert_true(tops > 1000);
    assert_true(worst < 0.01);
    assert_true(fabs(got / highest - 1) < 0.01);
    frame_close(&frame);
}

static void clear_pixel(struct frame *frame, int x, int y, bool faces_away)
{
    frame->positions[4 * (y * frame->view.width + x) + 3] = faces_away ? -1.0f : 0;
}

// Rows of the topmost ground of the truth, -1 when there is none.
static int truth_top(const struct frame *frame, int x)
{
    for (int y = frame->view.height - 1; y >= 0; y--)
        if (frame->truth.pixels[y * frame->view.width + x].depth > 0) return y;
    return -1;
}

static int drawn_top(const struct frame *frame, int x)
{
    for (int y = frame->view.height - 1; y >= 0; y--)
        if (frame->positions[4 * (y * frame->view.width + x) + 3] > 0) return y;
    return -1;
}

static void test_planted_cracks(void **state)
{
    (void)state;
    uint64_t random = 2;
    struct frame frame;
    struct mesh mesh = rough_mesh(33, &random);
    struct camera camera = {{30, 480, 120}, 0, -0.1, 0, 60 * DEGREES};
    frame_open(&frame, &mesh, &camera, 160, 120, 1);
    frame_draw(&frame, &mesh);
    clear_pixel(&frame, 80, 30, false); // one pixel, and one seen from below
    clear_pixel(&frame, 20, 10, true);
    frame_measure(&frame, 2);
    assert_int_equal(frame.error.holes, 2);
    assert_int_equal(frame.error.misses, 0);
    assert_int_equal(frame.error.kind[30 * 160 + 80], PIXEL_HOLE);
    assert_true(isnan(frame.error.error_px[30 * 160 + 80]));

    frame_draw(&frame, &mesh); // a crack in the picture's corner: the border is not sky
    clear_pixel(&frame, 0, 0, false);
    frame_measure(&frame, 1);
    assert_int_equal(frame.error.holes, 1);

    frame_draw(&frame,
               &mesh); // a crack from the skyline 30 pixels down: the part more than 8 px under it is holes
    int top = truth_top(&frame, 80);
    assert_true(top > 40 && top < 118);
    for (int y = top; y > top - 30; y--) clear_pixel(&frame, 80, y, false);
    frame_measure(&frame, 2);
    assert_int_equal(frame.error.misses, 9);
    assert_int_equal(frame.error.holes, 21);

    frame_draw(&frame, &mesh); // a diagonal chain of pixels hangs together by its corners
    for (int k = 0; k < 6; k++)
        for (int y = truth_top(&frame, 80 + k); y >= top - k; y--) clear_pixel(&frame, 80 + k, y, false);
    frame_measure(&frame, 2);
    assert_true(frame.error.misses > 0);
    frame_close(&frame);
}

// Ground drawn from below is undrawn ground, wherever it is: what explains some of it is bench/ridges.
static void test_seen_from_below(void **state)
{
    (void)state;
    uint64_t random = 5;
    struct frame frame;
    struct mesh mesh = rough_mesh(33, &random);
    struct camera camera = {{30, 480, 120}, 0, -0.1, 0, 60 * DEGREES};
    frame_open(&frame, &mesh, &camera, 160, 120, 1);
    frame_draw(&frame, &mesh);
    int turned = 0, holes = 0, misses = 0;
    for (int pixel = 0; pixel < 120 * 160; pixel += test_size(53, 1)) {
        const struct truth_pixel *truth = &frame.truth.pixels[pixel];
        if (!(truth->depth > 0) || truth->skyline) continue;
        frame.positions[4 * pixel + 3] = -1;
        frame_measure(&frame, 1);
        frame.positions[4 * pixel + 3] = 1;
        turned++;
        holes += frame.error.holes == 1 && frame.error.misses == 0;
        misses += frame.error.holes == 0 && frame.error.misses == 1; // beside the sky
    }
    FIGURE("seen from below: of %d pixels %d are holes, %d misses", turned, holes, misses);
    assert_true(holes > 100 && holes + misses == turned);
    frame_close(&frame);
}

static void test_nothing_drawn(void **state)
{
    (void)state;
    struct frame frame;
    struct mesh mesh = flat_mesh(33, 30, 0.1, 0);
    for (int down = 0; down < 2; down++) {
        struct camera camera = {{480, 480, 100}, 0, down ? -90 * DEGREES : 0, 0, 60 * DEGREES};
        frame_open(&frame, &mesh, &camera, 160, 120, 1);
        frame_draw(&frame, &mesh);
        memset(frame.positions, 0, 160 * 120 * 4 * sizeof(float));
        frame_measure(&frame, 2);
        uint64_t misses = 0;
        for (int x = 0; x < 160 && !down; x++)
            misses += truth_top(&frame, x) < 8 ? truth_top(&frame, x) + 1 : 9;
        assert_int_equal(frame.error.misses, misses);
        assert_int_equal(frame.error.holes, frame.truth.ground - misses);
        for (int x = 0; x < 160 && !down; x++) { // no skyline drawn: it lies under the lowest row
            int y = truth_top(&frame, x);
            assert_true((double)frame.error.error_px[y * 160 + x] == y + 1);
        }
        frame_close(&frame);
    }
}

static void test_planted_missing_tile(void **state)
{
    (void)state;
    uint64_t random = 3;
    struct frame frame;
    struct mesh mesh = rough_mesh(33, &random);
    struct camera camera = {{480, 100, 400}, 90 * DEGREES, -0.9, 0, 60 * DEGREES};
    frame_open(&frame, &mesh, &camera, 160, 120, 1);
    mesh.skip[0] = 14, mesh.skip[1] = 12, mesh.skip[2] = 18, mesh.skip[3] = 16;
    frame_draw(&frame, &mesh);
    frame_measure(&frame, 2);
    uint64_t inside = 0;
    for (int k = 0; k < 160 * 120; k++) {
        const struct truth_pixel *hit = &frame.truth.pixels[k];
        if (hit->depth == 0) continue;
        int i = (int)floor((hit->relative[0] + frame.view.eye_m[0]) / 30);
        int j = (int)floor((hit->relative[1] + frame.view.eye_m[1]) / 30);
        if (!is_skipped(&mesh, i, j)) continue;
        inside++;
        assert_true(frame.error.kind[k] == PIXEL_HOLE || frame.error.error_px[k] > 1.0f);
    }
    FIGURE("missing tile of %d px: %d holes, %d seen through it", (int)inside, (int)frame.error.holes,
           (int)frame.error.uncovered);
    assert_true(inside > 100);
    assert_int_equal(frame.error.holes + frame.error.uncovered, inside);
    assert_true(frame.error.holes > 0);
    frame_close(&frame);
}

// A ridge between the eye and a plain is not drawn.  The plain drawn in its stead is right where it is, so
// (a) is 0 there: the error is K times the height of the hidden ridge over its depth, and comes from (b).
static void test_planted_skipped_ridge(void **state)
{
    (void)state;
    struct mesh plain = flat_mesh(49, 20, 0.5, 0), ridge = plain;
    for (int j = 0; j < 49; j++) ridge.q[j * 49 + 15] = 60;
    struct frame frame;
    struct camera camera = {{40, 480, 40}, 0, 0, 0, 60 * DEGREES};
    frame_open(&frame, &ridge, &camera, 320, 240, 0.1);
    frame_draw(&frame, &plain);
    frame_measure(&frame, 2);
    double pixels_per_tangent = 240 / (2 * tan(30 * DEGREES)), worst = 0, most = 0;
    int hidden = 0;
    for (int k = 0; k < 320 * 240; k++) {
        const struct truth_pixel *hit = &frame.truth.pixels[k];
        double drawn_x = (double)frame.positions[4 * k] + frame.view.eye_m[0];
        if (frame.error.kind[k] != PIXEL_GROUND || drawn_x < 16 * 20 ||
            hit->relative[0] + frame.view.eye_m[0] > 16 * 20)
            continue;
        double want = pixels_per_tangent * (hit->relative[2] + frame.view.eye_m[2]) / hit->depth;
        worst = fmax(worst, fabs((double)frame.error.error_px[k] - want));
        most = fmax(most, want);
        hidden++;
    }
    FIGURE("skipped ridge: %d px of plain in its stead, up to %.1f px, at most %.1e px off", hidden, most,
           worst);
    assert_true(hidden > 500 && most > 10);
    assert_true(worst < 1e-3);
    assert_true(frame.error.order_mismatches > 500);

    struct mesh gap = plain; // the same with the ridge's triangles missing: no mesh to hold the truth against
    gap.skip[0] = 14, gap.skip[2] = 16, gap.skip[3] = 48;
    frame_draw(&frame, &gap);
    frame_measure(&frame, 2);
    int through = 0;
    for (int k = 0; k < 320 * 240; k++) {
        if (frame.error.kind[k] != PIXEL_GROUND ||
            (double)frame.positions[4 * k] + frame.view.eye_m[0] < 16 * 20)
            continue;
        if (frame.truth.pixels[k].relative[0] + frame.view.eye_m[0] > 15 * 20) continue;
        assert_true(frame.error.error_px[k] > 1);
        through++;
    }
    assert_int_equal(through, frame.error.uncovered);
    assert_true(through > 500 && frame.error.holes > 500);
    frame_draw(&frame, &plain);

    places_clear(frame.hits); // without (b), as if the ridge were drawn: nothing is found there
    frame.count = mesh_triangles(&ridge, &frame.view, frame.triangles);
    places_feed(frame.triangles, frame.count, frame.hits);
    frame_measure(&frame, 2);
    for (int k = 0; k < 320 * 240; k++)
        if (frame.error.kind[k] == PIXEL_GROUND &&
            (double)frame.positions[4 * k] + frame.view.eye_m[0] > 16 * 20)
            assert_true(frame.error.error_px[k] < 1e-3f);
    frame_close(&frame);
}

// The same ground drawn 5 m too low and 5 m too high: each miss and spill has its distance to the other
// skyline.
static void test_misses_and_spills(void **state)
{
    (void)state;
    struct mesh truth = flat_mesh(33, 30, 0.1, 0), drawn = truth;
    for (int j = 0; j < 33; j++)
        for (int i = 20; i < 33; i++) truth.q[j * 33 + i] = (int32_t)lround(300 + 200 * sin(0.4 * j));
    for (int higher = 0; higher < 2; higher++) {
        struct frame frame;
        struct camera camera = {{30, 480, 20}, 0, 0.05, 0, 60 * DEGREES};
        for (int k = 0; k < 33 * 33; k++) drawn.q[k] = truth.q[k] + (higher ? 50 : -50);
        frame_open(&frame, &truth, &camera, 320, 240, 1);
        frame_draw(&frame, &drawn);
        frame_measure(&frame, 2);
        int misses = 0, spills = 0, ties = 0;
        for (int x = 0; x < 320; x++)
            for (int y = 0; y < 240; y++) {
                bool ground = y <= truth_top(&frame, x), seen = y <= drawn_top(&frame, x);
                float error_px = frame.error.error_px[y * 320 + x];
                uint8_t kind = frame.error.kind[y * 320 + x];
                if (ground != seen && frame.truth.pixels[y * 320 + x].skyline) { // both are right
                    assert_int_equal(kind, PIXEL_SKY);
                    assert_true(isnan(error_px));
                    ties++;
                    continue;
                }
                misses += ground && !seen, spills += seen && !ground;
                if (ground && !seen) {
                    assert_int_equal(kind, PIXEL_MISS);
                    assert_true((double)error_px == y - drawn_top(&frame, x));
                } else if (seen && !ground) {
                    assert_int_equal(kind, PIXEL_SPILL);
                    assert_true((double)error_px == y - truth_top(&frame, x));
                }
            }
        assert_int_equal(frame.error.misses, misses);
        assert_int_equal(frame.error.spills, spills);
        assert_true(ties <= 320 / 20); // a skyline is that near a centre in about 1 of 90 columns
        assert_int_equal(frame.error.holes, 0);
        assert_true((higher ? spills : misses) > 100);
        assert_int_equal(higher ? misses : spills, 0);
        frame_close(&frame);
    }
}

// A needle vanishes from the percentiles, not from the maximum.
static void test_needle(void **state)
{
    (void)state;
    struct mesh flat = flat_mesh(49, 20, 0.5, 0), needle = flat;
    needle.q[24 * 49 + 24] = 200;
    struct frame frame;
    struct camera camera = {{480, 200, 600}, 90 * DEGREES, -60 * DEGREES, 0, 60 * DEGREES};
    frame_open(&frame, &needle, &camera, 640, 480, 1);
    frame_draw(&frame, &flat);
    frame_measure(&frame, 2);
    struct error_summary summary = frame_summary(&frame);
    FIGURE("needle of 100 m: p50 %.2g px, max %.1f px of %llu samples", summary.p50, summary.max,
           (unsigned long long)summary.samples);
    double peak[3] = {0, 480 - frame.view.eye_m[1], 100 - frame.view.eye_m[2]}, px[2], foot_px[2];
    double foot[3] = {peak[0], peak[1], peak[2] - 100};
    assert_true(view_project(&frame.view, peak, px) && view_project(&frame.view, foot, foot_px));
    double length = hypot(px[0] - foot_px[0], px[1] - foot_px[1]);
    // A pixel's centre is within 0.71 px of the peak, from where the needle loses all its height within 20 m,
    // 9 px or more.
    assert_true(length > 20 && 20 * frame.view.pixels_per_tangent / dot(peak, frame.view.forward) > 9);
    assert_true(summary.max <= length * 1.001 && summary.max > (1 - 0.71 * sqrt(2) / 9) * length);
    assert_true(summary.p50 == 0);
    frame_close(&frame);
}

// ---- hard views, threads --------------------------------------------------------------------------

// Verticals that cross the near plane are cut there; nothing is larger than the window without being counted
// (E7).
static void test_hard_views(void **state)
{
    (void)state;
    uint64_t random = 4;
    int views = test_size(150, 4000), crossing = 0;
    uint64_t samples = 0, beyond = 0;
    for (int k = 0; k < views; k++) {
        enum { WIDTH = 40, HEIGHT = 30 };
        struct frame frame;
        struct mesh truth = rough_mesh(17, &random), drawn = rough_mesh(17, &random);
        struct camera camera = {{test_uniform(&random, -100, 600), test_uniform(&random, -100, 600),
                                 test_uniform(&random, -80, 120)},
                                test_uniform(&random, -4, 4),
                                test_uniform(&random, -1.58, 1.58),
                                k % 3 ? 0 : test_uniform(&random, -3.2, 3.2),
                                test_uniform(&random, 1, 170) * DEGREES};
        frame_open(&frame, &truth, &camera, WIDTH, HEIGHT, 0);
        frame_draw(&frame, &drawn);
        frame_measure(&frame, 2);
        const struct frame_error *error = &frame.error;
        uint64_t measured = 0, over = 0, ground = 0, ties = 0;
        for (int p = 0; p < WIDTH * HEIGHT; p++) {
            bool sample = !isnan(error->error_px[p]);
            if (sample) assert_true(isfinite(error->error_px[p]) && error->error_px[p] >= 0);
            assert_true(!sample || (error->kind[p] != PIXEL_SKY && error->kind[p] != PIXEL_HOLE));
            measured += sample && error->kind[p] == PIXEL_GROUND;
            over += sample && (double)error->error_px[p] > hypot(WIDTH, HEIGHT);
            ground += error->kind[p] == PIXEL_GROUND;
            ties += error->kind[p] == PIXEL_SKY && frame.truth.pixels[p].depth > 0;
            assert_true(error->kind[p] != PIXEL_SKY || frame.truth.pixels[p].depth == 0 ||
                        frame.truth.pixels[p].skyline);
            double low, high; // below near at one end: what a projection without clipping would get wrong
            const struct truth_pixel *hit = &frame.truth.pixels[p];
            if (hit->depth == 0 || !places_height(frame.hits, frame.truth.row_first[p / WIDTH], &low, &high))
                continue;
            double foot[3] = {hit->relative[0], hit->relative[1], low};
            crossing += dot(foot, frame.view.forward) < frame.view.near_m;
        }
        assert_int_equal(error->ground, ground);
        assert_int_equal(error->ground + error->holes + error->misses + ties, frame.truth.ground);
        assert_int_equal(error->ground - error->unmeasured, measured);
        assert_int_equal(error->beyond_window, over);
        samples += measured, beyond += over;
        frame_close(&frame);
    }
    FIGURE(
        "hard views: %d, samples %llu, larger than the window and counted %llu, verticals that cross near %d",
        views, (unsigned long long)samples, (unsigned long long)beyond, crossing);
    assert_true(samples > 1000 && crossing > 0);
}

// Clears what a renderer leaves open: some cells, some blots of pixels, some of a column's upper pixels.
static void open_up(struct frame *frame, const struct mesh *drawn, uint64_t *random)
{
    struct mesh open = *drawn;
    for (int k = 0; k < 4; k++) open.skip[k] = (int)(test_random(random) % 17);
    frame_draw(frame, &open);
    for (int n = 0; n < 4; n++) {
        int x0 = (int)(test_random(random) % 40), y0 = (int)(test_random(random) % 30);
        int width = 1 + (int)(test_random(random) % 3), height = 1 + (int)(test_random(random) % 12);
        for (int y = y0; y < y0 + height && y < frame->view.height; y++)
            for (int x = x0; x < x0 + width && x < frame->view.width; x++) clear_pixel(frame, x, y, n == 0);
        for (int y = drawn_top(frame, x0), k = 0; y >= 0 && k < height; y--, k++)
            clear_pixel(frame, x0, y, false);
    }
}

// With rays through a few pixels alone, the same pixels are holes and misses.
static void test_holes_alone(void **state)
{
    (void)state;
    uint64_t random = 6, holes = 0, misses = 0;
    int views = test_size(300, 10000);
    for (int k = 0; k < views; k++) {
        enum { WIDTH = 40, HEIGHT = 30 };
        struct frame frame;
        struct frame_error alone;
        struct truth truth;
        struct mesh mesh = rough_mesh(17, &random), other = rough_mesh(17, &random);
        struct camera camera = {{test_uniform(&random, -100, 600), test_uniform(&random, -100, 600),
                                 test_uniform(&random, -20, 120)},
                                test_uniform(&random, -4, 4),
                                test_uniform(&random, -1.2, 0.3),
                                k % 3 ? 0 : test_uniform(&random, -3.2, 3.2),
                                test_uniform(&random, 30, 90) * DEGREES};
        frame_open(&frame, &mesh, &camera, WIDTH, HEIGHT, 0);
        open_up(&frame, k % 2 ? &mesh : &other, &random);
        frame_measure(&frame, 2);
        assert_true(truth_init(&truth, WIDTH, HEIGHT) && frame_error_init(&alone, WIDTH, HEIGHT));
        frame_error_holes(&alone, &truth, frame.surface, &frame.view, frame.positions, 2);
        for (int p = 0; p < WIDTH * HEIGHT; p++)
            if (frame.error.kind[p] == PIXEL_HOLE || frame.error.kind[p] == PIXEL_MISS ||
                alone.kind[p] == PIXEL_HOLE || alone.kind[p] == PIXEL_MISS)
                assert_int_equal(alone.kind[p], frame.error.kind[p]);
        assert_int_equal(alone.holes, frame.error.holes);
        assert_int_equal(alone.misses, frame.error.misses);
        holes += alone.holes, misses += alone.misses;
        truth_finish(&truth);
        frame_error_finish(&alone);
        frame_close(&frame);
    }
    FIGURE("holes alone: %d views, %llu holes and %llu misses, the same pixels", views,
           (unsigned long long)holes, (unsigned long long)misses);
    assert_true(holes > 1000 && misses > 1000);
}

static void test_threads(void **state)
{
    (void)state;
    uint64_t random = 5;
    enum { WIDTH = 320, HEIGHT = 240, PIXELS = WIDTH * HEIGHT };
    struct frame frame;
    struct mesh truth = rough_mesh(49, &random), drawn = truth;
    for (int k = 0; k < 49 * 49; k++) drawn.q[k] += (int32_t)(test_random(&random) % 40) - 20;
    struct camera camera = {{720, 700, 200}, 1, -0.3, 0.1, 60 * DEGREES};
    frame_open(&frame, &truth, &camera, WIDTH, HEIGHT, 0);
    frame_draw(&frame, &drawn);
    float *error_px = malloc(2 * PIXELS * sizeof *error_px);
    uint8_t *kind = malloc(PIXELS);
    assert_true(error_px && kind);
    const int threads[] = {1, 2, 8};
    for (int k = 0; k < 3; k++) {
        frame_measure(&frame, threads[k]);
        if (k > 0) {
            assert_memory_equal(error_px, frame.error.error_px, PIXELS * sizeof *error_px);
            assert_memory_equal(error_px + PIXELS, frame.error.plane_px, PIXELS * sizeof *error_px);
            assert_memory_equal(kind, frame.error.kind, PIXELS);
        }
        memcpy(error_px, frame.error.error_px, PIXELS * sizeof *error_px);
        memcpy(error_px + PIXELS, frame.error.plane_px, PIXELS * sizeof *error_px);
        memcpy(kind, frame.error.kind, PIXELS);
    }
    assert_true(frame_summary(&frame).mean > 0.1);
    free(error_px), free(kind);
    frame_close(&frame);
}

// ---- colours --------------------------------------------------------------------------------------

static double lightness(const uint8_t rgb[3])
{
    return 0.2126 * pow(rgb[0] / 255.0, 2.2) + 0.7152 * pow(rgb[1] / 255.0, 2.2) +
           0.0722 * pow(rgb[2] / 255.0, 2.2);
}

static void test_colours(void **state)
{
    (void)state;
    uint8_t before[3], rgb[3], end[3];
    frame_error_colour(0, before);
    frame_error_colour(0.01, rgb);
    assert_memory_equal(before, rgb, 3);
    for (double decade = -2; decade < 1.001; decade += 0.05) { // the larger the darker
        frame_error_colour(pow(10, decade), rgb);
        assert_true(lightness(rgb) <= lightness(before));
        memcpy(before, rgb, 3);
    }
    frame_error_colour(10, rgb);
    frame_error_colour(1e9, end);
    assert_memory_equal(rgb, end, 3);

    struct frame_error error;
    uint8_t picture[5 * 3];
    assert_true(frame_error_init(&error, 5, 1));
    for (int k = 0; k < 5; k++)
        error.kind[k] = (uint8_t)k, error.error_px[k] = k == PIXEL_GROUND ? 0.3f : NAN;
    frame_error_picture(&error, picture);
    frame_error_colour(0.3, rgb);
    for (int k = 0; k < 3; k++) // 0.3 in float is not 0.3
        assert_true(abs(picture[3 * PIXEL_GROUND + k] - rgb[k]) <= 1);
    const uint8_t magenta[3] = {255, 0, 255};
    assert_memory_equal(picture + 3 * PIXEL_HOLE, magenta, 3);
    frame_error_finish(&error);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_flat_is_exactly_zero),
        cmocka_unit_test(test_truth_drawn_as_it_is),
        cmocka_unit_test(test_known_bump),
        cmocka_unit_test(test_planted_cracks),
        cmocka_unit_test(test_seen_from_below),
        cmocka_unit_test(test_nothing_drawn),
        cmocka_unit_test(test_planted_missing_tile),
        cmocka_unit_test(test_planted_skipped_ridge),
        cmocka_unit_test(test_misses_and_spills),
        cmocka_unit_test(test_needle),
        cmocka_unit_test(test_hard_views),
        cmocka_unit_test(test_holes_alone),
        cmocka_unit_test(test_threads),
        cmocka_unit_test(test_colours),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
