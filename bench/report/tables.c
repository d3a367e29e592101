// The report's tables: time at equal error and error at equal time, steadiness, every run.
// SPDX-License-Identifier: MIT
#include "bench/report/parts.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

void page_renderer(struct text *page, const struct report_renderer *renderer)
{
    text_add(page, "<span class=\"who\" style=\"--c:%s\">", renderer->colour);
    text_add_escaped(page, renderer->name);
    text_add(page, "</span>");
}

void page_run(struct text *page, const struct report *report, const struct report_run *run)
{
    text_add(page, "<span class=\"who\" style=\"--c:%s\">", report->renderers[run->renderer].colour);
    text_add_escaped(page, run->name);
    text_add(page, json_true(run->json, "uncertain") ? "</span>\u2020" : "</span>");
}

// ---- equal error, equal time --------------------------------------------------------------------

static bool stands_in_tables(const struct report_renderer *renderer)
{
    return renderer->point_count > 0 && (renderer->role == ROLE_METHOD || renderer->role == ROLE_DECIMATED);
}

static void add_standing(struct text *page, const struct standing *standing, enum report_table table,
                         bool best)
{
    char value[NUMBER_TEXT], low[NUMBER_TEXT], high[NUMBER_TEXT];
    if (standing->kind == STANDING_NOT) {
        text_add(page, "<td class=\"off\">%s</td>", table == EQUAL_ERROR ? "not reached" : "takes longer");
        return;
    }
    text_add(page, "<td%s>%s%s", best ? " class=\"best\"" : "",
             standing->kind == STANDING_AT_MOST ? "\u2264\u00a0" : "", number_text(standing->value, value));
    if (standing->kind == STANDING_AT && isfinite(standing->low))
        text_add(page, "<small>[%s, %s]</small>", number_text(standing->low, low),
                 number_text(standing->high, high));
    text_add(page, "</td>");
}

static void add_winner(const struct report *report, const cJSON *row, enum report_table table,
                       struct standing *standings, struct text *page)
{
    int count = report_standings(report, row, table, standings), tied = 1;
    while (tied < count && !report_clearly_better(&standings[0], &standings[tied])) tied++;
    text_add(page, "<td class=\"word\">");
    if (count == 0)
        text_add(page, "\u2013");
    else if (count > 1 && tied > 1)
        text_add(page, "cannot tell");
    else
        page_renderer(page, standings[0].renderer);
    text_add(page, "</td>");
}

static void add_equal_table(const struct report *report, enum report_table table, struct text *page)
{
    bool error = table == EQUAL_ERROR;
    const cJSON *rows = json_at(report->root, error ? "equal_error" : "equal_time"), *row;
    struct standing *standings = calloc((size_t)report->renderer_count + 1, sizeof *standings);
    char number[NUMBER_TEXT];
    text_add(page, "<div class=\"half\"><h3>%s</h3>", error ? "Time at equal error" : "Error at equal time");
    if (!standings || !cJSON_IsArray(rows) || cJSON_GetArraySize(rows) == 0) {
        text_add(page, "<p>Not measured: it takes at least two settings of a renderer.</p></div>");
        free(standings);
        return;
    }
    text_add(page, "<div class=\"scroll\"><table><thead><tr><th>%s</th>", error ? "px, p99.9" : "ms, median");
    for (int i = 0; i < report->renderer_count; i++) {
        if (!stands_in_tables(&report->renderers[i])) continue;
        text_add(page, "<th>");
        page_renderer(page, &report->renderers[i]);
        text_add(page, "%s</th>", error ? "<small>ms</small>" : "<small>px</small>");
    }
    text_add(page, "<th class=\"word\">%s</th></tr></thead><tbody>",
             error ? "fastest method" : "most accurate");
    for (row = json_first(rows); row; row = row->next) {
        text_add(page, "<tr><th>%s</th>", short_text(json_number(row, error ? "at_px" : "at_ms"), number));
        int count = report_standings(report, row, table, standings);
        bool clear = count == 1 || (count > 1 && report_clearly_better(&standings[0], &standings[1]));
        const struct report_renderer *first = clear ? standings[0].renderer : NULL;
        for (int i = 0; i < report->renderer_count; i++) {
            if (!stands_in_tables(&report->renderers[i])) continue;
            struct standing standing = report_standing(&report->renderers[i], row, table);
            add_standing(page, &standing, table, &report->renderers[i] == first);
        }
        add_winner(report, row, table, standings, page);
        text_add(page, "</tr>");
    }
    text_add(page, "</tbody></table></div></div>\n");
    free(standings);
}

