// Every number that is missing, and why: figures that share runs and a reason share a line.
// SPDX-License-Identifier: MIT
#include "bench/report/parts.h"

#include <stdlib.h>
#include <string.h>

struct missing { // one figure that one or more runs do not have, for one reason
    char field[96];
    const char *reason;
    bool *runs;
    bool told;
};

struct missing_list {
    struct missing *items;
    int count, capacity, run_count;
};

static const char *const expected_fields[] = {
    "frame_ms",
    "update_ms",
    "draw_ms",
    "wall_ms",
    "worker_ms",
    "gpu_ms",
    "throughput_ms",
    "roofline_ms",
    "steadiness",
    "fps",
    "triangles",
    "visible_triangles",
    "draw_calls",
    "upload_bytes",
    "resident_bytes",
    "error_px",
    "plane_px",
    "claimed_px",
    "claim_broken_frames",
    "tightness",
    "holes",
    "misses",
    "spills",
    "temporal_px",
    "counters",
    "frames_csv",
};

static const char *recorded_reason(const cJSON *reasons, const char *field, size_t length)
{
    char name[96];
    if (length >= sizeof name) return NULL;
    memcpy(name, field, length);
    name[length] = 0;
    const cJSON *reason = cJSON_GetObjectItemCaseSensitive(reasons, name);
    return cJSON_IsString(reason) ? reason->valuestring : NULL;
}

// Figures that are made of others: what they are made of explains them, too.
static const char *const made_of[][2] = {
    {"claim_broken_frames", "claimed_px"},
    {"tightness", "claimed_px"},
    {"steadiness", "roofline_ms"},
    {"plane_px", "error_px"},
    {"fps", "frame_ms"},
};

// The reason for "frame_ms.ci95" may stand under that name, under "ci95" or under "frame_ms".
static const char *reason_of(const cJSON *run, const char *field)
{
    const cJSON *reasons = json_at(run, "reasons");
    size_t parent = strcspn(field, ".");
    const char *leaf = field[parent] ? field + parent + 1 : field;
    const char *reason = recorded_reason(reasons, field, strlen(field));
    if (!reason) reason = recorded_reason(reasons, leaf, strlen(leaf));
    if (!reason) reason = recorded_reason(reasons, field, parent);
    for (size_t i = 0; !reason && i < sizeof made_of / sizeof made_of[0]; i++)
        if (strcmp(field, made_of[i][0]) == 0)
            reason = recorded_reason(reasons, made_of[i][1], strlen(made_of[i][1]));
    if (reason) return reason;
    bool absent = !field[parent] && !cJSON_HasObjectItem(run, field);
    return absent ? "these results were written without it" : "no reason was recorded";
}

static void add_missing(struct missing_list *list, int run, const cJSON *json, const char *field)
{
    const char *reason = reason_of(json, field);
    for (int i = 0; i < list->count; i++)
        if (strcmp(list->items[i].field, field) == 0 && strcmp(list->items[i].reason, reason) == 0) {
            list->items[i].runs[run] = true;
            return;
        }
    if (list->count == list->capacity) {
        int capacity = list->capacity ? list->capacity * 2 : 32;
        struct missing *items = realloc(list->items, (size_t)capacity * sizeof *items);
        if (!items) return;
        list->items = items;
        list->capacity = capacity;
    }
    struct missing *item = &list->items[list->count];
    *item = (struct missing){.reason = reason, .runs = calloc((size_t)list->run_count, sizeof *item->runs)};
    if (!item->runs) return;
    strncpy(item->field, field, sizeof item->field - 1);
    item->runs[run] = true;
    list->count++;
}

// A summary without a single number is missing as a whole: its parts need no lines of their own.
static bool is_empty_summary(const cJSON *value)
{
    if (!cJSON_IsObject(value)) return false;
    for (const cJSON *child = json_first(value); child; child = child->next)
        if (!cJSON_IsNull(child) && strcmp(child->string, "samples") != 0) return false;
    return true;
}

static void find_missing(struct missing_list *list, int run, const cJSON *json)
{
    char field[96];
    const cJSON *child;
    for (size_t i = 0; i < sizeof expected_fields / sizeof expected_fields[0]; i++) {
        const char *name = expected_fields[i];
        const cJSON *value = json_at(json, name);
        bool counts_nothing = cJSON_IsObject(value) && !value->child && strcmp(name, "counters") == 0;
        if (!value || (is_empty_summary(value) && !counts_nothing))
            add_missing(list, run, json, name);
        else if (cJSON_IsObject(value))
            for (child = json_first(value); child; child = child->next) {
                if (!cJSON_IsNull(child) || strlen(name) + strlen(child->string) + 2 > sizeof field) continue;
                strcpy(field, name);
                strcat(strcat(field, "."), child->string);
                add_missing(list, run, json, field);
            }
    }
}

static void add_missing_runs(const struct report *report, const bool *runs, struct text *page)
{
    int count = 0, written = 0;
    for (int i = 0; i < report->run_count; i++) count += runs[i];
    if (count == report->run_count) {
        text_add(page, "every run");
        return;
    }
    for (int i = 0; i < report->renderer_count; i++) { // a renderer's name stands for all its runs
        int all = 0, without = 0;
        for (int k = 0; k < report->run_count; k++) {
            all += report->runs[k].renderer == i;
            without += report->runs[k].renderer == i && runs[k];
        }
        if (without == 0) continue;
        if (all == without) {
            text_add(page, "%s", written++ ? ", " : "");
            page_renderer(page, &report->renderers[i]);
        } else
            for (int k = 0; k < report->run_count; k++) {
                if (report->runs[k].renderer != i || !runs[k]) continue;
                text_add(page, "%s", written++ ? ", " : "");
                page_run(page, report, &report->runs[k]);
            }
    }
}

void report_missing(const struct report *report, struct text *page)
{
    struct missing_list list = {.run_count = report->run_count};
    for (int i = 0; i < report->run_count; i++) find_missing(&list, i, report->runs[i].json);
    if (list.count == 0)
        text_add(page, "<p>Every figure of every run was measured.</p>");
    else
        text_add(page,
                 "<div class=\"scroll\"><table class=\"prose\"><thead><tr><th class=\"word\">figures</th>"
                 "<th class=\"word\">runs</th><th class=\"word\">reason</th></tr></thead><tbody>");
    for (int i = 0; i < list.count; i++) {
        struct missing *item = &list.items[i];
        if (item->told) continue;
        text_add(page, "<tr><td class=\"word\"><code>");
        text_add_escaped(page, item->field);
        text_add(page, "</code>");
        for (int k = i + 1; k < list.count; k++) {
            struct missing *other = &list.items[k];
            if (other->told || strcmp(other->reason, item->reason) != 0 ||
                memcmp(other->runs, item->runs, (size_t)report->run_count * sizeof *item->runs) != 0)
                continue;
            text_add(page, ", <code>");
            text_add_escaped(page, other->field);
            text_add(page, "</code>");
            other->told = true;
        }
        text_add(page, "</td><td class=\"word\">");
        add_missing_runs(report, item->runs, page);
        text_add(page, "</td><td class=\"word\">");
        text_add_escaped(page, item->reason);
        text_add(page, "</td></tr>\n");
    }
    if (list.count) text_add(page, "</tbody></table></div>\n");
    for (int i = 0; i < list.count; i++) free(list.items[i].runs);
    free(list.items);
}
