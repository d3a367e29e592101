// One row of results.json: a renderer at one setting.
// SPDX-License-Identifier: MIT
#include "bench/result_files.h"
#include "bench/result_parts.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define COUNT(array) ((int)(sizeof(array) / sizeof(array)[0]))

// ---- fields of the frames ----------------------------------------------------------------------

typedef double field_of(const struct frame_record *record);
#define FIELD(name)                                                                                          \
    static double get_##name(const struct frame_record *record)                                              \
    {                                                                                                        \
        return record->name;                                                                                 \
    }
FIELD(frame_ms)
FIELD(roofline_ms)
FIELD(gpu_ms)
FIELD(throughput_ms)
FIELD(triangles)
FIELD(visible_triangles)
FIELD(clipped_triangles)
FIELD(draw_calls)
FIELD(upload_bytes)
FIELD(holes)
FIELD(misses)
FIELD(spills)
FIELD(ground)

static double mean_of(const struct setting *setting, field_of *field)
{
    double sum = 0;
    for (int i = 0; i < setting->frame_count; i++) sum += field(&setting->records[i]);
    return setting->frame_count ? sum / setting->frame_count : (double)NAN;
}

static double max_of(const struct setting *setting, field_of *field)
{
    double most = -INFINITY;
    for (int i = 0; i < setting->frame_count; i++) {
        double value = field(&setting->records[i]);
        if (isnan(value)) return NAN;
        if (value > most) most = value;
    }
    return most;
}

// Nearest-rank percentile over the frames of an expression; frames where it is not a number are passed over.
static double frame_percentile(const struct setting *setting, double (*value)(const struct frame_record *),
                               int per_mille)
{
    double *values = malloc((size_t)setting->frame_count * sizeof *values), result;
    size_t count = 0;
    for (int i = 0; values && i < setting->frame_count; i++) {
        double v = value(&setting->records[i]);
        if (isfinite(v)) values[count++] = v;
    }
    result = count ? percentile(values, count, per_mille) : (double)NAN;
    free(values);
    return result;
}

static double frame_over_roofline(const struct frame_record *record)
{
    return record->frame_ms / record->roofline_ms;
}

static double draw_over_roofline(const struct frame_record *record)
{
    return record->draw_ms / record->roofline_ms;
}

// ---- one run -----------------------------------------------------------------------------------

static void add_times(cJSON *run_json, const char *key, const struct setting *setting, int column,
                      uint64_t seed)
{
    struct time_summary t =
        summarize_times(setting->times[column], setting->repeats_done, setting->frame_count, seed);
    cJSON *json = cJSON_AddObjectToObject(run_json, key);
    result_add_number(json, "median", t.median);
    result_add_number(json, "p95", t.p95);
    result_add_number(json, "p99", t.p99);
    result_add_number(json, "min", t.min);
    result_add_number(json, "max", t.max);
    if (t.has_ci) {
        cJSON *ci = cJSON_AddArrayToObject(json, "ci95");
        cJSON_AddItemToArray(ci, cJSON_CreateNumber(t.ci95[0]));
        cJSON_AddItemToArray(ci, cJSON_CreateNumber(t.ci95[1]));
    } else {
        cJSON_AddNullToObject(json, "ci95");
    }
}

static void add_mean_max(cJSON *run_json, const char *key, const struct setting *setting, field_of *field)
{
    cJSON *json = cJSON_AddObjectToObject(run_json, key);
    result_add_number(json, "mean", mean_of(setting, field));
    result_add_number(json, "max", max_of(setting, field));
}

static struct error_summary add_error(cJSON *run_json, const char *key, struct setting *setting,
                                      struct error_samples *samples)
{
    struct error_summary s = error_samples_summary(samples);
    bool known = setting->measured && s.samples > 0;
    cJSON *json = cJSON_AddObjectToObject(run_json, key);
    const char *names[] = {"mean", "rms", "p50", "p99", "p999", "max", "share_over_1px"};
    const double values[] = {s.mean, s.rms, s.p50, s.p99, s.p999, s.max, s.share_over_1px};
    for (int i = 0; i < COUNT(values); i++)
        result_add_number(json, names[i], known ? values[i] : (double)NAN);
    cJSON_AddNumberToObject(json, "samples", (double)s.samples);
    if (!known) s = (struct error_summary){NAN, NAN, NAN, NAN, NAN, NAN, NAN, 0};
    return s;
}

static void add_coverage(cJSON *run_json, const char *key, const struct setting *setting, field_of *field)
{
    cJSON *json = cJSON_AddObjectToObject(run_json, key);
    double total = mean_of(setting, field) * setting->frame_count;
    result_add_number(json, "total", total);
    result_add_number(json, "worst_frame", max_of(setting, field));
    result_add_number(json, "share", total / (mean_of(setting, get_ground) * setting->frame_count));
}

