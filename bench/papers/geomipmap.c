// What Brodersen 2005 prints: memory of the index sets, bytes a sample, the rate, tile sizes, one draw call
// against five.
// SPDX-License-Identifier: MIT
#include "geomipmap/geomipmap.h"
#include "bench/papers/papers.h"
#include "common/report.h"
#include "common/terrain/relief/relief_pack.h"
#include "geomipmap/geomipmap_mesh.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { FRAMES = 24 };

// ---- index sets --------------------------------------------------------------------------------

// Bytes of the indices; 0 after one line on stderr.
static size_t index_bytes(int bits, enum geomipmap_borders borders, bool strips, int *sets)
{
    struct geomipmap_mesh mesh;
    if (!geomipmap_mesh_init(&mesh, bits, borders, strips)) return 0;
    size_t bytes = mesh.index_count * sizeof *mesh.indices;
    *sets = mesh.set_count;
    geomipmap_mesh_finish(&mesh);
    return bytes;
}

bool papers_geomipmap_sets(struct papers *papers, struct papers_table *table)
{
    static const struct {
        enum geomipmap_borders borders;
        bool strips;
        double printed; // bytes, 17 x 17
    } forms[] = {
        {GEOMIPMAP_ADD, false, 88896}, {GEOMIPMAP_ADD, true, 58718}, {GEOMIPMAP_REGIONS, true, 4338}};
    static const char *const names[] = {"sets", "lists", "strips", "regions"};
    (void)papers;
    snprintf(table->title, sizeof table->title, "Index sets for every combination of levels");
    snprintf(table->row_name, sizeof table->row_name, "tile");
    for (int c = 0; c < 8; c++) papers_column(table, names[c / 2], c < 2 ? "" : "bytes", c % 2 == 0);
    for (int bits = 3; bits <= GEOMIPMAP_MAX_BITS; bits++) {
        double *values = papers_row(table, "%d x %d", (1 << bits) + 1, (1 << bits) + 1);
        if (bits == 4) values[0] = 354;
        for (int f = 0; f < 3; f++) {
            int sets = 0;
            size_t bytes = index_bytes(bits, forms[f].borders, forms[f].strips, &sets);
            if (bytes == 0) return false;
            if (bits == 4) values[2 + 2 * f] = forms[f].printed;
            values[1] = sets;
            values[3 + 2 * f] = (double)bytes;
        }
    }
    papers_note(table,
                "Lists are the printed number to the byte. Strips here are one a set, joined by triangles "
                "without area, with a vertex repeated where they turn, the shortest of some greedy attempts; "
                "the paper does not say how its own are made.");
    papers_note(table,
                "The five regions as strips: here two corner triangles lie on two sides, since every cell "
                "keeps the diagonal of the terrain, and their regions are stored for two neighbours; the "
                "paper's corners must turn their diagonal, so that its level 0 is not the terrain.");
    return true;
}

// ---- flights -----------------------------------------------------------------------------------

