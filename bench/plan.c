// Which renderers fly at which settings, and which frames each of them flies.
// SPDX-License-Identifier: MIT
#include "bench/run.h"
#include "common/report.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { HEAVY_TRIANGLES = 3000000, HEAVY_FRAMES = 4 };

static bool has_preset(const struct renderer_type *type, const double *knobs)
{
    int preset = type->preset_knob ? renderer_knob_index(type, type->preset_knob) : -1;
    return preset >= 0 && knobs[preset] != type->knobs[preset].fallback;
}

// "clipmap n=127": the quality knob first, unless a preset stands in for it, then every knob that is off its
// default.
static void name_setting(struct setting *setting)
{
    const struct renderer_type *type = setting->type;
    bool preset = has_preset(type, setting->knobs);
    char text[64];
    size_t length = (size_t)snprintf(setting->id, sizeof setting->id, "%s", type->name);
    for (int pass = 0; pass < 2; pass++)
        for (int k = 0; type->knobs[k].name; k++) {
            bool quality = type->quality_knob && strcmp(type->knobs[k].name, type->quality_knob) == 0;
            if (quality != (pass == 0) || (quality && preset) ||
                (!quality && setting->knobs[k] == type->knobs[k].fallback))
                continue;
            renderer_format_knob(&type->knobs[k], setting->knobs[k], text);
            if (length < sizeof setting->id)
                length += (size_t)snprintf(setting->id + length, sizeof setting->id - length, " %s=%s",
                                           type->knobs[k].name, text);
        }
    memcpy(setting->slug, setting->id, sizeof setting->slug);
    for (char *c = setting->slug; *c; c++)
        if (*c == ' ' || *c == '=' || *c == '/') *c = '_';
}

static bool add_setting(struct run *run, const struct renderer_type *type, const double *knobs)
{
    if (run->setting_count == MAX_SETTINGS)
        return fail("--renderers: more than %d settings in one run", MAX_SETTINGS);
    struct setting *setting = &run->settings[run->setting_count];
    *setting = (struct setting){.type = type, .claimed_px = NAN};
    memcpy(setting->knobs, knobs, sizeof setting->knobs);
    name_setting(setting);
    for (int s = 0; s < run->setting_count; s++)
        if (strcmp(run->settings[s].id, setting->id) == 0) return true; // named twice: flown once
    for (int m = 0; m < MOMENT_COUNT; m++) setting->snapshots[m].frame = -1;
    run->setting_count++;
    return true;
}

static bool add_sweep(struct run *run, const struct renderer_type *type, double *knobs)
{
    const double *values = strcmp(run->options.sweep, "full") == 0 ? type->full : type->quick;
    int index = type->quality_knob ? renderer_knob_index(type, type->quality_knob) : -1;
    if (index < 0 || !values || has_preset(type, knobs)) return add_setting(run, type, knobs);
    for (; !isnan(*values); values++) {
        knobs[index] = *values;
        if (!add_setting(run, type, knobs)) return false;
    }
    return true;
}

// "name", or "name:knob=value:knob=value"; with its quality knob or a preset given, that setting alone, else
// a sweep.
static bool add_spec(struct run *run, char *spec)
{
    double knobs[RENDERER_MAX_KNOBS];
    size_t length = strcspn(spec, ":");
    const struct renderer_type *type = renderer_find(spec, length);
    if (!type) {
        char names[256] = "";
        for (int i = 0; renderer_table[i]; i++)
            snprintf(names + strlen(names), sizeof names - strlen(names), "%s%s", i ? ", " : "",
                     renderer_table[i]->name);
        return fail("--renderers: no renderer is called '%.*s'; accepted are %s", (int)length, spec, names);
    }
    renderer_default_knobs(type, knobs);
    bool sweep = true;
    char *rest = spec + length;
    while (*rest == ':') {
        char *word = rest + 1;
        rest = word + strcspn(word, ":");
        char *equals = memchr(word, '=', (size_t)(rest - word)), kept = *rest;
        if (!equals) return fail("--renderers: '%s' is not knob=value", word);
        *equals = 0, *rest = 0;
        if (!renderer_parse_knob(type, word, equals + 1, knobs)) return false;
        if (type->quality_knob && strcmp(word, type->quality_knob) == 0) sweep = false;
        *rest = kept;
    }
    return sweep ? add_sweep(run, type, knobs) : add_setting(run, type, knobs);
}

