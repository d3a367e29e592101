// results.json (schema 1).  Every field is defined in reports/README.md.
// A number that was not measured is null and `reasons` says why; NaN and Inf are never written.
// SPDX-License-Identifier: MIT
#include "bench/machine.h"
#include "bench/result_files.h"
#include "bench/result_parts.h"
#include "common/cli.h"
#include "common/report.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

void result_add_number(cJSON *object, const char *key, double value)
{
    if (isfinite(value))
        cJSON_AddNumberToObject(object, key, value);
    else
        cJSON_AddNullToObject(object, key);
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
        result_add_number(json, "plane_px_p999", error_samples_summary(&setting->plane_px).p999);
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

// Mean way of the eye from frame to frame; NAN with one frame.
static double path_step_m(const struct run *run)
{
    double sum_m = 0;
    struct camera last = path_camera(run->scene->path, 0, run->frames);
    for (int f = 1; f < run->frames; f++) {
        struct camera camera = path_camera(run->scene->path, f, run->frames);
        double x = camera.eye_m[0] - last.eye_m[0], y = camera.eye_m[1] - last.eye_m[1],
               z = camera.eye_m[2] - last.eye_m[2];
        sum_m += sqrt(x * x + y * y + z * z);
        last = camera;
    }
    return run->frames > 1 ? sum_m / (run->frames - 1) : (double)NAN;
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
    if (run->truth) cJSON_AddStringToObject(json, "truth", terrain_info(run->truth)->name);
    if (info->packed.codec[0]) {
        cJSON *packed = cJSON_AddObjectToObject(json, "packed");
        cJSON_AddStringToObject(packed, "codec", info->packed.codec);
        cJSON_AddNumberToObject(packed, "bits_per_sample", info->packed.bits_per_sample);
        cJSON_AddNumberToObject(packed, "rms_m", info->packed.rms_m);
        cJSON_AddNumberToObject(packed, "max_m", info->packed.max_m);
    }
    cJSON_AddNumberToObject(json, "samples", (double)info->samples);
    cJSON_AddNumberToObject(json, "samples_x", (double)(finest.extent.x1 - finest.extent.x0));
    cJSON_AddNumberToObject(json, "samples_y", (double)(finest.extent.y1 - finest.extent.y0));
    cJSON_AddItemToObject(json, "spacing_m", cJSON_CreateDoubleArray(finest.spacing_m, 2));
    cJSON_AddNumberToObject(json, "synthesised_levels", -info->finest);
    cJSON_AddNumberToObject(json, "voids_filled", (double)info->voids_filled);
    cJSON_AddNumberToObject(json, "min_m", info->offset_m + info->quantum_m * info->min_q);
    cJSON_AddNumberToObject(json, "max_m", info->offset_m + info->quantum_m * info->max_q);
    if (info->datum == TERRAIN_SPHERE && info->finest < 0) cJSON_AddTrueToObject(json, "heights_are_bounds");
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
    result_add_number(json, "step_m", path_step_m(run));
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

// Renderers that were asked for and cannot draw this terrain: a row each, with the reason.
static void add_unsupported(cJSON *root, const struct run *run)
{
    if (!run->unsupported_count) return;
    cJSON *array = cJSON_AddArrayToObject(root, "unsupported");
    for (int i = 0; i < run->unsupported_count; i++) {
        cJSON *row = cJSON_CreateObject();
        cJSON_AddStringToObject(row, "renderer", run->unsupported[i]->name);
        cJSON_AddStringToObject(row, "reason",
                                renderer_unsupported(run->unsupported[i], run->scene->terrain));
        cJSON_AddItemToArray(array, row);
    }
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
static bool shows_pictures(const struct run *run, const struct result_summary *summaries, int s)
{
    double own = fabs(log(fmax(summaries[s].error_px.p999, 1e-9)));
    if (!run->settings[s].measured || run->settings[s].type == &null_renderer) return false;
    for (int other = 0; other < run->setting_count; other++) {
        if (run->settings[other].type != run->settings[s].type || !run->settings[other].measured) continue;
        double distance = fabs(log(fmax(summaries[other].error_px.p999, 1e-9)));
        if (distance < own || (distance == own && other < s)) return false;
    }
    return true;
}

bool write_results(struct run *run, const char *folder)
{
    struct result_summary summaries[MAX_SETTINGS];
    cJSON *root = cJSON_CreateObject(), *runs[MAX_SETTINGS];
    char path[1024];
    bool good = result_make_folders(folder);
    if (!good) goto done;
    cJSON_AddNumberToObject(root, "schema", 1);
    cJSON_AddBoolToObject(root, "complete", run->complete);
    result_add_created(root);
    cJSON_AddStringToObject(root, "command", run->command);
    result_add_machine(root, gpu_info(run->gpu));
    add_scene(root, run);
    add_method(root, run);
    add_agreement(root, run);
    add_unsupported(root, run);
    cJSON *array = cJSON_AddArrayToObject(root, "runs");
    for (int s = 0; s < run->setting_count; s++)
        cJSON_AddItemToArray(array, runs[s] = result_run(run, &run->settings[s], &summaries[s]));
    for (int s = 0; s < run->setting_count && good; s++) {
        good = result_write_csv(&run->settings[s], folder);
        if (!good || !shows_pictures(run, summaries, s)) continue;
        cJSON_ReplaceItemInObject(runs[s], "pictures", result_pictures(&run->settings[s]));
        good = result_write_pictures(run, &run->settings[s], folder);
    }
    good = good && result_add_curves(root, run, summaries);
    char *text = good ? cJSON_Print(root) : NULL;
    snprintf(path, sizeof path, "%s/results.json", folder);
    good = good && (text ? result_write_text(path, text) : fail("out of memory"));
    free(text);
done:
    cJSON_Delete(root);
    return good;
}
