// Livny et al. 2008: grid sizes (Table 1), steps (2), extension (3), distortion (4), screen-space error (5,
// 6), texture updates (7) and culled samples (section 6.3). SPDX-License-Identifier: MIT
#include "pgm/pgm.h"
#include "bench/papers/meter.h"
#include "bench/papers/papers.h"
#include "common/report.h"
#include "pgm/pgm_atlas.h"
#include "pgm/pgm_sampler.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const double degree = 0.017453292519943295;

static const struct grid {
    const char *name;
    double triangles_k, one, two, many; // Table 1: frames/s
    double max_px[2], mean_px[2];       // Table 5: of 640 x 480, of 1024 x 768
    double apart_px[2];                 // Table 4
} grids[] = {{"150x600", 180, 226, 177, 83, {6.0, 9.1}, {2.3, 3.4}, {3.9, 6.2}},
             {"200x800", 320, 133, 119, 56, {5.3, 8.1}, {2.1, 3.0}, {3.8, 6.0}},
             {"430x430", 370, 120, 112, 54, {5.9, 9.0}, {2.2, 3.4}, {1.9, 3.0}},
             {"300x900", 540, 81, 78, 37, {4.2, 6.2}, {1.0, 1.5}, {2.2, 3.5}},
             {"600x600", 720, 59, 59, 25, {4.9, 7.0}, {1.6, 2.3}, {1.2, 2.0}},
             {"400x1600", 1280, 35, 35, 16, {3.4, 5.3}, {0.3, 0.5}, {1.0, 1.6}}};
enum { GRIDS = sizeof grids / sizeof grids[0], FRAMES = 8, ERROR_FRAMES = 4 };

static const char *const windows[2] = {"640 x 480", "1024 x 768"};
static const int window_sizes[2][2] = {{640, 480}, {1024, 768}};

// The scene with this shading: the paper's fragments fetch.  It borrows everything.
static struct scene shaded_scene(const struct scene *scene, enum scene_shading shading)
{
    struct scene shaded = *scene;
    shaded.effects.shading = shading;
    return shaded;
}

static void name_table(struct papers_table *table, const char *title, const char *row_name)
{
    snprintf(table->title, sizeof table->title, "%s", title);
    snprintf(table->row_name, sizeof table->row_name, "%s", row_name);
}

// ---- Table 1: frame rates ----------------------------------------------------------------------

bool papers_pgm_rates(struct papers *papers, struct papers_table *table)
{
    struct scene *scene = papers_detailed_scene(papers);
    if (!scene) return false;
    struct scene own = shaded_scene(scene, SCENE_SHADING_OWN);
    name_table(table, "Frames a second by grid size and fetches a fragment", "grid");
    for (int c = 0; c < 6; c++) {
        static const char *const names[] = {"one fetch", "two fetches", "many textures"};
        papers_column(table, names[c / 2], "1/s", c % 2 == 0);
    }
    papers_column(table, "many / atlas", "times", true);
    papers_column(table, "many / atlas", "times", false);
    for (int g = 0; g < GRIDS; g++) {
        enum { ONE, TWO, MANY, FORMS };
        struct papers_flight forms[FORMS] = {
            [ONE] = {.type = &pgm_renderer, .knobs = {"grid", grids[g].name, "fragment", "one"}},
            [TWO] = {.type = &pgm_renderer, .knobs = {"grid", grids[g].name, "fragment", "two"}},
            [MANY] = {.type = &pgm_renderer, .knobs = {"grid", grids[g].name, "textures", "many"}}};
        if (!papers_fly(papers, &own, FRAMES, forms, FORMS)) return false;
        double *values = papers_row(table, "%s (%.0f k)", grids[g].name, grids[g].triangles_k);
        const double rates[] = {grids[g].one,
                                1000 / forms[ONE].frame_ms,
                                grids[g].two,
                                1000 / forms[TWO].frame_ms,
                                grids[g].many,
                                1000 / forms[MANY].frame_ms,
                                grids[g].two / grids[g].many,
                                forms[MANY].frame_ms / forms[TWO].frame_ms};
        memcpy(values, rates, sizeof rates);
    }
    papers_note(table,
                "Printed: NVIDIA GeForce 7800 GTX. Here the built-in terrain, %d x %d pixels, %s, shading of "
                "its own, the defaults of the renderer but for the grid. A fragment's fetch brings four "
                "words of shading of the level, the second those of its parent; the many textures are of "
                "heights and of shading, two fetches, as the last columns' atlas, which compare times.",
                papers->width, papers->height, gpu_info(papers->gpu)->renderer);
    return true;
}

// ---- Table 2: steps ----------------------------------------------------------------------------