// The field's figure: time as a share of brute's, at equal mean error.  Absent where no renderer meets those
// errors.
static void add_against_brute(const struct report *report, struct text *page)
{
    const cJSON *rows = json_at(report->root, "against_brute"), *row;
    char number[NUMBER_TEXT];
    bool any = false;
    for (row = json_first(rows); row; row = row->next)
        for (int i = 0; i < report->renderer_count; i++)
            any |= isfinite(json_number(row, report->renderers[i].name));
    if (!any) return;
    text_add(page,
             "<h3>Against the whole mesh</h3><p>Frame time as a share of brute\u2019s, at equal <b>mean</b> "
             "error: the figure that other terrain renderers are compared by.</p>"
             "<div class=\"scroll\"><table><thead><tr><th>px, mean</th>");
    for (int i = 0; i < report->renderer_count; i++) {
        if (!stands_in_tables(&report->renderers[i])) continue;
        text_add(page, "<th>");
        page_renderer(page, &report->renderers[i]);
        text_add(page, "</th>");
    }
    text_add(page, "</tr></thead><tbody>");
    for (row = json_first(rows); row; row = row->next) {
        text_add(page, "<tr><th>%s</th>", short_text(json_number(row, "at_mean_px"), number));
        for (int i = 0; i < report->renderer_count; i++)
            if (stands_in_tables(&report->renderers[i]))
                text_add(page, "<td>%s</td>",
                         number_text(json_number(row, report->renderers[i].name), number));
        text_add(page, "</tr>");
    }
    text_add(page, "</tbody></table></div>\n");
}

void report_equal_tables(const struct report *report, struct text *page)
{
    text_add(page, "<div class=\"halves\">");
    add_equal_table(report, EQUAL_ERROR, page);
    add_equal_table(report, EQUAL_TIME, page);
    text_add(page, "</div><p class=\"note\">Read off the curves between the two settings around each value. "
                   "In brackets the "
                   "95\u00a0%% interval. A method is called best only where the intervals are apart and the "
                   "values differ "
                   "by 5\u00a0%% or more; else the table says \u201ccannot tell\u201d.</p>\n");
    add_against_brute(report, page);
}

// ---- tables of runs -----------------------------------------------------------------------------

enum kind { NUMBER, TIME, WHOLE, BYTES, PERCENT, INTERVAL, CLAIM, ROOFLINE };

struct column {
    const char *heading, *unit, *value; // value: dotted name in the run
    enum kind kind;
    const char *meaning; // what hovering over the heading shows
};

static const struct column time_columns[] = {
    {"median", "ms", "frame_ms.median", TIME, "frame_ms: whole frame with the pipeline finished"},
    {"95\u00a0% interval", "ms", "frame_ms.ci95", INTERVAL, "of the median, block bootstrap over repeats"},
    {"p95", "ms", "frame_ms.p95", TIME, "95 of 100 frames take no longer"},
    {"p99", "ms", "frame_ms.p99", TIME, "99 of 100 frames take no longer"},
    {"max", "ms", "frame_ms.max", TIME, "slowest frame of the path"},
    {"update", "ms", "update_ms.median", TIME, "selection and upload, median"},
    {"draw", "ms", "draw_ms.median", TIME, "draw calls until the pipeline is finished, median"},
    {"wall", "ms", "wall_ms.median", TIME, "wall clock of the frame, median"},
    {"worker", "ms", "worker_ms.median", TIME, "CPU time of other threads, median"},
    {"GPU", "ms", "gpu_ms", TIME, "from timer queries, median"},
    {"draw over", "roofline", "roofline_ms.draw_ratio", ROOFLINE,
     "draw over the plainest possible draw of the same triangles"},
    {"throughput", "ms", "throughput_ms", TIME, "with two frames in flight, median"},
    {"frames/s", "", "fps", NUMBER, "frames over their time"},
    {"frames", "", "frames", WHOLE, "frames of the path that it flew"},
    {NULL, NULL, NULL, NUMBER, NULL},
};

