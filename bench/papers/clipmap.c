// Losasso & Hoppe 2004, section 9: the update of a level (Table 1), the error of levels (Table 2), the rate.
// SPDX-License-Identifier: MIT
#include "clipmap/clipmap.h"
#include "bench/papers/papers.h"
#include "bench/statistics.h"
#include "clipmap/clipmap_normals.h"
#include "clipmap/clipmap_store.h"
#include "common/report.h"
#include "common/terrain/synthesis.h"
#include "common/terrain/upsample.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

enum { N = 255, TEXELS = 2 * N, PRINTED_WIDTH = 640, FRAMES = 24, UPDATES_A_REPEAT = 50 };

// ---- Table 1: a full level ---------------------------------------------------------------------

// The whole refill is the sum of its steps; synthesis out of the published table is timed beside it.
enum step {
    STEP_PREDICT,
    STEP_SYNTHESISE,
    STEP_PAIR,
    STEP_BOUND,
    STEP_SHADE,
    STEP_UPLOAD,
    STEPS,
    TIME_WHOLE = STEPS,
    TIME_TABLE,
    TIME_DECODE,
    TIMES
};

struct refill { // of N x N samples of the finest level, as if it were not in memory
    struct papers *papers;
    const struct terrain *terrain;
    int level;
    double noise_q;
    int32_t *predicting; // samples of the coarser level that U reads
    struct clipmap_scratch scratch;
    struct clipmap_store store; // for its bounds
    struct clipmap_normals_scratch normals;
    GLuint heights, shades;
    struct synthesis_table table;
};

static bool refill_init(struct refill *refill, struct papers *papers, const struct terrain *terrain)
{
    int level = terrain_info(terrain)->finest;
    *refill = (struct refill){.papers = papers,
                              .terrain = terrain,
                              .level = level,
                              .noise_q = terrain_level(terrain, level).noise_q};
    size_t side = (size_t)upsample_coarse_size(1, N);
    refill->predicting = malloc(side * side * sizeof *refill->predicting);
    if (!refill->predicting) return fail("papers: out of memory");
    if (!clipmap_scratch_init(&refill->scratch, N) ||
        !clipmap_normals_scratch_init(&refill->normals, TEXELS) ||
        !clipmap_store_init(&refill->store, terrain, level, true, N))
        return false;
    synthesis_fill_table(&refill->table, PAPERS_SEED);
    glGenTextures(1, &refill->heights);
    glBindTexture(GL_TEXTURE_2D_ARRAY, refill->heights);
    glTexImage3D(GL_TEXTURE_2D_ARRAY, 0, GL_RG32F, N, N, 1, 0, GL_RG, GL_FLOAT, NULL);
    glGenTextures(1, &refill->shades);
    glBindTexture(GL_TEXTURE_2D, refill->shades);
    glTexImage2D(GL_TEXTURE_2D, 0, GL_RG16_SNORM, TEXELS, TEXELS, 0, GL_RG, GL_SHORT, NULL);
    return true;
}

static void refill_finish(struct refill *refill)
{
    free(refill->predicting);
    clipmap_scratch_finish(&refill->scratch);
    clipmap_store_finish(&refill->store);
    clipmap_normals_scratch_finish(&refill->normals);
    if (refill->heights) glDeleteTextures(1, &refill->heights);
    if (refill->shades) glDeleteTextures(1, &refill->shades);
}

static void predict(struct refill *refill, const struct clipmap_box *box)
{
    int columns = upsample_coarse_size(box->lo[0], N), rows = upsample_coarse_size(box->lo[1], N);
    terrain_window(refill->terrain, refill->level + 1, clipmap_floor_div(box->lo[0], 2) - 1,
                   clipmap_floor_div(box->lo[1], 2) - 1, columns, rows, refill->predicting, TERRAIN_WAIT);
    upsample(refill->predicting, box->lo[0], box->lo[1], N, N, refill->scratch.fine);
}

static void synthesise(struct refill *refill, const struct clipmap_box *box)
{
    for (int y = 0; y < N; y++)
        synthesis_add_row(refill->scratch.fine + (ptrdiff_t)y * N, N, box->lo[0], box->lo[1] + y,
                          refill->level, PAPERS_SEED, refill->noise_q);
}

