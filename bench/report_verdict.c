// The sentences at the top of the report, computed from the numbers and from nothing else.
// SPDX-License-Identifier: MIT
#include "bench/report_parts.h"
#include "bench/statistics.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double floor_share = 0.05; // a difference below 5 % is never claimed

// ---- how a renderer stands in a row -------------------------------------------------------------

// The row's value for a renderer: directly in the row or in an object inside it; NULL when it has none.
static const cJSON *row_entry(const cJSON *row, const char *renderer)
{
    const cJSON *child, *entry = cJSON_GetObjectItemCaseSensitive(row, renderer);
    if (entry || !cJSON_IsObject(row)) return entry;
    cJSON_ArrayForEach(child, row) if (cJSON_IsObject(child) && (entry = cJSON_GetObjectItemCaseSensitive(
                                                                     child, renderer))) return entry;
    return NULL;
}

// The renderer's curve read at x three times: with the median times, with their lower and with their upper
// ends. At equal time the curve of longer times gives the larger error, so low and high keep their meaning.
static void read_curve(const struct report_renderer *renderer, enum report_table table, double x,
                       double out[3])
{
    int count = renderer->point_count;
    double *errors = calloc((size_t)count * 2 + 2, sizeof *errors), *times = errors ? errors + count : NULL;
    for (int which = 0; which < 3; which++) {
        bool whole = true;
        out[which] = (double)NAN;
        for (int i = 0; errors && i < count; i++) {
            const struct report_point *point = &renderer->points[i];
            errors[i] = point->error_px;
            times[i] = which == 0 ? point->ms : which == 1 ? point->low_ms : point->high_ms;
            whole = whole && isfinite(times[i]);
        }
        if (!errors || !whole) continue; // half an interval is none
        out[which] =
            table == EQUAL_ERROR ? curve_at(errors, times, count, x) : curve_at(times, errors, count, x);
    }
    free(errors);
}

// Off its curve, does a renderer stop short of x or start beyond it?
static enum standing_kind off_curve(const struct report_renderer *renderer, enum report_table table, double x)
{
    if (renderer->point_count == 0) return STANDING_UNKNOWN;
    double low = INFINITY, high = 0;
    for (int i = 0; i < renderer->point_count; i++) {
        double value = table == EQUAL_ERROR ? renderer->points[i].error_px : renderer->points[i].ms;
        low = fmin(low, value);
        high = fmax(high, value);
    }
    return low > x ? STANDING_COARSER : high < x ? STANDING_FINER : STANDING_UNKNOWN;
}

struct standing report_standing(const struct report_renderer *renderer, const cJSON *row,
                                enum report_table table)
{
    struct standing standing = {renderer, STANDING_UNKNOWN, (double)NAN, (double)NAN, (double)NAN};
    double x = json_number(row, table == EQUAL_ERROR ? "at_px" : "at_ms"), curve[3];
    const cJSON *entry = row_entry(row, renderer->name);
    read_curve(renderer, table, x, curve);
    standing.value = entry ? json_number(entry, "") : curve[0];
    if (!(standing.value > 0)) {
        standing.value = (double)NAN;
        standing.kind = off_curve(renderer, table, x);
        return standing;
    }
    standing.kind = STANDING_AT;
    standing.low = standing.value * curve[1] / curve[0];
    standing.high = standing.value * curve[2] / curve[0];
    if (isnan(standing.low) || isnan(standing.high)) standing.low = standing.high = (double)NAN;
    return standing;
}

