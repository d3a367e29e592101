// GeoMipMaps as drawn: every vertex is a sample of a level of the terrain, the mesh is watertight, the
// picture does not depend on culling or on how large the cache may be, and the claim holds.
// SPDX-License-Identifier: MIT
#include "tests/unit/test_geomipmap.h"
#include "bench/error/error.h"
#include "bench/error/ridges.h"
#include "common/terrain/relief/relief_pack.h"
#include "geomipmap/geomipmap.h"
#include "tests/folder.h"
#include "tests/gpu/settings.h"

#include <string.h>

enum { WIDTH = 320, HEIGHT = 240, PIXELS = WIDTH * HEIGHT };

static const struct scene_effects effects = {.shading = SCENE_SHADING_COMMON};

struct fixture {
    struct gpu *gpu;
    struct gpu_target target;
    float *pixels;
};

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    *state = f;
    f->gpu = gpu_create(GPU_OFFSCREEN, 0, 0, "test", 0);
    if (!f->gpu || !gpu_target_init(f->gpu, &f->target, WIDTH, HEIGHT, GL_RGBA32F)) return -1;
    f->pixels = malloc(PIXELS * 4 * sizeof *f->pixels);
    return f->pixels ? 0 : -1;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    uint64_t errors = gpu_debug_errors(f->gpu);
    gpu_target_finish(&f->target);
    gpu_destroy(f->gpu);
    free(f->pixels);
    free(f);
    return errors ? -1 : 0;
}

static const struct test_map hills = {.width = 401,
                                      .height = 333,
                                      .first = {-170, -90},
                                      .spacing_m = {30, 20},
                                      .quantum_m = 0.1,
                                      .offset_m = 12,
                                      .height_m = 700,
                                      .rough = 0.5};

// settings: "tau=2 cull=off"; the rest as by default.
static struct renderer *create(const struct fixture *f, const struct terrain *terrain, const char *settings)
{
    struct renderer_desc desc = {
        .gpu = f->gpu, .terrain = terrain, .effects = &effects, .width = WIDTH, .height = HEIGHT};
    return create_with(&geomipmap_renderer, desc, settings);
}

// Above the ground of the map by `low` .. `high` metres, looking anywhere, rolled.
static struct view random_view(const struct terrain *terrain, uint64_t *seed, double low, double high)
{
    const struct terrain_info *info = terrain_info(terrain);
    const double *o = info->outline_m;
    double x = test_uniform(seed, o[0], o[2]), y = test_uniform(seed, o[1], o[3]), ground = 0;
    assert_true(terrain_truth_at(terrain, x, y, &ground, NULL));
    double above = low * pow(high / low, test_uniform(seed, 0, 1));
    const struct camera camera = {{x, y, ground * info->quantum_m + info->offset_m + above},
                                  test_uniform(seed, -4, 4),
                                  test_uniform(seed, -1.5, 0.3),
                                  test_uniform(seed, -0.5, 0.5),
                                  test_uniform(seed, 0.5, 2.2)};
    struct view view;
    view_init(&view, terrain, &camera, WIDTH, HEIGHT, 0);
    return view;
}

static void update(struct renderer *renderer, const struct view *views, int count)
{
    geomipmap_renderer.begin_frame(renderer, 0);
    assert_true(geomipmap_renderer.update(renderer, views, count));
}

static uint64_t draw_hash(struct fixture *f, struct renderer *renderer, const struct terrain *terrain,
                          const struct view *view, int index)
{
    gpu_set_view(f->gpu, terrain, view);
    gpu_target_begin(f->gpu, &f->target);
    geomipmap_renderer.draw(renderer, index, PASS_POSITION);
    gpu_target_read(f->gpu, &f->target, f->pixels);
    uint64_t hash = 0xcbf29ce484222325u; // FNV-1a over words
    for (size_t i = 0; i < PIXELS * 4; i++) {
        uint32_t word;
        memcpy(&word, &f->pixels[i], sizeof word);
        hash = (hash ^ word) * 0x100000001b3u;
    }
    return hash;
}

// ---- the captured mesh --------------------------------------------------------------------------

struct mesh {
    float (*vertices)[3];
    size_t count, room; // triangles
};

static void take_triangles(const float *triangles, size_t count, void *user)
{
    struct mesh *mesh = user;
    if (mesh->count + count > mesh->room) {
        mesh->room = 2 * (mesh->count + count);
        mesh->vertices = realloc(mesh->vertices, mesh->room * 3 * sizeof *mesh->vertices);
        assert_non_null(mesh->vertices);
    }
    memcpy(mesh->vertices + 3 * mesh->count, triangles, count * 9 * sizeof *triangles);
    mesh->count += count;
}

static struct mesh capture(struct fixture *f, struct renderer *renderer, const struct terrain *terrain,
                           const struct view *view, int index)
{
    struct mesh mesh = {0};
    gpu_set_view(f->gpu, terrain, view);
    assert_true(gpu_capture_begin(f->gpu, take_triangles, &mesh));
    geomipmap_renderer.draw(renderer, index, PASS_DEPTH);
    gpu_capture_end(f->gpu);
    return mesh;
}

// The vertex nearest to a sample, as the shared formulas place it, bit for bit: on a sample of the finest
// level, or on one of a coarser level that stands at that place.
static void check_vertex(const struct terrain *terrain, const struct view *view, const float vertex[3])
{
    const struct terrain_info *info = terrain_info(terrain);
    struct terrain_level level = terrain_level(terrain, info->finest);
    struct view_origin eye = view_level_origin(view, info->finest);
    int64_t cell[2];
    for (int axis = 0; axis < 2; axis++) {
        float spacing = (float)level.spacing_m[axis];
        cell[axis] = llround((double)vertex[axis] / level.spacing_m[axis] + (double)eye.fraction[axis]);
        assert_true(((float)cell[axis] - eye.fraction[axis]) * spacing == vertex[axis]);
        cell[axis] += eye.base[axis];
    }
    int32_t quanta, base;
    float fraction;
    bool found = false;
    view_eye_quanta(view, &base, &fraction);
    for (int l = info->finest; l <= info->coarsest && !found; l++) {
        int step = l - info->finest;
        if ((cell[0] | cell[1]) & ((INT64_C(1) << step) - 1)) break;
        terrain_window(terrain, l, cell[0] >> step, cell[1] >> step, 1, 1, &quanta, TERRAIN_WAIT);
        found = (((float)quanta - (float)base) - fraction) * (float)info->quantum_m == vertex[2];
    }
    assert_true(found);
}

