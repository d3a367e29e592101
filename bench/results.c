// results.json (schema 1).  Every field is defined in reports/README.md.
// A number that was not measured is null and `reasons` says why; NaN and Inf are never written.
// SPDX-License-Identifier: MIT
#include "bench/machine.h"
#include "bench/result_files.h"
#include "common/cli.h"
#include "common/report.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static const double equal_error_px[] = {0.125, 0.25, 0.5, 1, 2, 4, 8};
static const double equal_time_ms[] = {1, 2, 5, 10, 20, 50, 100, 200, 500};
static const double field_error_px[] = {0.1, 0.03, 0.013}; // mean errors at which peers were measured

#define COUNT(array) ((int)(sizeof(array) / sizeof(array)[0]))

// ---- small helpers -----------------------------------------------------------------------------

static void add_number(cJSON *object, const char *key, double value)
{
    if (isfinite(value))
        cJSON_AddNumberToObject(object, key, value);
    else
        cJSON_AddNullToObject(object, key);
}

static cJSON *number_or_null(double value)
{
    return isfinite(value) ? cJSON_CreateNumber(value) : cJSON_CreateNull();
}

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
    add_number(json, "median", t.median);
    add_number(json, "p95", t.p95);
    add_number(json, "p99", t.p99);
    add_number(json, "min", t.min);
    add_number(json, "max", t.max);
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
    add_number(json, "mean", mean_of(setting, field));
    add_number(json, "max", max_of(setting, field));
}

static struct error_summary add_error(cJSON *run_json, const char *key, struct setting *setting,
                                      struct error_samples *samples)
{
    struct error_summary s = error_samples_summary(samples);
    bool known = setting->measured && s.samples > 0;
    cJSON *json = cJSON_AddObjectToObject(run_json, key);
    const char *names[] = {"mean", "rms", "p50", "p99", "p999", "max", "share_over_1px"};
    const double values[] = {s.mean, s.rms, s.p50, s.p99, s.p999, s.max, s.share_over_1px};
    for (int i = 0; i < COUNT(values); i++) add_number(json, names[i], known ? values[i] : (double)NAN);
    cJSON_AddNumberToObject(json, "samples", (double)s.samples);
    if (!known) s = (struct error_summary){NAN, NAN, NAN, NAN, NAN, NAN, NAN, 0};
    return s;
}

static void add_coverage(cJSON *run_json, const char *key, const struct setting *setting, field_of *field)
{
    cJSON *json = cJSON_AddObjectToObject(run_json, key);
    double total = mean_of(setting, field) * setting->frame_count;
    add_number(json, "total", total);
    add_number(json, "worst_frame", max_of(setting, field));
    add_number(json, "share", total / (mean_of(setting, get_ground) * setting->frame_count));
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

static void add_reasons(cJSON *run_json, const struct run *run, const struct setting *setting)
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
    if (isnan(setting->claimed_px)) {
        cJSON_AddStringToObject(reasons, "claimed_px", "this method claims no bound");
        cJSON_AddStringToObject(reasons, "claim_broken_frames", "this method claims no bound");
    }
    const char *unmeasured = setting->type == &null_renderer ? "draws nothing: the cost of the harness alone"
                             : setting->measured             ? NULL
                                                             : "interrupted before its frames were measured";
    static const char *const measures[] = {
        "error_px",   "plane_px",     "temporal_px",    "roofline_ms", "steadiness",
        "holes",      "misses",       "spills",         "triangles",   "visible_triangles",
        "draw_calls", "upload_bytes", "pictures_sha256"};
    for (int m = 0; unmeasured && m < COUNT(measures); m++)
        cJSON_AddStringToObject(reasons, measures[m], unmeasured);
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
}

static cJSON *pictures_json(const struct setting *setting)
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
        add_number(json, "error_px_p999", snapshot->error_px_p999);
    }
    return array;
}

