// The clipmap over a planet, drawn off screen and held against the ray caster.
// SPDX-License-Identifier: MIT
#include "bench/error/error.h"
#include "bench/error/flat.h"
#include "clipmap/clipmap.h"
#include "clipmap/sphere.h"
#include "clipmap/sphere_levels.h"
#include "common/terrain/sphere.h"
#include "common/view/path.h"
#include "tests/gpu/settings.h"
#include "tests/planet.h"

#include <string.h>

static const struct scene_effects effects = {.shading = SCENE_SHADING_COMMON};

enum { WIDTH = 96, HEIGHT = 72, PIXELS = WIDTH * HEIGHT, COLUMNS = 512 };

struct fixture {
    struct gpu *gpu;
    struct gpu_target target;
    float (*pixels)[4], (*others)[4];
};

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    *state = f;
    f->gpu = gpu_create(GPU_OFFSCREEN, 0, 0, "test", 0);
    f->pixels = malloc(PIXELS * sizeof *f->pixels);
    f->others = malloc(PIXELS * sizeof *f->others);
    return f->gpu && f->pixels && f->others && gpu_target_init(f->gpu, &f->target, WIDTH, HEIGHT, GL_RGBA32F)
               ? 0
               : -1;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    uint64_t errors = gpu_debug_errors(f->gpu);
    gpu_target_finish(&f->target);
    gpu_destroy(f->gpu);
    free(f->pixels);
    free(f->others);
    free(f);
    return errors ? -1 : 0;
}

static struct renderer *create(const struct fixture *f, const struct terrain *terrain, const char *settings)
{
    struct renderer_desc desc = {
        .gpu = f->gpu, .terrain = terrain, .effects = &effects, .width = WIDTH, .height = HEIGHT};
    return create_with(&clipmap_renderer, desc, settings);
}

static void draw(const struct fixture *f, struct renderer *renderer, const struct terrain *terrain,
                 const struct view *view, int frame, float (*pixels)[4])
{
    clipmap_renderer.begin_frame(renderer, frame);
    assert_true(clipmap_renderer.update(renderer, view, 1));
    gpu_set_view(f->gpu, terrain, view);
    gpu_target_begin(f->gpu, &f->target);
    clipmap_renderer.draw(renderer, 0, PASS_POSITION);
    gpu_target_read(f->gpu, &f->target, pixels);
}

// From a man's height to three radii and back, over both poles and the 180th meridian, against the caster.
static void a_flight_has_no_holes(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = test_planet(COLUMNS, 2500, 9, 14);
    struct renderer *renderer = create(f, terrain, "n=127");
    struct truth_surface *surface = truth_surface_create(terrain);
    int frames = test_size(9, 400);
    struct path *path = path_for_terrain(terrain, frames, 60 * DEGREE);
    struct truth truth;
    struct frame_error error;
    truth_init(&truth, WIDTH, HEIGHT);
    frame_error_init(&error, WIDTH, HEIGHT);
    uint64_t holes = 0, ground = 0, order = 0, broken = 0, misses = 0;
    double sum = 0;
    for (int frame = 0; frame < frames; frame++) {
        struct camera camera = path_camera(path, frame, frames);
        struct view view;
        view_init(&view, terrain, &camera, WIDTH, HEIGHT, 0);
        draw(f, renderer, terrain, &view, frame, f->pixels);
        truth_cast(&truth, surface, &view, 0);
        struct flat_feeding feeding = {view.radius_m, truth_places(&truth, 0)};
        assert_true(gpu_capture_begin(f->gpu, flat_receive, &feeding));
        clipmap_renderer.draw(renderer, 0, PASS_POSITION);
        gpu_capture_end(f->gpu);
        frame_error_measure(&error, terrain, &view, &truth, &f->pixels[0][0], feeding.places, 0);
        holes += error.holes, ground += error.ground, order += error.order_mismatches, misses += error.misses;
        for (int p = 0; p < PIXELS; p++) {
            broken += !(isfinite(f->pixels[p][0]) && isfinite(f->pixels[p][1]) && isfinite(f->pixels[p][2]));
            if (error.kind[p] == PIXEL_GROUND && isfinite((double)error.error_px[p]))
                sum += (double)error.error_px[p];
        }
        places_destroy(feeding.places);
    }
    FIGURE("flight of %d frames, 1.7 m to 3 radii: %d holes, %d not finite, %d misses, %d other surfaces of "
           "%d ground pixels, mean "
           "error %.4f px",
           frames, (int)holes, (int)broken, (int)misses, (int)order, (int)ground, sum / (double)ground);
    assert_int_equal(holes, 0);
    assert_int_equal(broken, 0);
    assert_true((double)misses <= 0.01 * (double)ground && sum / (double)ground < 0.5);
    frame_error_finish(&error);
    truth_finish(&truth);
    path_destroy(path);
    truth_surface_destroy(surface);
    clipmap_renderer.destroy(renderer);
    terrain_destroy(terrain);
}