static void check_vertices(const struct terrain *terrain, const struct view *view, const struct mesh *mesh)
{
    for (size_t i = 0; i < 3 * mesh->count; i++) check_vertex(terrain, view, mesh->vertices[i]);
}

struct edge {
    float from[3], to[3];
};

static int compare_edges(const void *a, const void *b)
{
    return memcmp(a, b, sizeof(struct edge));
}

// Edges without a partner that runs the other way, by comparing bits.  Those along the map's outline or
// beyond are not counted.
static size_t open_edges(const struct terrain *terrain, const struct view *view, const struct mesh *mesh)
{
    size_t count = 3 * mesh->count, open = 0;
    struct edge *forth = malloc(count * sizeof *forth), *back = malloc(count * sizeof *back);
    assert_true(forth && back);
    for (size_t i = 0; i < count; i++) {
        const float *from = mesh->vertices[i], *to = mesh->vertices[i - i % 3 + (i + 1) % 3];
        memcpy(forth[i].from, from, sizeof forth[i].from), memcpy(forth[i].to, to, sizeof forth[i].to);
        memcpy(back[i].from, to, sizeof back[i].from), memcpy(back[i].to, from, sizeof back[i].to);
    }
    qsort(forth, count, sizeof *forth, compare_edges);
    qsort(back, count, sizeof *back, compare_edges);
    const double *outline = terrain_info(terrain)->outline_m;
    for (size_t i = 0, j = 0; i < count; i++) {
        while (j < count && compare_edges(&back[j], &forth[i]) < 0) j++;
        if (j < count && compare_edges(&back[j], &forth[i]) == 0) {
            j++;
            continue;
        }
        bool border = false;
        for (int axis = 0; axis < 2; axis++) {
            double a = (double)forth[i].from[axis] + view->eye_m[axis];
            double b = (double)forth[i].to[axis] + view->eye_m[axis];
            // A vertex is a float relative to the eye: two roundings, far off more than a millimetre.
            double slack =
                1e-3 + ldexp(fmax(fabs((double)forth[i].from[axis]), fabs((double)forth[i].to[axis])), -23);
            border = border || (a <= outline[axis] + slack && b <= outline[axis] + slack) ||
                     (a >= outline[axis + 2] - slack && b >= outline[axis + 2] - slack);
        }
        open += !border;
    }
    free(forth);
    free(back);
    return open;
}

static void mesh_is_watertight_and_made_of_samples(void **state)
{
    struct fixture *f = *state;
    static const char *const settings[] = {"tau=4 cull=off",
                                           "tau=1 cull=off merge=0",
                                           "tau=2 cull=off merge=1",
                                           "tau=2 cull=off patch=33",
                                           "tau=4 cull=off patch=65",
                                           "tau=1 cull=off borders=regions",
                                           "tau=4 cull=off indices=strips",
                                           "tau=2 cull=off metric=mean patch=9 merge=4",
                                           "tau=4 cull=off heights=samples",
                                           "tau=1 cull=off heights=samples metric=mean merge=1"};
    struct terrain *terrain = test_fractal(&hills, 1);
    uint64_t seed = 2;
    size_t triangles = 0;
    for (size_t s = 0; s < sizeof settings / sizeof settings[0]; s++) {
        struct renderer *renderer = create(f, terrain, settings[s]);
        for (int k = 0; k < test_size(6, 60); k++) {
            struct view view = random_view(terrain, &seed, 2, 3000);
            update(renderer, &view, 1);
            struct mesh mesh = capture(f, renderer, terrain, &view, 0);
            struct renderer_stats stats;
            geomipmap_renderer.stats(renderer, &stats);
            assert_int_equal(mesh.count, stats.triangles);
            assert_true(isnan(stats.claimed_error_px) == (strstr(settings[s], "mean") != NULL));
            assert_int_equal(open_edges(terrain, &view, &mesh), 0);
            check_vertices(terrain, &view, &mesh);
            triangles += mesh.count;
            mesh.count--; // a missing triangle is noticed, unless it lies on the outline
            if (k == 0) {
                struct mesh torn = {mesh.vertices + 3 * (mesh.count / 2), mesh.count - mesh.count / 2, 0};
                assert_true(open_edges(terrain, &view, &torn) > 0);
            }
            free(mesh.vertices);
        }
        geomipmap_renderer.destroy(renderer);
    }
    FIGURE("%zu triangles captured, no open edge, every vertex a sample", triangles);
    terrain_destroy(terrain);
}

// Vertices that stand on no sample, in the mesh of a view.
static size_t moved_vertices(const struct terrain *terrain, const struct view *view, const struct mesh *mesh)
{
    const struct terrain_info *info = terrain_info(terrain);
    size_t moved = 0;
    int32_t base;
    float fraction;
    view_eye_quanta(view, &base, &fraction);
    for (size_t i = 0; i < 3 * mesh->count; i++) {
        double quanta = (double)mesh->vertices[i][2] / info->quantum_m + (double)fraction + base;
        moved += fabs(quanta - round(quanta)) > 0.05; // float keeps heights to a hundredth of a quantum here
    }
    return moved;
}

// Both tiles move the vertices that they share alike, to the last bit.
static void morphed_mesh_is_watertight(void **state)
{
    struct fixture *f = *state;
    static const char *const settings[] = {"tau=4 cull=off morph=on", "tau=2 cull=off morph=on merge=0",
                                           "tau=2 cull=off morph=on patch=33 merge=1",
                                           "tau=2 cull=off morph=on cache=9",
                                           "tau=2 cull=off morph=on metric=paper indices=strips"};
    struct terrain *terrain = test_fractal(&hills, 21);
    uint64_t seed = 22;
    size_t triangles = 0, moved = 0;
    for (size_t s = 0; s < sizeof settings / sizeof settings[0]; s++) {
        struct renderer *renderer = create(f, terrain, settings[s]);
        for (int k = 0; k < test_size(6, 60); k++) {
            struct view view = random_view(terrain, &seed, 2, 3000);
            update(renderer, &view, 1);
            struct mesh mesh = capture(f, renderer, terrain, &view, 0);
            assert_int_equal(open_edges(terrain, &view, &mesh), 0);
            triangles += mesh.count;
            moved += moved_vertices(terrain, &view, &mesh);
            free(mesh.vertices);
        }
        geomipmap_renderer.destroy(renderer);
    }
    FIGURE("%zu morphed triangles captured, %.1f %% of their corners moved, no open edge", triangles,
           100.0 * (double)moved / (3.0 * (double)triangles));
    assert_true(moved > 0);
    terrain_destroy(terrain);
}

