// How the renderers stand at an equal error or an equal time, and when one may be called better.
// SPDX-License-Identifier: MIT
#include "bench/report/parts.h"
#include "bench/statistics.h"

#include <math.h>
#include <stdlib.h>

static const double floor_share = 0.05; // a difference below 5 % is never claimed

// The row's value for a renderer: directly in the row or in an object inside it; NULL when it has none.
static const cJSON *row_entry(const cJSON *row, const char *renderer)
{
    const cJSON *child, *entry = cJSON_GetObjectItemCaseSensitive(row, renderer);
    if (entry || !cJSON_IsObject(row)) return entry;
    for (child = json_first(row); child; child = child->next)
        if (cJSON_IsObject(child) && (entry = cJSON_GetObjectItemCaseSensitive(child, renderer)))
            return entry;
    return NULL;
}

// The smallest of the errors when every time is below x: what the renderer reaches at least in that time.
static double beyond_end(const double *errors, const double *times, int count, double x)
{
    double best = INFINITY;
    for (int i = 0; i < count; i++) {
        if (times[i] >= x) return NAN;
        best = fmin(best, errors[i]);
    }
    return best;
}

// The renderer's curve read at x three times: with the median times, with their lower and with their upper
// ends. At equal time the curve of longer times gives the larger error, so low and high keep their meaning.
static void read_curve(const struct report_renderer *renderer, enum report_table table, double x,
                       double out[3])
{
    int count = renderer->point_count;
    double *errors = calloc((size_t)count * 2 + 2, sizeof *errors), *times = errors ? errors + count : NULL;
    for (int which = 0; which < 3; which++) {
        bool whole = errors != NULL; // half an interval is none
        out[which] = (double)NAN;
        for (int i = 0; errors && i < count; i++) {
            const struct report_point *point = &renderer->points[i];
            errors[i] = point->error_px;
            times[i] = which == 0 ? point->ms : which == 1 ? point->low_ms : point->high_ms;
            whole = whole && isfinite(times[i]);
        }
        if (!whole) continue;
        out[which] =
            table == EQUAL_ERROR ? curve_at(errors, times, count, x) : curve_at(times, errors, count, x);
        if (which == 1 && table == EQUAL_TIME && isnan(out[1])) out[1] = beyond_end(errors, times, count, x);
    }
    free(errors);
}

// Off its curve: either the renderer never gets there, or all its points do and the best of them bounds the
// value.
static void stand_off_curve(struct standing *standing, enum report_table table, double x)
{
    const struct report_renderer *renderer = standing->renderer;
    double best = INFINITY, best_high = (double)NAN, nearest = INFINITY, farthest = 0;
    for (int i = 0; i < renderer->point_count; i++) {
        const struct report_point *point = &renderer->points[i];
        double at = table == EQUAL_ERROR ? point->error_px : point->ms;
        double value = table == EQUAL_ERROR ? point->ms : point->error_px;
        nearest = fmin(nearest, at);
        farthest = fmax(farthest, at);
        if (value >= best) continue;
        best = value;
        best_high = table == EQUAL_ERROR ? point->high_ms : point->high_ms <= x ? value : (double)NAN;
    }
    if (nearest > x && isfinite(nearest)) standing->kind = STANDING_NOT;
    if (!(farthest < x) || !(best > 0) || isinf(best)) return;
    standing->kind = STANDING_AT_MOST;
    standing->value = best;
    standing->low = 0;
    standing->high = best_high;
}

struct standing report_standing(const struct report_renderer *renderer, const cJSON *row,
                                enum report_table table)
{
    struct standing standing = {renderer, STANDING_UNKNOWN, (double)NAN, (double)NAN, (double)NAN};
    double x = json_number(row, table == EQUAL_ERROR ? "at_px" : "at_ms"), curve[3];
    const cJSON *entry = row_entry(row, renderer->name);
    read_curve(renderer, table, x, curve);
    double value = entry ? json_number(entry, "") : curve[0];
    if (!(value > 0)) {
        stand_off_curve(&standing, table, x);
        return standing;
    }
    standing.kind = STANDING_AT;
    standing.value = value;
    double low = value * curve[1] / curve[0], high = value * curve[2] / curve[0];
    if (isnan(low) || isnan(high)) return standing;
    standing.low = fmin(value, fmin(low, high)); // a curve may fall where it should rise
    standing.high = fmax(value, fmax(low, high));
    return standing;
}

int report_standings(const struct report *report, const cJSON *row, enum report_table table,
                     struct standing *standings)
{
    int count = 0;
    for (int i = 0; i < report->renderer_count; i++) {
        if (report->renderers[i].role != ROLE_METHOD) continue;
        struct standing standing = report_standing(&report->renderers[i], row, table);
        if (standing.kind != STANDING_AT && standing.kind != STANDING_AT_MOST) continue;
        int at = count++;
        for (; at > 0 && standings[at - 1].value > standing.value; at--) standings[at] = standings[at - 1];
        standings[at] = standing;
    }
    return count;
}

bool report_clearly_better(const struct standing *a, const struct standing *b)
{
    if (!isfinite(a->high) || !isfinite(b->low)) return false;
    return a->high < b->low && b->value >= a->value * (1 + floor_share);
}
