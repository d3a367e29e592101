// The clipmap's own shading as drawn: uniform on flat ground, equal to a double-precision reference, a
// function of the view alone, the same wherever the torus has its seam, continuous between levels.
// SPDX-License-Identifier: MIT
#include "clipmap/clipmap.h"
#include "clipmap/clipmap_levels.h"
#include "tests/gpu/settings.h"
#include "tests/unit/test_clipmap.h"

#include <string.h>

enum { WIDTH = 320, HEIGHT = 240, PIXELS = WIDTH * HEIGHT };

static const struct scene_effects common = {.shading = SCENE_SHADING_COMMON},
                                  own = {.shading = SCENE_SHADING_OWN};

// The light of terrain.frag: a colour changes by at most this many of 255 when n.s changes by one.
static const double LIGHT = 1.05 * 255;

static const struct test_map hills = {
    .width = 513, .height = 401, .spacing_m = {30, 25}, .quantum_m = 0.1, .rough = 14, .seed = 3};

struct fixture {
    struct gpu *gpu;
    struct gpu_target shaded, position;
    uint8_t (*colours)[4], (*other)[4];
    float (*places)[4];
};

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    *state = f;
    f->gpu = gpu_create(GPU_OFFSCREEN, 0, 0, "test", 0);
    if (!f->gpu || !gpu_target_init(f->gpu, &f->shaded, WIDTH, HEIGHT, GL_RGBA8) ||
        !gpu_target_init(f->gpu, &f->position, WIDTH, HEIGHT, GL_RGBA32F))
        return -1;
    f->colours = malloc(PIXELS * sizeof *f->colours);
    f->other = malloc(PIXELS * sizeof *f->other);
    f->places = malloc(PIXELS * sizeof *f->places);
    return f->colours && f->other && f->places ? 0 : -1;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    uint64_t errors = gpu_debug_errors(f->gpu);
    gpu_target_finish(&f->shaded);
    gpu_target_finish(&f->position);
    gpu_destroy(f->gpu);
    free(f->colours);
    free(f->other);
    free(f->places);
    free(f);
    return errors ? -1 : 0;
}

// settings: "n=31 normals=mipmap"; the rest as by default.
static struct renderer *create(const struct fixture *f, const struct terrain *terrain,
                               const struct scene_effects *effects, const char *settings)
{
    struct renderer_desc desc = {
        .gpu = f->gpu, .terrain = terrain, .effects = effects, .width = WIDTH, .height = HEIGHT};
    return create_with(&clipmap_renderer, desc, settings);
}

static void update(struct renderer *renderer, const struct view *view)
{
    clipmap_renderer.begin_frame(renderer, 0);
    assert_true(clipmap_renderer.update(renderer, view, 1));
}

static void draw_shaded(struct fixture *f, struct renderer *renderer, const struct terrain *terrain,
                        const struct view *view, uint8_t (*colours)[4])
{
    update(renderer, view);
    gpu_set_view(f->gpu, terrain, view);
    gpu_target_begin(f->gpu, &f->shaded);
    clipmap_renderer.draw(renderer, 0, PASS_SHADED);
    gpu_target_read(f->gpu, &f->shaded, colours);
}

static void draw_places(struct fixture *f, struct renderer *renderer)
{
    gpu_target_begin(f->gpu, &f->position);
    clipmap_renderer.draw(renderer, 0, PASS_POSITION);
    gpu_target_read(f->gpu, &f->position, f->places);
}

static struct view view_from(const struct terrain *terrain, double x_m, double y_m, double over_m, double yaw,
                             double pitch, double fov)
{
    const struct terrain_info *info = terrain_info(terrain);
    double ground_q = 0;
    assert_true(terrain_truth_at(terrain, x_m, y_m, &ground_q, NULL));
    struct camera camera = {.eye_m = {x_m, y_m, ground_q * info->quantum_m + info->offset_m + over_m},
                            .yaw = yaw,
                            .pitch = pitch,
                            .fov_vertical = fov};
    struct view view;
    view_init(&view, terrain, &camera, WIDTH, HEIGHT, 0);
    return view;
}

static struct view any_view(const struct terrain *terrain, uint64_t *seed)
{
    const double *o = terrain_info(terrain)->outline_m;
    double x = test_uniform(seed, o[0], o[2]), y = test_uniform(seed, o[1], o[3]);
    double over = 5 * pow(400, test_uniform(seed, 0, 1)), yaw = test_uniform(seed, -3, 3);
    return view_from(terrain, x, y, over, yaw, test_uniform(seed, -1.2, -0.05), 1);
}

