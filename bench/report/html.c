// The page around the parts: its style, its sections in reading order, the facts of machine, scene
// and method.
// SPDX-License-Identifier: MIT
#include "bench/report/parts.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static const char *const style[] = {
    // one string for each part: compilers need not take long ones
    ":root{color-scheme:light;--ink:#1a1c1e;--soft:#5a6066;--line:#d9dcdf;--wash:#f5f6f7;--accent:#0072b2}\n",
    "*{box-sizing:border-box}\n",
    "body{margin:0;background:#fff;color:var(--ink);font:16px/1.55 system-ui,-apple-system,'Segoe UI',Roboto,"
    "'Helvetica Neue',Arial,sans-serif}\n",
    "main{max-width:1180px;margin:0 auto;padding:40px 28px 80px}\n",
    "h1{font-size:2.1rem;line-height:1.15;margin:.1em 0 .5em;letter-spacing:-.015em}\n",
    "h2{font-size:1.35rem;line-height:1.25;margin:2.6em 0 .4em;padding-top:.7em;border-top:2px solid "
    "var(--ink)}\n",
    "h3{font-size:1rem;margin:1.6em 0 .5em}\n",
    "p{margin:.5em 0;max-width:78ch}a{color:var(--accent)}\n",
    "code{font:.875em ui-monospace,SFMono-Regular,Menlo,Consolas,'DejaVu Sans "
    "Mono',monospace;overflow-wrap:anywhere}\n",
    "pre{background:var(--wash);padding:12px 16px;overflow-x:auto;border-radius:4px;white-space:pre-wrap}\n",
    ".eyebrow{color:var(--soft);margin:0;max-width:none;font-size:.9rem}\n",
    ".lead{font-size:1.25rem;line-height:1.5;max-width:74ch;margin:.4em 0 1.2em}\n",
    ".note,.eyebrow+p{color:var(--soft);font-size:.9rem}.bad{color:#a8201a}\n",
    ".warning{border:2px solid #a8201a;border-radius:4px;padding:10px 16px;max-width:none}\n",
    "nav{font-size:.9rem;margin:1em 0;display:flex;flex-wrap:wrap;gap:.3em 1.4em}\n",
    ".who{white-space:nowrap;font-weight:600}.who::before{content:'';display:inline-block;width:.68em;height:"
    ".68em;"
    "border-radius:2px;background:var(--c);margin-right:.36em;-webkit-print-color-adjust:exact;"
    "print-color-adjust:exact}\n",
    "dl{display:grid;grid-template-columns:12.5rem 1fr;gap:.55em 1.2em;margin:1em 0}dt{color:var(--soft)}"
    ".verdict{font-size:.95rem}dd{margin:0;max-width:104ch;overflow-wrap:anywhere}\n",
    "small{font-size:.82em;color:var(--soft);font-weight:400;white-space:nowrap}\n",
    "figure{margin:1em 0;break-inside:avoid}figcaption{color:var(--soft);font-size:.9rem;margin-top:.3em}"
    "figcaption b{color:var(--ink)}\n",
    "svg{display:block;width:100%;min-width:680px;height:auto}svg "
    "text{font-family:system-ui,-apple-system,'Segoe "
    "UI',Roboto,Arial,"
    "sans-serif}\n",
    ".scroll{overflow-x:auto;margin:.5em 0}\n",
    "table{border-collapse:collapse;font-variant-numeric:tabular-nums;font-size:.9rem;line-height:1.35}\n",
    "th,td{padding:.34em .7em;text-align:right;vertical-align:baseline;white-space:nowrap;border-bottom:1px "
    "solid "
    "var(--line)}\n",
    "thead th{vertical-align:bottom;border-bottom:1.5px solid var(--ink);font-weight:600}thead "
    "small{display:block}\n",
    "tbody th{font-weight:400}td small{display:block}.word{text-align:left}td.best{font-weight:700}"
    "td.off{color:var(--soft);font-size:.82rem;white-space:normal}\n",
    ".runs .who{font-weight:400}.runs tr.first:not(:first-child)>*{border-top:2px solid #9aa0a6}.runs "
    "th.word{position:sticky;left:0;"
    "background:#fff}.runs th,.runs td{padding:.3em .55em}\n",
    ".prose .who{font-weight:400}td.word.long{white-space:normal;min-width:20rem}.prose "
    "td{white-space:normal;min-width:9rem}\n",
    ".halves{display:flex;flex-wrap:wrap;gap:0 3rem}"
    ".half{min-width:0;max-width:100%}\n",
    ".moments{display:grid;grid-template-columns:repeat(3,minmax(0,1fr));gap:14px}.moments figure{margin:0}"
    ".moments img{display:block;width:100%;height:auto;margin-bottom:3px;background:var(--wash)}"
    ".absent{color:var(--soft);background:var(--wash);padding:1em}\n",
    "details{margin:1.6em 0}summary{cursor:pointer;font-weight:600}"
    ".legend{display:flex;flex-wrap:wrap;align-items:flex-start;gap:8px 20px;margin:.8em 0;font-size:.85rem}"
    ".scale{display:grid;grid-template-columns:repeat(3,1fr) 0;width:min(380px,100%);margin-right:40px}"
    ".scale i{grid-column:1/-1;height:14px}.scale span{white-space:nowrap}"
    ".scale span+span{transform:translateX(-.6em)}"
    ".swatch{display:flex;align-items:center;gap:6px}.swatch i{width:14px;height:14px;border:1px solid "
    "var(--line)}"
    ".scale i,.swatch i{-webkit-print-color-adjust:exact;print-color-adjust:exact}\n",
    "@media(max-width:700px){main{padding:20px 16px 60px}dl{display:block}dt{font-weight:600;margin-top:.8em}"
    ".moments{grid-template-columns:1fr}h1{font-size:1.6rem}.lead{font-size:1.1rem}}\n",
    "@media print{main{max-width:none;padding:0}nav{display:none}body{font-size:10pt}h2{break-after:avoid}"
    "tr,dd{break-inside:avoid}.runs,.runs *{font-size:7pt}.runs th,.runs td{padding:.2em .3em}"
    ".scroll{overflow:visible}}\n",
};