int report_standings(const struct report *report, const cJSON *row, enum report_table table,
                     struct standing *standings)
{
    int count = 0;
    for (int i = 0; i < report->renderer_count; i++) {
        if (report->renderers[i].role != ROLE_METHOD) continue;
        struct standing standing = report_standing(&report->renderers[i], row, table);
        if (standing.kind != STANDING_AT) continue;
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

// ---- sentences ----------------------------------------------------------------------------------

static void add_number(struct text *page, double value, const char *unit)
{
    char number[NUMBER_TEXT];
    text_add(page, "%s%s%s", number_text(value, number), unit[0] ? "\u00a0" : "", unit);
}

static void add_interval(struct text *page, const struct standing *standing, const char *unit)
{
    char low[NUMBER_TEXT], high[NUMBER_TEXT];
    add_number(page, standing->value, unit);
    if (isfinite(standing->low))
        text_add(page, " <small>[%s, %s]</small>", number_text(standing->low, low),
                 number_text(standing->high, high));
}

// The best with those that cannot be told from it, then everyone else by how much more they need.
static void add_ranking(struct text *page, const struct standing *standings, int count)
{
    int tied = 1;
    while (tied < count && !report_clearly_better(&standings[0], &standings[tied])) tied++;
    if (count == 1) {
        page_renderer(page, standings[0].renderer);
        text_add(page, " is the only method that gets there, at ");
        add_interval(page, &standings[0], "ms");
        text_add(page, ".");
        return;
    }
    if (tied == 1) {
        text_add(page, "<b>");
        page_renderer(page, standings[0].renderer);
        text_add(page, " is fastest</b>, at ");
        add_interval(page, &standings[0], "ms");
        text_add(page, " a frame");
    } else {
        text_add(page, "<b>cannot tell</b> ");
        for (int i = 0; i < tied; i++) {
            text_add(page, "%s", i == 0 ? "" : i + 1 < tied ? ", " : " from ");
            page_renderer(page, standings[i].renderer);
            text_add(page, " (");
            add_interval(page, &standings[i], "ms");
            text_add(page, ")");
        }
        if (!isfinite(standings[0].high) || !isfinite(standings[1].high))
            text_add(page, ": there is no interval without 3 repeats");
        else if (standings[1].low <= standings[0].high)
            text_add(page, ": the intervals overlap");
        else
            text_add(page, ": less than 5\u00a0%% apart");
    }
    for (int i = tied; i < count; i++) {
        text_add(page, "%s", i == tied ? "; " : ", ");
        page_renderer(page, standings[i].renderer);
        text_add(page, " takes ");
        add_number(page, standings[i].value / standings[0].value, "");
        text_add(page, "\u00a0\u00d7 as long");
    }
    text_add(page, ".");
}

static const cJSON *row_nearest_1px(const struct report *report, struct standing *standings)
{
    const cJSON *rows = json_at(report->root, "equal_error"), *row, *best = NULL;
    double nearest = INFINITY;
    if (!cJSON_IsArray(rows)) return NULL;
    cJSON_ArrayForEach(row, rows)
    {
        double distance = fabs(log(json_number(row, "at_px")));
        if (!(distance < nearest) || report_standings(report, row, EQUAL_ERROR, standings) == 0) continue;
        nearest = distance;
        best = row;
    }
    return best;
}

static void add_row(const struct report *report, const cJSON *row, struct standing *standings,
                    struct text *page)
{
    int count = report_standings(report, row, EQUAL_ERROR, standings);
    text_add(page, "At ");
    add_number(page, json_number(row, "at_px"), "px");
    text_add(page, " ");
    add_ranking(page, standings, count);
    for (int i = 0; i < report->renderer_count; i++) {
        if (report->renderers[i].role != ROLE_METHOD) continue;
        struct standing standing = report_standing(&report->renderers[i], row, EQUAL_ERROR);
        if (standing.kind != STANDING_COARSER && standing.kind != STANDING_FINER) continue;
        text_add(page, " ");
        page_renderer(page, standing.renderer);
        text_add(page, standing.kind == STANDING_COARSER ? " does not get there."
                                                         : " is finer than that at every setting.");
    }
}

// What each method pays between the coarsest and the finest error that the table asks for.
static void add_price(const struct report *report, struct text *page)
{
    const cJSON *rows = json_at(report->root, "equal_error"), *row;
    int written = 0;
    for (int i = 0; i < report->renderer_count; i++) {
        const struct report_renderer *renderer = &report->renderers[i];
        double coarse_px = 0, fine_px = INFINITY, coarse_ms = 0, fine_ms = 0;
        if (renderer->role != ROLE_METHOD || !cJSON_IsArray(rows)) continue;
        cJSON_ArrayForEach(row, rows)
        {
            struct standing standing = report_standing(renderer, row, EQUAL_ERROR);
            double at_px = json_number(row, "at_px");
            if (standing.kind != STANDING_AT) continue;
            if (at_px > coarse_px) coarse_px = at_px, coarse_ms = standing.value;
            if (at_px < fine_px) fine_px = at_px, fine_ms = standing.value;
        }
        if (!(coarse_px > fine_px)) continue;
        text_add(page, written++ ? " " : "<dt>The price</dt><dd>");
        page_renderer(page, renderer);
        text_add(page, " goes from ");
        add_number(page, coarse_ms, "ms");
        text_add(page, " at ");
        add_number(page, coarse_px, "px");
        text_add(page, " to ");
        add_number(page, fine_ms, "ms");
        text_add(page, " at ");
        add_number(page, fine_px, "px");
        text_add(page, ": \u00d7\u00a0");
        add_number(page, fine_ms / coarse_ms, "");
        text_add(page, ".");
    }
    if (written) text_add(page, "</dd>");
}

static const struct report_renderer *of_role(const struct report *report, enum report_role role)
{
    for (int i = 0; i < report->renderer_count; i++)
        if (report->renderers[i].role == role && report->renderers[i].shown) return &report->renderers[i];
    return NULL;
}

static void add_brute(const struct report_renderer *brute, const struct standing *best, double at_px,
                      struct text *page)
{
    double ms = json_number(brute->shown->json, "frame_ms.median");
    double frames = json_number(brute->shown->json, "frames");
    if (isnan(ms)) return;
    page_renderer(page, brute);
    text_add(page, ", the whole mesh, costs ");
    add_number(page, ms, "ms");
    text_add(page, " a frame");
    if (best) {
        text_add(page, ", ");
        add_number(page, ms / best->value, "");
        text_add(page, "\u00a0\u00d7 ");
        page_renderer(page, best->renderer);
        text_add(page, " at ");
        add_number(page, at_px, "px");
    }
    if (json_true(brute->shown->json, "uncertain") && frames > 0) {
        text_add(page, " (it flew only ");
        add_number(page, frames, "");
        text_add(page, " frames, so this is uncertain)");
    }
    text_add(page, ".");
}

static void add_decimated(const struct report_renderer *decimated, const struct standing *best,
                          const cJSON *row, double at_px, struct text *page)
{
    struct standing plain = report_standing(decimated, row, EQUAL_ERROR);
    text_add(page, " ");
    page_renderer(page, decimated);
    text_add(page, ", the mesh evenly sub-sampled, ");
    if (plain.kind == STANDING_COARSER)
        text_add(page, "does not reach ");
    else if (plain.kind == STANDING_AT)
        text_add(page, "needs ");
    else
        text_add(page, "was not measured at ");
    if (plain.kind == STANDING_AT) {
        add_interval(page, &plain, "ms");
        text_add(page, " at ");
    }
    add_number(page, at_px, "px");
    if (plain.kind != STANDING_AT)
        text_add(page, ".");
    else if (report_clearly_better(best, &plain))
        text_add(page, ": level of detail pays.");
    else if (report_clearly_better(&plain, best))
        text_add(page, ": level of detail does <b>not</b> pay here.");
    else
        text_add(page, ": cannot tell whether level of detail pays.");
}

static void add_baselines(const struct report *report, const cJSON *row, struct standing *standings,
                          struct text *page)
{
    const struct report_renderer *brute = of_role(report, ROLE_BRUTE);
    const struct report_renderer *decimated = of_role(report, ROLE_DECIMATED);
    const struct report_renderer *empty = of_role(report, ROLE_EMPTY);
    int count = row ? report_standings(report, row, EQUAL_ERROR, standings) : 0;
    const struct standing *best = count ? &standings[0] : NULL;
    double at_px = json_number(row, "at_px");
    if (!brute && !decimated && !empty) return;
    text_add(page, "<dt>Without level of detail</dt><dd>");
    if (brute) add_brute(brute, best, at_px, page);
    if (decimated && best) add_decimated(decimated, best, row, at_px, page);
    if (empty && isfinite(json_number(empty->shown->json, "frame_ms.median"))) {
        text_add(page, " An empty frame (");
        page_renderer(page, empty);
        text_add(page, ") costs ");
        add_number(page, json_number(empty->shown->json, "frame_ms.median"), "ms");
        text_add(page, ", which every time here contains.");
    }
    text_add(page, "</dd>");
}

static void add_holes(const struct report *report, struct text *page)
{
    int measured = 0, broken = 0;
    for (int i = 0; i < report->run_count; i++) {
        double holes = json_number(report->runs[i].json, "holes.total");
        if (report->renderers[report->runs[i].renderer].role == ROLE_EMPTY || isnan(holes)) continue;
        measured++;
        if (holes == 0) continue;
        text_add(page, broken++ ? ", " : "<b class=\"bad\">Holes</b>, which are defects: ");
        text_add_escaped(page, report->runs[i].name);
        text_add(page, " ");
        add_number(page, holes, holes == 1 ? "pixel" : "pixels");
    }
    if (!measured)
        text_add(page, "Holes were not measured.");
    else if (!broken)
        text_add(page, "<b>No holes</b> in any frame of any setting.");
    else
        text_add(page, ".");
}

// At a method's best setting misses and spills have a stated bound: 0.5 % of the ground for pgm, 0.05 % for
// others.
static void add_outlines(const struct report *report, struct text *page)
{
    int written = 0, beyond = 0;
    for (int i = 0; i < report->renderer_count; i++) {
        const struct report_renderer *renderer = &report->renderers[i];
        if (renderer->role != ROLE_METHOD || renderer->point_count == 0) continue;
        const cJSON *run = renderer->points[renderer->point_count - 1].run->json;
        double misses = json_number(run, "misses.share"), spills = json_number(run, "spills.share");
        double bound = strcmp(renderer->name, "pgm") == 0 ? 0.005 : 0.0005;
        if (isnan(misses) || isnan(spills)) continue;
        text_add(page, written++ ? "; " : " Skylines at each finest setting, misses and spills: ");
        page_renderer(page, renderer);
        text_add(page, " ");
        add_number(page, misses * 100, "% and ");
        add_number(page, spills * 100, "% of the ground");
        if (misses <= bound && spills <= bound) continue;
        beyond++;
        text_add(page, " (<b class=\"bad\">beyond the bound of ");
        add_number(page, bound * 100, "%</b>)");
    }
    if (written) text_add(page, beyond ? "." : ", all within their bounds.");
}

static void add_claims(const struct report *report, struct text *page)
{
    text_add(page, "<dt>Promises</dt><dd>");
    for (int i = 0; i < report->renderer_count; i++) {
        const struct report_renderer *renderer = &report->renderers[i];
        double broken = 0;
        int claims = 0, runs = 0;
        if (renderer->role != ROLE_METHOD) continue;
        for (int k = 0; k < report->run_count; k++) {
            if (report->runs[k].renderer != i) continue;
            runs++;
            if (isnan(json_number(report->runs[k].json, "claimed_px"))) continue;
            claims++;
            double frames = json_number(report->runs[k].json, "claim_broken_frames");
            if (frames > 0) broken += frames;
        }
        page_renderer(page, renderer);
        if (claims == 0)
            text_add(page, " claims no bound on its error. ");
        else if (broken == 0)
            text_add(page, " keeps the error it claims in every frame%s. ",
                     claims == runs ? "" : " of the settings that claim one");
        else {
            text_add(page, " <b class=\"bad\">breaks</b> the error it claims in ");
            add_number(page, broken, broken == 1 ? "frame" : "frames");
            text_add(page, ". ");
        }
    }
    text_add(page, "</dd>");
}

static void add_floor(const struct report *report, struct text *page)
{
    const cJSON *agreement = json_at(report->root, "agreement");
    double plane = json_number(agreement, "plane_px_p999"), pixels = json_number(agreement, "pixels");
    double coverage = json_number(agreement, "coverage_mismatch_max");
    double order = json_number(agreement, "order_mismatch_max");
    double allowed = 4 * fmax(1, pixels / 307200);
    text_add(page, "<dt>Floor of the method</dt><dd>");
    if (isnan(plane) || isnan(coverage) || isnan(order)) {
        text_add(page, "Not measured here: it takes brute beside the ray caster.</dd>");
        return;
    }
    bool kept = plane <= 1.6e-4 && coverage <= allowed && order <= allowed;
    text_add(page, "The full mesh and the ray caster that is the truth agree to ");
    add_number(page, plane, "px");
    text_add(page, " (plane_px p99.9); coverage differs in at most ");
    add_number(page, coverage, "");
    text_add(page, " and order in at most ");
    add_number(page, order, "");
    text_add(page, " of ");
    add_number(page, pixels, "pixels a frame: ");
    text_add(page, kept
                       ? "within the bounds of 1.6\u00d710\u207b\u2074\u00a0px and 4 in 307\u202f200.</dd>"
                       : "<b class=\"bad\">beyond the bounds</b> of 1.6\u00d710\u207b\u2074\u00a0px and 4 in "
                         "307\u202f200.</dd>");
}

static void add_machine(const struct report *report, struct text *page)
{
    const char *name = json_text(report->root, "gl.renderer");
    bool software = json_true(report->root, "gl.software"),
         known = json_at(report->root, "gl.software") != NULL;
    const char *times = json_text(report->root, "method.times");
    text_add(page, "<dt>Holds for</dt><dd>");
    if (!known)
        text_add(page, "Which GL drew this was not recorded. ");
    else if (software) {
        text_add(page, "Everything was <b>software-rendered</b> (");
        text_add_escaped(page, name);
        text_add(page, "), so vertex and pixel work share the CPU and times are %s. ",
                 times && strcmp(times, "wall") == 0 ? "wall times" : "CPU times");
    } else {
        text_add(page, "Everything was drawn by ");
        text_add_escaped(page, name);
        text_add(page, ". ");
    }
    text_add(page, "A ranking holds for the machine, terrain and path it was measured on.</dd>");
}

void report_verdict(const struct report *report, struct text *page)
{
    struct standing *standings = calloc((size_t)report->renderer_count + 1, sizeof *standings);
    if (!standings) {
        page->out_of_memory = true;
        return;
    }
    const cJSON *rows = json_at(report->root, "equal_error"), *row,
                *main_row = row_nearest_1px(report, standings);
    text_add(page, "<p class=\"lead\">");
    if (main_row)
        add_row(report, main_row, standings, page);
    else
        text_add(page, "No method has an error and a time that could be compared: cannot tell.");
    text_add(page, "</p>\n<dl class=\"verdict\">");
    add_price(report, page);
    int others = 0;
    if (main_row) cJSON_ArrayForEach(row, rows)
        {
            if (row == main_row || report_standings(report, row, EQUAL_ERROR, standings) == 0) continue;
            text_add(page, others++ ? "<br>" : "<dt>At other errors</dt><dd>");
            add_row(report, row, standings, page);
        }
    if (others) text_add(page, "</dd>");
    add_baselines(report, main_row, standings, page);
    text_add(page, "<dt>Coverage</dt><dd>");
    add_holes(report, page);
    add_outlines(report, page);
    text_add(page, "</dd>");
    add_claims(report, page);
    add_floor(report, page);
    add_machine(report, page);
    text_add(page, "</dl>\n");
    free(standings);
}
