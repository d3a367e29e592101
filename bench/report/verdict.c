// The sentences at the top of the report, computed from the numbers and from nothing else.
// SPDX-License-Identifier: MIT
#include "bench/report/parts.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static void add_number(struct text *page, double value, const char *unit)
{
    char number[NUMBER_TEXT];
    text_add(page, "%s%s%s", number_text(value, number), unit[0] ? "\u00a0" : "", unit);
}

static void add_row_key(struct text *page, double at_px)
{
    char number[NUMBER_TEXT];
    text_add(page, "%s\u00a0px", short_text(at_px, number));
}

static void add_time(struct text *page, const struct standing *standing)
{
    char low[NUMBER_TEXT], high[NUMBER_TEXT];
    if (standing->kind == STANDING_AT_MOST) text_add(page, "at most ");
    add_number(page, standing->value, "ms");
    if (standing->kind == STANDING_AT && isfinite(standing->low))
        text_add(page, " <small>[%s, %s]</small>", number_text(standing->low, low),
                 number_text(standing->high, high));
}

static void add_tie(struct text *page, const struct standing *standings, int tied)
{
    bool overlap = false, bound = false, interval = true;
    text_add(page, "<b>cannot tell</b> ");
    for (int i = 0; i < tied; i++) {
        text_add(page, "%s", i == 0 ? "" : i + 1 < tied ? ", " : " from ");
        page_renderer(page, standings[i].renderer);
        text_add(page, " (");
        add_time(page, &standings[i]);
        text_add(page, ")");
        bound |= i > 0 && standings[i].kind == STANDING_AT_MOST;
        interval &= isfinite(standings[i].high) != 0;
        overlap |= i > 0 && standings[i].low <= standings[0].high;
    }
    text_add(page, !interval ? ": there is no interval without 3 repeats"
                   : bound   ? ": one is finer than that at every setting"
                   : overlap ? ": the intervals overlap"
                             : ": less than 5\u00a0%% apart");
}

// The best with those that cannot be told from it, then everyone else by how much more they need.
static void add_ranking(struct text *page, const struct standing *standings, int count)
{
    int tied = 1;
    while (tied < count && !report_clearly_better(&standings[0], &standings[tied])) tied++;
    if (count > 1 && tied > 1)
        add_tie(page, standings, tied);
    else {
        if (count > 1) text_add(page, "<b>");
        page_renderer(page, standings[0].renderer);
        text_add(page, count > 1 ? " is fastest</b>, at " : " is the only method that gets there, at ");
        add_time(page, &standings[0]);
    }
    for (int i = tied; i < count; i++) {
        text_add(page, "%s", i == tied ? "; " : ", ");
        page_renderer(page, standings[i].renderer);
        text_add(page, standings[0].kind == STANDING_AT_MOST ? " takes at least " : " takes ");
        add_number(page, standings[i].value / standings[0].value, "");
        text_add(page, "\u00a0\u00d7 as long");
    }
    text_add(page, ".");
}