bool plan_settings(struct run *run)
{
    char specs[1024];
    if (run->options.renderers || *run->scene->renderers) {
        snprintf(specs, sizeof specs, "%s",
                 run->options.renderers ? run->options.renderers : run->scene->renderers);
    } else {
        bool fit = baselines_fit(run->scene->terrain);
        if (!fit)
            note(
                "brute and decimated are left out: they draw every sample, and so many do not fit in memory");
        specs[0] = 0;
        for (int i = 0; renderer_table[i]; i++)
            if (fit || (renderer_table[i] != &brute_renderer && renderer_table[i] != &decimated_renderer))
                snprintf(specs + strlen(specs), sizeof specs - strlen(specs), "%s%s", *specs ? "," : "",
                         renderer_table[i]->name);
    }
    char *saved = NULL;
    for (char *spec = strtok_r(specs, ",", &saved); spec; spec = strtok_r(NULL, ",", &saved))
        if (!add_spec(run, spec)) return false;
    return run->setting_count > 0 || fail("--renderers: names no renderer");
}

bool leave_out_unsupported(struct run *run)
{
    int kept = 0;
    for (int s = 0; s < run->setting_count; s++) {
        const struct renderer_type *type = run->settings[s].type;
        int count = run->unsupported_count;
        if (!renderer_unsupported(type, run->scene->terrain))
            run->settings[kept++] = run->settings[s];
        else if (count == 0 || run->unsupported[count - 1] != type)
            run->unsupported[run->unsupported_count++] = type;
    }
    run->setting_count = kept;
    return kept > 0 || fail("--renderers: none of these draws this terrain; clipmap does");
}

// A setting of millions of triangles flies few frames, spread over the path, and the report says so.
static bool choose_frames(struct run *run, struct setting *setting, uint64_t triangles)
{
    setting->few_frames = triangles > HEAVY_TRIANGLES && run->frames > HEAVY_FRAMES;
    setting->frame_count = setting->few_frames ? HEAVY_FRAMES : run->frames;
    setting->frames = malloc((size_t)setting->frame_count * sizeof *setting->frames);
    setting->records = calloc((size_t)setting->frame_count, sizeof *setting->records);
    if (!setting->frames || !setting->records) return fail("out of memory");
    for (int i = 0; i < setting->frame_count; i++)
        setting->frames[i] =
            setting->frame_count > 1 ? (int)((int64_t)i * (run->frames - 1) / (setting->frame_count - 1)) : 0;
    setting->error_px.most = setting->plane_px.most =
        (uint64_t)setting->frame_count * (uint64_t)run->scene->width * (uint64_t)run->scene->height;
    size_t count = (size_t)setting->frame_count * (size_t)run->options.repeats;
    for (int column = 0; column < TIME_COLUMNS; column++) {
        setting->times[column] = malloc(count * sizeof(double));
        if (!setting->times[column]) return fail("out of memory");
        for (size_t i = 0; i < count; i++) setting->times[column][i] = NAN;
    }
    return true;
}

bool create_renderers(struct run *run)
{
    for (int s = 0; s < run->setting_count && !*run->interrupted; s++) {
        struct setting *setting = &run->settings[s];
        struct renderer_desc desc = {
            .gpu = run->gpu,
            .terrain = run->scene->terrain,
            .effects = &run->scene->effects,
            .width = run->scene->width,
            .height = run->scene->height,
        };
        struct view view;
        struct renderer_stats stats;
        memcpy(desc.knobs, setting->knobs, sizeof desc.knobs);
        setting->renderer = setting->type->create(&desc);
        if (!setting->renderer) return false;
        scene_view(run->scene, 0, run->frames, &view);
        setting->type->begin_frame(setting->renderer, 0);
        if (!setting->type->update(setting->renderer, &view, 1)) return false;
        gpu_set_view(run->gpu, run->scene->terrain, &view);
        gpu_target_begin(run->gpu, &run->shaded);
        setting->type->draw(setting->renderer, 0, PASS_SHADED);
        setting->type->stats(setting->renderer, &stats);
        if (!choose_frames(run, setting, stats.triangles) || terrain_failed(run->scene->terrain))
            return false;
    }
    return true;
}

void setting_finish(struct setting *setting)
{
    if (setting->renderer) setting->type->destroy(setting->renderer);
    for (int column = 0; column < TIME_COLUMNS; column++) free(setting->times[column]);
    for (int m = 0; m < MOMENT_COUNT; m++) {
        free(setting->snapshots[m].picture);
        free(setting->snapshots[m].error);
    }
    error_samples_finish(&setting->error_px);
    error_samples_finish(&setting->plane_px);
    error_samples_finish(&setting->temporal_px);
    free(setting->frames);
    free(setting->records);
    free(setting->previous_height);
    free(setting->picture_digests);
    *setting = (struct setting){0};
}
