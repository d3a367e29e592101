// How wrong a setting's ground is, and how far it moves on the screen while the eye goes on by a small step:
// popping and swimming.
// SPDX-License-Identifier: MIT
#include "bench/error/flat.h"
#include "bench/error/samples.h"
#include "bench/papers/meter.h"
#include "common/report.h"

#include <stdlib.h>

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

// One frame's error, and how far ground moves on the screen when the eye goes on by a step.
static bool measure_frame(struct papers_meter *meter, struct renderer *renderer, int look, int looks,
                          int steps, struct samples *samples)
{
    struct view view, next;
    scene_view(meter->scene, look * steps, looks * steps, &view);
    scene_view(meter->scene, look * steps + 1, looks * steps, &next);
    truth_cast(&meter->truth, meter->surface, &view, 0);
    struct places *hits = truth_places(&meter->truth, 0),
                  *moved = carried_places(&meter->truth, &view, &next);
    bool good = (hits && moved) || fail("papers: out of memory");
    renderer->type->begin_frame(renderer, 2 * look);
    good = good && papers_meter_draw(meter, renderer, &view, hits);
    if (good) {
        papers_meter_measure(meter, &view, hits);
        good = error_samples_add(&samples->errors, meter->error.error_px,
                                 (size_t)view.width * (size_t)view.height);
        renderer->type->begin_frame(renderer, 2 * look + 1);
        good = good && papers_meter_draw(meter, renderer, &next, moved) &&
               add_swims(&meter->truth, &view, hits, &next, moved, &samples->swims);
    }
    places_destroy(hits);
    places_destroy(moved);
    return good;
}

bool papers_look(const struct papers *papers, const struct scene *scene, const struct papers_flight *flight,
                 int looks, int steps, struct papers_motion *motion)
{
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
    for (int look = 0; look < looks && good; look++)
        good = measure_frame(&meter, renderer, look, looks, steps, &samples);
    if (good) {
        struct error_summary error = error_samples_summary(&samples.errors),
                             swim = error_samples_summary(&samples.swims);
        *motion = (struct papers_motion){error.mean, error.p999, swim.mean, swim.p999, swim.max};
    }
    error_samples_finish(&samples.errors);
    error_samples_finish(&samples.swims);
    papers_meter_finish(&meter);
    if (renderer) flight->type->destroy(renderer);
    return good;
}
