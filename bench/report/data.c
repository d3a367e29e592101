// SPDX-License-Identifier: MIT
#include "bench/report/parts.h"
#include "bench/statistics.h"
#include "common/report.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

// Okabe and Ito's palette, which stays apart for colour-blind readers; each renderer also has a mark of its
// own.
static const struct {
    const char *name, *colour;
    int mark;
    enum report_role role;
} looks[] = {
    {"clipmap", "#0072B2", 7, ROLE_METHOD}, {"geomipmap", "#D55E00", 5, ROLE_METHOD},
    {"pgm", "#009E73", 9, ROLE_METHOD},     {"decimated", "#CC79A7", 13, ROLE_DECIMATED},
    {"brute", "#333333", 3, ROLE_BRUTE},    {"null", "#8A8A8A", 2, ROLE_EMPTY},
};
enum { LOOKS = sizeof looks / sizeof looks[0] };
static const char *const spare_colours[] = {"#E69F00", "#56B4E9", "#882255", "#6B6B00"};
enum { SPARE_COLOURS = sizeof spare_colours / sizeof spare_colours[0] };

// ---- reading values -----------------------------------------------------------------------------

const cJSON *json_at(const cJSON *item, const char *dotted)
{
    char key[64];
    while (item && *dotted) {
        size_t length = strcspn(dotted, ".");
        if (length >= sizeof key || !cJSON_IsObject(item)) return NULL;
        memcpy(key, dotted, length);
        key[length] = 0;
        item = cJSON_GetObjectItemCaseSensitive(item, key);
        dotted += length + (dotted[length] == '.');
    }
    return item && !cJSON_IsNull(item) ? item : NULL;
}

const cJSON *json_first(const cJSON *item)
{
    return cJSON_IsArray(item) || cJSON_IsObject(item) ? item->child : NULL;
}

double json_number(const cJSON *item, const char *dotted)
{
    const cJSON *found = json_at(item, dotted);
    return cJSON_IsNumber(found) && isfinite(found->valuedouble) ? found->valuedouble : (double)NAN;
}

const char *json_text(const cJSON *item, const char *dotted)
{
    const cJSON *found = json_at(item, dotted);
    return cJSON_IsString(found) && found->valuestring[0] ? found->valuestring : NULL;
}

bool json_true(const cJSON *item, const char *dotted)
{
    return cJSON_IsTrue(json_at(item, dotted));
}

bool report_path(const struct report *report, const char *file, char *path, size_t size)
{
    if (!file || file[0] == '/' || strstr(file, "..")) return false;
    return (size_t)snprintf(path, size, "%s/%s", report->folder, file) < size;
}

// ---- frames -------------------------------------------------------------------------------------

static int column_of(const char *name, size_t length, const char *const *columns, int column_count)
{
    for (int i = 0; i < column_count; i++)
        if (strlen(columns[i]) == length && memcmp(columns[i], name, length) == 0) return i;
    return -1;
}

// Cells of one line into row[], by the place that the heading gives each column.
static void read_cells(const char *line, const int *places, int place_count, double *row)
{
    for (int cell = 0; cell < place_count; cell++) {
        size_t length = strcspn(line, ",\r\n");
        if (places[cell] >= 0 && length > 0) {
            char *end;
            double value = strtod(line, &end);
            if (end == line + length && isfinite(value)) row[places[cell]] = value;
        }
        line += length;
        if (*line != ',') return;
        line++;
    }
}

int report_csv(const struct report *report, const char *file, const char *const *columns, int column_count,
               double **values)
{
    char path[4096];
    size_t size;
    *values = NULL;
    if (!report_path(report, file, path, sizeof path)) return 0;
    char *content = file_read(path, &size);
    if (!content) return 0;
    int places[64], place_count = 0, lines = 0, rows = 0;
    for (char *c = content; *c; c++) lines += *c == '\n';
    char *line = content + strcspn(content, "\n");
    for (const char *c = content; c < line && place_count < 64; place_count++) {
        size_t length = strcspn(c, ",\r\n");
        places[place_count] = column_of(c, length, columns, column_count);
        c += length + 1;
    }
    *values = malloc(((size_t)lines + 1) * (size_t)column_count * sizeof **values);
    while (*values && *line && *++line) {
        double *row = *values + (size_t)rows++ * (size_t)column_count;
        for (int i = 0; i < column_count; i++) row[i] = (double)NAN;
        read_cells(line, places, place_count, row);
        line += strcspn(line, "\n");
    }
    free(content);
    return rows;
}