static void add_steps(struct papers_table *table, const char *stage, const char *const *labels,
                      const double *printed_ms, const double *printed_share, const double *ms, int count)
{
    double sum = 0, printed_sum = 0;
    for (int i = 0; i < count; i++) sum += ms[i], printed_sum += printed_ms[i];
    for (int i = 0; i <= count; i++) {
        double *values = papers_row(table, "%s: %s", stage, i < count ? labels[i] : "all");
        values[0] = i < count ? printed_ms[i] : printed_sum;
        values[1] = i < count ? ms[i] : sum;
        values[2] = i < count ? printed_share[i] : 100;
        values[3] = 100 * (i < count ? ms[i] : sum) / sum;
    }
}

bool papers_pgm_steps(struct papers *papers, struct papers_table *table)
{
    struct scene *scene = papers_detailed_scene(papers);
    if (!scene) return false;
    struct scene own = shaded_scene(scene, SCENE_SHADING_OWN);
    enum { PLAIN, PACKED, NEAREST, BARE, FRAGMENT_NONE = 0, FRAGMENT_NEAREST, FRAGMENT_BLENDED, FORMS = 4 };
    struct papers_flight vertex[FORMS], fragment[FORMS - 1];
    static const char *const vertex_forms[FORMS][4] = {{"filter", "bilinear", "fetch", "plain"},
                                                       {"filter", "bilinear", "fetch", "packed"},
                                                       {"filter", "nearest", "fetch", "packed"},
                                                       {"fragment", "none"}};
    static const char *const fragment_forms[FORMS - 1][4] = {
        {"fragment", "none"}, {"fragment", "two", "words", "nearest"}, {"fragment", "two"}};
    for (int i = 0; i < FORMS; i++) {
        const char *const *v = vertex_forms[i], *const *f = fragment_forms[i < FORMS - 1 ? i : 0];
        vertex[i] = (struct papers_flight){.type = &pgm_renderer,
                                           .knobs = {"rows", "450", "aspect", "1", v[0], v[1], v[2], v[3]}};
        if (i == FORMS - 1) break;
        fragment[i] = (struct papers_flight){.type = &pgm_renderer,
                                             .knobs = {"rows", "450", "aspect", "1", f[0], f[1], f[2], f[3]}};
    }
    glEnable(GL_RASTERIZER_DISCARD); // vertices alone: another filter makes other triangles
    bool good = papers_fly(papers, &own, FRAMES, vertex, FORMS);
    glDisable(GL_RASTERIZER_DISCARD);
    if (!good || !papers_fly(papers, &own, FRAMES, fragment, FORMS - 1)) return false;
    name_table(table, "Times of the steps of a frame, 450 x 450, two fetches a fragment", "step");
    for (int c = 0; c < 4; c++)
        papers_column(table, c < 2 ? "time" : "share", c < 2 ? "ms" : "%", c % 2 == 0);
    add_steps(
        table, "vertices",
        (const char *const[]){"computations, and one fetch", "fetches (seven of eight)", "interpolations"},
        (const double[]){2.56, 2.30, 2.05}, (const double[]){37, 33, 30},
        (const double[]){vertex[NEAREST].draw_ms, vertex[PLAIN].draw_ms - vertex[PACKED].draw_ms,
                         vertex[PACKED].draw_ms - vertex[NEAREST].draw_ms},
        3);
    add_steps(table, "fragments", (const char *const[]){"computations", "fetches (two)", "interpolations"},
              (const double[]){0.16, 0.66, 3.16}, (const double[]){6, 21, 73},
              (const double[]){fragment[FRAGMENT_NONE].draw_ms - vertex[BARE].draw_ms,
                               fragment[FRAGMENT_NEAREST].draw_ms - fragment[FRAGMENT_NONE].draw_ms,
                               fragment[FRAGMENT_BLENDED].draw_ms - fragment[FRAGMENT_NEAREST].draw_ms},
              3);
    papers_note(
        table,
        "Vertices: with the rasteriser off, one packed fetch of the nearest sample, then what the "
        "blend of all eight and what eight fetches add. Fragments: whole frames whose fragments find "
        "their cells but fetch nothing, less the same with the rasteriser off (setting up triangles, "
        "filling and lighting are in it); then what two fetches of the nearest word, and what blending "
        "the four words of each and the two levels, add. A step below zero is too short for the "
        "differences of this machine's times.");
    papers_note(table,
                "Printed shares: the fragment column's 6, 21 and 73 %% should read 4, 17 and 79 %% of its "
                "3.98 ms.");
    return true;
}

// ---- Table 3: extension ------------------------------------------------------------------------