static double apart_px(const struct view *view, const float a[4], const float b[4])
{
    double depth = 0, sum = 0;
    for (int k = 0; k < 3; k++) {
        depth += view->forward[k] * (double)a[k];
        sum += ((double)a[k] - (double)b[k]) * ((double)a[k] - (double)b[k]);
    }
    return view->pixels_per_tangent * sqrt(sum) / depth;
}

// D4: a turn more of longitude is the same picture, at the seam and at a pole.
static void a_turn_more_is_the_same_picture(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = test_planet(COLUMNS, 2500, 9, 6);
    static const double PLACES[3][2] = {{180, 20}, {-179.99, -40}, {30, 89.95}};
    double worst = 0;
    int sky = 0;
    for (int k = 0; k < 3; k++)
        for (int turn = -2; turn <= 2; turn += 4) {
            struct view views[2];
            for (int i = 0; i < 2; i++) {
                struct camera camera = {{(PLACES[k][0] + 360 * turn * i) * DEGREE * RADIUS,
                                         PLACES[k][1] * DEGREE * RADIUS, 20000},
                                        0.7,
                                        -0.6,
                                        0,
                                        60 * DEGREE};
                struct renderer *renderer = create(f, terrain, "n=127");
                view_init(&views[i], terrain, &camera, WIDTH, HEIGHT, 0);
                draw(f, renderer, terrain, &views[i], 0, i ? f->others : f->pixels);
                clipmap_renderer.destroy(renderer);
            }
            for (int p = 0; p < PIXELS; p++) {
                sky += (f->pixels[p][3] > 0) != (f->others[p][3] > 0);
                if (f->pixels[p][3] > 0 && f->others[p][3] > 0)
                    worst = fmax(worst, apart_px(&views[0], f->pixels[p], f->others[p]));
            }
        }
    FIGURE("D4: pictures a turn apart differ by at most %.2e px, %d pixels of sky", worst, sky);
    assert_int_equal(sky, 0);
    assert_true(worst <= 0.05);
    terrain_destroy(terrain);
}

// A drawn point from the planet's centre, in the world, and its height over the eye's radius.
static double place_in_world(const struct view *view, const float drawn[4], double world[3])
{
    double up = view->radius_m, rise = (double)drawn[2];
    memset(world, 0, 3 * sizeof *world);
    for (int axis = 0; axis < 3; axis++)
        for (int k = 0; k < 3; k++)
            world[axis] += view->axes[k][axis] * ((double)drawn[k] + (k == 2 ? up : 0));
    double across = (double)drawn[0] * (double)drawn[0] + (double)drawn[1] * (double)drawn[1];
    return rise + across / (up + rise + sqrt((up + rise) * (up + rise) + across));
}

struct steepness {
    double across,
        elsewhere; // steepest way from a pixel to the next over the seam or a pole; steepest facet beside
    int crossings, sky;
};

// The way from a pixel to the next one of its row or column: along the chord, and upwards.
struct way {
    double along[3], up;
    bool drawn, crosses;
};

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// Near a pole the opposite meridian counts as well as the 180th: what leads over the pole crosses either.
static struct way way_between(const struct fixture *f, const struct view *view, bool polar, int from, int to)
{
    double a[3], b[3], rise = place_in_world(view, f->pixels[from], a);
    struct way way = {.up = place_in_world(view, f->pixels[to], b) - rise,
                      .drawn = f->pixels[from][3] != 0 && f->pixels[to][3] != 0,
                      .crosses = (a[1] < 0) != (b[1] < 0) && (polar || a[0] < 0)};
    for (int k = 0; k < 3; k++) way.along[k] = b[k] - a[k];
    return way;
}

