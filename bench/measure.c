// The error passes: truth is cast once a frame and shared by all settings; then each setting's position pass
// and captured triangles are held against it.  No clock runs here but that of roofline_ms.
// SPDX-License-Identifier: MIT
#include "bench/error/flat.h"
#include "bench/error/ridges.h"
#include "bench/machine.h"
#include "bench/run.h"
#include "common/report.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { TEMPORAL_PLACES = 16384, ROOFLINE_REPEATS = 3 };

struct measure { // of one frame, shared by all settings
    struct truth_surface *surface;
    struct truth truth;
    struct view view;
    int frame;
    struct places *hits;     // over the truth's ground pixels
    struct places *previous; // over the temporal places of the frame before; NULL on the first
    size_t temporal_count, previous_count;
    double (*temporal_world)[3],
        (*previous_world)[3]; // places of this frame and of the one before, world, metres
    size_t *temporal_hit;     // which hit each temporal place is
    double previous_eye_height;
    struct frame_error error;
    float *positions;
    struct ridges ridges;
    uint8_t *picture;
    struct roofline *roofline;
};

static void measure_finish(struct measure *measure)
{
    truth_surface_destroy(measure->surface);
    truth_finish(&measure->truth);
    places_destroy(measure->hits);
    places_destroy(measure->previous);
    frame_error_finish(&measure->error);
    ridges_finish(&measure->ridges);
    roofline_destroy(measure->roofline);
    free(measure->temporal_world);
    free(measure->previous_world);
    free(measure->temporal_hit);
    free(measure->positions);
    free(measure->picture);
}

static bool measure_init(struct measure *measure, struct run *run)
{
    size_t pixels = (size_t)run->scene->width * (size_t)run->scene->height;
    *measure =
        (struct measure){.surface = truth_surface_create(run->truth ? run->truth : run->scene->terrain)};
    if (!measure->surface) return false;
    measure->temporal_world = malloc(TEMPORAL_PLACES * sizeof *measure->temporal_world);
    measure->previous_world = malloc(TEMPORAL_PLACES * sizeof *measure->previous_world);
    measure->temporal_hit = malloc(TEMPORAL_PLACES * sizeof *measure->temporal_hit);
    measure->positions = malloc(pixels * 4 * sizeof *measure->positions);
    measure->picture = malloc(pixels * 4);
    if (!measure->temporal_world || !measure->previous_world || !measure->temporal_hit ||
        !measure->positions || !measure->picture ||
        !truth_init(&measure->truth, run->scene->width, run->scene->height) ||
        !frame_error_init(&measure->error, run->scene->width, run->scene->height))
        return fail("out of memory");
    measure->roofline =
        roofline_create(run->gpu, terrain_info(run->scene->terrain)->datum, &run->scene->effects);
    return measure->roofline != NULL;
}

// Places at which the next frame looks again: evenly strided over the truth's hits.
static void choose_temporal_places(struct measure *measure)
{
    double(*swap)[3] = measure->previous_world;
    measure->previous_world = measure->temporal_world;
    measure->previous_count = measure->temporal_count;
    measure->temporal_world = swap;
    measure->temporal_count = 0;
    uint64_t stride = measure->truth.ground / TEMPORAL_PLACES + 1, hit = 0;
    for (size_t p = 0; p < (size_t)measure->truth.width * (size_t)measure->truth.height; p++) {
        const struct truth_pixel *pixel = &measure->truth.pixels[p];
        if (!(pixel->depth > 0)) continue;
        if (hit % stride == 0) {
            view_world(&measure->view, pixel->relative, measure->temporal_world[measure->temporal_count]);
            measure->temporal_hit[measure->temporal_count++] = hit;
        }
        hit++;
    }
}