static int largest_difference(const uint8_t (*a)[4], const uint8_t (*b)[4])
{
    int largest = 0;
    for (int i = 0; i < PIXELS; i++)
        for (int c = 0; c < 3; c++)
            if (abs(a[i][c] - b[i][c]) > largest) largest = abs(a[i][c] - b[i][c]);
    return largest;
}

// ---- flat ground -----------------------------------------------------------

static void flat_ground_is_shaded_alike(void **state)
{
    struct fixture *f = *state;
    const struct test_map flat = {
        .width = 300, .height = 300, .spacing_m = {30, 25}, .quantum_m = 0.1, .flat_q = 5003};
    static const char *const settings[] = {"n=31", "n=31 anisotropy=16", "n=31 normals=mipmap"};
    struct terrain *terrain = test_terrain(&flat);
    for (int s = 0; s < 3; s++) {
        struct renderer *renderer = create(f, terrain, &own, settings[s]);
        struct view view = view_from(terrain, 4000, 3500, 200, 0.3, -0.4, 1);
        draw_shaded(f, renderer, terrain, &view, f->colours);
        draw_places(f, renderer);
        const uint8_t *first = NULL;
        int ground = 0;
        for (int i = 0; i < PIXELS; i++) {
            if (f->places[i][3] == 0) continue;
            if (!first) first = f->colours[i];
            assert_memory_equal(f->colours[i], first, 4);
            ground++;
        }
        assert_true(ground > PIXELS / 2);
        clipmap_renderer.destroy(renderer);
    }
    terrain_destroy(terrain);
}

// ---- against a reference in double -----------------------------------------

static double half_sample(const struct terrain *terrain, int64_t x, int64_t y) // U of level 0, not rounded
{
    double columns[4] = {0}, weights[2][4] = {{0, 1, 0, 0}, {-0.0625, 0.5625, 0.5625, -0.0625}}, height = 0;
    int64_t i = clipmap_floor_div(x, 2), j = clipmap_floor_div(y, 2);
    int32_t samples[16];
    terrain_window(terrain, 0, i - 1, j - 1, 4, 4, samples, TERRAIN_WAIT);
    for (int a = 0; a < 4; a++)
        for (int b = 0; b < 4; b++) columns[a] += weights[y & 1][b] * samples[4 * b + a];
    for (int a = 0; a < 4; a++) height += weights[x & 1][a] * columns[a];
    return height;
}

static void texel_at(const struct terrain *terrain, int64_t x, int64_t y, double normal[2])
{
    const struct terrain_info *info = terrain_info(terrain);
    double slope[2] = {(half_sample(terrain, x + 1, y) - half_sample(terrain, x - 1, y)) * info->quantum_m /
                           info->spacing_m[0],
                       (half_sample(terrain, x, y + 1) - half_sample(terrain, x, y - 1)) * info->quantum_m /
                           info->spacing_m[1]};
    double length = sqrt(1 + slope[0] * slope[0] + slope[1] * slope[1]);
    for (int axis = 0; axis < 2; axis++) normal[axis] = -slope[axis] / length;
}

// The normal at a place, bilinear; *bend: the largest difference of the four texels.
static void reference_normal(const struct terrain *terrain, const double place_m[2], double normal[3],
                             double *bend)
{
    double half[2], texels[4][2];
    int64_t first[2];
    for (int axis = 0; axis < 2; axis++) {
        half[axis] = 2 * place_m[axis] / terrain_info(terrain)->spacing_m[axis];
        first[axis] = (int64_t)floor(half[axis]);
        half[axis] -= (double)first[axis];
    }
    *bend = 0;
    for (int i = 0; i < 4; i++) texel_at(terrain, first[0] + i % 2, first[1] + i / 2, texels[i]);
    for (int axis = 0; axis < 2; axis++) {
        double south = texels[0][axis] + (texels[1][axis] - texels[0][axis]) * half[0];
        double north = texels[2][axis] + (texels[3][axis] - texels[2][axis]) * half[0];
        normal[axis] = south + (north - south) * half[1];
        for (int i = 0; i < 16; i++) *bend = fmax(*bend, fabs(texels[i / 4][axis] - texels[i % 4][axis]));
    }
    normal[2] = sqrt(1 - normal[0] * normal[0] - normal[1] * normal[1]);
}