// A way over an edge is at most as steep as the steeper of the facets beside it; of those, three neighbouring
// pixels give the gradient.
static void add_steepness(const struct fixture *f, const struct view *view, bool polar,
                          struct steepness *steepness)
{
    for (int p = 0; p < PIXELS - WIDTH; p++) {
        if (p % WIDTH == WIDTH - 1) continue;
        struct way ways[2];
        for (int k = 0; k < 2; k++) {
            struct way *way = &ways[k];
            *way = way_between(f, view, polar, p, k ? p + WIDTH : p + 1);
            if (!way->drawn || !way->crosses) continue;
            steepness->across = fmax(steepness->across, fabs(way->up) / sqrt(dot(way->along, way->along)));
            steepness->crossings++;
        }
        if (!ways[0].drawn || !ways[1].drawn || ways[0].crosses || ways[1].crosses) continue;
        double uu = dot(ways[0].along, ways[0].along), vv = dot(ways[1].along, ways[1].along),
               uv = dot(ways[0].along, ways[1].along), u = ways[0].up, v = ways[1].up;
        steepness->elsewhere = fmax(steepness->elsewhere,
                                    sqrt((u * u * vv - 2 * u * v * uv + v * v * uu) / (uu * vv - uv * uv)));
    }
}

// D4: over the 180th meridian and over the poles heights rise and fall as they do beside them.  Seen straight
// from above, so that each pixel's ground is next to its neighbours'.
static struct steepness look_down(const struct fixture *f, const struct terrain *terrain,
                                  const char *settings, const double place[2], double height_m)
{
    struct steepness steepness = {0};
    struct renderer *renderer = create(f, terrain, settings);
    struct camera camera = test_camera(terrain, place[0], place[1], height_m, 0.4, -1.5);
    struct view view;
    view_init(&view, terrain, &camera, WIDTH, HEIGHT, 0);
    draw(f, renderer, terrain, &view, 0, f->pixels);
    for (int p = 0; p < PIXELS; p++) steepness.sky += f->pixels[p][3] == 0;
    add_steepness(f, &view, fabs(place[1]) > 80, &steepness);
    clipmap_renderer.destroy(renderer);
    return steepness;
}

static void heights_do_not_jump_at_seam_and_poles(void **state)
{
    struct fixture *f = *state;
    static const double PLACES[][2] = {{180, 20}, {-180, -40}, {180, 75}, {30, 90}, {-100, -90}};
    struct terrain *terrain = test_planet(COLUMNS, 2500, 9, 6);
    double worst = 0, published = 0;
    int sky = 0, published_sky = 0;
    for (int k = 0; k < 5; k++)
        for (double height_m = 500; height_m < 1e6; height_m *= test_size(20, 4)) {
            struct steepness right = look_down(f, terrain, "n=127", PLACES[k], height_m);
            struct steepness wrong =
                look_down(f, terrain, "n=127 trigonometry=published", PLACES[k], height_m);
            sky += right.sky, published_sky += wrong.sky;
            assert_true(right.crossings > 10);
            worst = fmax(worst, right.across / right.elsewhere);
            published = fmax(published, wrong.across / right.elsewhere);
        }
    FIGURE("D4: over the seam and the poles heights change by at most %.3f of the steepest beside them, %d "
           "pixels of sky (as published: %.1f, %d)",
           worst, sky, published, published_sky);
    assert_int_equal(sky, 0);
    assert_true(worst <= 1 && published > 1 && published_sky > 0);
    terrain_destroy(terrain);
}

// What of the drawn vertices lies in bilinear cells, and by how much the worst is off the truth.
struct bilinear_check {
    const struct terrain *terrain;
    const struct view *view;
    double from_m,
        reach_m; // latitude from which cells are bilinear; how far the finest level alone is sampled
    double steepest, worst; // slope; height that a vertex is off, of what is allowed
    int vertices;
};