bool papers_pgm_extension(struct papers *papers, struct papers_table *table)
{
    static const double ratios[4] = {1, 0.8, 0.5, 0.2};
    static const struct {
        double angle, printed[4];
    } rows[] = {{30, {37, 28, 16, 8}},
                {40, {20, 16, 9, 4}},
                {45, {15, 10, 7, 3}},
                {50, {10, 8, 5, 2}},
                {60, {0, 0, 0, 0}}};
    const double field = 60 * degree, half_pi = 90 * degree;
    (void)papers;
    name_table(table, "Extension of the viewport by view angle and highest terrain / camera height",
               "view angle");
    for (int c = 0; c < 8; c++) {
        char name[32];
        snprintf(name, sizeof name, "%.1f", ratios[c / 2]);
        papers_column(table, name, "%", c % 2 == 0);
    }
    for (int plane = 0; plane < 2; plane++)
        for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
            double *values =
                papers_row(table, "%.0f degrees, of the %s", rows[i].angle, plane ? "image plane" : "angle");
            double lower = rows[i].angle * degree + field / 2; // of the window, below the horizon
            double distance = lower < half_pi - 1e-9 ? 1 / tan(lower) : 0;
            for (int r = 0; r < 4; r++) {
                double gamma = pgm_extension_stable(1, distance, ratios[r]);
                double share =
                    plane ? (tan(field / 2 + gamma) - tan(field / 2)) / (2 * tan(field / 2)) : gamma / field;
                values[2 * r] = rows[i].printed[r];
                values[2 * r + 1] = 100 * share;
            }
        }
    papers_note(table,
                "Computed from Equation 3, in percent of the angle of view (60 degrees) and of the image "
                "plane's height. The printed table follows from neither: its first row, below 30 degrees, "
                "is nearly the image plane's at 45. From 60 degrees on both are 0.");
    return true;
}

// ---- screen-space error ------------------------------------------------------------------------

struct tally { // over views
    double largest_px, sum_px;
    uint64_t samples;
};

static void gather(const struct frame_error *error, struct tally *tally)
{
    for (size_t p = 0; p < (size_t)error->width * (size_t)error->height; p++) {
        if (error->kind[p] != PIXEL_GROUND || isnan(error->error_px[p])) continue;
        tally->largest_px = fmax(tally->largest_px, (double)error->error_px[p]);
        tally->sum_px += (double)error->error_px[p];
        tally->samples++;
    }
}

static bool measure_view(struct papers_meter *meter, struct renderer *renderer, const struct view *view,
                         struct tally *tally)
{
    truth_cast(&meter->truth, meter->surface, view, 0);
    struct places *hits = truth_places(&meter->truth, 0);
    if (!hits) return false;
    renderer->type->begin_frame(renderer, 0);
    bool good = papers_meter_draw(meter, renderer, view, hits);
    if (good) papers_meter_measure(meter, view, hits);
    places_destroy(hits);
    if (good) gather(&meter->error, tally);
    return good;
}

// The paper's choices in their right forms.
static struct renderer *create_grid(const struct papers *papers, const struct scene *scene, const char *grid,
                                    const char *extension, const char *strips)
{
    const char *const knobs[][2] = {{"law", "uniform"}, {"extension", extension}, {"lod", "ceil"},
                                    {"spread", "far"},  {"filter", "bilinear"},   {"strips", strips}};
    struct renderer_desc desc = {.gpu = papers->gpu,
                                 .terrain = scene->terrain,
                                 .effects = &scene->effects,
                                 .width = window_sizes[1][0],
                                 .height = window_sizes[1][1]};
    renderer_default_knobs(&pgm_renderer, desc.knobs);
    if (!renderer_parse_knob(&pgm_renderer, "grid", grid, desc.knobs)) return NULL;
    for (size_t k = 0; k < sizeof knobs / sizeof knobs[0]; k++)
        if (!renderer_parse_knob(&pgm_renderer, knobs[k][0], knobs[k][1], desc.knobs)) return NULL;
    // cppcheck-suppress returnDanglingLifetime ; the description is copied
    return pgm_renderer.create(&desc);
}

// The Cascades, 60 degrees high; NULL without the data (table->skipped) or after one line on stderr.
static struct scene *puget_scene(struct papers *papers, struct papers_table *table)
{
    char path[1024];
    if (!papers_data(table, "puget_cascades_72m_2049x2817.png", path)) return NULL;
    struct scene *scene = papers_scene(papers, terrain_load(path, NULL));
    if (!scene) return NULL;
    scene->fov_vertical = 60 * degree;
    scene->effects.shading = SCENE_SHADING_COMMON;
    return scene;
}

typedef bool measure_fn(struct papers *papers, const struct scene *scene, const struct grid *grid, int window,
                        double cells[4]);