// ---- pictures -----------------------------------------------------------------------------------

static void culling_leaves_the_picture_as_it_is(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = test_fractal(&hills, 3);
    uint64_t seed = 4;
    double drawn[2] = {0, 0};
    for (int merge = 0; merge <= 3; merge += 3) {
        struct renderer *on = create(f, terrain, merge ? "cull=on" : "cull=on merge=0");
        struct renderer *off = create(f, terrain, merge ? "cull=off" : "cull=off merge=0");
        for (int k = 0; k < test_size(15, 150); k++) {
            struct view view = random_view(terrain, &seed, 2, 3000);
            update(on, &view, 1);
            uint64_t culled = draw_hash(f, on, terrain, &view, 0);
            drawn[0] += counter(on, "tiles");
            update(off, &view, 1);
            assert_true(culled == draw_hash(f, off, terrain, &view, 0));
            drawn[1] += counter(off, "tiles");
        }
        geomipmap_renderer.destroy(on);
        geomipmap_renderer.destroy(off);
    }
    FIGURE("culled %.0f tiles, not culled %.0f: the same pictures", drawn[0], drawn[1]);
    assert_true(drawn[0] < drawn[1]);
    terrain_destroy(terrain);
}

static void explain(const float *triangles, size_t count, void *user)
{
    ridges_feed(user, triangles, count);
}

// Pixels where two pictures differ.  unexplained: those among them that are no ridge lines within the
// sub-pixel grid; `both` draws all faces, and drew the first picture.
static size_t count_differences(struct fixture *f, struct renderer *both, const struct terrain *terrain,
                                const struct view *view, uint8_t *const pictures[2], size_t *unexplained)
{
    struct ridges ridges = {0};
    size_t different = 0;
    draw_hash(f, both, terrain, view, 0);
    for (size_t p = 0; p < PIXELS; p++) {
        bool same = memcmp(pictures[0] + 4 * p, pictures[1] + 4 * p, 4) == 0;
        f->pixels[4 * p + 3] = same ? 1 : -1;
        different += !same;
    }
    assert_true(ridges_begin(&ridges, view, f->pixels) && gpu_capture_begin(f->gpu, explain, &ridges));
    geomipmap_renderer.draw(both, 0, PASS_DEPTH);
    gpu_capture_end(f->gpu);
    *unexplained += ridges.count;
    ridges_finish(&ridges);
    return different;
}

// Faces are left out only where no ray meets the drawn surface from below first, however wrong that is: an
// eye just above the ground may be below what is drawn.
//
// From above, the first face that a ray meets faces the eye, so a back face is nearest in a pixel only where
// the rasteriser moved it there: corners go to the nearest point of a grid of 1/256 px, and no edge moves
// farther than they do, less than TRUTH_SNAP_PX.  The face before the back one, or beside it across the fold
// that both share, then passes within TRUTH_SNAP_PX of the pixel's centre and is no farther there than what
// was drawn.  That is what bench/error/ridges asks for.  Where it holds, the picture without back faces may
// show what the front faces show; every other pixel must be the same.
static void safe_faces_leave_the_picture_as_it_is(void **state)
{
    struct fixture *f = *state;
    static const char *const settings[] = {"tau=64 metric=paper", "tau=64 metric=mean patch=9 merge=4",
                                           "tau=64 metric=paper heights=samples morph=on", "tau=1"};
    struct terrain *terrain = test_fractal(&hills, 23);
    struct gpu_target target;
    size_t bytes = (size_t)PIXELS * 4, below = 0, views = 0, folds = 0, wrong = 0, wrong_front = 0;
    uint8_t *pictures[3] = {malloc(bytes), malloc(bytes), malloc(bytes)};
    assert_true(pictures[0] && pictures[1] && pictures[2]);
    assert_true(gpu_target_init(f->gpu, &target, WIDTH, HEIGHT, GL_RGBA8));
    uint64_t seed = 24;
    for (int s = 0; s < 4; s++) {
        struct renderer *renderers[3];
        static const char *const faces[3] = {"both", "safe", "front"};
        for (int r = 0; r < 3; r++) {
            char text[96];
            snprintf(text, sizeof text, "%s faces=%s", settings[s], faces[r]);
            renderers[r] = create(f, terrain, text);
        }
        for (int k = 0; k < test_size(10, 200); k++, views++) {
            struct view view = random_view(terrain, &seed, 0.01, 30);
            for (int r = 0; r < 3; r++) {
                update(renderers[r], &view, 1);
                gpu_set_view(f->gpu, terrain, &view);
                gpu_target_begin(f->gpu, &target);
                geomipmap_renderer.draw(renderers[r], 0, PASS_SHADED);
                gpu_target_read(f->gpu, &target, pictures[r]);
            }
            if (memcmp(pictures[0], pictures[1], bytes) != 0)
                folds += count_differences(f, renderers[0], terrain, &view, pictures, &wrong);
            for (size_t p = 0; p < bytes; p++)
                assert_true(pictures[1][p] == pictures[0][p] || pictures[1][p] == pictures[2][p]);
            if (memcmp(pictures[0], pictures[2], bytes) == 0) continue;
            below++; // front alone is not enough
            uint8_t *const front[2] = {pictures[0], pictures[2]};
            count_differences(f, renderers[0], terrain, &view, front, &wrong_front);
        }
        for (int r = 0; r < 3; r++) geomipmap_renderer.destroy(renderers[r]);
    }
    FIGURE(
        "%zu views: the same pictures but for %zu pixels, all of them ridge lines within the sub-pixel grid; "
        "%zu views are others without looking where the eye is, in %zu pixels that no ridge line explains",
        views, folds, below, wrong_front);
    assert_int_equal(wrong, 0);
    assert_true(below > 0 && wrong_front > 0);
    gpu_target_finish(&target);
    for (int r = 0; r < 3; r++) free(pictures[r]);
    terrain_destroy(terrain);
}