static const cJSON *row_nearest_1px(const struct report *report, struct standing *standings)
{
    const cJSON *rows = json_at(report->root, "equal_error"), *row, *best = NULL;
    double nearest = INFINITY;
    for (row = json_first(rows); row; row = row->next) {
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
    add_row_key(page, json_number(row, "at_px"));
    text_add(page, " ");
    add_ranking(page, standings, count);
    for (int i = 0; i < report->renderer_count; i++) {
        const struct report_renderer *renderer = &report->renderers[i];
        if (renderer->role != ROLE_METHOD || renderer->point_count == 0) continue;
        if (report_standing(renderer, row, EQUAL_ERROR).kind != STANDING_NOT) continue;
        text_add(page, " ");
        page_renderer(page, renderer);
        text_add(page, " does not get there: its finest setting errs by ");
        add_number(page, renderer->points[renderer->point_count - 1].error_px, "px");
        text_add(page, ".");
    }
}

// By how much time grows each time the error is halved, between a curve's ends; NAN where the ends lie too
// close.
static double halving_cost(const struct report_renderer *renderer)
{
    if (renderer->role != ROLE_METHOD || renderer->point_count < 2) return NAN;
    const struct report_point *coarse = &renderer->points[0],
                              *fine = &renderer->points[renderer->point_count - 1];
    double halvings = log2(coarse->error_px / fine->error_px);
    return halvings >= 0.5 ? pow(fine->ms / coarse->ms, 1 / halvings) - 1 : (double)NAN;
}

static void add_halving_costs(const struct report *report, struct text *page)
{
    int count = 0, written = 0;
    for (int i = 0; i < report->renderer_count; i++)
        count += isfinite(halving_cost(&report->renderers[i])) != 0;
    for (int i = 0; i < report->renderer_count; i++) {
        double cost = halving_cost(&report->renderers[i]);
        if (!isfinite(cost)) continue;
        text_add(page, "%s",
                 written == 0           ? "Halving the error costs "
                 : written + 1 == count ? " and "
                                        : ", ");
        written++;
        page_renderer(page, &report->renderers[i]);
        if (cost >= 0.005)
            text_add(page, " %.0f\u00a0%%", cost * 100);
        else
            text_add(page, " nothing");
    }
    if (written) text_add(page, " more time. ");
}

static void add_price(const struct report *report, struct text *page)
{
    int written = 0;
    for (int i = 0; i < report->renderer_count; i++) {
        const struct report_renderer *renderer = &report->renderers[i];
        if (!isfinite(halving_cost(renderer))) continue;
        const struct report_point *ends[] = {&renderer->points[0],
                                             &renderer->points[renderer->point_count - 1]};
        text_add(page, written++ ? "<br>" : "<dt>The price</dt><dd>");
        page_renderer(page, renderer);
        for (int end = 0; end < 2; end++) {
            text_add(page, end ? " to " : " from ");
            add_number(page, ends[end]->ms, "ms");
            text_add(page, " at ");
            add_number(page, ends[end]->error_px, "px");
            text_add(page, " (");
            text_add_escaped(page, ends[end]->run->knob);
            text_add(page, ")");
        }
        text_add(page, ": ");
        add_number(page, ends[1]->ms / ends[0]->ms, "");
        text_add(page, "\u00a0\u00d7 the time, ");
        add_number(page, ends[0]->error_px / ends[1]->error_px, "");
        text_add(page, "\u00a0\u00d7 less error.");
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
        add_row_key(page, at_px);
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
    bool known = plain.kind == STANDING_AT || plain.kind == STANDING_AT_MOST;
    text_add(page, " ");
    page_renderer(page, decimated);
    text_add(page, ", the mesh evenly sub-sampled, ");
    text_add(page, known                        ? "needs "
                   : plain.kind == STANDING_NOT ? "does not reach "
                                                : "was not measured at ");
    if (known) add_time(page, &plain);
    if (known) text_add(page, " at ");
    add_row_key(page, at_px);
    if (!known)
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
        text_add(page, " ");
        page_renderer(page, empty);
        text_add(page, ", the empty frame, costs ");
        add_number(page, json_number(empty->shown->json, "frame_ms.median"), "ms");
        text_add(page, ", which every time here contains.");
    }
    text_add(page, "</dd>");
}

// A renderer's setting with most holes; NULL where none was measured.
static const struct report_run *most_holes(const struct report *report, int renderer)
{
    const struct report_run *worst = NULL;
    for (int i = 0; i < report->run_count; i++) {
        double holes = json_number(report->runs[i].json, "holes.total");
        if (report->runs[i].renderer != renderer || isnan(holes)) continue;
        if (!worst || holes > json_number(worst->json, "holes.total")) worst = &report->runs[i];
    }
    return worst;
}

// The sub-sampled mesh is closed, but nothing bounds how far under a skyline it stays: what is more than 8
// pixels under it is a hole by definition, and no defect of a method.
static void add_decimated_holes(const struct report *report, struct text *page)
{
    for (int i = 0; i < report->renderer_count; i++) {
        const struct report_run *worst = most_holes(report, i);
        if (!worst || report->renderers[i].role != ROLE_DECIMATED) continue;
        double holes = json_number(worst->json, "holes.total");
        if (holes == 0) continue;
        text_add(page, " ");
        page_run(page, report, worst);
        text_add(page, " leaves ");
        add_number(page, holes, holes == 1 ? "pixel" : "pixels");
        text_add(page, " more than 8 under the skyline undrawn.");
    }
}

static void add_holes(const struct report *report, struct text *page)
{
    int measured = 0, broken = 0;
    for (int i = 0; i < report->renderer_count; i++) {
        const struct report_run *worst = most_holes(report, i);
        enum report_role role = report->renderers[i].role;
        if (!worst || role == ROLE_EMPTY || role == ROLE_DECIMATED) continue;
        double holes = json_number(worst->json, "holes.total");
        measured++;
        if (holes == 0) continue;
        text_add(page,
                 broken++ ? ", " : "<b class=\"bad\">Holes</b>, which are defects; the setting with most: ");
        page_run(page, report, worst);
        text_add(page, " ");
        add_number(page, holes, holes == 1 ? "pixel" : "pixels");
    }
    if (!measured)
        text_add(page, "Holes were not measured.");
    else if (!broken)
        text_add(page, "<b>No holes</b> in any frame of any method's settings.");
    else
        text_add(page, ".");
    add_decimated_holes(report, page);
}

// Share of the ground, for misses and for spills, at a renderer's best setting.
static double outline_bound(const struct report_renderer *renderer)
{
    return strcmp(renderer->name, "pgm") == 0 ? 0.005 : 0.0005;
}

static void add_outlines(const struct report *report, struct text *page)
{
    char number[NUMBER_TEXT];
    int written = 0, beyond = 0;
    for (int i = 0; i < report->renderer_count; i++) {
        const struct report_renderer *renderer = &report->renderers[i];
        if (renderer->role != ROLE_METHOD || renderer->point_count == 0) continue;
        const cJSON *run = renderer->points[renderer->point_count - 1].run->json;
        double misses = json_number(run, "misses.share"), spills = json_number(run, "spills.share");
        double worse = fmax(misses, spills), bound = outline_bound(renderer);
        if (isnan(misses) || isnan(spills)) continue;
        text_add(page, written++ ? ", " : " Skylines drawn too low or too high, at each finest setting: ");
        page_renderer(page, renderer);
        if (worse > 0 && worse < 1e-5)
            text_add(page, " under 0.001\u00a0%%");
        else {
            text_add(page, " ");
            add_number(page, worse * 100, "%");
        }
        if (worse <= bound) continue;
        beyond++;
        text_add(page, " (<b class=\"bad\">beyond the bound of ");
        text_add(page, "%s\u00a0%%</b>)", short_text(bound * 100, number));
    }
    if (written) text_add(page, beyond ? " of the ground." : " of the ground: all within their bounds.");
}

struct claims { // of a renderer: settings measured, those that claim a bound, frames checked, frames that
                // broke it
    int settings, claiming;
    double checked, broken;
    double tightest, loosest; // over the settings: claimed over measured error, each a mean over its frames
};

static struct claims count_claims(const struct report *report, int renderer)
{
    struct claims claims = {.tightest = INFINITY, .loosest = -INFINITY};
    for (int k = 0; k < report->run_count; k++) {
        const cJSON *run = report->runs[k].json;
        bool claiming = isfinite(json_number(run, "claimed_px"));
        if (report->runs[k].renderer != renderer) continue;
        if (!claiming && isnan(json_number(run, "error_px.p999"))) continue; // it may have had one to make
        claims.settings++;
        if (!claiming) continue;
        claims.claiming++;
        double broken = json_number(run, "claim_broken_frames"), frames = json_number(run, "frames");
        if (isnan(broken) || isnan(frames)) continue;
        claims.checked += frames;
        claims.broken += broken;
        claims.tightest = fmin(claims.tightest, json_number(run, "tightness.mean"));
        claims.loosest = fmax(claims.loosest, json_number(run, "tightness.mean"));
    }
    return claims;
}

static void add_tightness(const struct claims *claims, struct text *page)
{
    char number[NUMBER_TEXT];
    if (!(claims->tightest <= claims->loosest)) return;
    text_add(page, "Over the frames that claim is on average %s", number_text(claims->tightest, number));
    if (claims->loosest > claims->tightest) text_add(page, " to %s", number_text(claims->loosest, number));
    text_add(page, "\u00a0\u00d7 the largest error%s. ",
             claims->loosest > claims->tightest ? ", depending on the setting" : "");
}

static void add_claims(const struct report *report, struct text *page)
{
    char number[NUMBER_TEXT];
    text_add(page, "<dt>Promises</dt><dd>");
    for (int i = 0; i < report->renderer_count; i++) {
        if (report->renderers[i].role != ROLE_METHOD) continue;
        struct claims claims = count_claims(report, i);
        page_renderer(page, &report->renderers[i]);
        if (claims.settings == 0)
            text_add(page, " was not measured. ");
        else if (claims.claiming == 0)
            text_add(page, " claims no bound on its error. ");
        else if (claims.checked == 0)
            text_add(page, " claims a bound on its error that was not checked. ");
        else if (claims.broken == 0)
            text_add(page, " keeps the error it claims in all %s frames%s. ",
                     count_text(claims.checked, number),
                     claims.claiming == claims.settings ? "" : " of the settings that claim one");
        else {
            text_add(page, " <b class=\"bad\">breaks</b> the error it claims in ");
            add_number(page, claims.broken, "");
            text_add(page, " of ");
            add_number(page, claims.checked, claims.checked == 1 ? "frame" : "frames");
            text_add(page, ". ");
        }
        add_tightness(&claims, page);
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

// What compression lost, and whether it is among the errors of this page.
static void add_compression(const struct report *report, struct text *page)
{
    const cJSON *packed = json_at(report->root, "scene.packed");
    const char *truth = json_text(report->root, "scene.truth");
    char bits[NUMBER_TEXT], rms[NUMBER_TEXT], most[NUMBER_TEXT];
    if (!packed && !truth) return;
    text_add(page, "<dt>Compression</dt><dd>");
    if (packed) {
        text_add(page, "The terrain was packed (");
        text_add_escaped(page, json_text(packed, "codec"));
        text_add(page, ", %s bits a sample): %s\u00a0m rms and at most %s\u00a0m off its source. ",
                 number_text(json_number(packed, "bits_per_sample"), bits),
                 number_text(json_number(packed, "rms_m"), rms),
                 number_text(json_number(packed, "max_m"), most));
    }
    if (truth) {
        text_add(page, "Errors are against <b>");
        text_add_escaped(page, truth);
        text_add(page, "</b>: compression and levels of detail together; the same flight without "
                       "<code>--truth</code> gives levels of detail alone.</dd>");
    } else
        text_add(page, "Errors are against the packed map itself: levels of detail alone; <code>--truth "
                       "SOURCE</code> gives both together.</dd>");
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

// The other rows within a factor of four of 1 px; the table has them all.
static void add_other_rows(const struct report *report, const cJSON *main_row, struct standing *standings,
                           struct text *page)
{
    const cJSON *rows = json_at(report->root, "equal_error"), *row;
    int written = 0;
    if (!main_row) return;
    for (row = json_first(rows); row; row = row->next) {
        double at_px = json_number(row, "at_px");
        if (row == main_row || !(at_px >= 0.25 && at_px <= 4)) continue;
        int count = report_standings(report, row, EQUAL_ERROR, standings);
        if (count == 0) continue;
        text_add(page, written++ ? "<br>At " : "<dt>At other errors</dt><dd>At ");
        add_row_key(page, at_px);
        text_add(page, " ");
        add_ranking(page, standings, count);
    }
    if (written) text_add(page, "</dd>");
}

void report_verdict(const struct report *report, struct text *page)
{
    struct standing *standings = calloc((size_t)report->renderer_count + 1, sizeof *standings);
    if (!standings) {
        page->out_of_memory = true;
        return;
    }
    const cJSON *main_row = row_nearest_1px(report, standings);
    text_add(page, "<p class=\"lead\">");
    add_halving_costs(report, page);
    if (main_row)
        add_row(report, main_row, standings, page);
    else
        text_add(page,
                 "Which method is fastest: cannot tell, as no two have an error and a time to compare.");
    text_add(page, "</p>\n<dl class=\"verdict\">");
    add_price(report, page);
    add_other_rows(report, main_row, standings, page);
    add_baselines(report, main_row, standings, page);
    text_add(page, "<dt>Coverage</dt><dd>");
    add_holes(report, page);
    add_outlines(report, page);
    text_add(page, "</dd>");
    add_claims(report, page);
    add_floor(report, page);
    add_compression(report, page);
    add_machine(report, page);
    text_add(page, "</dl>\n");
    free(standings);
}