// A row a grid, four cells a window.
static bool measure_grids(struct papers *papers, struct papers_table *table, measure_fn *measure)
{
    struct scene *scene = puget_scene(papers, table);
    if (!scene) return table->skipped[0] != 0;
    bool good = true;
    for (int g = 0; g < GRIDS && good; g++) {
        double *values = papers_row(table, "%s", grids[g].name);
        for (int window = 0; window < 2 && good; window++)
            good = measure(papers, scene, &grids[g], window, values + (ptrdiff_t)4 * window);
    }
    scene_destroy(scene);
    return good;
}

static bool measure_path(struct papers *papers, const struct scene *scene, const struct grid *grid,
                         int window, double cells[4])
{
    struct scene sized = *scene;
    sized.width = window_sizes[window][0], sized.height = window_sizes[window][1];
    struct papers_meter meter;
    struct tally tally = {.samples = 0};
    struct renderer *renderer = create_grid(papers, &sized, grid->name, "stable", "off");
    bool good = papers_meter_init(&meter, papers, &sized) && renderer;
    for (int frame = 0; frame < ERROR_FRAMES && good; frame++) {
        struct view view;
        scene_view(&sized, frame, ERROR_FRAMES, &view);
        good = measure_view(&meter, renderer, &view, &tally);
    }
    cells[0] = grid->max_px[window];
    cells[1] = tally.largest_px;
    cells[2] = grid->mean_px[window];
    cells[3] = tally.samples ? tally.sum_px / (double)tally.samples : (double)NAN;
    pgm_renderer.destroy(renderer);
    papers_meter_finish(&meter);
    return good;
}

static void error_notes(struct papers_table *table)
{
    papers_note(table,
                "Printed: Puget Sound at 10 m, the height difference of sampled vertices alone. Here: the "
                "same ground at 72 m, every ground pixel from both sides (reports/README.md), skipped "
                "ridges included, so maxima are larger. The grid is the paper's with its equations put "
                "right: uniform rows, stable extension, levels rounded up, bilinear, parent blended.");
}

bool papers_pgm_error(struct papers *papers, struct papers_table *table)
{
    name_table(table, "Screen-space error by grid size, Puget Sound", "grid");
    for (int c = 0; c < 8; c++) {
        char name[32];
        snprintf(name, sizeof name, "%s, %s", c % 4 < 2 ? "max" : "mean", c < 4 ? "640" : "1024");
        papers_column(table, name, "px", c % 2 == 0);
    }
    bool good = measure_grids(papers, table, measure_path);
    if (table->skipped[0]) return good;
    error_notes(table);
    papers_note(table, "Windows of %s and %s pixels, %d frames.", windows[0], windows[1], ERROR_FRAMES);
    return good;
}

// ---- Table 4: distortion -----------------------------------------------------------------------

enum { BIN_PX = 8 };

struct lattice { // points of the window, pixels
    float (*points)[2];
    size_t count, most;
    int across, down;
    size_t *starts, *order; // of the bins; points by bin
};

static size_t bin_of(const struct lattice *lattice, const float point[2])
{
    int x = (int)point[0] / BIN_PX, y = (int)point[1] / BIN_PX;
    return (size_t)y * (size_t)lattice->across + (size_t)x;
}

static bool lattice_init(struct lattice *lattice, size_t most, const struct view *view)
{
    *lattice =
        (struct lattice){.most = most, .across = view->width / BIN_PX + 1, .down = view->height / BIN_PX + 1};
    size_t bins = (size_t)lattice->across * (size_t)lattice->down;
    lattice->points = malloc(most * sizeof *lattice->points);
    lattice->starts = calloc(bins + 1, sizeof *lattice->starts);
    lattice->order = malloc(most * sizeof *lattice->order);
    return (lattice->points && lattice->starts && lattice->order) || fail("papers: out of memory");
}

static void lattice_finish(struct lattice *lattice)
{
    free(lattice->points);
    free(lattice->starts);
    free(lattice->order);
}

static void lattice_sort(struct lattice *lattice)
{
    size_t bins = (size_t)lattice->across * (size_t)lattice->down;
    for (size_t i = 0; i < lattice->count; i++) lattice->starts[bin_of(lattice, lattice->points[i]) + 1]++;
    for (size_t b = 0; b < bins; b++) lattice->starts[b + 1] += lattice->starts[b];
    for (size_t i = lattice->count; i-- > 0;) // starts move up to the ends, and are set back
        lattice->order[lattice->starts[bin_of(lattice, lattice->points[i])]++] = i;
    memmove(lattice->starts + 1, lattice->starts, bins * sizeof *lattice->starts);
    lattice->starts[0] = 0;
}