// ---- facts --------------------------------------------------------------------------------------

// " <separator>value unit" when it was recorded; nothing otherwise.
static void add_fact(struct text *page, const char *before, const char *value, const char *after)
{
    if (!value) return;
    text_add(page, "%s", before);
    text_add_escaped(page, value);
    text_add(page, "%s", after);
}

static void add_figure_fact(struct text *page, const char *before, double value, const char *after)
{
    char number[NUMBER_TEXT];
    if (isnan(value)) return;
    bool whole = value == floor(value);
    text_add(page, "%s%s%s", before, whole ? count_text(value, number) : number_text(value, number), after);
}

static double item_number(const cJSON *array, int index)
{
    return cJSON_IsArray(array) ? json_number(cJSON_GetArrayItem(array, index), "") : (double)NAN;
}

static void add_size(const cJSON *root, struct text *page)
{
    double width = json_number(root, "scene.width"), height = json_number(root, "scene.height");
    if (isnan(width) || isnan(height)) return;
    text_add(page, " \u00b7 %.0f\u00a0\u00d7\u00a0%.0f pixels", width, height);
}

void page_head(struct text *page, const char *title)
{
    text_add(page, "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">"
                   "<meta name=\"viewport\" content=\"width=device-width,initial-scale=1\"><title>Relief: ");
    text_add_escaped(page, title);
    text_add(page, "</title>\n<style>\n");
    for (size_t i = 0; i < sizeof style / sizeof style[0]; i++) text_add(page, "%s", style[i]);
    text_add(page, "</style></head>\n<body><main>\n");
}

static void add_opening(const struct report *report, struct text *page)
{
    const cJSON *root = report->root;
    const char *scene = json_text(root, "scene.name");
    page_head(page, scene ? scene : "results");
    text_add(page, "<header><p class=\"eyebrow\">Relief");
    add_fact(page, " \u00b7 scene <b>", scene, "</b>");
    add_figure_fact(page, " \u00b7 ", json_number(root, "scene.samples"), " samples");
    add_size(root, page);
    add_figure_fact(page, " \u00b7 ", json_number(root, "path.frames"), " frames");
    add_fact(page, " \u00b7 ", json_text(root, "gl.renderer"), "");
    add_fact(page, " \u00b7 ", json_text(root, "created"), "");
    text_add(page, "</p>\n<h1>What does accuracy cost in time?</h1>\n");
    if (!cJSON_IsTrue(json_at(root, "complete")))
        text_add(page, "<p class=\"warning\"><b class=\"bad\">Incomplete.</b> The measurement was stopped "
                       "before its end: "
                       "what stands here is what was measured until then.</p>\n");
    text_add(page, "</header>\n");
}