// A place in the world, flattened for this frame's eye.
static void flat_place(const struct measure *measure, const double world[3], double flat[3])
{
    const struct view *view = &measure->view;
    double apart[3], relative[3] = {0, 0, 0};
    for (int k = 0; k < 3; k++) apart[k] = world[k] - view->eye_m[k];
    for (int axis = 0; axis < 3; axis++)
        for (int k = 0; k < 3; k++) relative[axis] += apart[k] * view->axes[axis][k];
    flat_from_relative(view->radius_m, relative, flat);
}

static bool begin_frame(struct measure *measure, struct run *run, int frame)
{
    scene_view(run->scene, frame, run->frames, &measure->view);
    measure->frame = frame;
    truth_cast(&measure->truth, measure->surface, &measure->view, run->options.threads);
    places_destroy(measure->hits);
    places_destroy(measure->previous);
    measure->previous = NULL;
    measure->hits = truth_places(&measure->truth, run->options.threads);
    choose_temporal_places(measure);
    if (measure->previous_count) {
        double(*xy)[2] = malloc(measure->previous_count * sizeof *xy);
        for (size_t k = 0; xy && k < measure->previous_count; k++) {
            double flat[3];
            flat_place(measure, measure->previous_world[k], flat);
            for (int axis = 0; axis < 2; axis++) xy[k][axis] = flat[axis];
        }
        measure->previous =
            xy ? places_create((const double(*)[2])xy, measure->previous_count, run->options.threads) : NULL;
        free(xy);
        if (!measure->previous) return fail("out of memory");
    }
    return measure->hits || fail("out of memory");
}

static void receive_triangles(const float *triangles, size_t count, void *user)
{
    struct measure *measure = user;
    double radius_m = measure->view.radius_m;
    flat_feed(radius_m, triangles, count, measure->hits);
    if (measure->previous) flat_feed(radius_m, triangles, count, measure->previous);
    roofline_feed(triangles, count, measure->roofline);
    ridges_feed(&measure->ridges, triangles, count);
}

// Ground that moved on the screen though only the camera should have moved: |drawn height now - drawn height
// a frame ago| at the same place, projected by this frame's view.
static bool measure_temporal(struct measure *measure, struct setting *setting, struct frame_record *record,
                             bool consecutive)
{
    const struct view *view = &measure->view;
    struct error_samples frame = {0};
    bool good = true;
    record->temporal_px_p999 = NAN;
    if (consecutive && setting->previous_height && measure->previous) {
        for (size_t k = 0; k < measure->previous_count && good; k++) {
            double low, high, length_px, flat[3], relative[3], step[3], pixel[2], radius_m = view->radius_m;
            double before = setting->previous_height[k] - view->eye_place[2];
            if (isnan(before) || !places_height(measure->previous, k, &low, &high)) continue;
            flat_place(measure, measure->previous_world[k], flat);
            flat[2] = low;
            double now = flat_rise(radius_m, flat);
            flat_point(radius_m, flat, now, relative);
            if (!view_project(&measure->view, relative, pixel) || pixel[0] < 0 || pixel[1] < 0 ||
                pixel[0] > measure->view.width || pixel[1] > measure->view.height)
                continue; // left the picture
            flat_up(radius_m, flat, step);
            for (int axis = 0; axis < 3; axis++) step[axis] *= before - now;
            if (!view_project_segment(view, relative, step, &length_px)) continue;
            float value = (float)length_px;
            good =
                error_samples_add(&frame, &value, 1) && error_samples_add(&setting->temporal_px, &value, 1);
        }
        if (frame.count) record->temporal_px_p999 = error_samples_summary(&frame).p999;
    }
    if (!setting->previous_height) setting->previous_height = malloc(TEMPORAL_PLACES * sizeof(double));
    for (size_t k = 0; setting->previous_height && k < measure->temporal_count; k++) {
        double low, high;
        bool drawn = places_height(measure->hits, measure->temporal_hit[k], &low, &high);
        double flat[3];
        flat_place(measure, measure->temporal_world[k], flat);
        flat[2] = low;
        setting->previous_height[k] =
            drawn ? flat_rise(view->radius_m, flat) + view->eye_place[2] : (double)NAN;
    }
    error_samples_finish(&frame);
    return good && setting->previous_height;
}