// Distance to the nearest point; searched in widening squares of bins.
static double nearest_px(const struct lattice *lattice, const float point[2])
{
    int x = (int)point[0] / BIN_PX, y = (int)point[1] / BIN_PX;
    double best = INFINITY;
    for (int ring = 0; ring <= lattice->across + lattice->down && best > (ring - 1.0) * BIN_PX; ring++)
        for (int j = y - ring; j <= y + ring; j++)
            for (int i = x - ring; i <= x + ring; i++) {
                if (i < 0 || j < 0 || i >= lattice->across || j >= lattice->down) continue;
                if (abs(i - x) != ring && abs(j - y) != ring) continue;
                size_t bin = (size_t)j * (size_t)lattice->across + (size_t)i;
                for (size_t k = lattice->starts[bin]; k < lattice->starts[bin + 1]; k++) {
                    const float *other = lattice->points[lattice->order[k]];
                    best = fmin(best, hypot((double)(other[0] - point[0]), (double)(other[1] - point[1])));
                }
            }
    return best;
}

static double farthest_px(const struct lattice *from, const struct lattice *to)
{
    double farthest = 0;
    for (size_t i = 0; i < from->count; i++) farthest = fmax(farthest, nearest_px(to, from->points[i]));
    return farthest;
}

struct distortion {
    const struct view *view;
    double plane_m; // the sampling plane, relative to the eye
    struct lattice uniform, drawn;
    double moved_sum, moved_max;
    size_t moved;
};

static bool add_point(struct lattice *lattice, const struct view *view, const double relative[3],
                      double pixel[2])
{
    if (!view_project(view, relative, pixel)) return false;
    bool inside = pixel[0] >= 0 && pixel[1] >= 0 && pixel[0] < view->width && pixel[1] < view->height;
    if (!inside || lattice->count == lattice->most) return inside;
    lattice->points[lattice->count][0] = (float)pixel[0];
    lattice->points[lattice->count++][1] = (float)pixel[1];
    return true;
}

// A vertex stands over its place on the sampling plane: where that is seen is where the grid had it.
static void gather_distortion(const float *triangles, size_t count, void *user)
{
    struct distortion *d = user;
    for (size_t t = 0; t + 1 < count; t += 2) { // the first corner of a quad's first triangle
        const float *v = triangles + 9 * t;
        const double drawn[3] = {(double)v[0], (double)v[1], (double)v[2]};
        const double plane[3] = {drawn[0], drawn[1], d->plane_m};
        double there[2], here[2];
        bool stood = add_point(&d->uniform, d->view, plane, there);
        if (!add_point(&d->drawn, d->view, drawn, here) || !stood) continue;
        double moved = hypot(here[0] - there[0], here[1] - there[1]);
        d->moved_sum += moved;
        d->moved_max = fmax(d->moved_max, moved);
        d->moved++;
    }
}

static double lowest_of_all_levels(const struct terrain *terrain)
{
    const struct terrain_info *info = terrain_info(terrain);
    int32_t low = info->min_q;
    for (int level = info->finest; level <= info->coarsest; level++) {
        int32_t at = terrain_level(terrain, level).min_q;
        if (at < low) low = at;
    }
    return info->quantum_m * low + info->offset_m;
}

static bool measure_distortion(struct papers *papers, const struct scene *scene, const struct grid *grid,
                               int window, double cells[4])
{
    const struct terrain_info *info = terrain_info(scene->terrain);
    double low_m = lowest_of_all_levels(scene->terrain);
    const double *outline = info->outline_m, height_m = info->quantum_m * ((double)info->max_q - info->min_q);
    // Twice as high as the terrain, and steep enough that both cameras are one.
    struct camera camera = {
        .eye_m = {0.5 * (outline[0] + outline[2]), 0.5 * (outline[1] + outline[3]), low_m + 2 * height_m},
        .yaw = 0.3,
        .pitch = -50 * degree,
        .fov_vertical = 60 * degree};
    struct view view;
    struct gpu_target target = {0};
    view_init(&view, scene->terrain, &camera, window_sizes[window][0], window_sizes[window][1], 0);
    struct distortion d = {.view = &view, .plane_m = low_m - view.eye_m[2]};
    size_t most = (size_t)(2 * grid->triangles_k * 1000); // extra rows included
    struct renderer *renderer = create_grid(papers, scene, grid->name, "stable", "on");
    bool good = renderer && lattice_init(&d.uniform, most, &view) && lattice_init(&d.drawn, most, &view) &&
                gpu_target_init(papers->gpu, &target, view.width, view.height, GL_RGBA32F) &&
                renderer->type->update(renderer, &view, 1);
    if (good) {
        gpu_set_view(papers->gpu, scene->terrain, &view);
        gpu_target_begin(papers->gpu, &target);
        good = gpu_capture_begin(papers->gpu, gather_distortion, &d);
        renderer->type->draw(renderer, 0, PASS_POSITION);
        gpu_capture_end(papers->gpu);
        lattice_sort(&d.uniform);
        lattice_sort(&d.drawn);
        cells[0] = grid->apart_px[window];
        cells[1] = fmax(farthest_px(&d.uniform, &d.drawn), farthest_px(&d.drawn, &d.uniform));
        cells[2] = d.moved ? d.moved_sum / (double)d.moved : (double)NAN;
        cells[3] = d.moved_max;
    }
    gpu_target_finish(&target);
    lattice_finish(&d.uniform);
    lattice_finish(&d.drawn);
    pgm_renderer.destroy(renderer);
    return good;
}