// Over the frames that claim a bound and err at all: the others have no such ratio.
static double add_tightness(cJSON *run_json, const struct setting *setting)
{
    double sum = 0, least = INFINITY;
    int count = 0;
    for (int i = 0; setting->measured && i < setting->frame_count; i++) {
        double tightness = frame_tightness(&setting->records[i]);
        if (!isfinite(tightness)) continue;
        sum += tightness;
        least = fmin(least, tightness);
        count++;
    }
    cJSON *json = cJSON_AddObjectToObject(run_json, "tightness");
    result_add_number(json, "mean", sum / count);
    result_add_number(json, "min", least);
    return sum / count;
}

// Mean over the frames; null until every frame was measured.
static void add_counters(cJSON *run_json, const struct setting *setting)
{
    if (!setting->measured) {
        cJSON_AddNullToObject(run_json, "counters");
        return;
    }
    cJSON *json = cJSON_AddObjectToObject(run_json, "counters");
    for (int c = 0; c < RENDERER_MAX_COUNTERS && setting->counters[c].name; c++)
        result_add_number(json, setting->counters[c].name, setting->counters[c].value / setting->frame_count);
}

// Whether the pipeline counted the renderer's own number of triangles in every frame; null when not measured.
static void add_confirmed(cJSON *run_json, const struct setting *setting)
{
    bool confirmed = true;
    for (int i = 0; i < setting->frame_count; i++)
        confirmed = confirmed && setting->records[i].generated_triangles == setting->records[i].triangles;
    if (setting->measured)
        cJSON_AddBoolToObject(run_json, "triangles_confirmed", confirmed);
    else
        cJSON_AddNullToObject(run_json, "triangles_confirmed");
}

static void add_setting_json(cJSON *run_json, const struct setting *setting)
{
    cJSON *json = cJSON_AddObjectToObject(run_json, "setting");
    for (int k = 0; setting->type->knobs[k].name; k++) {
        const struct renderer_knob *knob = &setting->type->knobs[k];
        char text[64];
        renderer_format_knob(knob, setting->knobs[k], text);
        if (knob->choices)
            cJSON_AddStringToObject(json, knob->name, text);
        else
            cJSON_AddNumberToObject(json, knob->name, setting->knobs[k]);
    }
}

static void add_reasons(cJSON *run_json, const struct run *run, const struct setting *setting,
                        double tightness)
{
    cJSON *reasons = cJSON_AddObjectToObject(run_json, "reasons");
    if (run->cpu_times) {
        cJSON_AddStringToObject(reasons, "gpu_ms", "a software rasteriser's timer queries mean nothing");
        cJSON_AddStringToObject(reasons, "throughput_ms", "measured on a GPU only");
    } else if (!gpu_info(run->gpu)->timer_query) {
        cJSON_AddStringToObject(reasons, "gpu_ms", "the driver has no timer queries");
    }
    if (run->options.repeats < 3) cJSON_AddStringToObject(reasons, "ci95", "fewer than 3 repeats");
    if (!setting->repeats_done)
        cJSON_AddStringToObject(reasons, "frame_ms", "interrupted before a flight was complete");
    const char *unmeasured = setting->type == &null_renderer ? "draws nothing: the cost of the harness alone"
                             : setting->measured             ? NULL
                                                             : "interrupted before its frames were measured";
    static const char *const measures[] = {
        "error_px",   "plane_px",     "temporal_px",     "roofline_ms", "steadiness",
        "holes",      "misses",       "spills",          "triangles",   "visible_triangles",
        "draw_calls", "upload_bytes", "pictures_sha256", "counters"};
    for (int m = 0; unmeasured && m < COUNT(measures); m++)
        cJSON_AddStringToObject(reasons, measures[m], unmeasured);
    const char *unpromised = unmeasured                   ? unmeasured
                             : run->truth                 ? "errors are measured against another map"
                             : isnan(setting->claimed_px) ? "this method claims no bound"
                                                          : NULL;
    static const char *const promises[] = {"claimed_px", "claim_broken_frames", "tightness"};
    for (int p = isnan(setting->claimed_px) ? 0 : 1; unpromised && p < COUNT(promises); p++)
        cJSON_AddStringToObject(reasons, promises[p], unpromised);
    if (setting->few_frames)
        cJSON_AddStringToObject(reasons, "frames",
                                "drawn so slowly that it flies few frames, spread over the path");
    if (unmeasured) return;
    if (setting->few_frames)
        cJSON_AddStringToObject(reasons, "temporal_px", "its frames do not follow each other");
    else if (setting->temporal_px.count == 0)
        cJSON_AddStringToObject(reasons, "temporal_px",
                                "no ground was drawn in two frames that follow each other");
    if (setting->error_px.count == 0) cJSON_AddStringToObject(reasons, "error_px", "no pixel to measure");
    if (!unpromised && isnan(tightness))
        cJSON_AddStringToObject(reasons, "tightness", "no pixel of any frame is off: there is no ratio");
}