static void keep_snapshot(struct measure *measure, struct setting *setting, enum moment moment,
                          double error_px_p999)
{
    struct snapshot *snapshot = &setting->snapshots[moment];
    size_t pixels = (size_t)measure->truth.width * (size_t)measure->truth.height;
    if (!snapshot->picture) snapshot->picture = malloc(pixels * 4);
    if (!snapshot->error) snapshot->error = malloc(pixels * 3);
    if (!snapshot->picture || !snapshot->error) return; // a report without this picture
    memcpy(snapshot->picture, measure->picture, pixels * 4);
    frame_error_picture(&measure->error, snapshot->error);
    snapshot->frame = measure->frame;
    snapshot->error_px_p999 = error_px_p999;
}

static void keep_snapshots(struct measure *measure, struct setting *setting, int i, double error_px_p999)
{
    if (i == 0) keep_snapshot(measure, setting, MOMENT_START, error_px_p999);
    if (i == setting->frame_count / 2) keep_snapshot(measure, setting, MOMENT_MIDDLE, error_px_p999);
    if (i == 0 || error_px_p999 > setting->snapshots[MOMENT_WORST].error_px_p999)
        keep_snapshot(measure, setting, MOMENT_WORST, error_px_p999);
}

static double time_roofline(struct measure *measure, struct run *run)
{
    double least = NAN;
    if (!roofline_build(measure->roofline)) return least;
    for (int repeat = 0; repeat < ROOFLINE_REPEATS; repeat++) {
        gpu_finish(run->gpu);
        double start = run->cpu_times ? clock_thread_ms() : clock_wall_ms();
        gpu_set_view(run->gpu, run->scene->terrain, &measure->view);
        gpu_target_begin(run->gpu, &run->shaded);
        roofline_draw(measure->roofline);
        gpu_finish(run->gpu);
        double time = (run->cpu_times ? clock_thread_ms() : clock_wall_ms()) - start;
        if (!(time > least)) least = time;
    }
    return least;
}

// What the pipeline itself counted of a draw: an independent witness of the renderer's own number.
struct witness {
    GLuint generated, clipped; // queries; clipped is 0 where the driver has no pipeline statistics
};

static struct witness witness_begin(struct run *run)
{
    struct witness witness = {0};
    glGenQueries(1, &witness.generated);
    glBeginQuery(GL_PRIMITIVES_GENERATED, witness.generated);
    if (gpu_info(run->gpu)->pipeline_statistics) {
        glGenQueries(1, &witness.clipped);
        glBeginQuery(GL_CLIPPING_OUTPUT_PRIMITIVES_ARB, witness.clipped);
    }
    return witness;
}

static void witness_end(struct witness *witness, struct frame_record *record)
{
    GLuint64 count = 0;
    glEndQuery(GL_PRIMITIVES_GENERATED);
    glGetQueryObjectui64v(witness->generated, GL_QUERY_RESULT, &count);
    record->generated_triangles = (double)count;
    record->clipped_triangles = NAN;
    if (witness->clipped) {
        glEndQuery(GL_CLIPPING_OUTPUT_PRIMITIVES_ARB);
        glGetQueryObjectui64v(witness->clipped, GL_QUERY_RESULT, &count);
        record->clipped_triangles = (double)count;
        glDeleteQueries(1, &witness->clipped);
    }
    glDeleteQueries(1, &witness->generated);
}