bool papers_pgm_distortion(struct papers *papers, struct papers_table *table)
{
    name_table(table, "Distortion of the grid by the terrain, Puget Sound", "grid");
    for (int window = 0; window < 2; window++) {
        papers_column(table, windows[window], "px", true);
        papers_column(table, windows[window], "px", false);
        papers_column(table, "moved, mean", "px", false);
        papers_column(table, "moved, max", "px", false);
    }
    bool good = measure_grids(papers, table, measure_distortion);
    if (table->skipped[0]) return good;
    papers_note(
        table,
        "First of each window: the Hausdorff distance between the grid where it was laid and where the "
        "terrain moved it, on the screen, one view looking down by 50 degrees from twice the terrain's "
        "height, extended by strips. Two lattices are seldom much farther apart than a cell, so this "
        "hides how far vertices moved, which stands beside it: the printed figures grow with the window "
        "and with the cell alone.");
    return good;
}

// ---- Table 6: by view angle --------------------------------------------------------------------

// The middle of the square of 16 km with the least (sign -1) or the most (+1) height between its lowest and
// its highest sample.
static void find_region(const struct terrain *terrain, int sign, double middle_m[2], double *highest_m)
{
    const struct terrain_info *info = terrain_info(terrain);
    const double side = 16000;
    double best = -INFINITY;
    for (int k = 0; k < 144; k++) {
        int64_t from[2], to[2];
        double middle[2];
        for (int axis = 0; axis < 2; axis++) {
            double share = ((axis ? k / 12 : k % 12) + 0.5) / 12;
            double low = info->outline_m[axis] + side, high = info->outline_m[axis + 2] - side;
            middle[axis] = low + share * (high - low);
            from[axis] = (int64_t)floor((middle[axis] - side / 2) / info->spacing_m[axis]);
            to[axis] = (int64_t)ceil((middle[axis] + side / 2) / info->spacing_m[axis]);
        }
        int32_t low_q, high_q;
        terrain_bounds(terrain, 0, from[0], from[1], to[0], to[1], &low_q, &high_q);
        double score = sign * ((double)high_q - low_q);
        if (score <= best) continue;
        best = score;
        memcpy(middle_m, middle, sizeof middle);
        *highest_m = info->quantum_m * high_q + info->offset_m;
    }
}

static bool measure_region(struct papers_meter *meter, struct renderer *renderer, int sign, double angle,
                           double *largest)
{
    double middle[2] = {0, 0}, highest_m = 0;
    find_region(meter->scene->terrain, sign, middle, &highest_m);
    struct tally tally = {.samples = 0};
    for (int k = 0; k < 4; k++) {
        struct camera camera = {.eye_m = {middle[0], middle[1], highest_m + 500},
                                .yaw = 90 * degree * k + 0.3,
                                .pitch = -angle * degree,
                                .fov_vertical = 60 * degree};
        struct view view;
        view_init(&view, meter->scene->terrain, &camera, meter->error.width, meter->error.height, 0);
        if (!measure_view(meter, renderer, &view, &tally)) return false;
    }
    *largest = tally.largest_px;
    return true;
}

bool papers_pgm_angles(struct papers *papers, struct papers_table *table)
{
    static const double printed[10][2] = {{0.1, 0.2}, {0.5, 1.1}, {0.6, 1.8}, {1.0, 2.7}, {1.3, 3.4},
                                          {1.6, 4.1}, {1.8, 4.5}, {1.9, 4.9}, {2.1, 5.2}, {2.1, 5.3}};
    name_table(table, "Largest screen-space error by view angle, 200 x 800", "view angle");
    for (int c = 0; c < 4; c++) papers_column(table, c < 2 ? "flat" : "mountainous", "px", c % 2 == 0);
    struct scene *scene = puget_scene(papers, table);
    if (!scene) return table->skipped[0] != 0;
    struct papers_meter meter;
    struct renderer *renderer = create_grid(papers, scene, "200x800", "stable", "off");
    bool good = papers_meter_init(&meter, papers, scene) && renderer;
    for (int i = 0; i < 10 && good; i++) {
        double angle = 90 - 10 * i, *values = papers_row(table, "%.0f degrees", angle);
        for (int region = 0; region < 2 && good; region++) {
            values[2 * region] = printed[i][region];
            good = measure_region(&meter, renderer, region ? 1 : -1, angle, &values[2 * region + 1]);
        }
    }
    error_notes(table);
    papers_note(table,
                "Flat and mountainous: over the squares of 16 km with the least and the most between "
                "their lowest and highest sample, 500 m above the highest, four directions each. What is "
                "seen farther away may be neither.");
    pgm_renderer.destroy(renderer);
    papers_meter_finish(&meter);
    scene_destroy(scene);
    return good;
}