// Blue of the ramp is left out of the reference by asking for one height only: the light alone is compared,
// on a map so high above one far sample that all of it is snow, where the ramp is white.
static double reference_red(const double normal[3])
{
    double lambert = -0.58 * normal[0] + 0.58 * normal[1] + 0.57 * normal[2];
    return 255 * fmin(0.30 + 1.05 * fmax(lambert, 0), 1);
}

// One level, seen from straight above.  The bound: half a step of the picture; a texel of 0.67 / 32767 and U
// rounded to a quantum / 4 at 16-bit heights (0.1 m / 4 over 25 m: 1e-3); a filter's weights of 8 bits, 2^-8
// of the bend along each axis; the place to 2e-3 texel.  n.s changes by |s_x - s_z n_x / n_z| + |s_y - ...|
// per part, at most 1.16 + 0.57 * 2 tan(slope) <= 2.3 where the slope is under 45 degrees.
static void seen_from_above_it_is_the_reference(void **state)
{
    struct fixture *f = *state;
    enum { W = 121, H = 101 };
    int32_t *samples = malloc(sizeof *samples * W * H);
    assert_non_null(samples);
    for (int i = 0; i < W * H; i++) samples[i] = 30000 + test_fractal(i % W, i / W, 8, 5);
    samples[0] = 0; // a pit in the corner
    struct terrain_grid grid = {
        .name = "test", .samples = samples, .width = W, .height = H, .spacing_m = {30, 25}, .quantum_m = 0.1};
    struct terrain *terrain = terrain_from_grid(&grid, NULL);
    assert_non_null(terrain);
    struct renderer *renderer = create(f, terrain, &own, "n=127");
    struct view view = view_from(terrain, 1800, 1250, 600, 0, -1.5707963, 1);
    draw_shaded(f, renderer, terrain, &view, f->colours);
    draw_places(f, renderer);
    double worst = 0, worst_bound = 0;
    int checked = 0;
    for (int i = 0; i < PIXELS; i++) {
        if (f->places[i][3] == 0) continue;
        double place_m[2] = {view.eye_m[0] + (double)f->places[i][0],
                             view.eye_m[1] + (double)f->places[i][1]};
        if (place_m[0] < 300 || place_m[1] < 300) continue; // the pit
        double normal[3], bend;
        reference_normal(terrain, place_m, normal, &bend);
        double bound = 0.5 + LIGHT * 2.3 * (0.67 / 32767 + 1e-3 + bend * 2 * (1.0 / 256 + 2e-3));
        double off = fabs(f->colours[i][0] - reference_red(normal));
        assert_true(normal[2] > 0.7072 && off <= bound);
        worst = fmax(worst, off);
        worst_bound = fmax(worst_bound, bound);
        checked++;
    }
    FIGURE("own shading from above: at most %.2f of 255 off the reference (bound 0.5 to %.2f), %d pixels",
           worst, worst_bound, checked);
    assert_true(checked > PIXELS / 2);
    clipmap_renderer.destroy(renderer);
    terrain_destroy(terrain);
    free(samples);
}

// ---- the torus -------------------------------------------------------------

static const char *const filters[] = {"n=31", "n=31 anisotropy=16", "n=31 normals=mipmap",
                                      "n=31 normals=mipmap anisotropy=8"};

// What else is in memory, and where the clip regions lag, leaves no trace: no filter reads beyond the active
// regions.
static void walks_are_shaded_as_a_fresh_renderer_shades(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = test_terrain(&hills);
    uint64_t seed = 5;
    int steps = test_size(12, 200);
    for (int s = 0; s < 4; s++) {
        struct renderer *walker = create(f, terrain, &own, filters[s]);
        for (int step = 0; step < steps; step++) {
            struct view view = any_view(terrain, &seed);
            for (int near = 0; near < 3; near++) { // small steps make clip regions lag
                view = view_from(terrain, view.eye_m[0] * 0.99 + 60, view.eye_m[1] * 0.99 + 50, 40, view.yaw,
                                 -0.2, 1);
                update(walker, &view);
            }
            draw_shaded(f, walker, terrain, &view, f->colours);
            struct renderer *fresh = create(f, terrain, &own, filters[s]);
            draw_shaded(f, fresh, terrain, &view, f->other);
            clipmap_renderer.destroy(fresh);
            assert_int_equal(
                largest_difference((const uint8_t(*)[4])f->colours, (const uint8_t(*)[4])f->other), 0);
        }
        clipmap_renderer.destroy(walker);
    }
    FIGURE("own shading: %d views with 4 filters each, walked to and fresh, equal bit for bit", steps);
    terrain_destroy(terrain);
}

