// Timed flights for the tables of the papers: the same frames for every setting, settings interleaved.
// SPDX-License-Identifier: MIT
#include "bench/machine.h"
#include "bench/papers/papers.h"
#include "bench/statistics.h"
#include "common/report.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_FLIGHTS = 16, DETAIL_LEVELS = 4 };

double papers_clock_ms(const struct papers *papers)
{
    return papers->cpu_times ? clock_thread_ms() : clock_wall_ms();
}

struct scene *papers_scene(const struct papers *papers, struct terrain *terrain)
{
    const double tan_half_horizontal = 1; // 90 degrees, as in section 9 of Losasso & Hoppe 2004
    struct scene *scene = terrain ? calloc(1, sizeof *scene) : NULL;
    if (!scene) return terrain_destroy(terrain), NULL;
    scene->terrain = terrain;
    scene->width = papers->width;
    scene->height = papers->height;
    scene->fov_vertical = 2 * atan(tan_half_horizontal * papers->height / papers->width);
    scene->path = path_for_terrain(terrain, 96, scene->fov_vertical);
    if (scene->path) return scene;
    scene_destroy(scene);
    return NULL;
}

struct scene *papers_detailed_scene(struct papers *papers)
{
    if (!papers->scene) {
        struct terrain_options options = {.synthesize_levels = DETAIL_LEVELS, .seed = PAPERS_SEED};
        papers->scene = papers_scene(papers, terrain_builtin(&options));
        if (papers->scene) papers->scene->effects.shading = SCENE_SHADING_OWN;
    }
    return papers->scene;
}

struct flying { // a setting in flight
    struct renderer *renderer;
    struct gpu_target target, resolved; // resolved: of a multisampled target
    double *frame_ms, *update_ms, *draw_ms;
    double *triangles; // a frame
};

static bool take_off(const struct papers *papers, const struct scene *scene, int frames,
                     const struct papers_flight *flight, struct flying *flying)
{
    struct renderer_desc desc = {.gpu = papers->gpu,
                                 .terrain = scene->terrain,
                                 .effects = &scene->effects,
                                 .width = scene->width,
                                 .height = scene->height};
    renderer_default_knobs(flight->type, desc.knobs);
    for (int k = 0; flight->knobs[k]; k += 2)
        if (!renderer_parse_knob(flight->type, flight->knobs[k], flight->knobs[k + 1], desc.knobs))
            return false;
    size_t times = (size_t)papers->repeats * (size_t)frames;
    flying->frame_ms = malloc(3 * times * sizeof *flying->frame_ms);
    flying->triangles = calloc((size_t)frames, sizeof *flying->triangles);
    if (!flying->frame_ms || !flying->triangles) return fail("papers: out of memory");
    flying->update_ms = flying->frame_ms + times;
    flying->draw_ms = flying->update_ms + times;
    flying->renderer = flight->type->create(&desc);
    return flying->renderer &&
           gpu_target_init_multisampled(papers->gpu, &flying->target, scene->width, scene->height, GL_RGBA8,
                                        flight->samples) &&
           (!flight->samples ||
            gpu_target_init(papers->gpu, &flying->resolved, scene->width, scene->height, GL_RGBA8));
}

static void land(const struct papers_flight *flight, struct flying *flying)
{
    if (flying->renderer) flight->type->destroy(flying->renderer);
    gpu_target_finish(&flying->target);
    gpu_target_finish(&flying->resolved);
    free(flying->frame_ms);
    free(flying->triangles);
}