static const struct column error_columns[] = {
    {"mean", "px", "error_px.mean", NUMBER, "error_px over all pixels of all frames"},
    {"rms", "px", "error_px.rms", NUMBER, "root mean square of error_px"},
    {"p50", "px", "error_px.p50", NUMBER, "half of the pixels err no more"},
    {"p99", "px", "error_px.p99", NUMBER, "99 of 100 pixels err no more"},
    {"p99.9", "px", "error_px.p999", NUMBER, "999 of 1000 pixels err no more"},
    {"max", "px", "error_px.max", NUMBER, "worst pixel of the path"},
    {"over 1\u00a0px", "%", "error_px.share_over_1px", PERCENT, "share of pixels that err by more than 1 px"},
    {"plane", "px, p99.9", "plane_px.p999", NUMBER, "plane_px: point to plane distance"},
    {"temporal", "px, p99.9", "temporal_px.p999", NUMBER, "temporal_px: popping and swimming between frames"},
    {"", "px, max", "temporal_px.max", NUMBER, "temporal_px: popping and swimming between frames"},
    {NULL, NULL, NULL, NUMBER, NULL},
};

static const struct column promise_columns[] = {
    {"claimed", "px", "claimed_px", CLAIM, "largest error that the method itself promises"},
    {"broken", "frames", "claim_broken_frames", WHOLE, "frames whose error exceeds the claim"},
    {"tightness", "mean", "tightness.mean", NUMBER, "claimed over measured error, mean over frames"},
    {"", "least", "tightness.min", NUMBER, "claimed over measured error in the frame that comes nearest"},
    {"holes", "pixels", "holes.total", WHOLE,
     "undrawn ground inside the terrain, all frames together: a defect"},
    {"misses", "pixels", "misses.total", WHOLE, "undrawn ground at the skyline, all frames together"},
    {"", "% of ground", "misses.share", PERCENT, "undrawn ground at the skyline"},
    {"", "worst frame", "misses.worst_frame", WHOLE, "pixels in the frame with most"},
    {"spills", "pixels", "spills.total", WHOLE, "drawn where the truth has sky, all frames together"},
    {"", "% of ground", "spills.share", PERCENT, "drawn where the truth has sky"},
    {"", "worst frame", "spills.worst_frame", WHOLE, "pixels in the frame with most"},
    {NULL, NULL, NULL, NUMBER, NULL},
};

static const struct column work_columns[] = {
    {"triangles", "mean", "triangles.mean", WHOLE, "submitted in a frame"},
    {"", "max", "triangles.max", WHOLE, "submitted in a frame"},
    {"visible", "mean", "visible_triangles.mean", WHOLE,
     "less degenerate ones and those outside the frustum"},
    {"draw calls", "mean", "draw_calls.mean", NUMBER, "in a frame"},
    {"upload", "mean", "upload_bytes.mean", BYTES, "bytes sent to the GL in a frame"},
    {"", "max", "upload_bytes.max", BYTES, "bytes sent to the GL in a frame"},
    {"resident", "", "resident_bytes", BYTES, "held in buffers and textures"},
    {NULL, NULL, NULL, NUMBER, NULL},
};

// A number, or what stands for the whole where the value is a summary: its median, else its mean.
static double run_value(const cJSON *run, const char *name)
{
    const cJSON *found = json_at(run, name);
    if (!cJSON_IsObject(found)) return json_number(run, name);
    double median = json_number(found, "median");
    return isfinite(median) ? median : json_number(found, "mean");
}