static void check_bilinear(const float *triangles, size_t count, void *user)
{
    struct bilinear_check *check = user;
    const struct terrain_info *info = terrain_info(check->terrain);
    for (size_t k = 0; k < 3 * count; k++) {
        double relative[3], world_m[3], place[3], q;
        for (int a = 0; a < 3; a++) relative[a] = (double)triangles[3 * k + (size_t)a];
        view_world(check->view, relative, world_m);
        sphere_place_from_world(RADIUS, world_m, place);
        double distance_m = sqrt(dot(relative, relative));
        if (fabs(place[1]) < check->from_m || hypot(relative[0], relative[1]) > check->reach_m) continue;
        assert_true(terrain_truth_at(check->terrain, place[0], place[1], &q, NULL));
        // A vertex samples within 3e-5 of its distance of its place (D2), and is placed in float32: four
        // roundings of a distance and one of a height of up to 2^12 m.
        double allowed = distance_m * (3e-5 * check->steepest + 4 * 0x1p-24) + 0x1p-12;
        check->worst = fmax(check->worst, fabs(place[2] - (q * info->quantum_m + info->offset_m)) / allowed);
        check->vertices++;
    }
}

// Of the finest level: from column to column and from row to row.  From one row to the next towards a pole,
// the pole's own left out, parallels get shorter by half at most.
static double steepest_slope(const struct terrain *terrain)
{
    const struct terrain_info *info = terrain_info(terrain);
    struct terrain_level finest = terrain_level(terrain, info->finest);
    struct terrain_extent e = finest.extent;
    int width = (int)(e.x1 - e.x0) + 1;
    int32_t *rows = malloc(2 * (size_t)width * sizeof *rows);
    double east = 0, north = 0;
    assert_non_null(rows);
    for (int64_t j = e.y0; j < e.y1 - 1; j++) {
        double parallel = cos((double)j * finest.spacing_m[1] / RADIUS);
        terrain_window(terrain, info->finest, e.x0, j, width, 2, rows, TERRAIN_WAIT);
        for (int i = 0; i < width - 1; i++) {
            north = fmax(north, fabs((double)rows[width + i] - rows[i]));
            if (j > e.y0) east = fmax(east, fabs((double)rows[i + 1] - rows[i]) / parallel);
        }
    }
    free(rows);
    return info->quantum_m * hypot(2 * east / finest.spacing_m[0], north / finest.spacing_m[1]);
}

// Cells at a pole are fans, straight along meridians, and towards the poles those of synthesised levels are
// several columns wide (terrain.h): both are bilinear.  Split as others are, a vertex would be off by up to a
// quarter of what the ground climbs across.
static void bilinear_cells_are_drawn_so(void **state)
{
    struct fixture *f = *state;
    for (int finer = 0; finer <= 2; finer += 2) {
        struct terrain *terrain = test_planet(64, 2500, 9, finer);
        struct renderer *renderer = create(f, terrain, "n=127 cull=off texture=0.5");
        struct sphere_shape shape;
        sphere_shape_init(&shape, terrain, sphere_rings_make(127).azimuths, 0.5);
        double reach = 1; // half a level beyond the finest the next one is blended in
        while (sphere_level_at(&shape, reach) > shape.sampled + 0.5) reach *= 0.99;
        struct bilinear_check check = {.terrain = terrain,
                                       .from_m =
                                           finer ? 61 * DEGREE * RADIUS : (1 - 1. / 16) * M_PI / 2 * RADIUS,
                                       .reach_m = sin(reach) * RADIUS,
                                       .steepest = steepest_slope(terrain)};
        uint64_t seed = 31;
        for (int k = 0; k < test_size(8, 400); k++) {
            double latitude = M_PI / 2 - test_uniform(&seed, 0, (finer ? 6 : 1.5) * M_PI / 32);
            struct camera camera = {{test_uniform(&seed, -M_PI, M_PI) * RADIUS,
                                     (k % 2 ? latitude : -latitude) * RADIUS,
                                     4500 + exp(test_uniform(&seed, log(100), log(1e5)))},
                                    0,
                                    -1,
                                    0,
                                    1};
            struct view view;
            view_init(&view, terrain, &camera, WIDTH, HEIGHT, 0);
            clipmap_renderer.begin_frame(renderer, k);
            assert_true(clipmap_renderer.update(renderer, &view, 1));
            gpu_set_view(f->gpu, terrain, &view);
            check.view = &view;
            assert_true(gpu_capture_begin(f->gpu, check_bilinear, &check));
            clipmap_renderer.draw(renderer, 0, PASS_POSITION);
            gpu_capture_end(f->gpu);
        }
        FIGURE(
            "bilinear cells, %d finer levels: %d vertices are off the truth by at most %.2f of what float32 "
            "allows",
            finer, check.vertices, check.worst);
        assert_true(check.vertices > 1000 && check.worst <= 1);
        clipmap_renderer.destroy(renderer);
        terrain_destroy(terrain);
    }
}