static void add_contents(struct text *page)
{
    text_add(page,
             "<nav><a href=\"#frontier\">Accuracy against time</a><a href=\"#path\">Over the path</a>"
             "<a href=\"#triangles\">Triangles</a><a href=\"#pictures\">Pictures</a><a href=\"#runs\">Every "
             "run</a>"
             "<a href=\"#method\">Method and machine</a><a href=\"#missing\">What is missing</a></nav>\n");
}

// ---- figures ------------------------------------------------------------------------------------

static void add_figure(const struct report_figures *figures, enum report_figure figure, const char *caption,
                       struct text *page)
{
    const struct text *svg = &figures->svg[figure];
    text_add(page, "<figure><div class=\"scroll\">");
    if (svg->length)
        text_add_bytes(page, svg->data, svg->length);
    else if (!figures->gnuplot_found)
        text_add(
            page,
            "<p class=\"absent\">This figure needs gnuplot, which is not installed; its script and numbers "
            "are in "
            "<code>figures/</code>. Install gnuplot and run <code>bench report</code> on this folder.</p>");
    else
        text_add(page, "<p class=\"absent\">No figure: the numbers it needs were not measured.</p>");
    text_add(page, "</div><figcaption>%s</figcaption></figure>\n", caption);
}

// The settings that stand for the renderers, by name.
static void add_shown_settings(const struct report *report, struct text *page)
{
    char number[NUMBER_TEXT];
    int written = 0;
    for (int i = 0; i < report->renderer_count; i++) {
        const struct report_renderer *renderer = &report->renderers[i];
        if (renderer->role != ROLE_METHOD || !renderer->shown) continue;
        text_add(page, "%s<span class=\"who\" style=\"--c:%s\">", written++ ? ", " : "", renderer->colour);
        text_add_escaped(page, renderer->shown->name);
        text_add(page, "</span> (%s\u00a0px)",
                 number_text(json_number(renderer->shown->json, "error_px.p999"), number));
    }
    if (!written) text_add(page, "none");
}

static void add_correlations(const struct report *report, struct text *page)
{
    int written = 0;
    for (int i = 0; i < report->renderer_count; i++) {
        const struct report_renderer *renderer = &report->renderers[i];
        double correlation = renderer->rank_correlation;
        if (isnan(correlation)) continue;
        text_add(page, written++ ? ", "
                                 : "<p>Rank correlation \u03c1 (Spearman) of error with visible triangles: ");
        page_renderer(page, renderer);
        text_add(page, " %s%.2f", correlation < 0 ? "\u2212" : "", fabs(correlation));
    }
    text_add(page, written ? ". At \u22121 more triangles always bought less error.</p>\n"
                           : "<p>No rank correlation: it takes three settings of a renderer.</p>\n");
}

// What lies outside the figures of curves, if anything does; "" otherwise.
static const char *outside_text(const struct report *report, char out[128])
{
    int count = report_points_outside(report);
    out[0] = 0;
    if (count)
        snprintf(out, 128,
                 " Outside: %d setting%s of decimated, erring over four times as much as any method.", count,
                 count == 1 ? "" : "s");
    return out;
}

static void add_captioned(const struct report *report, const struct report_figures *figures,
                          enum report_figure figure, const char *caption, struct text *page)
{
    char outside[128], whole[512];
    snprintf(whole, sizeof whole, "%s%s", caption, outside_text(report, outside));
    add_figure(figures, figure, whole, page);
}