// How far a colour is from the range of those within `reach` pixels of the same place in another picture.
static int beyond_range(const uint8_t (*picture)[4], const uint8_t (*other)[4], int pixel, int reach)
{
    int off = 0, x = pixel % WIDTH, y = pixel / WIDTH;
    for (int c = 0; c < 3; c++) {
        int low = 255, high = 0, colour = picture[pixel][c];
        for (int j = y - reach; j <= y + reach; j++)
            for (int i = x - reach; i <= x + reach; i++) {
                if (i < 0 || i >= WIDTH || j < 0 || j >= HEIGHT) continue;
                int near = other[j * WIDTH + i][c];
                low = near < low ? near : low;
                high = near > high ? near : high;
            }
        off = low - colour > off ? low - colour : off;
        off = colour - high > off ? colour - high : off;
    }
    return off;
}

// The same map at other indices has its seam elsewhere in the picture.  Indices move by a multiple of all
// levels' spacings, so the samples are the same; texture coordinates are rounded elsewhere, which can turn
// one step of 255.  It can also turn how many samples an anisotropic filter takes, a whole number: it gives
// another mean over the same footprint then, which is no longer than the way to the next pixels, so that mean
// lies within the range of theirs.  Coordinates are below 8, rounded to 2^-22, and differ by 2^-6 or more
// from one pixel to the next: ratios of a footprint's axes, 1 to 16, are off by 2^-15 of themselves, and turn
// in 2^-14 (1 + .. + 16) / 15 = 5.5e-4 of the pixels.
static void the_seam_leaves_no_trace(void **state)
{
    struct fixture *f = *state;
    struct test_map moved = hills;
    moved.first[0] = 64 * 7;
    moved.first[1] = -64 * 11;
    struct terrain *here = test_terrain(&hills), *there = test_terrain(&moved);
    uint64_t seed = 9;
    int worst = 0, views = test_size(12, 200);
    uint64_t turned = 0, slanted = 0;
    for (int s = 0; s < 4; s++) {
        struct renderer *a = create(f, here, &own, filters[s]), *b = create(f, there, &own, filters[s]);
        int reach = strstr(filters[s], "anisotropy") ? 1 : 0;
        for (int i = 0; i < views; i++) {
            struct view view = any_view(here, &seed), same;
            struct camera camera = {
                .eye_m = {view.eye_m[0] + 64 * 7 * 30, view.eye_m[1] - 64 * 11 * 25, view.eye_m[2]},
                .yaw = view.yaw,
                .pitch = view.pitch,
                .fov_vertical = 1};
            view_init(&same, there, &camera, WIDTH, HEIGHT, view.near_m);
            draw_shaded(f, a, here, &view, f->colours);
            draw_shaded(f, b, there, &same, f->other);
            const uint8_t(*pictures[2])[4] = {(const uint8_t(*)[4])f->colours, (const uint8_t(*)[4])f->other};
            for (int p = 0; p < PIXELS; p++) {
                int off = beyond_range(pictures[0], pictures[1], p, 0);
                if (off > 1 && reach) off = beyond_range(pictures[0], pictures[1], p, reach), turned++;
                worst = off > worst ? off : worst;
            }
            if (reach) slanted += PIXELS;
        }
        clipmap_renderer.destroy(a);
        clipmap_renderer.destroy(b);
    }
    FIGURE("own shading: the torus's seam moves at most %d of 255 (bound 1) beyond what a filter's number of "
           "samples "
           "does, in %lu of %lu pixels; %d views with 4 filters each",
           worst, turned, slanted, views);
    assert_true(worst <= 1);
    assert_true((double)turned <= 5.5e-4 * (double)slanted);
    terrain_destroy(here);
    terrain_destroy(there);
}

// ---- between levels --------------------------------------------------------

// Largest difference of colour between a pixel and the one above it, across the border of a level's active
// region and elsewhere.
static void steps_at_border(const struct fixture *f, const struct clipmap_region *region,
                            const struct view_origin *eye, const struct terrain_level *level, int *border,
                            int *elsewhere)
{
    for (int i = 0; i < PIXELS - WIDTH; i++) {
        bool in[2] = {true, true};
        for (int p = 0; p < 2; p++)
            for (int axis = 0; axis < 2; axis++) {
                double at = (double)f->places[i + p * WIDTH][axis] / level->spacing_m[axis] +
                            (double)eye->fraction[axis] + (double)eye->base[axis];
                in[p] = in[p] && at > (double)region->active.lo[axis] && at < (double)region->active.hi[axis];
            }
        int step = abs(f->colours[i][0] - f->colours[i + WIDTH][0]),
            *largest = in[0] != in[1] ? border : elsewhere;
        if (step > *largest) *largest = step;
    }
}