// Case C5 as drawn: whatever the cache may hold, each view of a frame is drawn with its tiles' own heights.
static void cache_size_leaves_the_picture_as_it_is(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = test_fractal(&hills, 5);
    struct renderer *reference = create(f, terrain, "tau=2");
    uint64_t seed = 6;
    struct view views[4][2];
    uint64_t expected[4][2];
    int needed = 0;
    for (int frame = 0; frame < 4; frame++)
        for (int i = 0; i < 2; i++) {
            views[frame][i] = random_view(terrain, &seed, 20, 2000);
            update(reference, &views[frame][i], 1);
            expected[frame][i] = draw_hash(f, reference, terrain, &views[frame][i], 0);
            if (frame == 0 && i == 0) needed = (int)counter(reference, "tiles");
        }
    geomipmap_renderer.destroy(reference);
    const int limits[] = {0, 1, needed - 1, needed, needed + 1};
    for (int n = 0; n < 5; n++) {
        char settings[64];
        snprintf(settings, sizeof settings, "tau=2 cache=%d", limits[n]);
        struct renderer *renderer = create(f, terrain, settings);
        for (int pass = 0; pass < 3; pass++)
            for (int frame = 0; frame < 4; frame++) {
                update(renderer, views[frame], 2);
                for (int i = 0; i < 4; i++) // each view twice, interleaved
                    assert_true(draw_hash(f, renderer, terrain, &views[frame][i % 2], i % 2) ==
                                expected[frame][i % 2]);
            }
        for (int frame = 0; frame < 6; frame++) { // a static frame, one view
            update(renderer, &views[0][0], 1);
            gpu_reset_counters(f->gpu);
            assert_true(draw_hash(f, renderer, terrain, &views[0][0], 0) == expected[0][0]);
            if (limits[n] == 0 || limits[n] >= needed) {
                assert_true(frame == 0 || counter(renderer, "misses") == 0);
                assert_int_equal(gpu_counters(f->gpu).upload_bytes, 0); // never while drawing
            } else {
                assert_true(counter(renderer, "misses") >= needed - limits[n]);
            }
            if (limits[n]) assert_true(counter(renderer, "slots") <= limits[n]);
        }
        geomipmap_renderer.destroy(renderer);
    }
    terrain_destroy(terrain);
}

// From one place: straight down, where few tiles are seen, and ahead, where many are.
static void narrow_and_wide(const struct terrain *terrain, struct view *narrow, struct view *wide)
{
    uint64_t seed = 8;
    struct view view = random_view(terrain, &seed, 800, 900);
    const struct camera down = {{view.eye_m[0], view.eye_m[1], view.eye_m[2]}, 0, -1.5, 0, 0.1},
                        ahead = {{view.eye_m[0], view.eye_m[1], view.eye_m[2]}, 0.7, -0.5, 0, 1.5};
    view_init(narrow, terrain, &down, WIDTH, HEIGHT, 0);
    view_init(wide, terrain, &ahead, WIDTH, HEIGHT, 0);
}

// The buffer grows and shrinks with what a frame uses, and is right all the while.
static void growing_and_shrinking_keep_the_picture(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = test_fractal(&hills, 7);
    struct renderer *renderer = create(f, terrain, "tau=0.5 merge=0");
    struct view narrow, wide;
    narrow_and_wide(terrain, &narrow, &wide);
    update(renderer, &narrow, 1);
    uint64_t expected = draw_hash(f, renderer, terrain, &narrow, 0);
    update(renderer, &wide, 1);
    uint64_t expected_wide = draw_hash(f, renderer, terrain, &wide, 0);
    double most = counter(renderer, "slots"), before = most;
    struct renderer_stats largest, smallest;
    geomipmap_renderer.stats(renderer, &largest);
    for (int frame = 0; frame < 500; frame++) {
        update(renderer, &narrow, 1);
        if (frame % 25 == 0) assert_true(draw_hash(f, renderer, terrain, &narrow, 0) == expected);
        double slots = counter(renderer, "slots");
        assert_true(slots == before || slots == before - 1);
        before = slots;
    }
    geomipmap_renderer.stats(renderer, &smallest);
    FIGURE("slots %.0f, then %.0f; bytes %llu, then %llu", most, before,
           (unsigned long long)largest.resident_bytes, (unsigned long long)smallest.resident_bytes);
    assert_true(before < most / 4);
    assert_true(smallest.resident_bytes < largest.resident_bytes);
    update(renderer, &wide, 1);
    assert_true(draw_hash(f, renderer, terrain, &wide, 0) == expected_wide);
    geomipmap_renderer.destroy(renderer);
    terrain_destroy(terrain);
}

// ---- against the truth --------------------------------------------------------------------------

struct judged {
    double worst_px; // of drawn ground
    uint64_t ground, misses, spills;
    uint64_t holes; // undrawn ground farther from the sky than the claim and a pixel
};

// Is there sky within `reach` pixels?  A silhouette that is wrong by the claim leaves undrawn ground no
// farther from it; the measure calls that a hole where the silhouette runs straight up the picture, as an
// outline seen end on does.
static bool near_sky(const struct truth *truth, size_t pixel, int reach)
{
    int x = (int)(pixel % WIDTH), y = (int)(pixel / WIDTH);
    for (int j = y - reach; j <= y + reach; j++)
        for (int i = x - reach; i <= x + reach; i++)
            if (i >= 0 && j >= 0 && i < WIDTH && j < HEIGHT && !(truth->pixels[j * WIDTH + i].depth > 0))
                return true;
    return false;
}