// Draws the frame in the three ways that are measured: shaded (its hash and snapshot), position, captured.
static bool draw_passes(struct measure *measure, struct run *run, struct setting *setting, int i)
{
    const struct renderer_type *type = setting->type;
    struct frame_record *record = &setting->records[i];
    struct renderer_stats stats;
    gpu_reset_counters(run->gpu);
    type->begin_frame(setting->renderer, measure->frame);
    if (!type->update(setting->renderer, &measure->view, 1)) return false;
    gpu_set_view(run->gpu, run->scene->terrain, &measure->view);
    gpu_target_begin(run->gpu, &run->shaded);
    struct witness witness = witness_begin(run);
    type->draw(setting->renderer, 0, PASS_SHADED);
    witness_end(&witness, record);
    type->stats(setting->renderer, &stats);
    struct gpu_counters counted = gpu_counters(run->gpu);
    record->triangles = (double)stats.triangles;
    record->draw_calls = (double)counted.draw_calls;
    record->upload_bytes = (double)counted.upload_bytes;
    if (stats.resident_bytes > setting->resident_bytes) setting->resident_bytes = stats.resident_bytes;
    if (run->truth) stats.claimed_error_px = NAN; // it promises nothing about another map
    record->claimed_px = stats.claimed_error_px;
    if (!(setting->claimed_px >= stats.claimed_error_px)) setting->claimed_px = stats.claimed_error_px;
    for (int c = 0; c < RENDERER_MAX_COUNTERS && stats.counters[c].name; c++) {
        setting->counters[c].name = stats.counters[c].name;
        setting->counters[c].value += stats.counters[c].value;
    }
    gpu_target_read(run->gpu, &run->shaded, measure->picture);
    sha256_hex(measure->picture, (size_t)run->scene->width * (size_t)run->scene->height * 4,
               (char *)setting->picture_digests + 65 * (size_t)i);
    gpu_target_begin(run->gpu, &run->position);
    type->draw(setting->renderer, 0, PASS_POSITION);
    gpu_target_read(run->gpu, &run->position, measure->positions);
    places_clear(measure->hits);
    if (measure->previous) places_clear(measure->previous);
    if (!ridges_begin(&measure->ridges, &measure->view, measure->positions)) return false;
    roofline_begin(measure->roofline, &measure->view);
    if (!gpu_capture_begin(run->gpu, receive_triangles, measure)) return false;
    type->draw(setting->renderer, 0, PASS_DEPTH);
    gpu_capture_end(run->gpu);
    record->visible_triangles = (double)roofline_visible(measure->roofline);
    return true;
}

// The largest error of the frame that is certain.  A miss or spill of d rows puts a skyline between d - 1 and
// d pixels off: pixel centres cannot tell it better.  A claim is broken only by what is certain.
static double certain_error_px(const struct frame_error *error)
{
    double most = 0;
    for (size_t p = 0; p < (size_t)error->width * (size_t)error->height; p++) {
        double value = (double)error->error_px[p];
        if (error->kind[p] == PIXEL_MISS || error->kind[p] == PIXEL_SPILL) value -= 1;
        if (value > most) most = value;
    }
    return most;
}

static bool record_errors(struct measure *measure, struct run *run, struct setting *setting, int i,
                          double claimed_px)
{
    struct frame_record *record = &setting->records[i];
    struct frame_error *error = &measure->error;
    size_t pixels = (size_t)error->width * (size_t)error->height;
    frame_error_measure(error, run->truth ? run->truth : run->scene->terrain, &measure->view, &measure->truth,
                        measure->positions, measure->hits, run->options.threads);
    struct error_samples frame = {0};
    if (!error_samples_add(&frame, error->error_px, pixels) ||
        !error_samples_add(&setting->error_px, error->error_px, pixels) ||
        !error_samples_add(&setting->plane_px, error->plane_px, pixels)) {
        error_samples_finish(&frame);
        return fail("out of memory for error samples");
    }
    struct error_summary summary = error_samples_summary(&frame);
    error_samples_finish(&frame);
    record->error_px_mean = summary.mean;
    record->error_px_p999 = summary.p999;
    record->error_px_max = summary.max;
    record->ground = (double)error->ground;
    record->holes = (double)error->holes;
    record->misses = (double)error->misses;
    record->spills = (double)error->spills;
    record->order_mismatches = (double)error->order_mismatches;
    record->order_beyond_grid =
        setting->type == &brute_renderer
            ? (double)frame_error_order_beyond_grid(error, &measure->truth, measure->surface, &measure->view,
                                                    measure->positions)
            : (double)NAN;
    record->error_px_certain = certain_error_px(error);
    if (!isnan(claimed_px) && record->error_px_certain > claimed_px + 1e-3)
        setting->claim_broken_frames++; // 1e-3 px: the method's floor
    keep_snapshots(measure, setting, i, summary.p999);
    return true;
}