static cJSON *run_json(struct run *run, struct setting *setting, struct error_summary *error)
{
    uint64_t seed = (uint64_t)run->options.seed;
    cJSON *json = cJSON_CreateObject();
    char path[256];
    cJSON_AddStringToObject(json, "id", setting->id);
    cJSON_AddStringToObject(json, "renderer", setting->type->name);
    cJSON_AddStringToObject(json, "summary", setting->type->summary);
    add_setting_json(json, setting);
    cJSON_AddStringToObject(json, "label", setting->id);
    if (setting->type->quality_knob)
        cJSON_AddStringToObject(json, "quality_knob", setting->type->quality_knob);
    else
        cJSON_AddNullToObject(json, "quality_knob");
    cJSON_AddNumberToObject(json, "frames", setting->frame_count);
    cJSON_AddBoolToObject(json, "uncertain", setting->few_frames);
    add_times(json, "frame_ms", setting, TIME_FRAME, seed);
    add_times(json, "update_ms", setting, TIME_UPDATE, seed);
    add_times(json, "draw_ms", setting, TIME_DRAW, seed);
    add_times(json, "wall_ms", setting, TIME_WALL, seed);
    add_times(json, "worker_ms", setting, TIME_WORKER, seed);
    add_number(json, "gpu_ms", frame_percentile(setting, get_gpu_ms, 500));
    add_number(json, "throughput_ms", frame_percentile(setting, get_throughput_ms, 500));
    cJSON *roofline = cJSON_AddObjectToObject(json, "roofline_ms");
    add_number(roofline, "median", frame_percentile(setting, get_roofline_ms, 500));
    add_number(roofline, "draw_ratio", frame_percentile(setting, draw_over_roofline, 500));
    add_number(json, "steadiness",
               frame_percentile(setting, frame_over_roofline, 990) /
                   frame_percentile(setting, frame_over_roofline, 500));
    add_number(json, "fps", 1e3 / mean_of(setting, get_frame_ms));
    add_mean_max(json, "triangles", setting, get_triangles);
    add_mean_max(json, "visible_triangles", setting, get_visible_triangles);
    add_mean_max(json, "clipped_triangles", setting, get_clipped_triangles);
    add_confirmed(json, setting);
    add_mean_max(json, "draw_calls", setting, get_draw_calls);
    add_mean_max(json, "upload_bytes", setting, get_upload_bytes);
    cJSON_AddNumberToObject(json, "resident_bytes", (double)setting->resident_bytes);
    *error = add_error(json, "error_px", setting, &setting->error_px);
    add_error(json, "plane_px", setting, &setting->plane_px);
    add_number(json, "claimed_px", setting->claimed_px);
    add_number(json, "claim_broken_frames",
               isnan(setting->claimed_px) || !setting->measured ? (double)NAN : setting->claim_broken_frames);
    add_coverage(json, "holes", setting, get_holes);
    add_coverage(json, "misses", setting, get_misses);
    add_coverage(json, "spills", setting, get_spills);
    struct error_summary temporal = error_samples_summary(&setting->temporal_px);
    cJSON *temporal_json = cJSON_AddObjectToObject(json, "temporal_px");
    add_number(temporal_json, "p999", temporal.samples ? temporal.p999 : (double)NAN);
    add_number(temporal_json, "max", temporal.samples ? temporal.max : (double)NAN);
    cJSON *counters = cJSON_AddObjectToObject(json, "counters");
    for (int c = 0; c < RENDERER_MAX_COUNTERS && setting->counters[c].name; c++)
        add_number(counters, setting->counters[c].name, setting->counters[c].value / setting->frame_count);
    if (setting->measured)
        cJSON_AddStringToObject(json, "pictures_sha256", setting->pictures_sha256);
    else
        cJSON_AddNullToObject(json, "pictures_sha256");
    snprintf(path, sizeof path, "frames/%s.csv", setting->slug);
    cJSON_AddStringToObject(json, "frames_csv", path);
    cJSON_AddArrayToObject(json, "pictures"); // filled for the settings that the report shows
    add_reasons(json, run, setting);
    return json;
}

// ---- curves over a renderer's settings ---------------------------------------------------------

struct curve { // a renderer's measured settings
    const struct renderer_type *type;
    int count, member[MAX_SETTINGS];
    double error_px_p999[MAX_SETTINGS], error_px_mean[MAX_SETTINGS], frame_ms[MAX_SETTINGS],
        visible[MAX_SETTINGS];
};

static int build_curves(const struct run *run, const struct error_summary *errors, struct curve *curves)
{
    int count = 0;
    for (int i = 0; renderer_table[i]; i++) {
        struct curve *curve = &curves[count];
        *curve = (struct curve){.type = renderer_table[i]};
        if (!curve->type->quality_knob) continue;
        for (int s = 0; s < run->setting_count; s++) {
            const struct setting *setting = &run->settings[s];
            double frame_ms = frame_percentile(setting, get_frame_ms, 500);
            if (setting->type != curve->type || !setting->measured || !isfinite(frame_ms)) continue;
            int k = curve->count++;
            curve->member[k] = s;
            curve->error_px_p999[k] = errors[s].p999;
            curve->error_px_mean[k] = errors[s].mean;
            curve->frame_ms[k] = frame_ms;
            curve->visible[k] = mean_of(setting, get_visible_triangles);
        }
        if (curve->count) count++;
    }
    return count;
}