static struct judged judge_frame(struct fixture *f, struct renderer *renderer, const struct terrain *terrain,
                                 const struct truth *truth, const struct view *view)
{
    struct frame_error error;
    assert_true(frame_error_init(&error, WIDTH, HEIGHT));
    struct places *hits = truth_places(truth, 0);
    assert_non_null(hits);
    update(renderer, view, 1);
    draw_hash(f, renderer, terrain, view, 0);
    assert_true(gpu_capture_begin(f->gpu, places_feed, hits));
    geomipmap_renderer.draw(renderer, 0, PASS_DEPTH);
    gpu_capture_end(f->gpu);
    frame_error_measure(&error, terrain, view, truth, f->pixels, hits, 0);
    struct judged judged = {.ground = error.ground, .misses = error.misses, .spills = error.spills};
    struct renderer_stats stats;
    geomipmap_renderer.stats(renderer, &stats);
    for (size_t p = 0; p < PIXELS; p++)
        if (error.kind[p] == PIXEL_HOLE && !near_sky(truth, p, (int)ceil(stats.claimed_error_px) + 1))
            judged.holes++;
    for (size_t p = 0; p < PIXELS; p++)
        if (error.kind[p] == PIXEL_GROUND && error.error_px[p] > (float)judged.worst_px)
            judged.worst_px = (double)error.error_px[p];
    places_destroy(hits);
    frame_error_finish(&error);
    return judged;
}

static void claim_holds_and_nothing_is_left_out(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = test_fractal(&hills, 9);
    struct truth_surface *surface = truth_surface_create(terrain);
    struct truth truth;
    assert_true(surface && truth_init(&truth, WIDTH, HEIGHT));
    static const double taus[] = {0.25, 0.5, 1, 2, 4, 8};
    static const char *const metrics[] = {"safe", "paper", "safe morph=on", "safe heights=samples"};
    enum { TAUS = sizeof taus / sizeof taus[0], METRICS = sizeof metrics / sizeof metrics[0] };
    struct renderer *renderers[TAUS * METRICS];
    int broken[METRICS] = {0}, frames = 0;
    uint64_t misses = 0, spills = 0, ground = 0, seed = 10;
    for (int n = 0; n < TAUS * METRICS; n++) {
        char settings[64];
        snprintf(settings, sizeof settings, "tau=%g metric=%s", taus[n / METRICS], metrics[n % METRICS]);
        renderers[n] = create(f, terrain, settings);
    }
    for (int k = 0; k < test_size(8, 80); k++) {
        struct view view = random_view(terrain, &seed, 2, 3000);
        truth_cast(&truth, surface, &view, 0);
        for (int n = 0; n < TAUS * METRICS; n++, frames++) {
            struct judged judged = judge_frame(f, renderers[n], terrain, &truth, &view);
            broken[n % METRICS] += judged.worst_px > taus[n / METRICS] + 1e-3; // the floor of the measure
            assert_int_equal(judged.holes, 0);
            if (n == 0) misses += judged.misses, spills += judged.spills, ground += judged.ground;
        }
    }
    for (int n = 0; n < TAUS * METRICS; n++) geomipmap_renderer.destroy(renderers[n]);
    FIGURE("%d frames: claim broken in %d by safe, %d by paper, %d by safe with morphing, %d by safe with "
           "samples; "
           "at tau 0.25 %.4f %% misses, %.4f %% spills",
           frames, broken[0], broken[1], broken[2], broken[3], 100.0 * (double)misses / (double)ground,
           100.0 * (double)spills / (double)ground);
    assert_int_equal(broken[0], 0);
    assert_true(broken[1] > 0);
    assert_int_equal(broken[2], 0);
    assert_int_equal(broken[3], 0);
    assert_true((double)misses <= 0.0005 * (double)ground);
    assert_true((double)spills <= 0.0005 * (double)ground);
    truth_finish(&truth);
    truth_surface_destroy(surface);
    terrain_destroy(terrain);
}

static void flat_ground_is_exact_and_cheap(void **state)
{
    struct fixture *f = *state;
    static const double heights[] = {0, 1000, 8848.8};
    for (int h = 0; h < 3; h++) {
        struct test_map map = hills;
        map.height_m = 0;
        map.offset_m = heights[h];
        struct terrain *terrain = test_fractal(&map, 1);
        struct truth_surface *surface = truth_surface_create(terrain);
        struct truth truth;
        assert_true(surface && truth_init(&truth, WIDTH, HEIGHT));
        struct renderer *renderer = create(f, terrain, "tau=0");
        uint64_t seed = 11;
        for (int k = 0; k < 5; k++) {
            struct view view = random_view(terrain, &seed, 2, 3000);
            truth_cast(&truth, surface, &view, 0);
            struct judged judged = judge_frame(f, renderer, terrain, &truth, &view);
            assert_true(judged.worst_px <= 1e-3);
            assert_int_equal(judged.holes, 0);
            // 4 x 3 tiles of 128 cells cover the map; each has 2 x 2 cells, and 14 vertices more on a side
            // at the map's edge.
            struct renderer_stats stats;
            geomipmap_renderer.stats(renderer, &stats);
            assert_true(stats.triangles <= 4 * 3 * 8 + 2 * (4 + 3) * 14);
            struct mesh mesh = capture(f, renderer, terrain, &view, 0);
            check_vertices(terrain, &view, &mesh);
            free(mesh.vertices);
        }
        geomipmap_renderer.destroy(renderer);
        truth_finish(&truth);
        truth_surface_destroy(surface);
        terrain_destroy(terrain);
    }
}

// Terrain of any height range, size and place.
static void any_terrain_is_drawn_with_its_own_heights(void **state)
{
    struct fixture *f = *state;
    struct test_map tall = hills, far_away = hills, tiny = hills, thin = hills;
    tall.quantum_m = 0.001; // tiles of more than 65,535 quanta
    far_away.first[0] = 10000000000, far_away.first[1] = -10000000000;
    tiny.width = 3, tiny.height = 2;
    thin.width = 17, thin.height = 300;
    const struct test_map maps[] = {tall, far_away, tiny, thin};
    static const int height_bytes[] = {4, 2, 2, 2};
    for (int m = 0; m < 4; m++) {
        struct terrain *terrain = test_fractal(&maps[m], 12);
        struct renderer *renderer = create(f, terrain, "tau=1");
        uint64_t seed = 13;
        for (int k = 0; k < 5; k++) {
            struct view view = random_view(terrain, &seed, 2, 300);
            update(renderer, &view, 1);
            struct mesh mesh = capture(f, renderer, terrain, &view, 0);
            check_vertices(terrain, &view, &mesh);
            free(mesh.vertices);
        }
        assert_true(counter(renderer, "height_bytes") == height_bytes[m]);
        geomipmap_renderer.destroy(renderer);
        terrain_destroy(terrain);
    }
}

