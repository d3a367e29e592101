// What results.json derives from its rows: curves over a renderer's settings and the tables read off them.
// SPDX-License-Identifier: MIT
#include "bench/result_parts.h"
#include "common/report.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double equal_error_px[] = {0.125, 0.25, 0.5, 1, 2, 4, 8};
static const double equal_time_ms[] = {1, 2, 5, 10, 20, 50, 100, 200, 500};
static const double field_error_px[] = {0.1, 0.03, 0.013}; // mean errors at which peers were measured

#define COUNT(array) ((int)(sizeof(array) / sizeof(array)[0]))

struct curve { // a renderer's measured settings
    const struct renderer_type *type;
    int count, member[MAX_SETTINGS];
    double error_px_p999[MAX_SETTINGS], error_px_mean[MAX_SETTINGS], frame_ms[MAX_SETTINGS],
        visible[MAX_SETTINGS];
};

static int build_curves(const struct run *run, const struct result_summary *summaries, struct curve *curves)
{
    int count = 0;
    for (int i = 0; renderer_table[i]; i++) {
        struct curve *curve = &curves[count];
        *curve = (struct curve){.type = renderer_table[i]};
        if (!curve->type->quality_knob) continue;
        for (int s = 0; s < run->setting_count; s++) {
            const struct setting *setting = &run->settings[s];
            const struct result_summary *summary = &summaries[s];
            if (setting->type != curve->type || !setting->measured || !isfinite(summary->frame_ms)) continue;
            int k = curve->count++;
            curve->member[k] = s;
            curve->error_px_p999[k] = summary->error_px.p999;
            curve->error_px_mean[k] = summary->error_px.mean;
            curve->frame_ms[k] = summary->frame_ms;
            curve->visible[k] = summary->visible_triangles;
        }
        if (curve->count) count++;
    }
    return count;
}

// Whether two settings differ in the knob that is swept alone.
static bool same_sweep(const struct setting *a, const struct setting *b)
{
    int quality = renderer_knob_index(a->type, a->type->quality_knob);
    for (int k = 0; a->type->knobs[k].name; k++)
        if (k != quality && a->knobs[k] != b->knobs[k]) return false;
    return true;
}

// Of error with visible triangles over one sweep of a curve: the one with the most settings, the first of
// these.
static double sweep_correlation(const struct run *run, const struct curve *curve)
{
    double best[2][MAX_SETTINGS];
    int most = 0;
    for (int first = 0; first < curve->count; first++) {
        double values[2][MAX_SETTINGS];
        int count = 0;
        for (int k = 0; k < curve->count; k++) {
            if (!same_sweep(&run->settings[curve->member[first]], &run->settings[curve->member[k]])) continue;
            values[0][count] = curve->error_px_p999[k];
            values[1][count++] = curve->visible[k];
        }
        if (count <= most) continue;
        memcpy(best, values, sizeof best);
        most = count;
    }
    return rank_correlation(best[0], best[1], most);
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
            result_add_number(point, "error_px_p999", curve->error_px_p999[k]);
            result_add_number(point, "error_px_mean", curve->error_px_mean[k]);
            result_add_number(point, "frame_ms_median", curve->frame_ms[k]);
        }
        cJSON *sweep = cJSON_CreateObject();
        cJSON_AddItemToArray(sweeps, sweep);
        cJSON_AddStringToObject(sweep, "renderer", curve->type->name);
        cJSON_AddStringToObject(sweep, "knob", curve->type->quality_knob);
        result_add_number(sweep, "rank_correlation", sweep_correlation(run, curve));
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
            result_add_number(row, curve->type->name, value);
            any = any || isfinite(value);
        }
        if (any)
            cJSON_AddItemToArray(table, row);
        else
            cJSON_Delete(row);
    }
}

// Time at a mean error.  Settings that another one beats in both are passed over: of several sweeps of a
// renderer, the best is read.
static double best_at(const struct curve *curve, double error_px)
{
    double errors_px[MAX_SETTINGS], frame_ms[MAX_SETTINGS];
    int count = 0;
    for (int k = 0; k < curve->count; k++) {
        bool beaten = false;
        for (int other = 0; other < curve->count; other++)
            beaten = beaten || (curve->error_px_mean[other] < curve->error_px_mean[k] &&
                                curve->frame_ms[other] < curve->frame_ms[k]);
        if (beaten) continue;
        errors_px[count] = curve->error_px_mean[k];
        frame_ms[count++] = curve->frame_ms[k];
    }
    return curve_at(errors_px, frame_ms, count, error_px);
}

// Frame time over that of brute drawn whole, at equal mean error: the figure peers are compared by.
static void add_field(cJSON *root, const struct run *run, const struct result_summary *summaries,
                      const struct curve *curves, int count)
{
    cJSON *table = cJSON_AddArrayToObject(root, "against_brute");
    double brute_ms = NAN;
    for (int s = 0; s < run->setting_count; s++)
        if (run->settings[s].type == &brute_renderer && run->settings[s].knobs[0] == 0)
            brute_ms = summaries[s].frame_ms;
    for (int r = 0; r < COUNT(field_error_px) && isfinite(brute_ms); r++) {
        cJSON *row = cJSON_CreateObject();
        cJSON_AddItemToArray(table, row);
        cJSON_AddNumberToObject(row, "at_mean_px", field_error_px[r]);
        for (int c = 0; c < count; c++)
            result_add_number(row, curves[c].type->name, best_at(&curves[c], field_error_px[r]) / brute_ms);
    }
}
bool result_add_curves(cJSON *root, const struct run *run, const struct result_summary *summaries)
{
    int types = 0;
    while (renderer_table[types]) types++;
    struct curve *curves = calloc((size_t)types, sizeof *curves);
    if (!curves) return fail("out of memory");
    int count = build_curves(run, summaries, curves);
    add_curves(root, run, curves, count);
    add_table(root, "equal_error", "at_px", equal_error_px, COUNT(equal_error_px), curves, count, true);
    add_table(root, "equal_time", "at_ms", equal_time_ms, COUNT(equal_time_ms), curves, count, false);
    add_field(root, run, summaries, curves, count);
    free(curves);
    return true;
}