// Culling leaves the picture as it is, and at 90 degrees at most 0.3 of the vertices.
static void culling_is_right_and_pays(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = test_planet(COLUMNS, 2500, 9, 10);
    struct renderer *all = create(f, terrain, "n=127 cull=off"), *culled = create(f, terrain, "n=127");
    double share = 0;
    int different = 0, views = test_size(8, 500);
    uint64_t seed = 4;
    for (int k = 0; k < views; k++) {
        double height_m = exp(test_uniform(&seed, log(1.7), log(1e5)));
        struct camera camera = {{test_uniform(&seed, -M_PI, M_PI) * RADIUS,
                                 asin(test_uniform(&seed, -1, 1)) * RADIUS, 3500 + height_m},
                                test_uniform(&seed, -M_PI, M_PI),
                                test_uniform(&seed, -0.2, 0.05),
                                0,
                                2 * atan(0.75)};
        struct view view; // 90 degrees across at 4:3
        struct renderer_stats stats[2];
        view_init(&view, terrain, &camera, WIDTH, HEIGHT, 0);
        draw(f, all, terrain, &view, 0, f->pixels);
        draw(f, culled, terrain, &view, 0, f->others);
        different += memcmp(f->pixels, f->others, PIXELS * sizeof *f->pixels) != 0;
        clipmap_renderer.stats(all, &stats[0]);
        clipmap_renderer.stats(culled, &stats[1]);
        share += (double)stats[1].triangles / (double)stats[0].triangles / views;
    }
    FIGURE("culling: %.3f of the triangles at 90 degrees, %d of %d pictures differ", share, different, views);
    assert_int_equal(different, 0);
    assert_true(share <= 0.3);
    clipmap_renderer.destroy(all);
    clipmap_renderer.destroy(culled);
    terrain_destroy(terrain);
}

static uint64_t picture(const struct fixture *f, struct renderer *renderer, const struct terrain *terrain,
                        const struct view *view, enum render_pass pass)
{
    gpu_set_view(f->gpu, terrain, view);
    gpu_target_begin(f->gpu, &f->target);
    clipmap_renderer.draw(renderer, 0, pass);
    if (pass == PASS_DEPTH)
        gpu_target_read_depth(f->gpu, &f->target, &f->pixels[0][0]);
    else
        gpu_target_read(f->gpu, &f->target, f->pixels);
    uint64_t sum = 1;
    const uint32_t *words = (const uint32_t *)f->pixels;
    for (int k = 0; k < PIXELS * (pass == PASS_DEPTH ? 1 : 4); k++) sum = (sum ^ words[k]) * 0x100000001b3u;
    return sum;
}

static void add_to_sum(const float *triangles, size_t count, void *user)
{
    uint64_t *sum = user;
    const uint32_t *words = (const uint32_t *)triangles;
    for (size_t k = 0; k < 9 * count; k++) *sum = (*sum ^ words[k]) * 0x100000001b3u;
}