// Heights take 4 bytes from the first tile on that needs them, and the tiles that are there stay what they
// are.
static void heights_are_widened_when_a_tile_needs_it(void **state)
{
    struct fixture *f = *state;
    struct test_map tall = hills;
    tall.quantum_m = 0.001;
    struct terrain *terrain = test_fractal(&tall, 12);
    struct renderer *renderer = create(f, terrain, "tau=0.5 merge=0 patch=9");
    struct view narrow, wide;
    narrow_and_wide(terrain, &narrow, &wide);
    update(renderer, &narrow, 1);
    assert_true(counter(renderer, "height_bytes") == 2);
    uint64_t expected = draw_hash(f, renderer, terrain, &narrow, 0);
    update(renderer, &wide, 1);
    assert_true(counter(renderer, "height_bytes") == 4);
    struct mesh mesh = capture(f, renderer, terrain, &wide, 0);
    check_vertices(terrain, &wide, &mesh);
    free(mesh.vertices);
    update(renderer, &narrow, 1);
    assert_true(draw_hash(f, renderer, terrain, &narrow, 0) == expected);
    geomipmap_renderer.destroy(renderer);
    terrain_destroy(terrain);
}

// The paper's figure, less than 2.5 bytes a sample for all but the terrain itself: tiles, index sets, lists
// and the heights of every tile in use.
static void tiles_fit_the_bytes_a_sample_of_the_paper(void **state)
{
    struct fixture *f = *state;
    struct test_map square = hills;
    square.width = square.height = 2049;
    struct terrain *terrain = test_fractal(&square, 16);
    static const char *const settings[] = {"tau=1", "tau=1 merge=0", "tau=1 morph=on hysteresis=0.1"};
    const double *o = terrain_info(terrain)->outline_m;
    uint64_t seed = 17;
    for (int s = 0; s < 3; s++) {
        struct renderer *renderer = create(f, terrain, settings[s]);
        double most = 0;
        for (int k = 0; k < test_size(10, 100); k++) {
            struct view view = random_view(terrain, &seed, 2, 3000);
            update(renderer, &view, 1);
            most = fmax(most, counter(renderer, "tile_bytes_a_sample"));
        }
        double with_terrain = counter(renderer, "bytes_a_sample");
        const struct camera above = {
            {0.5 * (o[0] + o[2]), 0.5 * (o[1] + o[3]), o[2] - o[0]}, 0, -M_PI / 2, 0, 1};
        struct view map;
        view_init(&map, terrain, &above, WIDTH, HEIGHT, 0);
        update(renderer, &map, 1);
        FIGURE(
            "%s: at most %.3f bytes a sample, %.2f with the terrain in memory; %.3f when the whole map, %.0f "
            "tiles, is in view",
            settings[s], most, with_terrain, counter(renderer, "tile_bytes_a_sample"),
            counter(renderer, "tiles"));
        assert_true(most < 2.5);
        geomipmap_renderer.destroy(renderer);
    }
    terrain_destroy(terrain);
}

// ---- terrain on disk ----------------------------------------------------------------------------

// The fractal as a file, read on demand: few samples a frame, so that tiles are late for many; with finer
// levels, none.
static struct terrain *on_disk(int side, uint64_t seed, int finer)
{
    struct test_map map = hills;
    map.width = side, map.height = side - 70;
    map.first[0] = map.first[1] = 0;
    struct terrain *made = test_fractal(&map, seed);
    struct heightfield field = {.name = "hills",
                                .width = map.width,
                                .height = map.height,
                                .spacing_m = {map.spacing_m[0], map.spacing_m[1]},
                                .quantum_m = map.quantum_m,
                                .offset_m = map.offset_m,
                                .samples = malloc((size_t)map.width * (size_t)map.height * sizeof(int32_t))};
    struct relief_pack_options options = {.layout = LAYOUT_BOUNDED, .max_m = 1};
    struct relief_header header;
    terrain_window(made, 0, 0, 0, map.width, map.height, field.samples, TERRAIN_WAIT);
    assert_int_equal(folder_create(NULL), 0);
    assert_true(relief_pack(&field, &options, in_folder("hills.relief"), &header));
    heightfield_finish(&field);
    terrain_destroy(made);
    struct terrain_options how = {.frame_samples = finer ? -1 : 1 << 15, .synthesize_levels = finer};
    struct terrain *terrain = terrain_load(in_folder("hills.relief"), &how);
    assert_non_null(terrain);
    return terrain;
}

static struct view flown_view(const struct terrain *terrain, int frame)
{
    const double *o = terrain_info(terrain)->outline_m;
    const struct camera camera = {
        {o[0] + 0.1 * (o[2] - o[0]) + 150 * frame, 0.5 * (o[1] + o[3]), 900}, 0.3 + 0.02 * frame, -0.4, 0, 1};
    struct view view;
    view_init(&view, terrain, &camera, WIDTH, HEIGHT, 0);
    return view;
}