// Median of the frames' own ratios when it was recorded, else the ratio of the medians.
static double roofline_ratio(const cJSON *run)
{
    double ratio = json_number(run, "roofline_ms.draw_ratio");
    return isfinite(ratio) ? ratio
                           : json_number(run, "draw_ms.median") / json_number(run, "roofline_ms.median");
}

// A method that was measured and promised nothing; one that was not measured may have had something to
// promise.
static bool claims_none(const cJSON *run)
{
    return isnan(json_number(run, "claimed_px")) && isfinite(json_number(run, "error_px.p999"));
}

static bool measured(const cJSON *run, const struct column *column)
{
    if (column->kind == CLAIM) return true;
    if (column->kind == INTERVAL) return cJSON_IsArray(json_at(run, column->value));
    if (column->kind == ROOFLINE) return isfinite(roofline_ratio(run));
    return isfinite(run_value(run, column->value));
}

static bool column_shown(const struct report *report, const struct column *column)
{
    for (int i = 0; i < report->run_count; i++)
        if (measured(report->runs[i].json, column)) return true;
    return false;
}

static void add_interval(const cJSON *interval, struct text *page)
{
    char low[NUMBER_TEXT], high[NUMBER_TEXT];
    const cJSON *array = cJSON_IsArray(interval) ? interval : NULL;
    double from = json_number(cJSON_GetArrayItem(array, 0), ""),
           to = json_number(cJSON_GetArrayItem(array, 1), "");
    if (isfinite(from) && isfinite(to))
        text_add(page, "[%s, %s]", number_text(from, low), number_text(to, high));
    else
        text_add(page, "\u2013");
}

static void add_cell(const cJSON *run, const struct column *column, struct text *page)
{
    char number[NUMBER_TEXT];
    double value = run_value(run, column->value);
    text_add(page, "<td>");
    switch (column->kind) {
    case NUMBER:
        text_add(page, "%s", number_text(value, number));
        break;
    case TIME:
        if (value > 0 && value < 1e-3)
            text_add(page, "&lt;0.001");
        else
            text_add(page, "%s", number_text(value, number));
        break;
    case WHOLE:
        text_add(page, "%s", count_text(value, number));
        break;
    case BYTES:
        text_add(page, "%s", bytes_text(value, number));
        break;
    case PERCENT:
        text_add(page, "%s", number_text(value * 100, number));
        break;
    case INTERVAL:
        add_interval(json_at(run, column->value), page);
        break;
    case CLAIM:
        text_add(page, "%s", claims_none(run) ? "none" : number_text(value, number));
        break;
    case ROOFLINE:
        text_add(page, "%s", number_text(roofline_ratio(run), number));
        break;
    }
    text_add(page, "</td>");
}

static void add_run_table(const struct report *report, const char *title, const struct column *columns,
                          struct text *page)
{
    text_add(
        page,
        "<h3>%s</h3><div class=\"scroll\"><table class=\"runs\"><thead><tr><th class=\"word\">setting</th>",
        title);
    for (const struct column *column = columns; column->heading; column++)
        if (column_shown(report, column))
            text_add(page, "<th title=\"%s\">%s<small>%s</small></th>", column->meaning, column->heading,
                     column->unit);
    text_add(page, "</tr></thead><tbody>");
    for (int i = 0; i < report->run_count; i++) {
        bool first = i == 0 || report->runs[i].renderer != report->runs[i - 1].renderer;
        text_add(page, "<tr%s><th class=\"word\">", first ? " class=\"first\"" : "");
        page_run(page, report, &report->runs[i]);
        text_add(page, "</th>");
        for (const struct column *column = columns; column->heading; column++)
            if (column_shown(report, column)) add_cell(report->runs[i].json, column, page);
        text_add(page, "</tr>\n");
    }
    text_add(page, "</tbody></table></div>\n");
}

// ---- what the methods counted -------------------------------------------------------------------

enum { COUNTER_NAMES = 32 };