static void add_body(const struct report *report, const struct report_figures *figures, struct text *page)
{
    text_add(page, "<section id=\"frontier\"><h2>Accuracy against time</h2>\n");
    add_captioned(
        report, figures, FIGURE_FRONTIER,
        "Each point is a setting, each curve a renderer with its quality knob turned; towards the "
        "lower left is "
        "better. Upright bars: 95\u00a0% interval of the median time. Dashed: <b>brute</b> draws the "
        "whole mesh. "
        "Grey: one pixel.",
        page);
    report_equal_tables(report, page);
    text_add(
        page,
        "</section>\n<section id=\"path\"><h2>Over the path</h2>\n<p>Each method at its setting nearest to "
        "1\u00a0px: ");
    add_shown_settings(report, page);
    text_add(page, ".</p>\n");
    add_figure(figures, FIGURE_PATH,
               "The same frames, by number, for everyone; lower is better. Grey: one pixel.", page);
    report_steadiness(report, page);
    text_add(page, "<h3>Popping and swimming</h3>\n");
    add_figure(
        figures, FIGURE_MOTION,
        "How far drawn ground moves on the screen from one frame to the next, the camera\u2019s motion "
        "taken out, at the same settings; lower is better. Popping shows as peaks, swimming as a level. "
        "A frame has no point where nothing moved or where the frame before was not flown. Grey: one "
        "pixel.",
        page);
    report_motion(report, page);
    text_add(page, "</section>\n<section id=\"triangles\"><h2>Error against triangles</h2>\n");
    add_correlations(report, page);
    add_captioned(report, figures, FIGURE_TRIANGLES,
                  "What a triangle buys, whatever it costs to draw. Lower left is better. Grey: one pixel.",
                  page);
    text_add(page, "</section>\n<section id=\"pictures\"><h2>What was drawn</h2>\n<p>The path\u2019s start, "
                   "its middle and "
                   "each renderer\u2019s worst frame; under each picture its error in pixels.</p>\n");
    report_pictures(report, page);
    text_add(page, "</section>\n<section id=\"runs\"><h2>Every run</h2>\n");
    report_run_tables(report, page);
    text_add(page, "</section>\n");
}

// ---- method and machine -------------------------------------------------------------------------

// Opens <dt>name</dt><dd> ... the caller closes it.
static void add_term(struct text *page, const char *name)
{
    text_add(page, "<dt>%s</dt><dd>", name);
}

static void add_scene(const cJSON *root, struct text *page)
{
    const cJSON *effects = json_at(root, "scene.effects"), *effect;
    add_term(page, "Scene");
    text_add_escaped(page, json_text(root, "scene.name"));
    add_fact(page, ", from <code>", json_text(root, "scene.file"), "</code>");
    add_fact(page, ", terrain <code>", json_text(root, "scene.terrain"), "</code>");
    add_figure_fact(page, ", ", json_number(root, "scene.samples"), " samples");
    add_figure_fact(page, " (", json_number(root, "scene.samples_x"), "");
    add_figure_fact(page, " \u00d7 ", json_number(root, "scene.samples_y"), ")");
    add_figure_fact(page, ", ", item_number(json_at(root, "scene.spacing_m"), 0), "\u00a0m");
    add_figure_fact(page, " \u00d7 ", item_number(json_at(root, "scene.spacing_m"), 1), "\u00a0m apart");
    bool bounds = cJSON_IsTrue(json_at(root, "scene.heights_are_bounds"));
    add_figure_fact(page, bounds ? ", heights within " : ", heights from ", json_number(root, "scene.min_m"),
                    "");
    add_figure_fact(page, " to ", json_number(root, "scene.max_m"), "\u00a0m");
    add_figure_fact(page, ", synthesised levels ", json_number(root, "scene.synthesised_levels"), "");
    add_figure_fact(page, ", voids filled ", json_number(root, "scene.voids_filled"), "");
    add_size(root, page);
    add_figure_fact(page, ", vertical field of view ", json_number(root, "scene.fov_vertical_deg"), "\u00b0");
    if (cJSON_IsObject(effects))
        for (effect = json_first(effects); effect; effect = effect->next) {
            add_fact(page, "; effect ", effect->string, "");
            add_fact(page, ": ",
                     cJSON_IsString(effect)  ? effect->valuestring
                     : cJSON_IsFalse(effect) ? "off"
                                             : "on",
                     "");
        }
    add_fact(page, "; sha256 <code>", json_text(root, "scene.sha256"), "</code>");
    text_add(page, "</dd>");
    add_term(page, "Path");
    text_add_escaped(page, json_text(root, "path.name"));
    add_figure_fact(page, ", ", json_number(root, "path.frames"), " frames");
    add_fact(page, ", sha256 <code>", json_text(root, "path.sha256"), "</code>");
    text_add(page, "</dd>");
}

