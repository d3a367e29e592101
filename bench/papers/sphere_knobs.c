// Clasen & Hege 2006: what keeping transformed vertices gains (section 6.1), and what sizes of height
// textures and ways of filtering them cost and spoil (sections 4.2 and 5.2). SPDX-License-Identifier: MIT
#include "bench/error/flat.h"
#include "bench/error/samples.h"
#include "bench/papers/meter.h"
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

struct samples { // over frames
    struct error_samples errors, swims;
};

// Where hit number k of the view before lies in the flattened coordinates of another.
static void carry(const struct truth_pixel *pixel, const struct view *from, const struct view *to,
                  double flat[3])
{
    double world[3], relative[3] = {0, 0, 0};
    view_world(from, pixel->relative, world);
    for (int axis = 0; axis < 3; axis++)
        for (int k = 0; k < 3; k++) relative[axis] += (world[k] - to->eye_m[k]) * to->axes[axis][k];
    flat_from_relative(to->radius_m, relative, flat);
}

static bool add_swims(const struct truth *truth, const struct view *before, const struct places *hits,
                      const struct view *now, const struct places *moved, struct error_samples *swims)
{
    bool good = true;
    for (size_t p = 0, hit = 0; p < (size_t)before->width * (size_t)before->height && good; p++) {
        const struct truth_pixel *pixel = &truth->pixels[p];
        double flat[3], low[2], high, relative[3], step[3], length_px, rise[2];
        if (!(pixel->depth > 0)) continue;
        size_t k = hit++;
        if (!places_height(hits, k, &low[0], &high) || !places_height(moved, k, &low[1], &high)) continue;
        flat_from_relative(before->radius_m, pixel->relative, flat);
        flat[2] = low[0];
        rise[0] = flat_rise(before->radius_m, flat) + before->eye_place[2];
        carry(pixel, before, now, flat);
        flat[2] = low[1];
        rise[1] = flat_rise(now->radius_m, flat) + now->eye_place[2];
        flat_point(now->radius_m, flat, rise[1] - now->eye_place[2], relative);
        flat_up(now->radius_m, flat, step);
        for (int axis = 0; axis < 3; axis++) step[axis] *= rise[0] - rise[1];
        if (!view_project_segment(now, relative, step, &length_px)) continue;
        float value = (float)length_px;
        good = error_samples_add(swims, &value, 1);
    }
    return good || fail("papers: out of memory");
}

static struct places *carried_places(const struct truth *truth, const struct view *before,
                                     const struct view *now)
{
    double(*flat)[2] = malloc((size_t)truth->ground * sizeof *flat), at[3];
    size_t count = 0;
    for (size_t p = 0; flat && p < (size_t)before->width * (size_t)before->height; p++) {
        if (!(truth->pixels[p].depth > 0)) continue;
        carry(&truth->pixels[p], before, now, at);
        flat[count][0] = at[0], flat[count++][1] = at[1];
    }
    struct places *places = flat ? places_create((const double(*)[2])flat, count, 0) : NULL;
    free(flat);
    return places;
}

// One frame's error, and how far ground moves on the screen when the eye goes on by a 64th of a frame's way.
static bool measure_frame(struct papers_meter *meter, struct renderer *renderer, int frame, int frames,
                          struct samples *samples)
{
    enum { FINE = 64 };
    struct view view, next;
    scene_view(meter->scene, frame * FINE, frames * FINE, &view);
    scene_view(meter->scene, frame * FINE + 1, frames * FINE, &next);
    truth_cast(&meter->truth, meter->surface, &view, 0);
    struct places *hits = truth_places(&meter->truth, 0),
                  *moved = carried_places(&meter->truth, &view, &next);
    bool good = (hits && moved) || fail("papers: out of memory");
    renderer->type->begin_frame(renderer, 2 * frame);
    good = good && papers_meter_draw(meter, renderer, &view, hits);
    if (good) {
        papers_meter_measure(meter, &view, hits);
        good = error_samples_add(&samples->errors, meter->error.error_px,
                                 (size_t)view.width * (size_t)view.height);
        renderer->type->begin_frame(renderer, 2 * frame + 1);
        good = good && papers_meter_draw(meter, renderer, &next, moved) &&
               add_swims(&meter->truth, &view, hits, &next, moved, &samples->swims);
    }
    places_destroy(hits);
    places_destroy(moved);
    return good;
}

static bool measure_setting(struct papers *papers, const struct scene *scene,
                            const struct papers_flight *flight, double values[8])
{
    enum { LOOKS = 4 };
    struct renderer_desc desc = {.gpu = papers->gpu,
                                 .terrain = scene->terrain,
                                 .effects = &scene->effects,
                                 .width = scene->width,
                                 .height = scene->height};
    struct papers_meter meter;
    struct samples samples = {.errors = {.most = 1 << 22}, .swims = {.most = 1 << 22}};
    renderer_default_knobs(flight->type, desc.knobs);
    for (int k = 0; flight->knobs[k]; k += 2)
        if (!renderer_parse_knob(flight->type, flight->knobs[k], flight->knobs[k + 1], desc.knobs))
            return false;
    struct renderer *renderer = flight->type->create(&desc);
    bool good = papers_meter_init(&meter, papers, scene) && renderer;
    for (int look = 0; look < LOOKS && good; look++)
        good = measure_frame(&meter, renderer, look, LOOKS, &samples);
    if (good) {
        struct error_summary error = error_samples_summary(&samples.errors),
                             swim = error_samples_summary(&samples.swims);
        values[3] = error.mean, values[4] = error.p999, values[5] = swim.mean, values[6] = swim.p999;
    }
    error_samples_finish(&samples.errors);
    error_samples_finish(&samples.swims);
    papers_meter_finish(&meter);
    if (renderer) flight->type->destroy(renderer);
    return good;
}

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
    enum { SETTINGS = sizeof settings / sizeof settings[0], FRAMES = 12 };
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
        good = measure_setting(papers, &scene, &flights[k], values);
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