// ---- renderers and runs -------------------------------------------------------------------------

static int find_renderer(const struct report *report, const char *name)
{
    for (int i = 0; i < report->renderer_count; i++)
        if (strcmp(report->renderers[i].name, name) == 0) return i;
    return -1;
}

static int rank_of(const char *name) // known methods, unknown ones, baselines
{
    for (int i = 0; i < LOOKS; i++)
        if (strcmp(looks[i].name, name) == 0) return looks[i].role == ROLE_METHOD ? i : i + 1000;
    return 500;
}

static void insert_renderer(struct report *report, const char *name)
{
    int at = report->renderer_count++;
    for (; at > 0 && rank_of(report->renderers[at - 1].name) > rank_of(name); at--)
        report->renderers[at] = report->renderers[at - 1];
    report->renderers[at] = (struct report_renderer){.name = name, .rank_correlation = (double)NAN};
}

static void dress_renderers(struct report *report)
{
    int spare = 0;
    for (int i = 0; i < report->renderer_count; i++) {
        struct report_renderer *renderer = &report->renderers[i];
        renderer->colour = NULL;
        for (int k = 0; k < LOOKS; k++)
            if (strcmp(looks[k].name, renderer->name) == 0) {
                renderer->colour = looks[k].colour;
                renderer->mark = looks[k].mark;
                renderer->role = looks[k].role;
            }
        if (renderer->colour) continue;
        renderer->colour = spare_colours[spare++ % SPARE_COLOURS];
        renderer->mark = 10 + spare % 3;
    }
}

static const char *run_renderer(const cJSON *run)
{
    const char *name = json_text(run, "renderer");
    return name ? name : "unnamed";
}

static struct report_run make_run(const cJSON *json, int renderer)
{
    struct report_run run = {.json = json, .renderer = renderer};
    run.name = json_text(json, "id");
    if (!run.name) run.name = json_text(json, "label");
    if (!run.name) run.name = run_renderer(json);
    size_t prefix = strlen(run_renderer(json));
    bool has_prefix = strncmp(run.name, run_renderer(json), prefix) == 0 && run.name[prefix] == ' ';
    run.knob = has_prefix ? run.name + prefix + 1 : run.name;
    return run;
}

static bool collect_runs(struct report *report)
{
    const cJSON *runs = json_at(report->root, "runs"), *run;
    int count = cJSON_IsArray(runs) ? cJSON_GetArraySize(runs) : 0;
    report->runs = calloc((size_t)count + 1, sizeof *report->runs);
    report->renderers = calloc((size_t)count + 1, sizeof *report->renderers);
    if (!report->runs || !report->renderers) return false;
    for (run = json_first(runs); run; run = run->next)
        if (cJSON_IsObject(run) && find_renderer(report, run_renderer(run)) < 0)
            insert_renderer(report, run_renderer(run));
    dress_renderers(report);
    for (int i = 0; i < report->renderer_count; i++)
        for (run = json_first(runs); run; run = run->next)
            if (cJSON_IsObject(run) && strcmp(run_renderer(run), report->renderers[i].name) == 0)
                report->runs[report->run_count++] = make_run(run, i);
    return true;
}

// ---- frontiers ----------------------------------------------------------------------------------

static const cJSON *entry_of(const cJSON *list, const char *renderer)
{
    for (const cJSON *entry = json_first(list); entry; entry = entry->next) {
        const char *name = json_text(entry, "renderer");
        if (name && strcmp(name, renderer) == 0) return entry;
    }
    return NULL;
}

// A renderer that the frontier does not list shows all its runs; a listed one only the settings listed, so
// that a run beside the sweep (a published form, another knob) does not bend the curve.
static bool on_frontier(const cJSON *entry, const struct report_run *run)
{
    const cJSON *points = json_at(entry, "points");
    if (!cJSON_IsArray(points)) return true;
    for (const cJSON *point = json_first(points); point; point = point->next) {
        const char *name = json_text(point, "setting");
        if (name && strcmp(name, run->name) == 0) return true;
        if (!name && cJSON_Compare(json_at(point, "setting"), json_at(run->json, "setting"), true))
            return true;
    }
    return false;
}

static int by_error_descending(const void *a, const void *b)
{
    const struct report_point *p = a, *q = b;
    if (p->error_px != q->error_px) return p->error_px < q->error_px ? 1 : -1;
    return (p->ms > q->ms) - (p->ms < q->ms);
}