static void synthesise_as_published(struct refill *refill, const struct clipmap_box *box)
{
    for (int y = 0; y < N; y++)
        synthesis_add_table_row(refill->scratch.fine + (ptrdiff_t)y * N, N, box->lo[0], box->lo[1] + y,
                                &refill->table, refill->noise_q);
}

static void pair(struct refill *refill, const struct clipmap_box *box)
{
    struct clipmap_box under = clipmap_under(box);
    terrain_window(refill->terrain, refill->level + 1, under.lo[0], under.lo[1],
                   (int)(under.hi[0] - under.lo[0] + 1), (int)(under.hi[1] - under.lo[1] + 1),
                   refill->scratch.coarse, TERRAIN_WAIT);
    clipmap_pair(box, true, &refill->scratch);
}

static void bound(struct refill *refill, const struct clipmap_box *box)
{
    clipmap_store_bound(&refill->store, box);
}

// The level is the finest: its normals come of its own prediction U at twice the resolution, the dearer case.
static void shade(struct refill *refill, const struct clipmap_box *box)
{
    struct clipmap_box texels;
    for (int axis = 0; axis < 2; axis++) {
        texels.lo[axis] = 2 * box->lo[axis];
        texels.hi[axis] = 2 * box->hi[axis] + 1;
    }
    clipmap_normals_compute(refill->terrain, refill->level, &texels, &refill->normals);
}

static void upload(struct refill *refill, const struct clipmap_box *box)
{
    (void)box;
    gpu_texture_sub_image(refill->papers->gpu, GL_TEXTURE_2D_ARRAY, 0, 0, 0, N, N, GL_RG, GL_FLOAT,
                          refill->scratch.pairs);
    gpu_texture_sub_image(refill->papers->gpu, GL_TEXTURE_2D, -1, 0, 0, TEXELS, TEXELS, GL_RG, GL_SHORT,
                          refill->normals.texels);
    gpu_finish(refill->papers->gpu);
}

static void (*const steps[STEPS])(struct refill *, const struct clipmap_box *) = {
    predict, synthesise, pair, bound, shade, upload};

// A level somewhere on the map: each repeat finds other samples in other lines of the cache.
static struct clipmap_box random_box(const struct refill *refill, struct random_state *random)
{
    struct terrain_extent extent = terrain_level(refill->terrain, refill->level).extent;
    struct clipmap_box box;
    const int64_t margin = 8; // within which U would extrapolate
    const int64_t first[2] = {extent.x0 + margin, extent.y0 + margin};
    const int64_t room[2] = {extent.x1 - extent.x0 - N - 2 * margin, extent.y1 - extent.y0 - N - 2 * margin};
    for (int axis = 0; axis < 2; axis++) {
        box.lo[axis] = first[axis] + (int64_t)random_below(random, (uint64_t)room[axis]);
        box.hi[axis] = box.lo[axis] + N - 1;
    }
    return box;
}

static double time_step(struct refill *refill, const struct clipmap_box *box,
                        void (*step)(struct refill *, const struct clipmap_box *))
{
    double start = papers_clock_ms(refill->papers);
    step(refill, box);
    return papers_clock_ms(refill->papers) - start;
}

// times[step * count + repeat]; checks on the way that what is made is the terrain's own level, bit for bit.
static bool time_refills(struct refill *refill, double *times, int count)
{
    struct random_state random = {1};
    int32_t *expected = malloc((size_t)N * N * sizeof *expected);
    if (!expected) return fail("papers: out of memory");
    bool same = true;
    for (int r = 0; r < count; r++) {
        struct clipmap_box box = random_box(refill, &random);
        double whole = 0;
        for (int s = 0; s < STEPS; s++) whole += times[s * count + r] = time_step(refill, &box, steps[s]);
        times[TIME_WHOLE * count + r] = whole;
        terrain_window(refill->terrain, refill->level, box.lo[0], box.lo[1], N, N, expected, TERRAIN_WAIT);
        for (int i = 0; i < N * N; i++) same = same && refill->scratch.fine[i] == expected[i];
        times[TIME_TABLE * count + r] = time_step(refill, &box, synthesise_as_published);
    }
    free(expected);
    return same || fail("papers: a synthesised level differs from the terrain's own");
}