static bool measure_setting(struct measure *measure, struct run *run, struct setting *setting, int i)
{
    struct renderer_stats stats;
    if (!draw_passes(measure, run, setting, i)) return false;
    setting->type->stats(setting->renderer, &stats);
    if (!record_errors(measure, run, setting, i, stats.claimed_error_px)) return false;
    bool consecutive = i > 0 && setting->frames[i] == setting->frames[i - 1] + 1;
    if (!measure_temporal(measure, setting, &setting->records[i], consecutive)) return fail("out of memory");
    setting->records[i].roofline_ms = time_roofline(measure, run);
    return true;
}

static void blank_errors(struct setting *setting)
{
    for (int i = 0; i < setting->frame_count; i++) {
        struct frame_record *record = &setting->records[i];
        record->generated_triangles = record->clipped_triangles = record->roofline_ms = record->triangles =
            record->visible_triangles = record->draw_calls = record->upload_bytes = record->error_px_mean =
                record->error_px_p999 = record->error_px_max = record->temporal_px_p999 = record->claimed_px =
                    record->error_px_certain = record->ground = record->holes = record->misses =
                        record->spills = record->order_mismatches = record->order_beyond_grid = NAN;
    }
}

static bool measure_frame(struct measure *measure, struct run *run, int frame, int *next)
{
    bool wanted = false;
    for (int s = 0; s < run->setting_count; s++) {
        const struct setting *setting = &run->settings[s];
        if (setting->type == &null_renderer) continue; // draws nothing: there is nothing to measure
        wanted = wanted || (next[s] < setting->frame_count && setting->frames[next[s]] == frame);
    }
    if (!wanted) return true;
    if (!begin_frame(measure, run, frame)) return false;
    for (int s = 0; s < run->setting_count && !*run->interrupted; s++) {
        struct setting *setting = &run->settings[s];
        if (setting->type == &null_renderer || next[s] >= setting->frame_count ||
            setting->frames[next[s]] != frame)
            continue;
        if (!measure_setting(measure, run, setting, next[s]) || terrain_failed(run->scene->terrain))
            return false;
        next[s]++;
        setting->measured = next[s] == setting->frame_count;
        progress_add(&run->progress, setting->expected_ms * 6 + 150);
    }
    return true;
}

bool measure_errors(struct run *run)
{
    struct measure measure;
    int next[MAX_SETTINGS] = {0};
    bool good = measure_init(&measure, run);
    for (int s = 0; s < run->setting_count && good; s++) {
        struct setting *setting = &run->settings[s];
        blank_errors(setting);
        setting->picture_digests = calloc((size_t)setting->frame_count, 65);
        good = setting->picture_digests || fail("out of memory");
        if (setting->type != &null_renderer)
            progress_expect(&run->progress, (setting->expected_ms * 6 + 150) * setting->frame_count);
    }
    if (good) progress_phase(&run->progress, "measuring errors");
    for (int frame = 0; frame < run->frames && good && !*run->interrupted; frame++)
        good = measure_frame(&measure, run, frame, next);
    for (int s = 0; s < run->setting_count && good; s++) {
        struct setting *setting = &run->settings[s];
        if (setting->measured)
            sha256_hex(setting->picture_digests, 65 * (size_t)setting->frame_count, setting->pictures_sha256);
    }
    measure_finish(&measure);
    return good;
}