static struct report_point make_point(const struct report_run *run)
{
    const cJSON *interval = json_at(run->json, "frame_ms.ci95");
    struct report_point point = {
        .run = run,
        .error_px = json_number(run->json, "error_px.p999"),
        .ms = json_number(run->json, "frame_ms.median"),
        .low_ms = json_number(cJSON_IsArray(interval) ? cJSON_GetArrayItem(interval, 0) : NULL, ""),
        .high_ms = json_number(cJSON_IsArray(interval) ? cJSON_GetArrayItem(interval, 1) : NULL, ""),
        .triangles = json_number(run->json, "visible_triangles.mean"),
    };
    if (isnan(point.low_ms) || isnan(point.high_ms)) point.low_ms = point.high_ms = (double)NAN;
    return point;
}

// Whether two settings of a renderer differ in its quality knob alone; results that name none have one sweep.
static bool same_sweep(const struct report_run *a, const struct report_run *b, const char *quality)
{
    if (!quality) return true;
    const cJSON *knobs = json_at(a->json, "setting"), *others = json_at(b->json, "setting");
    if (cJSON_GetArraySize(knobs) != cJSON_GetArraySize(others)) return false;
    for (const cJSON *knob = json_first(knobs); knob; knob = knob->next)
        if (strcmp(knob->string, quality) != 0 &&
            !cJSON_Compare(knob, cJSON_GetObjectItemCaseSensitive(others, knob->string), true))
            return false;
    return true;
}

static int sweep_of(struct report_renderer *renderer, const struct report_run *run, const char *quality)
{
    for (int i = 0; i < renderer->point_count; i++)
        if (same_sweep(renderer->points[i].run, run, quality)) return renderer->points[i].sweep;
    return renderer->sweep_count++;
}

static bool collect_points(struct report *report, int index)
{
    struct report_renderer *renderer = &report->renderers[index];
    const cJSON *entry = entry_of(json_at(report->root, "frontier"), renderer->name),
                *sweep = entry_of(json_at(report->root, "sweeps"), renderer->name);
    renderer->points = calloc((size_t)report->run_count + 1, sizeof *renderer->points);
    if (!renderer->points) return false;
    double nearest = INFINITY;
    for (int i = 0; i < report->run_count; i++) {
        const struct report_run *run = &report->runs[i];
        if (run->renderer != index || !on_frontier(entry, run)) continue;
        struct report_point point = make_point(run);
        if (!renderer->shown) renderer->shown = run;
        if (isnan(point.error_px) || isnan(point.ms)) continue;
        point.sweep = sweep_of(renderer, run, json_text(sweep, "knob"));
        renderer->points[renderer->point_count++] = point;
        double distance = fabs(log(fmax(point.error_px, 1e-9)));
        if (distance < nearest && renderer->role != ROLE_BRUTE) {
            nearest = distance;
            renderer->shown = run;
        }
    }
    qsort(renderer->points, (size_t)renderer->point_count, sizeof *renderer->points, by_error_descending);
    renderer->rank_correlation = json_number(sweep, "rank_correlation");
    return true;
}

bool report_load(struct report *report, const char *folder)
{
    *report = (struct report){.folder = folder};
    char path[4096];
    size_t size;
    if ((size_t)snprintf(path, sizeof path, "%s/results.json", folder) >= sizeof path)
        return fail("%s: the name is too long", folder);
    char *content = file_read(path, &size);
    if (!content)
        return fail("%s: cannot be read (%s); expected the results that `bench run --out` left", path,
                    strerror(errno));
    const char *stopped = NULL;
    report->root = cJSON_ParseWithLengthOpts(content, size + 1, &stopped, true);
    size_t line = 1;
    for (const char *c = content; !report->root && stopped && c < stopped; c++) line += *c == '\n';
    free(content);
    if (!report->root)
        return fail("%s: is not JSON (line %zu); expected the results of `bench run`", path, line);
    if (json_number(report->root, "schema") != 1)
        return fail("%s: expected \"schema\": 1, as `bench run` writes it", path);
    bool good = collect_runs(report);
    for (int i = 0; good && i < report->renderer_count; i++) good = collect_points(report, i);
    return good || fail("%s: not enough memory to read it", path);
}

void report_finish(struct report *report)
{
    for (int i = 0; i < report->renderer_count; i++) free(report->renderers[i].points);
    free(report->renderers);
    free(report->runs);
    cJSON_Delete(report->root);
    *report = (struct report){0};
}