bool papers_geomipmap_rate(struct papers *papers, struct papers_table *table)
{
    static const struct {
        const char *label;
        double frames_s, million_s, cost; // printed
    } rows[] = {{"17 x 17, tau 1, one call a tile", 70, 35, 1},
                {"17 x 17, tau 1, five calls a tile", NAN, NAN, 1.07},
                {"17 x 17, tau 1, vertices removed", NAN, NAN, NAN},
                {"33 x 33, tau 1", NAN, NAN, NAN},
                {"17 x 17, tau 3", NAN, NAN, NAN},
                {"17 x 17, tau 1, distant tiles merged", NAN, NAN, NAN}};
    struct papers_flight flights[] = {
        {.type = &geomipmap_renderer, .knobs = {"heights", "samples", "merge", "0"}},
        {.type = &geomipmap_renderer, .knobs = {"heights", "samples", "merge", "0", "borders", "regions"}},
        {.type = &geomipmap_renderer, .knobs = {"borders", "remove"}},
        {.type = &geomipmap_renderer, .knobs = {"heights", "samples", "merge", "0", "patch", "33"}},
        {.type = &geomipmap_renderer, .knobs = {"heights", "samples", "merge", "0", "tau", "3"}},
        {.type = &geomipmap_renderer},
    };
    enum { COUNT = sizeof rows / sizeof rows[0] };
    struct scene *scene = papers_detailed_scene(papers);
    snprintf(table->title, sizeof table->title, "Tile sizes, tau, and one draw call against five");
    snprintf(table->row_name, sizeof table->row_name, "setting");
    static const char *const names[] = {"frames", "frames", "triangles", "triangles",
                                        "cost",   "cost",   "a frame",   "tiles"};
    static const char *const units[] = {"1/s", "1/s", "million/s", "million/s",
                                        "",    "",    "thousand",  "B/sample"};
    for (int c = 0; c < 8; c++) papers_column(table, names[c], units[c], c < 6 && c % 2 == 0);
    if (!scene || !papers_fly(papers, scene, FRAMES, flights, COUNT)) return false;
    for (int f = 0; f < COUNT; f++) {
        double *values = papers_row(table, "%s", rows[f].label);
        values[0] = rows[f].frames_s;
        values[1] = 1000 / flights[f].frame_ms;
        values[2] = rows[f].million_s;
        values[3] = flights[f].triangles_per_s * 1e-6;
        values[4] = rows[f].cost;
        values[5] = flights[f].frame_ms / flights[0].frame_ms;
        values[6] = flights[f].triangles * 1e-3;
        values[7] = papers_counter(flights[f].stats.counters, "tile_bytes_a_sample");
    }
    papers_note(table,
                "Cost: ms a frame over those of the first row. Printed: 8193 x 8193 samples with an image of "
                "8192 x 8192, GeForce FX 5650 Go; here the built-in terrain with its light map, %d x %d "
                "pixels, %s.",
                papers->width, papers->height, gpu_info(papers->gpu)->renderer);
    papers_note(table,
                "Bytes a sample: all tile memory, the heights of the tiles in use included; the paper prints "
                "less than 2.5 with all heights. The terrain that heights are read from is in memory "
                "here and takes %.1f more.",
                papers_counter(flights[0].stats.counters, "bytes_a_sample") -
                    papers_counter(flights[0].stats.counters, "tile_bytes_a_sample"));
    papers_note(
        table,
        "Most tiles draw their 8 coarsest triangles here, so that tau saves few: tiles that merge do.");
    papers_note(table, "Removal breaks tau: the border of a tile is then as wrong as its neighbour's level.");
    return true;
}

// ---- CPU work ----------------------------------------------------------------------------------

bool papers_geomipmap_work(struct papers *papers, struct papers_table *table)
{
    static const char *const taus[] = {"8", "4", "2", "1", "0.5"};
    enum { COUNT = sizeof taus / sizeof taus[0] };
    struct papers_flight flights[COUNT];
    for (int f = 0; f < COUNT; f++)
        flights[f] = (struct papers_flight){.type = &geomipmap_renderer, .knobs = {"tau", taus[f]}};
    struct scene *scene = papers_detailed_scene(papers);
    snprintf(table->title, sizeof table->title, "CPU time of selection and culling");
    snprintf(table->row_name, sizeof table->row_name, "setting");
    static const char *const names[] = {"frame", "update", "selection", "share", "tiles", "a tile"};
    static const char *const units[] = {"ms", "ms", "ms", "%", "", "us"};
    for (int c = 0; c < 6; c++) papers_column(table, names[c], units[c], false);
    if (!scene || !papers_fly(papers, scene, FRAMES, flights, COUNT)) return false;
    for (int f = 0; f < COUNT; f++) {
        double *values = papers_row(table, "17 x 17, tau %s", taus[f]);
        values[0] = flights[f].frame_ms;
        values[1] = flights[f].update_ms;
        values[2] = flights[f].select_ms;
        values[3] = 100 * values[2] / values[0];
        values[4] = papers_counter(flights[f].counters, "tiles");
        values[5] = 1000 * values[2] / values[4];
    }
    papers_note(
        table,
        "Selection: levels, culling, borders and index sets of all tiles, without uploads and draws. The "
        "paper leaves this to the CPU and asks that it stay small; the bar is 10 %% of a frame.");
    papers_note(table, "Frame and update are medians, selection and tiles means, %d frames, %d x %d pixels.",
                FRAMES, papers->width, papers->height);
    return true;
}

