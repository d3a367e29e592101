// What Brodersen 2005 prints: memory of the index sets, bytes a sample, the rate, tile sizes, one draw call
// against five.
// SPDX-License-Identifier: MIT
#include "bench/papers.h"
#include "common/report.h"
#include "geomipmap/geomipmap.h"
#include "geomipmap/geomipmap_mesh.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

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
                "without area, from a greedy search; the paper does not say how its own are made.");
    papers_note(table,
                "The five regions as strips: here two corner triangles lie on two sides, since every cell "
                "keeps the diagonal of the terrain, and their regions are stored for two neighbours; the "
                "paper's corners must turn their diagonal, so that its level 0 is not the terrain.");
    return true;
}

// ---- flights -----------------------------------------------------------------------------------

static double counter(const struct renderer_stats *stats, const char *name)
{
    for (int c = 0; c < RENDERER_MAX_COUNTERS && stats->counters[c].name; c++)
        if (strcmp(stats->counters[c].name, name) == 0) return stats->counters[c].value;
    return NAN;
}

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
        values[7] = counter(&flights[f].stats, "tile_bytes_a_sample");
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
                counter(&flights[0].stats, "bytes_a_sample") -
                    counter(&flights[0].stats, "tile_bytes_a_sample"));
    papers_note(
        table,
        "Most tiles draw their 8 coarsest triangles here, so that tau saves few: tiles that merge do.");
    papers_note(table, "Removal breaks tau: the border of a tile is then as wrong as its neighbour's level.");
    return true;
}