// Kept vertices draw what transformed ones draw, in each pass and in a capture, bit for bit: while the eye
// stands still and looks about, and when it goes on.  What is in sight twice is transformed once.
static void kept_vertices_draw_the_same(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = test_planet(COLUMNS, 2500, 9, 10);
    struct renderer *renderers[2] = {create(f, terrain, "n=127 keep=off"), create(f, terrain, "n=127")};
    uint64_t seed = 14, transformed = 0;
    int frame = 0, compared = 0, different = 0, again = 0;
    for (int place = 0; place < test_size(3, 200); place++) {
        struct camera camera = {{test_uniform(&seed, -M_PI, M_PI) * RADIUS,
                                 asin(test_uniform(&seed, -1, 1)) * RADIUS,
                                 3500 + exp(test_uniform(&seed, log(5), log(1e6)))},
                                test_uniform(&seed, -M_PI, M_PI),
                                test_uniform(&seed, -0.6, 0.05),
                                0,
                                1};
        for (int look = 0; look < 4; look++, frame++) {
            struct view view;
            uint64_t sums[2][PASS_COUNT + 1];
            view_init(&view, terrain, &camera, WIDTH, HEIGHT, 1);
            for (int i = 0; i < 2; i++) {
                clipmap_renderer.begin_frame(renderers[i], frame);
                assert_true(clipmap_renderer.update(renderers[i], &view, 1));
                for (int pass = 0; pass < PASS_COUNT; pass++)
                    sums[i][pass] = picture(f, renderers[i], terrain, &view, (enum render_pass)pass);
                sums[i][PASS_COUNT] = 1;
                assert_true(gpu_capture_begin(f->gpu, add_to_sum, &sums[i][PASS_COUNT]));
                clipmap_renderer.draw(renderers[i], 0, PASS_SHADED);
                gpu_capture_end(f->gpu);
            }
            for (int k = 0; k <= PASS_COUNT; k++, compared++) different += sums[0][k] != sums[1][k];
            double anew = counter(renderers[1], "vertices kept anew");
            if (look == 2) again += anew > 0; // the same view once more
            transformed += (uint64_t)anew;
            if (look != 1) camera.yaw += 0.8;
        }
    }
    FIGURE("kept vertices: %d of %d pictures and captures differ; %lu transformed, %d frames did so twice",
           different, compared, transformed, again);
    assert_int_equal(different, 0);
    assert_int_equal(again, 0);
    assert_true(transformed > 0);
    for (int i = 0; i < 2; i++) clipmap_renderer.destroy(renderers[i]);
    terrain_destroy(terrain);
}

static double smooth(const double world[3], int channel)
{
    return 80 + 79 * world[channel];
}

static void paint(struct scene_colour *colour, bool grey)
{
    for (int j = 0; j < colour->height; j++)
        for (int i = 0; i < colour->width; i++) {
            uint8_t *pixel = colour->pixels + 4 * ((size_t)j * (size_t)colour->width + (size_t)i);
            double place[3] = {(2 * (i + 0.5) / colour->width - 1) * M_PI,
                               (0.5 - (j + 0.5) / colour->height) * M_PI, 0},
                   world[3];
            sphere_world_from_place(1, place, world);
            for (int k = 0; k < 3; k++) pixel[k] = (uint8_t)(grey ? 128 : lrint(smooth(world, k)));
            pixel[3] = 255;
        }
}

// One view: what was drawn where, coloured and grey.
struct colour_view {
    struct view view;
    float places[PIXELS][4];
    uint8_t pictures[2][PIXELS][4];
};

// How far a pixel reaches on the ground where it is seen most from the side, radians; slopes lean it by up to
// .15.
static double pixel_reach(const struct view *view, const double relative[3], const double up[3])
{
    double toward[3], down = 0, distance = 0;
    for (int k = 0; k < 3; k++) distance += relative[k] * relative[k];
    distance = sqrt(distance);
    for (int k = 0; k < 3; k++) {
        toward[k] = 0;
        for (int axis = 0; axis < 3; axis++) toward[k] += relative[axis] * view->axes[axis][k] / distance;
        down -= toward[k] * up[k];
    }
    return down > 0.15 ? distance / (view->pixels_per_tangent * RADIUS * (down - 0.15)) : HUGE_VAL;
}