// ---- popping -----------------------------------------------------------------------------------

static double path_m(const struct scene *scene)
{
    enum { PARTS = 1024 };
    struct view view;
    double length_m = 0, last[3] = {0, 0, 0};
    for (int frame = 0; frame < PARTS; frame++) {
        double squares = 0;
        scene_view(scene, frame, PARTS, &view);
        for (int axis = 0; axis < 3; axis++) {
            squares += pow(view.eye_m[axis] - last[axis], 2);
            last[axis] = view.eye_m[axis];
        }
        length_m += frame > 0 ? sqrt(squares) : 0;
    }
    return length_m;
}

bool papers_geomipmap_motion(struct papers *papers, struct papers_table *table)
{
    static const char *const labels[] = {"levels change at once", "hysteresis 0.2", "vertices morph",
                                         "filtered levels (default)"};
    struct papers_flight flights[] = {
        {.type = &geomipmap_renderer, .knobs = {"heights", "samples"}},
        {.type = &geomipmap_renderer, .knobs = {"heights", "samples", "hysteresis", "0.2"}},
        {.type = &geomipmap_renderer, .knobs = {"heights", "samples", "morph", "on"}},
        {.type = &geomipmap_renderer},
    };
    enum { COUNT = sizeof labels / sizeof labels[0], LOOKS = 12, STEPS = 1024 };
    static const char *const names[] = {"frame", "draw",  "triangles", "error",
                                        "error", "moves", "moves",     "moves"};
    static const char *const units[] = {"ms",        "ms",       "thousand",  "px, mean",
                                        "px, p99.9", "px, mean", "px, p99.9", "px, most"};
    struct scene *scene = papers_detailed_scene(papers);
    snprintf(table->title, sizeof table->title, "Popping, and what morphing costs");
    snprintf(table->row_name, sizeof table->row_name, "17 x 17, tau 1");
    for (int c = 0; c < 8; c++) papers_column(table, names[c], units[c], false);
    if (!scene || !papers_fly(papers, scene, FRAMES, flights, COUNT)) return false;
    for (int f = 0; f < COUNT; f++) {
        struct papers_motion motion;
        if (!papers_look(papers, scene, &flights[f], LOOKS, STEPS, &motion)) return false;
        double *values = papers_row(table, "%s", labels[f]);
        values[0] = flights[f].frame_ms, values[1] = flights[f].draw_ms;
        values[2] = flights[f].triangles * 1e-3;
        values[3] = motion.error_mean_px, values[4] = motion.error_p999_px;
        values[5] = motion.mean_px, values[6] = motion.p999_px, values[7] = motion.max_px;
    }
    papers_note(
        table,
        "The paper lets levels change at once and prints no figure. Moves: how far drawn ground moves on "
        "the screen, the camera's motion taken out, while the eye goes on by %.1f m, from %d places of its "
        "path: temporal_px over small steps.",
        path_m(scene) / (LOOKS * STEPS), LOOKS);
    papers_note(table,
                "Hysteresis keeps levels from changing to and fro with the eye; on a path that goes on it "
                "only costs.");
    return true;
}

// ---- a large map on disk -----------------------------------------------------------------------

enum { LARGE_LEVELS = 3, LARGE_FRAMES = 48 };

struct large {
    char folder[32], path[64];
    struct scene *scene;
    struct renderer *renderer;
    struct gpu_target shaded, position;
    uint8_t *colours;
    float *places;
    double bytes, tile_bytes, textures; // most of a frame
    double prepare_ms;
    double ground, untextured; // pixels of all frames
};

static void large_finish(struct large *large)
{
    if (large->renderer) geomipmap_renderer.destroy(large->renderer);
    gpu_target_finish(&large->shaded);
    gpu_target_finish(&large->position);
    if (large->scene) scene_destroy(large->scene);
    if (large->folder[0]) unlink(large->path), rmdir(large->folder);
    free(large->colours);
    free(large->places);
}