// Waves three samples long, which differ from level to level: their normals keep sin(kh) / kh of the slope,
// 0.83 with differences over half a sample and 0.41 over a whole one.  So where levels meet unblended, the
// slope jumps by 0.4 of itself, and elsewhere, from pixel to pixel (1.4 m at most here), by 2 pi / 90 m * 1.4
// m = 0.1 of itself.
static struct terrain *waves(void)
{
    enum { W = 201, H = 201 };
    int32_t *samples = malloc(sizeof *samples * W * H);
    assert_non_null(samples);
    for (int i = 0; i < W * H; i++) samples[i] = 30000 + (int32_t)lrint(58 * sin(2.0943951 * (i % W)));
    samples[0] = 0; // a pit in the corner: the rest is snow, white whatever its height
    struct terrain_grid grid = {.name = "waves",
                                .samples = samples,
                                .width = W,
                                .height = H,
                                .spacing_m = {30, 30},
                                .quantum_m = 0.1};
    struct terrain *terrain = terrain_from_grid(&grid, NULL);
    assert_non_null(terrain);
    free(samples);
    return terrain;
}

// With the blend, the colour steps no more at the border than elsewhere (one for rounding); with mipmaps it
// does: the fronts that the paper speaks of.
static void blended_over_the_border_of_levels(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = waves();
    struct clipmap_rules rules = {
        .n = 31, .transition = 0.1, .alpha = CLIPMAP_ALPHA_STABLE, .fade = true, .throttle = 1};
    struct clipmap_shape shape;
    struct terrain_level finest = terrain_level(terrain, 0);
    clipmap_shape_init(&shape, &rules, terrain_info(terrain)->coarsest + 1, &finest.extent,
                       finest.spacing_m[0]);
    static const char *const settings[2] = {"n=31", "n=31 normals=mipmap"};
    int border[2] = {0, 0}, elsewhere[2] = {0, 0};
    for (int r = 0; r < 2; r++) {
        struct renderer *renderer = create(f, terrain, &own, settings[r]);
        for (int trial = 0; trial < test_size(10, 100); trial++) {
            struct view view = view_from(terrain, 2500 + 47 * trial / (trial < 10 ? 1 : 10),
                                         3000 + 3.1 * trial, 240, 0, -0.5, 0.3);
            struct view_origin eyes[CLIPMAP_MAX_LEVELS];
            struct clipmap_region regions[CLIPMAP_MAX_LEVELS];
            for (int k = 0; k < shape.levels; k++) eyes[k] = view_level_origin(&view, k);
            clipmap_regions(&shape, eyes, 240, NULL, NULL, regions);
            draw_shaded(f, renderer, terrain, &view, f->colours);
            draw_places(f, renderer);
            steps_at_border(f, &regions[0], &eyes[0], &finest, &border[r], &elsewhere[r]);
        }
        clipmap_renderer.destroy(renderer);
    }
    FIGURE("colour steps at the border of a level, and elsewhere: %d, %d blended; %d, %d with mipmaps",
           border[0], elsewhere[0], border[1], elsewhere[1]);
    assert_true(border[0] > 0 && border[0] <= elsewhere[0] + 1);
    assert_true(border[1] > elsewhere[1] + 1);
    terrain_destroy(terrain);
}

// ---- the colour image ------------------------------------------------------

static double image_at(const struct scene_colour *image, double u, double v, int channel) // v from the north
{
    double x = fmin(fmax(u * image->width - 0.5, 0), image->width - 1);
    double y = fmin(fmax(v * image->height - 0.5, 0), image->height - 1);
    int i = (int)fmin(x, image->width - 2), j = (int)fmin(y, image->height - 2);
    const uint8_t *p = image->pixels + 4 * (j * image->width + i) + channel;
    double north = p[0] + (p[4] - p[0]) * (x - i);
    double south = p[4 * image->width] + (p[4 * image->width + 4] - p[4 * image->width]) * (x - i);
    return north + (south - north) * (y - j);
}