// ---- Table 7: texture updates ------------------------------------------------------------------

// Most memory whose largest tile is at most `side` texels.
static size_t memory_for_side(const struct terrain *terrain, struct pgm_storage storage, int side)
{
    size_t low = (size_t)side * (size_t)side, high = (size_t)1 << 28;
    struct pgm_atlas atlas;
    while (high - low > 256) {
        storage.memory_bytes = low + (high - low) / 2;
        memset(&atlas, 0, sizeof atlas);
        if (pgm_atlas_layout(&atlas, terrain, &storage) && atlas.side <= side)
            low = storage.memory_bytes;
        else
            high = storage.memory_bytes;
    }
    return low;
}

// Mean ms a frame of a flight eastwards; cells a frame < 0: everything is loaded anew each frame.
static double time_updates(const struct papers *papers, struct pgm_atlas *atlas, const struct scene *scene,
                           double cells)
{
    struct view view;
    double total = 0, spacing = terrain_info(scene->terrain)->spacing_m[0];
    int frames = cells < 0 ? 2 * papers->repeats : 20 * papers->repeats;
    for (int frame = -1; frame < frames; frame++) {
        scene_view(scene, 0, 2, &view);
        struct camera camera = {
            .eye_m = {view.eye_m[0] + frame * fmax(cells, 0) * spacing, view.eye_m[1], view.eye_m[2]},
            .fov_vertical = scene->fov_vertical};
        view_init(&view, scene->terrain, &camera, scene->width, scene->height, 0);
        for (int k = 0; k < atlas->levels && cells < 0; k++)
            if (!pgm_window_is_whole(&atlas->slots[k].window))
                memset(&atlas->slots[k].window.held, 0, sizeof atlas->slots[k].window.held);
        double start = papers_clock_ms(papers);
        pgm_atlas_follow(atlas, papers->gpu, scene->terrain, NULL, &view);
        gpu_finish(papers->gpu);
        if (frame >= 0) total += papers_clock_ms(papers) - start;
    }
    return total / frames;
}

bool papers_pgm_updates(struct papers *papers, struct papers_table *table)
{
    static const double printed[3][4] = {
        {38, 1.22, 0.17, 0.01}, {161, 1.57, 0.63, 0.01}, {994, 3.59, 1.39, 0.02}};
    static const double speeds[4] = {-1, 16, 4, 0.1};
    static const char *const names[4] = {"all of it", "fast", "medium", "slow"};
    name_table(table, "Times of updating the heights on the GPU, by tile size and motion", "tile");
    for (int c = 0; c < 8; c++) papers_column(table, names[c / 2], "ms", c % 2 == 0);
    struct scene *scene = puget_scene(papers, table);
    if (!scene) return table->skipped[0] != 0;
    bool good = true;
    for (int i = 0; i < 3 && good; i++) {
        int side = 128 << i;
        struct pgm_storage storage = {.fetch = PGM_FETCH_PACKED,
                                      .budget_bytes = (size_t)1 << 40,
                                      .most_texels = gpu_info(papers->gpu)->max_texture_size};
        struct pgm_atlas atlas = {0};
        storage.memory_bytes = memory_for_side(scene->terrain, storage, side);
        good = pgm_atlas_init(&atlas, papers->gpu, scene->terrain, &storage);
        double *values = papers_row(table, "%d x %d", side, side);
        for (int speed = 0; speed < 4 && good; speed++) {
            values[2 * speed] = printed[i][speed];
            values[2 * speed + 1] = time_updates(papers, &atlas, scene, speeds[speed]);
        }
        pgm_atlas_finish(&atlas);
    }
    papers_note(table,
                "Packed texels (16 bytes a sample) of the Cascades, without a budget. The paper does not "
                "say how fast its motions are: fast, medium and slow are 16, 4 and 0.1 cells of the finest "
                "level a frame here. Reading, packing and uploading; levels that are smaller than a tile "
                "are loaded once.");
    scene_destroy(scene);
    return good;
}