static void update_rows(struct papers_table *table, const double medians[TIMES])
{
    const struct {
        const char *label;
        double printed_ms, measured_ms;
        bool share; // of a whole refill
    } rows[] = {
        {"computation of z_c", 2, medians[STEP_PAIR], true},
        {"interpolatory subdivision U", 3, medians[STEP_PREDICT], true},
        {"decompression, U included", 8, medians[TIME_DECODE], false},
        {"synthesis", 3, medians[STEP_SYNTHESISE], true},
        {"synthesis out of a table, as published", 3, medians[TIME_TABLE], false},
        {"bounds of heights, for culling", NAN, medians[STEP_BOUND], true},
        {"upload to video memory", 2, medians[STEP_UPLOAD], true},
        {"normal map computation", 11, medians[STEP_SHADE], true},
        {"total, with synthesis", 21, medians[TIME_WHOLE], true},
        {"total, with decompression", 26,
         medians[TIME_WHOLE] - medians[STEP_PREDICT] - medians[STEP_SYNTHESISE] + medians[TIME_DECODE],
         false}};
    int printed = papers_column(table, "time", "ms", true),
        measured = papers_column(table, "time", "ms", false);
    int share = papers_column(table, "share of the total", "%", false);
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        double *values = papers_row(table, "%s", rows[i].label);
        values[printed] = rows[i].printed_ms;
        values[measured] = rows[i].measured_ms;
        if (rows[i].share) values[share] = 100 * rows[i].measured_ms / medians[TIME_WHOLE];
    }
}

static double median_ms(double *times, int count) // NAN: not measured
{
    return isnan(times[0]) ? times[0] : percentile(times, (size_t)count, 500);
}

bool papers_clipmap_update(struct papers *papers, struct papers_table *table)
{
    struct scene *scene = papers_detailed_scene(papers);
    struct papers_flight flight = {.type = &clipmap_renderer, .knobs = {"n", "255"}};
    struct refill refill = {0};
    int count = papers->repeats * UPDATES_A_REPEAT;
    double *times = malloc(TIMES * (size_t)count * sizeof *times), medians[TIMES];
    bool good = scene && times && refill_init(&refill, papers, scene->terrain) &&
                time_refills(&refill, times, count) &&
                papers_decompression(papers, times + (ptrdiff_t)TIME_DECODE * count, count) &&
                papers_fly(papers, scene, FRAMES, &flight, 1);
    snprintf(table->title, sizeof table->title, "Times of updating a full level of %d x %d samples", N, N);
    snprintf(table->row_name, sizeof table->row_name, "step");
    if (good) {
        for (int t = 0; t < TIMES; t++) medians[t] = median_ms(times + (ptrdiff_t)t * count, count);
        update_rows(table, medians);
        papers_note(table,
                    "Median of %d refills at random places of level %d of the built-in terrain; one thread. "
                    "Printed: Pentium 4 at 3.0 GHz, ATI Radeon 9800 XT; the totals of 21 and 26 stand in the "
                    "other order than 8 and 3 for decompression and synthesis.",
                    count, refill.level);
        papers_note(table,
                    "A whole refill is %.1f %% of a frame of this renderer with its normal maps at n = %d "
                    "(%.1f ms, median of %d frames over the same terrain). In flight only the samples that "
                    "the motion exposes are read.",
                    100 * medians[TIME_WHOLE] / flight.frame_ms, N, flight.frame_ms, FRAMES);
        papers_note(table, "Synthesis draws each deviate from a hash of the absolute sample and level. The "
                           "published table of 50 x 50 deviates is cheaper; it repeats every 50 samples and "
                           "is the same in every level (terrain option noise = table).");
        papers_note(
            table,
            "The normal map has twice the resolution; the level is the finest, so it is made from U of the "
            "level. Uploads are two floats a sample and two 16-bit numbers a texel; on a software rasteriser "
            "a copy in memory.");
        papers_note(table,
                    "Decompression: as many samples of the Puget Sound set at 160 m, out of a .relief "
                    "file of an rms error of a tenth of the spacing, as the paper's; the coarser level "
                    "is there. The total with it is that with synthesis, less U and synthesis.");
    }
    refill_finish(&refill);
    free(times);
    return good;
}

// ---- Table 2: screen-space error of each level -------------------------------------------------