// Names of all counters that a renderer's runs have, in their own order.  Returns how many.
static int counter_names(const struct report *report, int renderer, const char *names[COUNTER_NAMES])
{
    int count = 0;
    for (int i = 0; i < report->run_count; i++) {
        if (report->runs[i].renderer != renderer) continue;
        const cJSON *counter = json_first(json_at(report->runs[i].json, "counters"));
        for (; counter; counter = counter->next) {
            int k = 0;
            while (k < count && counter->string && strcmp(names[k], counter->string) != 0) k++;
            if (counter->string && k == count && count < COUNTER_NAMES) names[count++] = counter->string;
        }
    }
    return count;
}

static void add_counter_rows(const struct report *report, int renderer, const char *const *names, int count,
                             struct text *page)
{
    char number[NUMBER_TEXT];
    for (int i = 0; i < report->run_count; i++) {
        if (report->runs[i].renderer != renderer) continue;
        const cJSON *counters = json_at(report->runs[i].json, "counters");
        text_add(page, "<tr><th class=\"word\">");
        page_run(page, report, &report->runs[i]);
        text_add(page, "</th>");
        for (int k = 0; k < count; k++) {
            const cJSON *counter = cJSON_GetObjectItemCaseSensitive(counters, names[k]);
            text_add(page, "<td>%s</td>", number_text(json_number(counter, ""), number));
        }
        text_add(page, "</tr>\n");
    }
}

// A table a renderer, closed until asked for: no two count the same things.
static void add_counters(const struct report *report, struct text *page)
{
    const char *names[COUNTER_NAMES];
    bool any = false;
    for (int i = 0; i < report->renderer_count; i++) {
        int count = counter_names(report, i, names);
        if (count == 0) continue;
        if (!any)
            text_add(page,
                     "<details id=\"counters\"><summary>What the methods counted</summary><p>Figures of "
                     "each method\u2019s own, under its own names: means over the frames.</p>\n");
        any = true;
        text_add(page, "<div class=\"scroll\"><table class=\"runs\"><thead><tr><th class=\"word\">");
        page_renderer(page, &report->renderers[i]);
        text_add(page, "</th>");
        for (int k = 0; k < count; k++) {
            text_add(page, "<th>");
            text_add_escaped(page, names[k]);
            text_add(page, "</th>");
        }
        text_add(page, "</tr></thead><tbody>");
        add_counter_rows(report, i, names, count, page);
        text_add(page, "</tbody></table></div>\n");
    }
    if (any) text_add(page, "</details>\n");
}

// ---- all ----------------------------------------------------------------------------------------

// Renderers that cannot draw the scene's terrain.
static void add_unsupported(const struct report *report, struct text *page)
{
    const cJSON *rows = cJSON_GetObjectItemCaseSensitive(report->root, "unsupported"), *row;
    if (cJSON_GetArraySize(rows) == 0) return;
    text_add(page, "<table><tbody>");
    cJSON_ArrayForEach(row, rows)
    {
        const char *name = json_text(row, "renderer"), *reason = json_text(row, "reason");
        text_add(page, "<tr><th>");
        text_add_escaped(page, name ? name : "");
        text_add(page, "</th><td>unsupported: ");
        text_add_escaped(page, reason ? reason : "");
        text_add(page, "</td></tr>");
    }
    text_add(page, "</tbody></table>\n");
}

void report_run_tables(const struct report *report, struct text *page)
{
    bool uncertain = false;
    if (report->run_count == 0) {
        text_add(page, "<p>No run was measured.</p>");
        return;
    }
    add_run_table(report, "Time", time_columns, page);
    add_run_table(report, "Error on the screen", error_columns, page);
    add_run_table(report, "Coverage and promises", promise_columns, page);
    add_run_table(report, "Work and memory", work_columns, page);
    add_counters(report, page);
    add_unsupported(report, page);
    const char *why = NULL;
    for (int i = 0; i < report->run_count; i++) {
        if (!json_true(report->runs[i].json, "uncertain")) continue;
        uncertain = true;
        why = json_text(report->runs[i].json, "reasons.frames");
    }
    text_add(page, "<p class=\"note\">A dash is a number that was not measured; the reasons stand below.");
    if (uncertain) {
        text_add(page, " \u2020\u00a0Flew fewer frames than the path has, so its figures are uncertain");
        if (why) text_add(page, ": ");
        if (why) text_add_escaped(page, why);
        text_add(page, ".");
    }
    text_add(page, "</p>\n");
}