// ---- section 6.3: culled samples ---------------------------------------------------------------

struct inside {
    const struct view *view;
    uint64_t seen, all;
};

static void count_inside(const float *triangles, size_t count, void *user)
{
    struct inside *inside = user;
    for (size_t v = 0; v < 3 * count; v++) {
        const double relative[3] = {(double)triangles[3 * v], (double)triangles[3 * v + 1],
                                    (double)triangles[3 * v + 2]};
        double pixel[2];
        inside->all++;
        inside->seen += view_project(inside->view, relative, pixel) && pixel[0] >= 0 && pixel[1] >= 0 &&
                        pixel[0] <= inside->view->width && pixel[1] <= inside->view->height;
    }
}

static bool culled_share(const struct papers *papers, const struct scene *scene, struct renderer *renderer,
                         double altitude_m, double *share)
{
    struct gpu_target target;
    if (!gpu_target_init(papers->gpu, &target, scene->width, scene->height, GL_RGBA32F)) return false;
    const double *outline = terrain_info(scene->terrain)->outline_m;
    struct inside inside = {0};
    bool good = true;
    for (int k = 0; k < 8 && good; k++) {
        struct camera camera = {
            .eye_m = {0.5 * (outline[0] + outline[2]), 0.5 * (outline[1] + outline[3]), altitude_m},
            .yaw = 45 * degree * k,
            .fov_vertical = scene->fov_vertical};
        struct view view;
        view_init(&view, scene->terrain, &camera, scene->width, scene->height, 0);
        inside.view = &view;
        good = renderer->type->update(renderer, &view, 1);
        gpu_set_view(papers->gpu, scene->terrain, &view);
        gpu_target_begin(papers->gpu, &target);
        good = good && gpu_capture_begin(papers->gpu, count_inside, &inside);
        renderer->type->draw(renderer, 0, PASS_POSITION);
        gpu_capture_end(papers->gpu);
    }
    gpu_target_finish(&target);
    *share = inside.all ? 100 * (1 - (double)inside.seen / (double)inside.all) : (double)NAN;
    return good;
}

bool papers_pgm_culled(struct papers *papers, struct papers_table *table)
{
    static const struct {
        double altitude, printed;
    } rows[] = {{1.1, 0}, {1.5, 0}, {2, 0}, {3, NAN}, {4, 25}, {6, NAN}};
    name_table(table, "Samples outside the window, level view, by altitude", "altitude / highest terrain");
    papers_column(table, "culled", "%", true);
    papers_column(table, "no extension", "%", false);
    papers_column(table, "extended", "%", false);
    papers_column(table, "tight", "%", false);
    struct scene *scene = puget_scene(papers, table);
    if (!scene) return table->skipped[0] != 0;
    const struct terrain_info *info = terrain_info(scene->terrain);
    double low_m = info->quantum_m * info->min_q + info->offset_m;
    double height_m = info->quantum_m * ((double)info->max_q - info->min_q);
    struct renderer_desc desc = {.gpu = papers->gpu,
                                 .terrain = scene->terrain,
                                 .effects = &scene->effects,
                                 .width = scene->width,
                                 .height = scene->height};
    renderer_default_knobs(&pgm_renderer, desc.knobs);
    struct renderer *renderers[3] = {create_grid(papers, scene, "200x800", "none", "off"),
                                     create_grid(papers, scene, "200x800", "stable", "off"),
                                     pgm_renderer.create(&desc)};
    bool good = renderers[0] && renderers[1] && renderers[2];
    for (size_t i = 0; i < sizeof rows / sizeof rows[0] && good; i++) {
        double *values = papers_row(table, "%.1f", rows[i].altitude);
        values[0] = rows[i].printed;
        for (int k = 0; k < 3 && good; k++)
            good = culled_share(papers, scene, renderers[k], low_m + rows[i].altitude * height_m,
                                &values[k + 1]);
    }
    papers_note(
        table,
        "Vertices of triangles that project outside the window, 60 degrees high, over the middle of the "
        "Cascades in eight directions; altitude over the lowest terrain. The 200 x 800 grid as published, "
        "without and with the extension, and the renderer's default, which begins where ground is seen.");
    papers_note(
        table,
        "Printed: around 25 %% at four times the height of the terrain, almost none below twice. It cannot "
        "be so for a level view on the base plane: a sampling camera of 60 degrees that looks down by 30 "
        "sends half of its rays below the window's lower edge, and only terrain that rises lifts some of "
        "their vertices into view.");
    for (int k = 0; k < 3; k++) pgm_renderer.destroy(renderers[k]);
    scene_destroy(scene);
    return good;
}