// Height of the piecewise-linear surface of a level at the sample (x, y) of a level 2^shift finer.
static double surface_at(const int32_t *samples, size_t stride, const struct terrain_extent *extent,
                         int shift, int64_t x, int64_t y)
{
    int64_t i = x >> shift, j = y >> shift;
    int64_t cell = (int64_t)1 << shift;
    double u = ldexp((double)(x - i * cell), -shift), v = ldexp((double)(y - j * cell), -shift);
    // On the last column and row u and v are 0: their neighbours do not count.
    size_t east = i + 1 < extent->x1, north = j + 1 < extent->y1 ? stride : 0;
    const int32_t *sw = samples + (size_t)(j - extent->y0) * stride + (size_t)(i - extent->x0);
    double z = sw[0], z_se = sw[east], z_nw = sw[north], z_ne = sw[north + east];
    return u >= v ? z + u * (z_se - z) + v * (z_ne - z_se) : z + v * (z_nw - z) + u * (z_ne - z_nw);
}

void papers_level_errors(const struct terrain *terrain, int level, double *errors_q)
{
    int finest = terrain_info(terrain)->finest;
    struct terrain_extent from = terrain_level(terrain, finest).extent,
                          to = terrain_level(terrain, level).extent;
    size_t stride, finest_stride;
    const int32_t *samples = terrain_samples(terrain, level, &stride);
    const int32_t *truth = terrain_samples(terrain, finest, &finest_stride);
    for (int64_t y = from.y0; y < from.y1; y++)
        for (int64_t x = from.x0; x < from.x1; x++)
            *errors_q++ = fabs(surface_at(samples, stride, &to, level - finest, x, y) -
                               truth[(size_t)(y - from.y0) * finest_stride + (size_t)(x - from.x0)]);
}

// Screen size in pixels of the spacing at the average depth 0.4 n g (section 4), in the paper's window.
static double printed_spacing_px(void)
{
    const double tan_half_horizontal = 1;
    return clipmap_spacing_px(N, PRINTED_WIDTH, tan_half_horizontal);
}

static const struct { // Table 2, Puget Sound
    double rms, p999, max;
} printed_errors[] = {{0.12, 0.58, 1.27}, {0.14, 0.75, 1.39},  {0.15, 0.86, 2.08},
                      {0.15, 0.93, 2.50}, {0.14, 0.96, 3.38},  {0.13, 0.94, 5.55},
                      {0.11, 0.83, 8.03}, {0.11, 0.75, 14.25}, {0, 0, 0}};
enum { PRINTED_LEVELS = sizeof printed_errors / sizeof printed_errors[0] };
static const double printed_spacing_m = 10; // of its finest level

// The paper's level whose spacing is nearest, counted its way, from 1, the coarsest.
static int printed_level(double spacing_m)
{
    return PRINTED_LEVELS - (int)lround(log2(spacing_m / printed_spacing_m));
}

static void error_row(const struct terrain *terrain, int level, double *errors, struct papers_table *table)
{
    struct terrain_level l = terrain_level(terrain, level);
    size_t count = (size_t)terrain_info(terrain)->samples;
    double px_per_q = terrain_info(terrain)->quantum_m * printed_spacing_px() / l.spacing_m[0], squares = 0;
    int number = printed_level(l.spacing_m[0]);
    papers_level_errors(terrain, level, errors);
    for (size_t i = 0; i < count; i++) squares += errors[i] * errors[i];
    double *values = papers_row(table, "%d (%.0f m)", number, l.spacing_m[0]);
    if (number >= 1) {
        values[0] = printed_errors[number - 1].rms;
        values[2] = printed_errors[number - 1].p999;
        values[4] = printed_errors[number - 1].max;
    }
    values[1] = sqrt(squares / (double)count) * px_per_q;
    values[3] = percentile(errors, count, 999) * px_per_q;
    values[5] = errors[count - 1] * px_per_q; // percentile() sorted them
}