// ---- steadiness ---------------------------------------------------------------------------------

static const struct column steadiness_columns[] = {
    {"median", "ms", "frame_ms.median", NUMBER, "frame_ms"},
    {"p95", "ms", "frame_ms.p95", NUMBER, "95 of 100 frames take no longer"},
    {"p99", "ms", "frame_ms.p99", NUMBER, "99 of 100 frames take no longer"},
    {"max", "ms", "frame_ms.max", NUMBER, "slowest frame"},
    {"steadiness", "p99 / median", "steadiness", NUMBER, "of frame_ms over roofline_ms, frame by frame"},
    {NULL, NULL, NULL, NUMBER, NULL},
};

static const struct column motion_columns[] = {
    {"p99.9", "px", "temporal_px.p999", NUMBER, "999 of 1000 places move no farther"},
    {"max", "px", "temporal_px.max", NUMBER, "the place that moves farthest"},
    {NULL, NULL, NULL, NUMBER, NULL},
};

// One row for each setting that stands for a renderer, up to the last of the roles asked for.
static void add_shown_table(const struct report *report, const struct column *columns, enum report_role last,
                            struct text *page)
{
    text_add(page, "<div class=\"scroll\"><table><thead><tr><th class=\"word\">setting</th>");
    for (const struct column *column = columns; column->heading; column++)
        text_add(page, "<th title=\"%s\">%s<small>%s</small></th>", column->meaning, column->heading,
                 column->unit);
    text_add(page, "</tr></thead><tbody>");
    for (int i = 0; i < report->renderer_count; i++) {
        const struct report_run *run = report->renderers[i].shown;
        if (!run || report->renderers[i].role > last) continue;
        text_add(page, "<tr><th class=\"word\">");
        page_run(page, report, run);
        text_add(page, "</th>");
        for (const struct column *column = columns; column->heading; column++)
            add_cell(run->json, column, page);
        text_add(page, "</tr>");
    }
    text_add(page, "</tbody></table></div>");
}

void report_steadiness(const struct report *report, struct text *page)
{
    add_shown_table(report, steadiness_columns, ROLE_METHOD, page);
    text_add(page,
             "<p class=\"note\">Steadiness takes the scene out: each frame\u2019s time over the time of "
             "the plainest draw of the same triangles, its p99 over its median. 1 is perfectly "
             "steady.</p>\n");
}

void report_motion(const struct report *report, struct text *page)
{
    double step_m = json_number(report->root, "path.step_m");
    char number[NUMBER_TEXT];
    int written = 0;
    add_shown_table(report, motion_columns, ROLE_BRUTE, page);
    text_add(page, "<p class=\"note\">temporal_px over the whole path; brute moves by rounding alone.");
    if (isfinite(step_m))
        text_add(page, " From frame to frame the eye moves %s\u00a0m on average: it depends on that.",
                 number_text(step_m, number));
    for (int i = 0; i < report->renderer_count; i++) {
        const struct report_run *run = report->renderers[i].shown;
        if (!run || report->renderers[i].role > ROLE_BRUTE) continue;
        if (isfinite(json_number(run->json, "temporal_px.p999"))) continue;
        const char *reason = json_text(run->json, "reasons.temporal_px");
        text_add(page, written++ ? "; " : " Not measured: ");
        page_run(page, report, run);
        text_add(page, ", ");
        text_add_escaped(page, reason ? reason : "no reason was recorded");
    }
    text_add(page, written ? ".</p>\n" : "</p>\n");
}