cJSON *result_pictures(const struct setting *setting)
{
    cJSON *array = cJSON_CreateArray();
    for (int m = 0; m < MOMENT_COUNT; m++) {
        const struct snapshot *snapshot = &setting->snapshots[m];
        if (snapshot->frame < 0) continue;
        char path[256];
        cJSON *json = cJSON_CreateObject();
        cJSON_AddItemToArray(array, json);
        cJSON_AddStringToObject(json, "moment", moment_names[m]);
        cJSON_AddNumberToObject(json, "frame", snapshot->frame);
        snprintf(path, sizeof path, "pictures/%s_%s.png", setting->slug, moment_names[m]);
        cJSON_AddStringToObject(json, "picture", path);
        snprintf(path, sizeof path, "pictures/%s_%s_error.png", setting->slug, moment_names[m]);
        cJSON_AddStringToObject(json, "error", path);
        result_add_number(json, "error_px_p999", snapshot->error_px_p999);
    }
    return array;
}

static void add_text(cJSON *json, const char *key, const char *text) // NULL: null
{
    if (text)
        cJSON_AddStringToObject(json, key, text);
    else
        cJSON_AddNullToObject(json, key);
}

static void add_identity(cJSON *json, const struct setting *setting)
{
    cJSON_AddStringToObject(json, "id", setting->id);
    cJSON_AddStringToObject(json, "renderer", setting->type->name);
    cJSON_AddStringToObject(json, "summary", setting->type->summary);
    add_setting_json(json, setting);
    cJSON_AddStringToObject(json, "label", setting->id);
    add_text(json, "quality_knob", setting->type->quality_knob);
    cJSON_AddNumberToObject(json, "frames", setting->frame_count);
    cJSON_AddBoolToObject(json, "uncertain", setting->few_frames);
}

static void add_all_times(cJSON *json, const struct setting *setting, uint64_t seed)
{
    add_times(json, "frame_ms", setting, TIME_FRAME, seed);
    add_times(json, "update_ms", setting, TIME_UPDATE, seed);
    add_times(json, "draw_ms", setting, TIME_DRAW, seed);
    add_times(json, "wall_ms", setting, TIME_WALL, seed);
    add_times(json, "worker_ms", setting, TIME_WORKER, seed);
    result_add_number(json, "gpu_ms", frame_percentile(setting, get_gpu_ms, 500));
    result_add_number(json, "throughput_ms", frame_percentile(setting, get_throughput_ms, 500));
    cJSON *roofline = cJSON_AddObjectToObject(json, "roofline_ms");
    result_add_number(roofline, "median", frame_percentile(setting, get_roofline_ms, 500));
    result_add_number(roofline, "draw_ratio", frame_percentile(setting, draw_over_roofline, 500));
    result_add_number(json, "steadiness",
                      frame_percentile(setting, frame_over_roofline, 990) /
                          frame_percentile(setting, frame_over_roofline, 500));
    result_add_number(json, "fps", 1e3 / mean_of(setting, get_frame_ms));
}

static void add_amounts(cJSON *json, const struct setting *setting)
{
    add_mean_max(json, "triangles", setting, get_triangles);
    add_mean_max(json, "visible_triangles", setting, get_visible_triangles);
    add_mean_max(json, "clipped_triangles", setting, get_clipped_triangles);
    add_confirmed(json, setting);
    add_mean_max(json, "draw_calls", setting, get_draw_calls);
    add_mean_max(json, "upload_bytes", setting, get_upload_bytes);
    cJSON_AddNumberToObject(json, "resident_bytes", (double)setting->resident_bytes);
}

static void add_temporal(cJSON *run_json, struct setting *setting)
{
    struct error_summary s = error_samples_summary(&setting->temporal_px);
    bool known = setting->measured && s.samples > 0;
    cJSON *json = cJSON_AddObjectToObject(run_json, "temporal_px");
    result_add_number(json, "p999", known ? s.p999 : (double)NAN);
    result_add_number(json, "max", known ? s.max : (double)NAN);
}

cJSON *result_run(const struct run *run, struct setting *setting, struct result_summary *summary)
{
    cJSON *json = cJSON_CreateObject();
    add_identity(json, setting);
    add_all_times(json, setting, (uint64_t)run->options.seed);
    add_amounts(json, setting);
    *summary = (struct result_summary){
        .error_px = add_error(json, "error_px", setting, &setting->error_px),
        .frame_ms = frame_percentile(setting, get_frame_ms, 500),
        .visible_triangles = mean_of(setting, get_visible_triangles),
    };
    add_error(json, "plane_px", setting, &setting->plane_px);
    bool claims = setting->measured && !isnan(setting->claimed_px);
    result_add_number(json, "claimed_px", setting->claimed_px);
    result_add_number(json, "claim_broken_frames", claims ? setting->claim_broken_frames : (double)NAN);
    double tightness = add_tightness(json, setting);
    add_coverage(json, "holes", setting, get_holes);
    add_coverage(json, "misses", setting, get_misses);
    add_coverage(json, "spills", setting, get_spills);
    add_temporal(json, setting);
    add_counters(json, setting);
    add_text(json, "pictures_sha256", setting->measured ? setting->pictures_sha256 : NULL);
    char path[256];
    snprintf(path, sizeof path, "frames/%s.csv", setting->slug);
    cJSON_AddStringToObject(json, "frames_csv", path);
    cJSON_AddArrayToObject(json, "pictures"); // filled for the settings that the report shows
    add_reasons(json, run, setting, tightness);
    return json;
}