// Largest difference, in steps of 255, of a picture from what it should be, given that of a grey planet; of
// pixels that reach no farther than `reach`, counted.
static double off_colour(const struct colour_view *v, double reach, int *count)
{
    double worst = 0;
    for (int p = 0; p < PIXELS; p++) {
        double relative[3], world[3], length = 0;
        if (!(v->places[p][3] > 0)) continue;
        for (int k = 0; k < 3; k++) relative[k] = (double)v->places[p][k];
        view_world(&v->view, relative, world);
        for (int k = 0; k < 3; k++) length += world[k] * world[k];
        for (int k = 0; k < 3; k++) world[k] /= sqrt(length);
        if (reach < HUGE_VAL && pixel_reach(&v->view, relative, world) > reach) continue;
        ++*count;
        for (int k = 0; k < 3; k++)
            worst = fmax(worst, fabs(v->pictures[0][p][k] - smooth(world, k) * v->pictures[1][p][k] / 128));
    }
    return worst;
}

// Anywhere, on the 180th meridian, and within 6 km of the poles.
static struct camera colour_camera(uint64_t *seed, int k)
{
    double longitude = test_uniform(seed, -M_PI, M_PI), latitude = asin(test_uniform(seed, -1, 1));
    if (k % 3 == 1) longitude = M_PI;
    if (k % 3 == 2) latitude = (k & 1 ? 1 : -1) * (M_PI / 2 - test_uniform(seed, 0, 1e-3));
    double height_m = 3500 + exp(test_uniform(seed, log(100), log(2e7))),
           yaw = test_uniform(seed, -M_PI, M_PI), pitch = test_uniform(seed, -1.5, -0.1);
    return (struct camera){{longitude * RADIUS, latitude * RADIUS, height_m}, yaw, pitch, 0, 1};
}

// The same views of the coloured (0) or the grey (1) planet.
static void draw_coloured(const struct fixture *f, const struct terrain *terrain, enum scene_shading shading,
                          int grey, struct colour_view *views, int count)
{
    enum { W = 512, H = 256 };
    struct scene_colour colour = {.sha256 = {grey ? 'g' : 'c'}, .width = W, .height = H};
    struct gpu_target target;
    uint64_t seed = 17;
    colour.pixels = malloc(4 * W * H);
    paint(&colour, grey);
    struct scene_effects effects_of = {shading, &colour};
    struct renderer_desc desc = {
        .gpu = f->gpu, .terrain = terrain, .effects = &effects_of, .width = WIDTH, .height = HEIGHT};
    struct renderer *renderer = create_with(&clipmap_renderer, desc, "n=127");
    assert_true(gpu_target_init(f->gpu, &target, WIDTH, HEIGHT, GL_RGBA8));
    for (int k = 0; k < count; k++) {
        struct camera camera = colour_camera(&seed, k);
        view_init(&views[k].view, terrain, &camera, WIDTH, HEIGHT, 0);
        draw(f, renderer, terrain, &views[k].view, k, views[k].places);
        gpu_target_begin(f->gpu, &target);
        clipmap_renderer.draw(renderer, 0, PASS_SHADED);
        gpu_target_read(f->gpu, &target, views[k].pictures[grey]);
    }
    clipmap_renderer.destroy(renderer);
    gpu_target_finish(&target);
    free(colour.pixels);
}

// A smooth image has its colour at every place drawn, over seam and poles, as the clipmap drapes it and as
// all renderers do.  Of 255 steps: half of one for rounding the image, two levels and a mean of columns, lit
// by at most 1.49; half of one in each picture, that of the grey planet worth 160 / 128; and less than 0.3
// for linear filters of 0.05 radians.
static void colours_are_those_of_the_place(void **state)
{
    const double BOUND = 4 * 0.5 * 1.49 + 0.5 + 0.5 * 160 / 128 + 0.3;
    static const char *const NAMES[] = {[SCENE_SHADING_COMMON] = "common", [SCENE_SHADING_OWN] = "by level"};
    struct fixture *f = *state;
    struct terrain *terrain = test_planet(COLUMNS, 2500, 9, 6);
    int count = test_size(12, 400);
    struct colour_view *views = malloc((size_t)count * sizeof *views);
    assert_non_null(views);
    for (int shading = SCENE_SHADING_COMMON; shading <= SCENE_SHADING_OWN; shading++) {
        double worst = 0, reach = shading == SCENE_SHADING_OWN ? HUGE_VAL : 0.05;
        int pixels = 0;
        for (int grey = 0; grey < 2; grey++)
            draw_coloured(f, terrain, (enum scene_shading)shading, grey, views, count);
        for (int k = 0; k < count; k++) worst = fmax(worst, off_colour(&views[k], reach, &pixels));
        FIGURE("colours, %s: off by at most %.2f of 255 in %d pixels of %d views (%.2f are allowed)",
               NAMES[shading], worst, pixels, count, BOUND);
        assert_true(pixels > count * PIXELS / 4);
        assert_true(worst <= BOUND);
    }
    free(views);
    terrain_destroy(terrain);
}