// Late tiles are coarser, never open; at rest all is there, the same however the eye came.
static void late_tiles_leave_no_crack(void **state)
{
    struct fixture *f = *state;
    static const char *const settings[] = {"tau=1 cull=off", "tau=0.5 cull=off patch=9 merge=4 metric=mean",
                                           "tau=1 cull=off merge=0"};
    struct terrain *terrain = on_disk(test_size(1025, 2049), 31, 0);
    int frames = test_size(12, 60), all_late = 0;
    for (int s = 0; s < 3; s++) {
        struct renderer *flown = create(f, terrain, settings[s]), *fresh = create(f, terrain, settings[s]);
        int late_frames = 0, frame = 0;
        struct renderer_stats stats;
        for (; frame < frames; frame++) {
            struct view view = flown_view(terrain, frame);
            geomipmap_renderer.begin_frame(flown, frame);
            assert_true(geomipmap_renderer.update(flown, &view, 1));
            struct mesh mesh = capture(f, flown, terrain, &view, 0);
            assert_int_equal(open_edges(terrain, &view, &mesh), 0);
            check_vertices(terrain, &view, &mesh);
            free(mesh.vertices);
            geomipmap_renderer.stats(flown, &stats);
            bool late = counter(flown, "late") > 0;
            late_frames += late;
            if (late) assert_true(isnan(stats.claimed_error_px)); // nothing is promised
        }
        struct view view = flown_view(terrain, frame - 1);
        struct renderer *both[2] = {flown, fresh};
        uint64_t hashes[2];
        for (int r = 0; r < 2; r++) {
            for (int n = 0; n == 0 || (counter(both[r], "late") > 0 && n < 400); n++) {
                geomipmap_renderer.begin_frame(both[r], frame + n);
                assert_true(geomipmap_renderer.update(both[r], &view, 1));
            }
            assert_true(counter(both[r], "late") == 0);
            hashes[r] = draw_hash(f, both[r], terrain, &view, 0);
        }
        assert_true(hashes[0] == hashes[1]);
        FIGURE("%s: tiles late in %d of %d frames, no open edge; at rest the same picture", settings[s],
               late_frames, frames);
        all_late += late_frames;
        geomipmap_renderer.destroy(flown);
        geomipmap_renderer.destroy(fresh);
    }
    assert_true(all_late > 0);
    terrain_destroy(terrain);
    folder_remove(NULL);
}

// Over made-up levels of a large file the errors of blocks from coarser levels are estimates.
static void estimates_claim_nothing(void **state)
{
    struct fixture *f = *state;
    for (int finer = 0; finer <= 2; finer += 2) {
        struct terrain *terrain = on_disk(385, 33, finer);
        struct renderer *renderer = create(f, terrain, "tau=1");
        struct view view = flown_view(terrain, 0);
        struct renderer_stats stats;
        for (int frame = 0; frame == 0 || (counter(renderer, "late") > 0 && frame < 400); frame++) {
            geomipmap_renderer.begin_frame(renderer, frame);
            assert_true(geomipmap_renderer.update(renderer, &view, 1));
        }
        geomipmap_renderer.stats(renderer, &stats);
        if (finer)
            assert_true(isnan(stats.claimed_error_px));
        else
            assert_true(stats.claimed_error_px == 1);
        geomipmap_renderer.destroy(renderer);
        terrain_destroy(terrain);
        folder_remove(NULL);
    }
}

// ---- blocks from coarser levels -----------------------------------------------------------------

struct ground { // the whole finest level
    const struct terrain *terrain;
    struct terrain_level level;
    int width, height;
    int32_t *samples;
};

static struct ground read_ground(const struct terrain *terrain)
{
    struct ground g = {.terrain = terrain, .level = terrain_level(terrain, terrain_info(terrain)->finest)};
    g.width = (int)(g.level.extent.x1 - g.level.extent.x0);
    g.height = (int)(g.level.extent.y1 - g.level.extent.y0);
    g.samples = malloc((size_t)g.width * (size_t)g.height * sizeof *g.samples);
    assert_non_null(g.samples);
    terrain_window(terrain, terrain_info(terrain)->finest, g.level.extent.x0, g.level.extent.y0, g.width,
                   g.height, g.samples, TERRAIN_WAIT);
    return g;
}

static bool in_window(const struct view *view, const double relative[3])
{
    double pixel[2];
    return view_project(view, relative, pixel) && pixel[0] >= 0 && pixel[1] >= 0 && pixel[0] <= view->width &&
           pixel[1] <= view->height;
}

// Largest error on the screen at the samples under one drawn triangle, where either surface is seen.
static double triangle_error(const struct ground *g, const struct view *view, float (*v)[3])
{
    const struct terrain_info *info = terrain_info(g->terrain);
    double x[3], y[3], low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY}, worst = 0;
    for (int k = 0; k < 3; k++) { // in samples
        x[k] = round(((double)v[k][0] + view->eye_m[0]) / g->level.spacing_m[0]) - (double)g->level.extent.x0;
        y[k] = round(((double)v[k][1] + view->eye_m[1]) / g->level.spacing_m[1]) - (double)g->level.extent.y0;
        low[0] = fmin(low[0], x[k]), high[0] = fmax(high[0], x[k]);
        low[1] = fmin(low[1], y[k]), high[1] = fmax(high[1], y[k]);
    }
    double area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0]);
    for (int j = (int)fmax(low[1], 0); j <= high[1] && j < g->height; j++)
        for (int i = (int)fmax(low[0], 0); i <= high[0] && i < g->width; i++) {
            double b = ((i - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (j - y[0])) / area;
            double c = ((x[1] - x[0]) * (j - y[0]) - (i - x[0]) * (y[1] - y[0])) / area;
            if (b < 0 || c < 0 || b + c > 1) continue;
            double east = (double)(g->level.extent.x0 + i) * g->level.spacing_m[0] - view->eye_m[0];
            double north = (double)(g->level.extent.y0 + j) * g->level.spacing_m[1] - view->eye_m[1];
            double truth = g->samples[(size_t)j * (size_t)g->width + (size_t)i] * info->quantum_m +
                           info->offset_m - view->eye_m[2];
            double drawn = (1 - b - c) * (double)v[0][2] + b * (double)v[1][2] + c * (double)v[2][2], length;
            if (!in_window(view, (double[3]){east, north, truth}) &&
                !in_window(view, (double[3]){east, north, drawn}))
                continue;
            view_project_vertical(view, east, north, truth, drawn, &length);
            worst = fmax(worst, length);
        }
    return worst;
}

// Whether a triangle is larger than any of tiles of height 0: 2^coarsest samples.
static bool from_a_block(const struct ground *g, float (*v)[3], int coarsest)
{
    double longest = 0;
    for (int k = 0; k < 3; k++) longest = fmax(longest, fabs((double)v[k][0] - (double)v[(k + 1) % 3][0]));
    return longest > 1.5 * ldexp(g->level.spacing_m[0], coarsest);
}