static void add_curves(cJSON *root, const struct run *run, const struct curve *curves, int count)
{
    cJSON *frontier = cJSON_AddArrayToObject(root, "frontier"),
          *sweeps = cJSON_AddArrayToObject(root, "sweeps");
    for (int c = 0; c < count; c++) {
        const struct curve *curve = &curves[c];
        cJSON *json = cJSON_CreateObject();
        cJSON_AddItemToArray(frontier, json);
        cJSON_AddStringToObject(json, "renderer", curve->type->name);
        cJSON *points = cJSON_AddArrayToObject(json, "points");
        for (int k = 0; k < curve->count; k++) {
            cJSON *point = cJSON_CreateObject();
            cJSON_AddItemToArray(points, point);
            cJSON_AddStringToObject(point, "setting", run->settings[curve->member[k]].id);
            add_number(point, "error_px_p999", curve->error_px_p999[k]);
            add_number(point, "error_px_mean", curve->error_px_mean[k]);
            add_number(point, "frame_ms_median", curve->frame_ms[k]);
        }
        cJSON *sweep = cJSON_CreateObject();
        cJSON_AddItemToArray(sweeps, sweep);
        cJSON_AddStringToObject(sweep, "renderer", curve->type->name);
        cJSON_AddStringToObject(sweep, "knob", curve->type->quality_knob);
        add_number(sweep, "rank_correlation",
                   rank_correlation(curve->error_px_p999, curve->visible, curve->count));
    }
}

// One row a value of `xs`; rows that no curve reaches are left out.
static void add_table(cJSON *root, const char *name, const char *key, const double *at, int rows,
                      const struct curve *curves, int count, bool time_at_error)
{
    cJSON *table = cJSON_AddArrayToObject(root, name);
    for (int r = 0; r < rows; r++) {
        cJSON *row = cJSON_CreateObject();
        bool any = false;
        cJSON_AddNumberToObject(row, key, at[r]);
        for (int c = 0; c < count; c++) {
            const struct curve *curve = &curves[c];
            double value = time_at_error
                               ? curve_at(curve->error_px_p999, curve->frame_ms, curve->count, at[r])
                               : curve_at(curve->frame_ms, curve->error_px_p999, curve->count, at[r]);
            cJSON_AddItemToObject(row, curve->type->name, number_or_null(value));
            any = any || isfinite(value);
        }
        if (any)
            cJSON_AddItemToArray(table, row);
        else
            cJSON_Delete(row);
    }
}

// Frame time over that of brute drawn whole, at equal mean error: the figure peers are compared by.
static void add_field(cJSON *root, const struct run *run, const struct curve *curves, int count)
{
    cJSON *table = cJSON_AddArrayToObject(root, "against_brute");
    double brute_ms = NAN;
    for (int s = 0; s < run->setting_count; s++)
        if (run->settings[s].type == &brute_renderer && run->settings[s].knobs[0] == 0)
            brute_ms = frame_percentile(&run->settings[s], get_frame_ms, 500);
    for (int r = 0; r < COUNT(field_error_px) && isfinite(brute_ms); r++) {
        cJSON *row = cJSON_CreateObject();
        cJSON_AddItemToArray(table, row);
        cJSON_AddNumberToObject(row, "at_mean_px", field_error_px[r]);
        for (int c = 0; c < count; c++)
            add_number(
                row, curves[c].type->name,
                curve_at(curves[c].error_px_mean, curves[c].frame_ms, curves[c].count, field_error_px[r]) /
                    brute_ms);
    }
}