void page_machine(const cJSON *root, struct text *page)
{
    add_term(page, "Machine");
    text_add_escaped(page, json_text(root, "machine.cpu"));
    add_figure_fact(page, ", ", json_number(root, "machine.cores"), " cores");
    add_fact(page, ", ", json_text(root, "machine.memory_gib"), "\u00a0GiB");
    add_figure_fact(page, ", ", json_number(root, "machine.memory_gib"), "\u00a0GiB");
    add_fact(page, ", ", json_text(root, "machine.system"), "");
    text_add(page, "</dd>");
    add_term(page, "GL");
    text_add_escaped(page, json_text(root, "gl.renderer"));
    add_fact(page, "; ", json_text(root, "gl.vendor"), "");
    add_fact(page, "; ", json_text(root, "gl.version"), "");
    add_fact(page, "; backend ", json_text(root, "gl.backend"), "");
    if (json_at(root, "gl.software"))
        text_add(page, "; %s", json_true(root, "gl.software") ? "<b>software</b>" : "hardware");
    if (json_at(root, "gl.reversed_depth"))
        text_add(page, "; reversed depth %s", json_true(root, "gl.reversed_depth") ? "on" : "off");
    add_fact(page, "; rasteriser threads: ", json_text(root, "gl.rasteriser_threads"), "");
    text_add(page, "</dd>");
    add_term(page, "Build");
    add_fact(page, "Relief ", json_text(root, "build.version"), "");
    add_fact(page, ", commit <code>", json_text(root, "build.commit"), "</code>");
    add_fact(page, ", ", json_text(root, "build.compiler"), "");
    add_fact(page, ", <code>", json_text(root, "build.flags"), "</code>");
    text_add(page, "</dd>");
}

static void add_order(const cJSON *root, struct text *page)
{
    const cJSON *order = json_at(root, "method.order");
    if (cJSON_IsString(order))
        add_fact(page, "; order: ", order->valuestring, "");
    else if (cJSON_IsArray(order))
        add_figure_fact(page, "; ", cJSON_GetArraySize(order), " flights in seeded random order");
}

static void add_method(const cJSON *root, struct text *page)
{
    const char *times = json_text(root, "method.times");
    add_term(page, "Time");
    text_add(page, "Whole frames with the pipeline finished, ");
    text_add(page, times && strcmp(times, "cpu") == 0 ? "as CPU time of the GL thread with its rasteriser"
                                                      : "wall clock");
    add_figure_fact(page, "; repeats ", json_number(root, "method.repeats"), "");
    add_figure_fact(page, "; untimed flights first ", json_number(root, "method.warmup"), "");
    add_fact(page, "; warm-up: ", json_text(root, "method.warmup"), "");
    add_order(root, page);
    add_figure_fact(page, "; seed ", json_number(root, "method.seed"), "");
    add_fact(page, "; sweep ", json_text(root, "method.sweep"), "");
    text_add(page,
             ". Per frame the minimum over repeats, then percentiles over frames; intervals from a block "
             "bootstrap over repeats.</dd>");
    add_term(page, "Error");
    text_add(
        page,
        "Truth is the piecewise-linear surface of the finest level, met by a double-precision ray caster. "
        "<b>error_px</b> is, pixel by pixel, the larger of the drawn point against the truth at the same "
        "place and "
        "the truth\u2019s hit against the drawn mesh at the same place: vertical differences, projected to "
        "the "
        "screen. Skyline misses and spills enter with their distance to the other picture\u2019s skyline");
    add_figure_fact(page, ". Frames measured: ", json_number(root, "method.error_frames"), "");
    text_add(page, ".</dd>");
}

static void add_reproduction(const cJSON *root, struct text *page)
{
    const char *command = json_text(root, "command");
    text_add(page, "<h3>Reproduce it</h3>\n");
    if (command) {
        text_add(page, "<pre><code>make deps all\n");
        text_add_escaped(page, command);
        text_add(page, "</code></pre>\n");
    } else
        text_add(page, "<p>The command was not recorded.</p>\n");
    text_add(page, "<p class=\"note\">The same commit, scene and path give the same errors and triangle "
                   "counts on every run; times "
                   "belong to the machine. <code>results.json</code>, <code>frames/*.csv</code> and "
                   "<code>figures/*.gp</code> lie beside this page; <code>reports/README.md</code> in the "
                   "source says what "
                   "every field means.</p>\n");
}

void report_page(const struct report *report, const struct report_figures *figures, struct text *page)
{
    add_opening(report, page);
    report_verdict(report, page);
    add_contents(page);
    add_body(report, figures, page);
    text_add(page, "<section id=\"method\"><h2>Method and machine</h2>\n<dl>");
    add_scene(report->root, page);
    page_machine(report->root, page);
    add_method(report->root, page);
    text_add(page, "</dl>\n");
    add_reproduction(report->root, page);
    text_add(page, "</section>\n<section id=\"missing\"><h2>What is missing, and why</h2>\n");
    report_missing(report, page);
    text_add(page, "</section>\n</main></body></html>\n");
}