// Flat ground from above, each pixel smaller than the image's: the image, bilinear, in the light of flat
// ground.  The bound: half a step of the picture; weights of 8 bits, 2^-8 of 255 along each axis, 2; results
// of 8 bits after each of three blends, 1.5.
static void the_colour_image_lies_on_the_map(void **state)
{
    struct fixture *f = *state;
    enum { W = 6, H = 5 };
    uint8_t pixels[W * H * 4];
    uint64_t seed = 21;
    for (int i = 0; i < W * H * 4; i++) pixels[i] = (uint8_t)test_random(&seed);
    struct scene_colour image = {.name = "test", .sha256 = "test", .width = W, .height = H, .pixels = pixels};
    const struct test_map flat = {.width = 101,
                                  .height = 81,
                                  .first = {-20, 30},
                                  .spacing_m = {30, 25},
                                  .quantum_m = 0.1,
                                  .flat_q = 400};
    struct terrain *terrain = test_terrain(&flat);
    const double *o = terrain_info(terrain)->outline_m;
    static const double light[3] = {0.30 + 1.05 * 0.57, 0.35 + 0.99 * 0.57, 0.44 + 0.88 * 0.57};
    for (int shading = 0; shading < 2; shading++) {
        const struct scene_effects effects = {shading ? SCENE_SHADING_OWN : SCENE_SHADING_COMMON, &image};
        struct renderer *renderer = create(f, terrain, &effects, "n=127");
        struct view view = view_from(terrain, (o[0] + o[2]) / 2, (o[1] + o[3]) / 2, 2100, 1.2, -1.5707963, 1);
        draw_shaded(f, renderer, terrain, &view, f->colours);
        draw_places(f, renderer);
        double worst = 0;
        int checked = 0;
        for (int i = 0; i < PIXELS; i++) {
            if (f->places[i][3] == 0) continue;
            double u = (view.eye_m[0] + (double)f->places[i][0] - o[0]) / (o[2] - o[0]);
            double v = (o[3] - view.eye_m[1] - (double)f->places[i][1]) / (o[3] - o[1]);
            for (int c = 0; c < 3; c++)
                worst = fmax(worst, fabs(f->colours[i][c] - light[c] * image_at(&image, u, v, c)));
            checked++;
        }
        FIGURE("colour image, shading %s: at most %.2f of 255 off (bound 4), %d pixels",
               shading ? "own" : "common", worst, checked);
        assert_true(checked > PIXELS / 2 && worst <= 4);
        clipmap_renderer.destroy(renderer);
    }
    terrain_destroy(terrain);
}

// ---- what it costs ---------------------------------------------------------

// The geometry is the same bit for bit, and without own shading there are no normal maps.
static void only_the_shaded_pass_changes(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = test_terrain(&hills);
    struct renderer *plain = create(f, terrain, &common, "n=63"), *shaded = create(f, terrain, &own, "n=63");
    float(*places)[4] = malloc(PIXELS * sizeof *places);
    assert_non_null(places);
    uint64_t seed = 15;
    for (int i = 0; i < 10; i++) {
        struct view view = any_view(terrain, &seed);
        draw_shaded(f, plain, terrain, &view, f->colours);
        draw_places(f, plain);
        memcpy(places, f->places, PIXELS * sizeof *places);
        draw_shaded(f, shaded, terrain, &view, f->other);
        draw_places(f, shaded);
        assert_memory_equal(places, f->places, PIXELS * sizeof *places);
        assert_true(largest_difference((const uint8_t(*)[4])f->colours, (const uint8_t(*)[4])f->other) > 0);
    }
    struct renderer_stats stats[2];
    clipmap_renderer.stats(plain, &stats[0]);
    clipmap_renderer.stats(shaded, &stats[1]);
    FIGURE("resident: %.2f MB without normal maps, %.2f MB with", (double)stats[0].resident_bytes / 1e6,
           (double)stats[1].resident_bytes / 1e6);
    assert_true(stats[1].resident_bytes > stats[0].resident_bytes);
    free(places);
    clipmap_renderer.destroy(plain);
    clipmap_renderer.destroy(shaded);
    terrain_destroy(terrain);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(flat_ground_is_shaded_alike),
        cmocka_unit_test(seen_from_above_it_is_the_reference),
        cmocka_unit_test(walks_are_shaded_as_a_fresh_renderer_shades),
        cmocka_unit_test(the_seam_leaves_no_trace),
        cmocka_unit_test(blended_over_the_border_of_levels),
        cmocka_unit_test(the_colour_image_lies_on_the_map),
        cmocka_unit_test(only_the_shaded_pass_changes),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