// Distance of a drawn point from the surface that both draw, projected.
static double off_plane_px(const struct terrain *plane, const struct view *view, const float drawn[4])
{
    const struct terrain_info *info = terrain_info(plane);
    double height = 0, depth = 0, slope[2] = {0, 0};
    for (int k = 0; k < 3; k++) depth += view->forward[k] * (double)drawn[k];
    assert_true(terrain_truth_at(plane, view->eye_place[0] + (double)drawn[0],
                                 view->eye_place[1] + (double)drawn[1], &height, slope));
    double off_m = (double)drawn[2] + view->eye_place[2] - (height * info->quantum_m + info->offset_m);
    double east = slope[0] * info->quantum_m, north = slope[1] * info->quantum_m;
    return view->pixels_per_tangent * fabs(off_m) / sqrt(1 + east * east + north * north) / depth;
}

// Where curvature is below it, the planet's clipmap draws what the plane's draws: the same samples on the
// equator, seen from 60 m.  The two distances from the surface are added.
static void plane_and_sphere_agree(void **state)
{
    enum { SIDE = 513 };
    struct fixture *f = *state;
    struct terrain *sphere = test_planet(COLUMNS, 2500, 9, 16);
    const struct terrain_info *info = terrain_info(sphere);
    static int32_t samples[SIDE * SIDE];
    terrain_window(sphere, info->finest, -SIDE / 2, -SIDE / 2, SIDE, SIDE, samples, TERRAIN_WAIT);
    struct terrain_grid grid = {
        .name = "plane",
        .samples = samples,
        .width = SIDE,
        .height = SIDE,
        .first = {-SIDE / 2, -SIDE / 2},
        .spacing_m = {ldexp(info->spacing_m[0], info->finest), ldexp(info->spacing_m[1], info->finest)},
        .quantum_m = info->quantum_m,
        .offset_m = info->offset_m};
    struct terrain *plane = terrain_from_grid(&grid, NULL);
    double q, worst = 0;
    terrain_truth_at(plane, 0, 0, &q, NULL);
    struct camera camera = {
        {0, 0, q * info->quantum_m + info->offset_m + 60}, 0.4, -70 * DEGREE, 0, 60 * DEGREE};
    const struct terrain *both[2] = {plane, sphere};
    struct view views[2];
    for (int i = 0; i < 2; i++) {
        struct renderer *renderer = create(f, both[i], i ? "n=1023" : "n=255");
        view_init(&views[i], both[i], &camera, WIDTH, HEIGHT, 1);
        draw(f, renderer, both[i], &views[i], 0, i ? f->others : f->pixels);
        clipmap_renderer.destroy(renderer);
    }
    for (int p = 0; p < PIXELS; p++) {
        assert_true(f->pixels[p][3] > 0 && f->others[p][3] > 0);
        worst = fmax(worst, off_plane_px(plane, &views[0], f->pixels[p]) +
                                off_plane_px(plane, &views[1], f->others[p]));
    }
    FIGURE("plane and sphere: at most %.4f px apart over %d pixels", worst, PIXELS);
    assert_true(worst <= 0.05);
    terrain_destroy(plane);
    terrain_destroy(sphere);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_turn_more_is_the_same_picture),
        cmocka_unit_test(heights_do_not_jump_at_seam_and_poles),
        cmocka_unit_test(bilinear_cells_are_drawn_so),
        cmocka_unit_test(culling_is_right_and_pays),
        cmocka_unit_test(kept_vertices_draw_the_same),
        cmocka_unit_test(colours_are_those_of_the_place),
        cmocka_unit_test(plane_and_sphere_agree),
        cmocka_unit_test(a_flight_has_no_holes),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
