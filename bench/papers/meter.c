// SPDX-License-Identifier: MIT
#include "bench/papers/meter.h"
#include "bench/error/flat.h"

#include <stdlib.h>

bool papers_meter_init(struct papers_meter *meter, const struct papers *papers, const struct scene *scene)
{
    int width = scene->width, height = scene->height;
    *meter = (struct papers_meter){.papers = papers,
                                   .scene = scene,
                                   .surface = truth_surface_create(scene->terrain),
                                   .positions = malloc((size_t)width * (size_t)height * 4 * sizeof(float))};
    return meter->surface && meter->positions && truth_init(&meter->truth, width, height) &&
           frame_error_init(&meter->error, width, height) &&
           gpu_target_init(papers->gpu, &meter->target, width, height, GL_RGBA32F);
}

void papers_meter_finish(struct papers_meter *meter)
{
    truth_surface_destroy(meter->surface);
    truth_finish(&meter->truth);
    frame_error_finish(&meter->error);
    gpu_target_finish(&meter->target);
    free(meter->positions);
}

bool papers_meter_draw(struct papers_meter *meter, struct renderer *renderer, const struct view *view,
                       struct places *places)
{
    struct gpu *gpu = meter->papers->gpu;
    struct flat_feeding feeding = {view->radius_m, places};
    if (!renderer->type->update(renderer, view, 1)) return false;
    gpu_set_view(gpu, meter->scene->terrain, view);
    gpu_target_begin(gpu, &meter->target);
    renderer->type->draw(renderer, 0, PASS_POSITION);
    gpu_target_read(gpu, &meter->target, meter->positions);
    if (!gpu_capture_begin(gpu, flat_receive, &feeding)) return false;
    renderer->type->draw(renderer, 0, PASS_DEPTH);
    gpu_capture_end(gpu);
    return true;
}

void papers_meter_measure(struct papers_meter *meter, const struct view *view, struct places *hits)
{
    frame_error_measure(&meter->error, meter->scene->terrain, view, &meter->truth, meter->positions, hits, 0);
}