// One flight; repeat < 0: untimed.  The first frame is drawn once untimed, so that none pays for the jump
// back.
static bool fly_once(const struct papers *papers, const struct scene *scene, int frames,
                     struct papers_flight *flight, struct flying *flying, int repeat)
{
    for (int i = -1; i < frames; i++) {
        struct view view;
        int frame = i < 0 ? 0 : i;
        scene_view(scene, frame, frames, &view);
        gpu_finish(papers->gpu);
        double start = papers_clock_ms(papers);
        flight->type->begin_frame(flying->renderer, frame);
        if (!flight->type->update(flying->renderer, &view, 1) || terrain_failed(scene->terrain)) return false;
        double updated = papers_clock_ms(papers);
        gpu_set_view(papers->gpu, scene->terrain, &view);
        gpu_target_begin(papers->gpu, &flying->target);
        flight->type->draw(flying->renderer, 0, PASS_SHADED);
        if (flight->samples) gpu_target_resolve(papers->gpu, &flying->target, &flying->resolved);
        gpu_finish(papers->gpu);
        double end = papers_clock_ms(papers);
        flight->type->stats(flying->renderer, &flight->stats);
        if (i < 0 || repeat < 0) continue;
        size_t at = (size_t)repeat * (size_t)frames + (size_t)i;
        flying->frame_ms[at] = end - start;
        flying->update_ms[at] = updated - start;
        flying->draw_ms[at] = end - updated;
        flying->triangles[i] = (double)flight->stats.triangles;
        flight->select_ms += flight->stats.select_ms / ((double)papers->repeats * (double)frames);
        for (int c = 0; c < RENDERER_MAX_COUNTERS && flight->stats.counters[c].name; c++) {
            flight->counters[c].name = flight->stats.counters[c].name;
            flight->counters[c].value +=
                flight->stats.counters[c].value / ((double)papers->repeats * (double)frames);
        }
    }
    return true;
}

static bool summarise(const struct papers *papers, int frames, struct papers_flight *flight,
                      const struct flying *flying)
{
    double *least = malloc((size_t)frames * sizeof *least), triangles = 0, ms = 0;
    if (!least) return fail("papers: out of memory");
    minimum_over_repeats(flying->frame_ms, papers->repeats, frames, least);
    for (int i = 0; i < frames; i++) {
        triangles += flying->triangles[i];
        ms += least[i];
    }
    free(least);
    flight->triangles = triangles / frames;
    flight->triangles_per_s = triangles / (ms * 1e-3);
    flight->frame_ms = summarize_times(flying->frame_ms, papers->repeats, frames, PAPERS_SEED).median;
    flight->update_ms = summarize_times(flying->update_ms, papers->repeats, frames, PAPERS_SEED).median;
    flight->draw_ms = summarize_times(flying->draw_ms, papers->repeats, frames, PAPERS_SEED).median;
    return true;
}

bool papers_fly(const struct papers *papers, const struct scene *scene, int frames,
                struct papers_flight *flights, int count)
{
    struct flying flying[MOST_FLIGHTS] = {0};
    struct random_state random = {PAPERS_SEED};
    int order[MOST_FLIGHTS];
    bool good = count <= MOST_FLIGHTS || fail("papers: more than %d settings at a time", MOST_FLIGHTS);
    for (int f = 0; f < count && good; f++) {
        order[f] = f;
        good = take_off(papers, scene, frames, &flights[f], &flying[f]) &&
               fly_once(papers, scene, frames, &flights[f], &flying[f], -1);
    }
    for (int repeat = 0; repeat < papers->repeats && good; repeat++) {
        random_shuffle(&random, order, count);
        for (int k = 0; k < count && good; k++)
            good = fly_once(papers, scene, frames, &flights[order[k]], &flying[order[k]], repeat);
    }
    for (int f = 0; f < count && good; f++) good = summarise(papers, frames, &flights[f], &flying[f]);
    for (int f = 0; f < count && f < MOST_FLIGHTS; f++) land(&flights[f], &flying[f]);
    return good;
}

double papers_counter(const struct renderer_counter *counters, const char *name)
{
    for (int c = 0; c < RENDERER_MAX_COUNTERS && counters[c].name; c++)
        if (strcmp(counters[c].name, name) == 0) return counters[c].value;
    return NAN;
}