// The Puget set with synthesised levels, as a file.
static bool pack_large(struct large *large, const char *source)
{
    struct terrain_options made = {.synthesize_levels = LARGE_LEVELS, .seed = PAPERS_SEED, .refine_bits = 1};
    struct terrain *terrain = terrain_load(source, &made);
    if (!terrain) return false;
    const struct terrain_info *info = terrain_info(terrain);
    struct terrain_level level = terrain_level(terrain, info->finest);
    struct heightfield field = {.name = "large",
                                .width = level.extent.x1 - level.extent.x0,
                                .height = level.extent.y1 - level.extent.y0,
                                .spacing_m = {level.spacing_m[0], level.spacing_m[1]},
                                .quantum_m = info->quantum_m,
                                .offset_m = info->offset_m};
    field.samples = malloc((size_t)field.width * (size_t)field.height * sizeof *field.samples);
    if (field.samples)
        terrain_window(terrain, info->finest, level.extent.x0, level.extent.y0, (int)field.width,
                       (int)field.height, field.samples, TERRAIN_WAIT);
    terrain_destroy(terrain);
    struct relief_pack_options options = {.layout = LAYOUT_BOUNDED, .max_m = 1};
    struct relief_header header;
    bool good = field.samples ? relief_pack(&field, &options, large->path, &header)
                              : fail("papers: no memory for the large map");
    heightfield_finish(&field);
    return good;
}

// An image of one colour, a pixel a cell: a pixel drawn in another one is not textured.
static struct scene_colour *paint(int side)
{
    struct scene_colour *colour = calloc(1, sizeof *colour);
    if (!colour) return NULL;
    *colour = (struct scene_colour){.name = "one colour", .width = side, .height = side};
    colour->pixels = malloc((size_t)side * (size_t)side * 4);
    for (size_t i = 0; colour->pixels && i < (size_t)side * (size_t)side; i++)
        memcpy(colour->pixels + 4 * i, (uint8_t[4]){200, 100, 50, 255}, 4);
    return colour;
}

static bool large_init(struct large *large, const struct papers *papers, const char *source,
                       double *ceiling_kib)
{
    strcpy(large->folder, "/tmp/relief-XXXXXX");
    if (!mkdtemp(large->folder)) return large->folder[0] = 0, fail("papers: /tmp cannot be written");
    snprintf(large->path, sizeof large->path, "%s/large.relief", large->folder);
    if (!pack_large(large, source)) return false;
    // Three quarters of a byte for each sample of the map are kept decoded.
    struct terrain_options options = {.cache_bytes = (uint64_t)3 << (2 * (10 + LARGE_LEVELS) - 2)};
    large->scene = papers_scene(papers, terrain_load(large->path, &options));
    if (!large->scene) return false;
    int side = 1 << (10 + LARGE_LEVELS);
    large->scene->effects.shading = SCENE_SHADING_OWN;
    large->scene->effects.colour = paint(side);
    if (!large->scene->effects.colour || !large->scene->effects.colour->pixels)
        return fail("papers: no memory for the image of the large map");
    struct renderer_desc desc = {.gpu = papers->gpu,
                                 .terrain = large->scene->terrain,
                                 .effects = &large->scene->effects,
                                 .width = papers->width,
                                 .height = papers->height};
    char kib[32];
    *ceiling_kib = (double)side * side * 4 / 8 / 1024;
    snprintf(kib, sizeof kib, "%.0f", *ceiling_kib);
    renderer_default_knobs(&geomipmap_renderer, desc.knobs);
    size_t pixels = (size_t)papers->width * (size_t)papers->height;
    large->colours = malloc(pixels * 4);
    large->places = malloc(pixels * 4 * sizeof *large->places);
    if (!large->colours || !large->places) return fail("papers: out of memory");
    if (!renderer_parse_knob(&geomipmap_renderer, "blend", "replace", desc.knobs) ||
        !renderer_parse_knob(&geomipmap_renderer, "textures", kib, desc.knobs) ||
        !gpu_target_init(papers->gpu, &large->shaded, papers->width, papers->height, GL_RGBA8) ||
        !gpu_target_init(papers->gpu, &large->position, papers->width, papers->height, GL_RGBA32F))
        return false;
    large->renderer = geomipmap_renderer.create(&desc);
    return large->renderer;
}