// Blocks above those that are measured are bounded by what the file carries of its levels: beside each other
// and beside measured tiles they leave no crack, and the claim holds against the finest level.
static void blocks_of_coarser_levels_keep_the_claim(void **state)
{
    struct fixture *f = *state;
    static const char *const settings[] = {"patch=9 merge=0 cull=off", "patch=9 merge=1 cull=off",
                                           "patch=17 merge=0 cull=off borders=regions"};
    static const int coarsest[] = {2, 3, 3};
    struct terrain *terrain = on_disk(test_size(513, 2049), 41, 0);
    struct ground ground = read_ground(terrain);
    uint64_t seed = 42;
    for (int s = 0; s < 3; s++) {
        size_t triangles = 0, blocks = 0;
        double tightness = 0, most = 0;
        int views = test_size(4, 60), broken = 0;
        for (int k = 0; k < views; k++) {
            char text[96];
            double tau = 0.25 * (1 << k % 6);
            snprintf(text, sizeof text, "%s tau=%g", settings[s], tau);
            struct renderer *renderer = create(f, terrain, text);
            struct view view = random_view(terrain, &seed, 2, 20000);
            for (int frame = 0; frame == 0 || (counter(renderer, "late") > 0 && frame < 400); frame++) {
                geomipmap_renderer.begin_frame(renderer, frame);
                assert_true(geomipmap_renderer.update(renderer, &view, 1));
            }
            struct renderer_stats stats;
            geomipmap_renderer.stats(renderer, &stats);
            assert_true(stats.claimed_error_px == tau);
            struct mesh mesh = capture(f, renderer, terrain, &view, 0);
            assert_int_equal(open_edges(terrain, &view, &mesh), 0);
            double worst = 0;
            for (size_t i = 0; i < mesh.count; i++) {
                worst = fmax(worst, triangle_error(&ground, &view, mesh.vertices + 3 * i));
                blocks += from_a_block(&ground, mesh.vertices + 3 * i, coarsest[s]);
            }
            // Vertices are floats relative to the eye: that is the claim's slack.
            broken += worst > tau + 0.002;
            tightness += worst / tau / views;
            most = fmax(most, worst / tau);
            triangles += mesh.count;
            free(mesh.vertices);
            geomipmap_renderer.destroy(renderer);
        }
        FIGURE("%s: %zu triangles, %zu of them of blocks above height 0, no open edge; claim broken in %d of "
               "%d views, worst error %.2f of tau on average, at most %.2f",
               settings[s], triangles, blocks, broken, views, tightness, most);
        assert_int_equal(broken, 0);
        assert_true(blocks > 0 && most > 0);
    }
    free(ground.samples);
    terrain_destroy(terrain);
    folder_remove(NULL);
}

// Cameras that nothing flies with on purpose (E11): every one selects, draws samples of the terrain and
// leaves no GL error.
static void any_camera_is_drawn(void **state)
{
    struct fixture *f = *state;
    static const double pitches[] = {-M_PI / 2, -1.2, 0, M_PI / 2}, rolls[] = {0, M_PI / 2, M_PI};
    static const double fovs[] = {1, 60, 170}, lifts[] = {-400, 0, 5, 1e5};
    static const int windows[][2] = {{320, 240}, {1, 1}, {1, 480}, {640, 1}};
    static const double steps_aside_m[] = {0, 1e4, 1e8};
    struct terrain *terrain = test_fractal(&hills, 14);
    const struct terrain_info *info = terrain_info(terrain);
    static const char *const settings[] = {"tau=1", "tau=4 metric=paper delta=published merge=0",
                                           "tau=0 metric=depth cache=7 faces=front",
                                           "tau=2 borders=remove indices=strips heights=samples",
                                           "tau=2 borders=regions indices=strips cache=3"};
    uint64_t seed = 15, drawn = 0;
    int cameras = 0;
    for (int s = 0; s < 5; s++) {
        struct renderer *renderer = create(f, terrain, settings[s]);
        for (int k = 0; k < test_size(60, 600); k++, cameras++) {
            uint64_t n = test_random(&seed);
            double x = test_uniform(&seed, info->outline_m[0], info->outline_m[2]), ground = 0;
            double y = test_uniform(&seed, info->outline_m[1], info->outline_m[3]);
            assert_true(terrain_truth_at(terrain, x, y, &ground, NULL));
            const struct camera camera = {
                {x + steps_aside_m[n % 3], y, ground * info->quantum_m + info->offset_m + lifts[n / 3 % 4]},
                test_uniform(&seed, -4, 4),
                pitches[n / 12 % 4],
                rolls[n / 48 % 3],
                fovs[n / 144 % 3] * M_PI / 180};
            struct view view;
            view_init(&view, terrain, &camera, windows[n / 432 % 4][0], windows[n / 432 % 4][1], 0);
            update(renderer, &view, 1);
            draw_hash(f, renderer, terrain, &view, 0);
            struct mesh mesh = capture(f, renderer, terrain, &view, 0);
            struct renderer_stats stats;
            geomipmap_renderer.stats(renderer, &stats);
            assert_int_equal(mesh.count, stats.triangles);
            if (steps_aside_m[n % 3] < 1e6) check_vertices(terrain, &view, &mesh);
            drawn += mesh.count;
            free(mesh.vertices);
        }
        geomipmap_renderer.destroy(renderer);
    }
    FIGURE("%d cameras, %llu triangles", cameras, (unsigned long long)drawn);
    assert_true(drawn > 0);
    terrain_destroy(terrain);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(mesh_is_watertight_and_made_of_samples),
        cmocka_unit_test(morphed_mesh_is_watertight),
        cmocka_unit_test(culling_leaves_the_picture_as_it_is),
        cmocka_unit_test(safe_faces_leave_the_picture_as_it_is),
        cmocka_unit_test(cache_size_leaves_the_picture_as_it_is),
        cmocka_unit_test(growing_and_shrinking_keep_the_picture),
        cmocka_unit_test(claim_holds_and_nothing_is_left_out),
        cmocka_unit_test(flat_ground_is_exact_and_cheap),
        cmocka_unit_test(any_terrain_is_drawn_with_its_own_heights),
        cmocka_unit_test(heights_are_widened_when_a_tile_needs_it),
        cmocka_unit_test(tiles_fit_the_bytes_a_sample_of_the_paper),
        cmocka_unit_test(late_tiles_leave_no_crack),
        cmocka_unit_test(estimates_claim_nothing),
        cmocka_unit_test(blocks_of_coarser_levels_keep_the_claim),
        cmocka_unit_test(any_camera_is_drawn),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