// How well brute and the ray caster agree: the floor of the method.
static void add_agreement(cJSON *root, const struct run *run)
{
    for (int s = 0; s < run->setting_count; s++) {
        struct setting *setting = (struct setting *)&run->settings[s];
        if (setting->type != &brute_renderer || !setting->measured) continue;
        double coverage = 0, order = 0, beyond = 0;
        for (int i = 0; i < setting->frame_count; i++) {
            const struct frame_record *record = &setting->records[i];
            coverage = fmax(coverage, record->holes + record->misses + record->spills);
            order = fmax(order, record->order_mismatches);
            beyond = fmax(beyond, record->order_beyond_grid);
        }
        cJSON *json = cJSON_AddObjectToObject(root, "agreement");
        add_number(json, "plane_px_p999", error_samples_summary(&setting->plane_px).p999);
        cJSON_AddNumberToObject(json, "coverage_mismatch_max", coverage);
        cJSON_AddNumberToObject(json, "order_mismatch_max", beyond);
        cJSON_AddNumberToObject(json, "order_mismatch_with_snapping_max", order);
        cJSON_AddNumberToObject(json, "pixels", (double)run->scene->width * run->scene->height);
        cJSON_AddNumberToObject(json, "frames", setting->frame_count);
        return;
    }
    cJSON_AddNullToObject(root, "agreement");
}

// ---- the rest of the document ------------------------------------------------------------------

void result_add_machine(cJSON *root, const struct gpu_info *info)
{
    struct machine machine;
    machine_describe(&machine);
    const char *threads = getenv("LP_NUM_THREADS");
    cJSON *json = cJSON_AddObjectToObject(root, "machine");
    cJSON_AddStringToObject(json, "cpu", machine.cpu);
    cJSON_AddNumberToObject(json, "cores", machine.cores);
    cJSON_AddStringToObject(json, "memory_gib", machine.memory_gib);
    cJSON_AddStringToObject(json, "system", machine.system);
    json = cJSON_AddObjectToObject(root, "build");
    cJSON_AddStringToObject(json, "version", RELIEF_VERSION);
    cJSON_AddStringToObject(json, "commit", RELIEF_COMMIT);
    cJSON_AddStringToObject(json, "compiler", "gcc " __VERSION__);
    cJSON_AddStringToObject(json, "flags", RELIEF_BUILD " -ffp-contract=off");
    json = cJSON_AddObjectToObject(root, "gl");
    cJSON_AddStringToObject(json, "backend", info->backend);
    cJSON_AddStringToObject(json, "vendor", info->vendor);
    cJSON_AddStringToObject(json, "renderer", info->renderer);
    cJSON_AddStringToObject(json, "version", info->version);
    cJSON_AddBoolToObject(json, "software", info->software);
    cJSON_AddBoolToObject(json, "reversed_depth", info->clip_control);
    cJSON_AddStringToObject(json, "rasteriser_threads", threads ? threads : "driver's choice");
}

static void path_hash(const struct run *run, char hex[65])
{
    size_t size = (size_t)run->frames * 7 * sizeof(double);
    double *cameras = malloc(size);
    hex[0] = 0;
    if (!cameras) return;
    for (int f = 0; f < run->frames; f++) {
        struct camera camera = path_camera(run->scene->path, f, run->frames);
        double *out = cameras + 7 * (size_t)f;
        memcpy(out, camera.eye_m, 3 * sizeof *out);
        out[3] = camera.yaw, out[4] = camera.pitch, out[5] = camera.roll, out[6] = camera.fov_vertical;
    }
    sha256_hex(cameras, size, hex);
    free(cameras);
}

static void add_scene(cJSON *root, const struct run *run)
{
    const struct scene *scene = run->scene;
    const struct terrain_info *info = terrain_info(scene->terrain);
    struct terrain_level finest = terrain_level(scene->terrain, info->finest);
    char hex[65];
    cJSON *json = cJSON_AddObjectToObject(root, "scene");
    cJSON_AddStringToObject(json, "name", scene->name);
    cJSON_AddStringToObject(json, "file", run->options.scene ? run->options.scene : "");
    cJSON_AddStringToObject(json, "sha256", scene->sha256);
    cJSON_AddStringToObject(json, "terrain", scene->terrain_name);
    cJSON_AddNumberToObject(json, "samples", (double)info->samples);
    cJSON_AddNumberToObject(json, "samples_x", (double)(finest.extent.x1 - finest.extent.x0));
    cJSON_AddNumberToObject(json, "samples_y", (double)(finest.extent.y1 - finest.extent.y0));
    cJSON_AddItemToObject(json, "spacing_m", cJSON_CreateDoubleArray(finest.spacing_m, 2));
    cJSON_AddNumberToObject(json, "synthesised_levels", -info->finest);
    cJSON_AddNumberToObject(json, "voids_filled", (double)info->voids_filled);
    cJSON_AddNumberToObject(json, "min_m", info->offset_m + info->quantum_m * info->min_q);
    cJSON_AddNumberToObject(json, "max_m", info->offset_m + info->quantum_m * info->max_q);
    cJSON_AddNumberToObject(json, "width", scene->width);
    cJSON_AddNumberToObject(json, "height", scene->height);
    cJSON_AddNumberToObject(json, "fov_vertical_deg", scene->fov_vertical * 180 / 3.14159265358979323846);
    cJSON *effects = cJSON_AddObjectToObject(json, "effects");
    cJSON_AddStringToObject(effects, "shading", scene_shading_word(scene->effects.shading));
    if (scene->effects.colour) cJSON_AddStringToObject(effects, "colour", scene->effects.colour->name);
    json = cJSON_AddObjectToObject(root, "path");
    path_hash(run, hex);
    cJSON_AddStringToObject(json, "name", scene->name);
    cJSON_AddNumberToObject(json, "frames", run->frames);
    cJSON_AddStringToObject(json, "sha256", hex);
}