static void look(struct large *large, const struct papers *papers)
{
    gpu_target_begin(papers->gpu, &large->shaded);
    geomipmap_renderer.draw(large->renderer, 0, PASS_SHADED);
    gpu_target_read(papers->gpu, &large->shaded, large->colours);
    gpu_target_begin(papers->gpu, &large->position);
    geomipmap_renderer.draw(large->renderer, 0, PASS_POSITION);
    gpu_target_read(papers->gpu, &large->position, large->places);
    for (int i = 0; i < papers->width * papers->height; i++) {
        const uint8_t *c = large->colours + (size_t)4 * (size_t)i;
        if (large->places[4 * i + 3] == 0) continue;
        large->ground++;
        large->untextured += abs(c[0] - 200) > 1 || abs(c[1] - 100) > 1 || abs(c[2] - 50) > 1;
    }
}

static bool fly_large(struct large *large, const struct papers *papers)
{
    for (int frame = 0; frame < LARGE_FRAMES; frame++) {
        struct view view;
        struct renderer_stats stats;
        scene_view(large->scene, frame, LARGE_FRAMES, &view);
        geomipmap_renderer.begin_frame(large->renderer, frame);
        if (!geomipmap_renderer.update(large->renderer, &view, 1)) return false;
        gpu_set_view(papers->gpu, large->scene->terrain, &view);
        look(large, papers);
        geomipmap_renderer.stats(large->renderer, &stats);
        large->prepare_ms = stats.prepare_ms;
        large->bytes = fmax(large->bytes, papers_counter(stats.counters, "bytes_a_sample"));
        large->tile_bytes = fmax(large->tile_bytes, papers_counter(stats.counters, "tile_bytes_a_sample"));
        large->textures = fmax(large->textures, papers_counter(stats.counters, "texture_bytes"));
    }
    return true;
}

bool papers_geomipmap_large(struct papers *papers, struct papers_table *table)
{
    char path[1024];
    struct large large = {.bytes = 0};
    double ceiling_kib;
    int side = (1 << (10 + LARGE_LEVELS)) + 1;
    snprintf(table->title, sizeof table->title, "A large map with an image as large, from disk");
    snprintf(table->row_name, sizeof table->row_name, "map");
    static const char *const names[] = {"memory",   "memory",  "of it tiles",
                                        "textures", "ceiling", "untextured"};
    static const char *const units[] = {"B/sample", "B/sample", "B/sample", "KiB", "KiB", "pixels"};
    for (int c = 0; c < 6; c++) papers_column(table, names[c], units[c], c == 0);
    const char *source = papers_data(table, "puget_1k_160m.png", path);
    if (!source) return true;
    bool good = large_init(&large, papers, source, &ceiling_kib) && fly_large(&large, papers);
    if (good) {
        double *values = papers_row(table, "%d x %d, image of %d x %d", side, side, side - 1, side - 1);
        values[0] = 2.5;
        values[1] = large.bytes;
        values[2] = large.tile_bytes;
        values[3] = large.textures / 1024;
        values[4] = ceiling_kib;
        values[5] = large.untextured;
        papers_note(
            table,
            "Printed: less than this. All memory of terrain and tiles, the most of %d frames; heights are "
            "read through windows from a file within 1 m of the Puget Sound set at 160 m with %d "
            "synthesised levels. The image and its ceiling of an eighth of it are not counted.",
            LARGE_FRAMES, LARGE_LEVELS);
        papers_note(table,
                    "Preprocessing at load: %.2f s, the light map, of the finest level with at most 2^24 "
                    "samples. Tiles are measured when they are first seen, which the frames pay.",
                    large.prepare_ms / 1000);
        papers_note(table, "Untextured: of %.0f pixels of ground, at %d x %d.", large.ground, papers->width,
                    papers->height);
    }
    large_finish(&large);
    return good;
}