static bool error_rows(const struct terrain *terrain, struct papers_table *table)
{
    static const char *const names[] = {"rms", "p99.9", "max"};
    const struct terrain_info *info = terrain_info(terrain);
    double *errors = malloc((size_t)info->samples * sizeof *errors);
    if (!errors) return fail("papers: out of memory");
    for (int k = 0; k < 6; k++) papers_column(table, names[k / 2], "px", k % 2 == 0);
    for (int level = info->coarsest; level >= info->finest; level--)
        if (printed_level(terrain_level(terrain, level).spacing_m[0]) >= 1)
            error_row(terrain, level, errors, table);
    free(errors);
    return true;
}

bool papers_clipmap_error(struct papers *papers, struct papers_table *table)
{
    char path[1024];
    (void)papers;
    snprintf(table->title, sizeof table->title,
             "Screen-space error of each level of the Puget Sound set, e_l / g_l x s");
    snprintf(table->row_name, sizeof table->row_name, "level (spacing)");
    if (!papers_data(table, "puget_1k_160m.png", path)) return true;
    struct terrain *terrain = terrain_load(path, NULL);
    if (!terrain) return false;
    bool good = error_rows(terrain, table);
    papers_note(table, "Levels are matched by spacing and counted as in the paper, from the coarsest. The "
                       "paper's finest level has 16385 x 16385 samples at 10 m; this set is the same ground "
                       "at 160 m, so the levels that it has are measured against 160 m: what lies between 10 "
                       "and 160 m is missing from its errors, most in its finest levels.");
    papers_note(
        table,
        "s = 1.25 W / (n tan(phi / 2)) = %.3f pixels at n = %d, W = %d, a horizontal angle of 90 degrees "
        "(the paper prints 3, which makes its figures 4 %% smaller). It is the size at the average depth 0.4 "
        "n g: within a ring the depth goes down to 0.177 n g, where errors are up to 2.25 times as large.",
        printed_spacing_px(), N, PRINTED_WIDTH);
    papers_note(table, "D is (-1 2 6 2 -1) / 8 along each axis here, the dual of linear interpolation; the "
                       "paper fits 11 x 11 weights to its data and adds the error of its coder.");
    terrain_destroy(terrain);
    return good;
}

// ---- the rendering rate ------------------------------------------------------------------------

bool papers_clipmap_rate(struct papers *papers, struct papers_table *table)
{
    static const double printed[][3] = {{120, 59, 0.492}, {95, NAN, NAN}}; // frames/s, M/s, M a frame
    static const char *const labels[] = {"one sample a pixel", "4x multisampling"};
    struct papers_flight flights[] = {{.type = &clipmap_renderer, .knobs = {"n", "255"}},
                                      {.type = &clipmap_renderer, .knobs = {"n", "255"}, .samples = 4}};
    struct scene *scene = papers_detailed_scene(papers);
    snprintf(table->title, sizeof table->title, "Levels of %d x %d samples, frustum culling", N, N);
    snprintf(table->row_name, sizeof table->row_name, "framebuffer");
    for (int c = 0; c < 6; c++) {
        static const char *const names[] = {"frames", "triangles", "a frame"};
        static const char *const units[] = {"1/s", "million/s", "million"};
        papers_column(table, names[c / 2], units[c / 2], c % 2 == 0);
    }
    if (!scene || !papers_fly(papers, scene, FRAMES, flights, 2)) return false;
    for (int f = 0; f < 2; f++) {
        double *values = papers_row(table, "%s", labels[f]);
        for (int k = 0; k < 3; k++) values[2 * k] = printed[f][k];
        values[1] = 1000 / flights[f].frame_ms;
        values[3] = flights[f].triangles_per_s * 1e-6;
        values[5] = flights[f].triangles * 1e-6;
    }
    papers_note(table,
                "Here %.0f levels of the built-in terrain, %d x %d pixels, %s. Printed: 11 levels, 640 x "
                "480, ATI Radeon 9800 XT. 59 million/s at 120 frames/s are 0.49 million a frame, while a "
                "third of what 11 levels hold would be 0.37: the paper's two statements differ.",
                flights[0].stats.counters[0].value, papers->width, papers->height,
                gpu_info(papers->gpu)->renderer);
    if (papers->cpu_times)
        papers_note(
            table,
            "On a software rasteriser four samples a pixel are four times the coverage and depth tests of "
            "each triangle, and small triangles are all coverage; hardware does them side by side.");
    papers_note(
        table,
        "Frames: 1000 / median ms. Triangles: all of the path's over all of its time, update included.");
    return true;
}