static void add_method(cJSON *root, const struct run *run)
{
    cJSON *json = cJSON_AddObjectToObject(root, "method");
    cJSON_AddNumberToObject(json, "repeats", run->options.repeats);
    cJSON_AddStringToObject(json, "warmup", "the whole path once, untimed, by every setting");
    cJSON_AddNumberToObject(json, "seed", run->options.seed);
    cJSON_AddStringToObject(json, "sweep", run->options.sweep);
    cJSON_AddStringToObject(json, "times", run->cpu_times ? "cpu" : "wall");
    cJSON *order = cJSON_AddArrayToObject(json, "order");
    for (int i = 0; i < run->order_count; i++)
        cJSON_AddItemToArray(order, cJSON_CreateString(run->settings[run->order[i]].id));
}

void result_add_created(cJSON *root)
{
    char text[32];
    time_t now = time(NULL);
    struct tm utc;
    gmtime_r(&now, &utc);
    strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &utc);
    cJSON_AddStringToObject(root, "created", text);
}

// The setting of a renderer that the report shows: p99.9 error nearest 1 px.
static bool shows_pictures(const struct run *run, const struct error_summary *errors, int s)
{
    double own = fabs(log(fmax(errors[s].p999, 1e-9)));
    if (!run->settings[s].measured || run->settings[s].type == &null_renderer) return false;
    for (int other = 0; other < run->setting_count; other++) {
        if (run->settings[other].type != run->settings[s].type || !run->settings[other].measured) continue;
        double distance = fabs(log(fmax(errors[other].p999, 1e-9)));
        if (distance < own || (distance == own && other < s)) return false;
    }
    return true;
}

bool write_results(struct run *run, const char *folder)
{
    struct error_summary errors[MAX_SETTINGS];
    struct curve *curves = calloc(16, sizeof *curves);
    cJSON *root = cJSON_CreateObject(), *runs[MAX_SETTINGS];
    char path[1024];
    bool good = curves && result_make_folders(folder);
    if (!good) goto done;
    cJSON_AddNumberToObject(root, "schema", 1);
    cJSON_AddBoolToObject(root, "complete", run->complete);
    result_add_created(root);
    cJSON_AddStringToObject(root, "command", run->command);
    result_add_machine(root, gpu_info(run->gpu));
    add_scene(root, run);
    add_method(root, run);
    add_agreement(root, run);
    cJSON *array = cJSON_AddArrayToObject(root, "runs");
    for (int s = 0; s < run->setting_count; s++)
        cJSON_AddItemToArray(array, runs[s] = run_json(run, &run->settings[s], &errors[s]));
    for (int s = 0; s < run->setting_count && good; s++) {
        good = result_write_csv(&run->settings[s], folder);
        if (!good || !shows_pictures(run, errors, s)) continue;
        cJSON_ReplaceItemInObject(runs[s], "pictures", pictures_json(&run->settings[s]));
        good = result_write_pictures(run, &run->settings[s], folder);
    }
    int curve_count = build_curves(run, errors, curves);
    add_curves(root, run, curves, curve_count);
    add_table(root, "equal_error", "at_px", equal_error_px, COUNT(equal_error_px), curves, curve_count, true);
    add_table(root, "equal_time", "at_ms", equal_time_ms, COUNT(equal_time_ms), curves, curve_count, false);
    add_field(root, run, curves, curve_count);
    char *text = good ? cJSON_Print(root) : NULL;
    snprintf(path, sizeof path, "%s/results.json", folder);
    good = good && (text ? result_write_text(path, text) : fail("out of memory"));
    free(text);
done:
    cJSON_Delete(root);
    free(curves);
    return good;
}
