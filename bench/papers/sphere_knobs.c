// Clasen & Hege 2006: what keeping transformed vertices gains (section 6.1), and what sizes of height
// textures and ways of filtering them cost and spoil (sections 4.2 and 5.2). SPDX-License-Identifier: MIT
#include "bench/papers/papers.h"
#include "bench/papers/sphere.h"
#include "clipmap/clipmap.h"
#include "common/report.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

// ---- kept vertices -----------------------------------------------------------

static bool kept_rows(struct papers *papers, struct terrain *earth, enum papers_sphere_view view, bool still,
                      struct papers_table *table)
{
    struct papers_flight flights[2] = {
        {.type = &clipmap_renderer, .knobs = {"n", "255", "keep", "off"}},
        {.type = &clipmap_renderer, .knobs = {"n", "255", "keep", "on"}},
    };
    struct scene scene;
    int frames = still ? 24 : 8;
    bool good = papers_sphere_scene(papers, earth, view, still, frames, &scene) &&
                papers_fly(papers, &scene, frames, flights, 2);
    if (good) {
        double *values = papers_row(table, "%s, %s", papers_sphere_label(view),
                                    still ? "the eye turns where it stands" : "the eye moves");
        for (int f = 0; f < 2; f++) values[f] = flights[f].draw_ms, values[f + 2] = flights[f].frame_ms;
        values[4] = flights[0].draw_ms / flights[1].draw_ms;
        values[5] = flights[0].frame_ms / flights[1].frame_ms;
        values[6] = flights[1].triangles * 1e-6;
    }
    path_destroy(scene.path);
    return good;
}

bool papers_sphere_kept(struct papers *papers, struct papers_table *table)
{
    static const char *const names[] = {"draw", "draw, kept", "frame",    "frame, kept",
                                        "gain", "gain",       "triangles"};
    static const char *const units[] = {"ms", "ms", "ms", "ms", "in drawing", "in frames", "million"};
    struct terrain *earth = NULL;
    snprintf(table->title, sizeof table->title, "Transformed vertices kept until the viewer moves");
    snprintf(table->row_name, sizeof table->row_name, "view");
    for (int c = 0; c < 7; c++) papers_column(table, names[c], units[c], false);
    if (!papers_sphere_earth(table, &earth)) return false;
    for (int k = 0; earth && k < 2 * PAPERS_SPHERE_VIEWS; k++)
        if (!kept_rows(papers, earth, (enum papers_sphere_view)(k / 2), k % 2 == 0, table))
            return terrain_destroy(earth), false;
    terrain_destroy(earth);
    papers_note(
        table,
        "Section 6.1 leaves to the future that \"the geometry clipmap had to be evaluated only once per "
        "change of the position of the viewer\" and prints no figure. Both ways are flown in turns. "
        "A moving eye keeps nothing, and its two rows tell the noise.");
    return true;
}

// ---- textures and filters ----------------------------------------------------

bool papers_sphere_sampling(struct papers *papers, struct papers_table *table)
{
    static const char *const names[] = {"frame", "update",   "draw",     "error",
                                        "error", "swimming", "swimming", "texels"};
    static const char *const units[] = {"ms",        "ms",       "ms",        "px, mean",
                                        "px, p99.9", "px, mean", "px, p99.9", "a frame"};
    static const struct {
        const char *label, *texture, *fetch;
    } settings[] = {
        {"n/8, four fetches, one level", "0.125", "four"},  {"n/4, four fetches, one level", "0.25", "four"},
        {"n/8, eight fetches", "0.125", "eight"},           {"n/4, eight fetches", "0.25", "eight"},
        {"n/8, its triangles", "0.125", "surface"},         {"n/4, its triangles", "0.25", "surface"},
        {"n/2, its triangles (default)", "0.5", "surface"}, {"n, its triangles", "1", "surface"},
    };
    enum { SETTINGS = sizeof settings / sizeof settings[0], FRAMES = 12, LOOKS = 4, STEPS = 64 };
    struct papers_flight flights[SETTINGS] = {{0}};
    struct terrain *earth = NULL;
    struct scene scene = {.path = NULL};
    snprintf(table->title, sizeof table->title,
             "Size and filtering of height textures: cost and aliasing, aircraft view");
    snprintf(table->row_name, sizeof table->row_name, "texels across a level, n = 512 azimuths");
    for (int c = 0; c < 8; c++) papers_column(table, names[c], units[c], false);
    if (!papers_sphere_earth(table, &earth)) return false;
    if (!earth) return true;
    for (int k = 0; k < SETTINGS; k++)
        flights[k] = (struct papers_flight){
            .type = &clipmap_renderer,
            .knobs = {"n", "255", "texture", settings[k].texture, "fetch", settings[k].fetch}};
    bool good = papers_sphere_scene(papers, earth, PAPERS_SPHERE_AIRCRAFT, false, FRAMES, &scene) &&
                papers_fly(papers, &scene, FRAMES, flights, SETTINGS);
    for (int k = 0; k < SETTINGS && good; k++) {
        double *values = papers_row(table, "%s", settings[k].label);
        values[0] = flights[k].frame_ms, values[1] = flights[k].update_ms, values[2] = flights[k].draw_ms;
        values[7] = papers_counter(flights[k].stats.counters, "samples updated");
        struct papers_motion motion;
        good = papers_look(papers, &scene, &flights[k], LOOKS, STEPS, &motion);
        if (!good) break;
        values[3] = motion.error_mean_px, values[4] = motion.error_p999_px;
        values[5] = motion.mean_px, values[6] = motion.p999_px;
    }
    path_destroy(scene.path);
    terrain_destroy(earth);
    papers_note(
        table,
        "Section 4.2 asks for n/8 to n/4; section 5.2 fetches four texels, eight where levels blend. "
        "Error: against the truth; it holds what is missing of the finest level, too. Swimming: how far "
        "drawn ground moves on the screen, the camera's motion taken out, while the eye goes on by a "
        "256th of its path: what aliasing looks like.");
    return good;
}
