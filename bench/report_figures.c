// Figures: numbers into NAME.dat, a gnuplot script into NAME.gp, its output into NAME.svg, all of which the
// page's reader can run again by hand.  Ranges, ticks and label places are settled here, so that a script
// holds no surprises. SPDX-License-Identifier: MIT
#include "bench/report_parts.h"
#include "common/report.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

static const char *const figure_names[FIGURE_COUNT] = {"frontier", "path", "triangles"};
static const char *const figure_titles[FIGURE_COUNT] = {
    "Error on the screen against frame time, one curve a renderer",
    "Frame time and error over the path, one line a renderer",
    "Error on the screen against visible triangles, one curve a renderer",
};

struct axis {
    double low, high;
    bool logarithmic;
};

struct plot { // where the axes stand, in pixels, top left origin
    double left, right, top, bottom;
    struct axis x, y;
};

enum { WIDTH = 1120, FONT = 15, LABEL_FONT = 12 };

// ---- axes ---------------------------------------------------------------------------------------

static void axis_include(struct axis *axis, double value)
{
    if (!isfinite(value) || (axis->logarithmic && value <= 0)) return;
    axis->low = fmin(axis->low, value);
    axis->high = fmax(axis->high, value);
}

static struct axis axis_empty(bool logarithmic)
{
    return (struct axis){INFINITY, -INFINITY, logarithmic};
}

static bool axis_pad(struct axis *axis, double share)
{
    if (!(axis->low <= axis->high)) return false;
    if (axis->logarithmic) {
        double factor = pow(fmax(axis->high / axis->low, 2), share);
        axis->low /= factor;
        axis->high *= factor;
    } else {
        axis->high += share * fmax(axis->high - axis->low, 1e-9);
    }
    return true;
}

static double axis_place(const struct axis *axis, double value, double from, double to)
{
    double t = axis->logarithmic ? log(value / axis->low) / log(axis->high / axis->low)
                                 : (value - axis->low) / (axis->high - axis->low);
    return from + t * (to - from);
}

// Ticks of a logarithmic axis: as many round values a decade as its length bears.
static void add_ticks(struct text *script, char which, const struct axis *axis)
{
    static const char *const steps[] = {"1", "125", "12357"};
    static const double plenty[] = {1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 7, 8, 9};
    double decades = log10(axis->high / axis->low);
    const char *chosen = steps[decades > 3.5 ? 0 : decades > 1.5 ? 1 : 2], *separator = "";
    int count = decades > 0.7 ? (int)strlen(chosen) : (int)(sizeof plenty / sizeof plenty[0]);
    char number[NUMBER_TEXT];
    text_add(script, "set logscale %c\nset %ctics (", which, which);
    for (int decade = (int)floor(log10(axis->low)); decade <= (int)ceil(log10(axis->high)); decade++)
        for (int i = 0; i < count; i++) {
            double value = (decades > 0.7 ? chosen[i] - '0' : plenty[i]) * pow(10, decade);
            if (value < axis->low * 0.999 || value > axis->high * 1.001) continue;
            text_add(script, "%s'%s' %.17g", separator, short_text(value, number), value);
            separator = ", ";
        }
    text_add(script, ")\n");
}

// A name in single quotes, where gnuplot expands nothing.
static void add_quoted(struct text *script, const char *raw)
{
    text_add(script, "'");
    for (const char *c = raw; *c;) {
        size_t length = utf8_length(c);
        if (*c == '\'')
            text_add(script, "''");
        else if (length == 0 || (unsigned char)*c < 0x20 || *c == 0x7f || *c == '\\')
            text_add(script, " ");
        else
            text_add_bytes(script, c, length);
        c += length ? length : 1;
    }
    text_add(script, "'");
}

static void add_opening(struct text *script, enum report_figure figure, int height)
{
    const char *name = figure_names[figure];
    text_add(script, "# %s.  Draw it again: gnuplot %s.gp > %s.svg\n", figure_titles[figure], name, name);
    text_add(script,
             "set terminal svg size %d,%d noenhanced font 'sans-serif,%d' background '#ffffff' name '%s'\n",
             WIDTH, height, FONT, name);
    text_add(script,
             "set encoding utf8\nset datafile missing '?'\nset border 3 lc rgb '#777777'\nset tics nomirror "
             "tc rgb '#333333'\nset grid lc rgb '#e6e6e6' lw 1 lt 1\n");
}

static void add_axes(struct text *script, const struct plot *plot, int height)
{
    text_add(script, "set margins screen %.5f, screen %.5f, screen %.5f, screen %.5f\n", plot->left / WIDTH,
             plot->right / WIDTH, 1 - plot->bottom / height, 1 - plot->top / height);
    text_add(script, "set xrange [%.9g:%.9g]\nset yrange [%.9g:%.9g]\n", plot->x.low, plot->x.high,
             plot->y.low, plot->y.high);
    if (plot->x.logarithmic) add_ticks(script, 'x', &plot->x);
    if (plot->y.logarithmic) add_ticks(script, 'y', &plot->y);
}

static void add_cell(struct text *data, double value)
{
    if (isfinite(value))
        text_add(data, " %.9g", value);
    else
        text_add(data, " ?");
}

// ---- labels beside points -----------------------------------------------------------------------

struct box {
    double left, top, right, bottom;
};

struct boxes {
    struct box *items;
    int count, capacity;
};

static void take(struct boxes *boxes, struct box box)
{
    if (boxes->count == boxes->capacity) {
        int capacity = boxes->capacity ? boxes->capacity * 2 : 256;
        struct box *items = realloc(boxes->items, (size_t)capacity * sizeof *items);
        if (!items) return;
        boxes->items = items;
        boxes->capacity = capacity;
    }
    boxes->items[boxes->count++] = box;
}

static bool is_free(const struct boxes *boxes, struct box box)
{
    for (int i = 0; i < boxes->count; i++) {
        const struct box *other = &boxes->items[i];
        if (box.left < other->right && other->left < box.right && box.top < other->bottom &&
            other->top < box.bottom)
            return false;
    }
    return true;
}

// What curves cover: a small box every few pixels along each segment, a larger one at each mark.
static void take_segment(struct boxes *taken, double x0, double y0, double x1, double y1)
{
    int steps = 1 + (int)(hypot(x1 - x0, y1 - y0) / 6);
    for (int i = 0; i <= steps; i++) {
        double x = x0 + (x1 - x0) * i / steps, y = y0 + (y1 - y0) * i / steps;
        take(taken, (struct box){x - 2, y - 2, x + 2, y + 2});
    }
}

static void take_mark(struct boxes *taken, double x, double y)
{
    take(taken, (struct box){x - 6, y - 6, x + 6, y + 6});
}

// Puts the label on the first free place around its point, or leaves it out: a label that covers another
// tells less than none.
static void place_label(struct text *script, struct boxes *taken, const struct plot *plot, int height,
                        double x, double y, const char *label, const char *colour)
{
    static const double places[][2] = {{1, -0.7}, {-1, 0.7}, {1, 0.7}, {-1, -0.7},
                                       {0, -1},   {0, 1},    {1, 0},   {-1, 0}};
    double width = 0.58 * LABEL_FONT * (double)strlen(label), tall = LABEL_FONT;
    for (size_t i = 0; i < sizeof places / sizeof places[0]; i++) {
        double middle_x = x + places[i][0] * (width / 2 + 9), middle_y = y + places[i][1] * (tall / 2 + 9);
        struct box box = {middle_x - width / 2, middle_y - tall / 2, middle_x + width / 2,
                          middle_y + tall / 2};
        if (box.left < plot->left + 2 || box.right > WIDTH - 2 || box.top < plot->top ||
            box.bottom > plot->bottom - 2)
            continue;
        if (!is_free(taken, box)) continue;
        take(taken, box);
        text_add(script, "set label ");
        add_quoted(script, label);
        text_add(script, " at screen %.5f,%.5f center font 'sans-serif,%d' tc rgb '%s'\n", middle_x / WIDTH,
                 1 - middle_y / height, LABEL_FONT, colour);
        return;
    }
}

// ---- curves: the frontier, and error against triangles ------------------------------------------

static double point_x(const struct report_point *point, enum report_figure figure)
{
    return figure == FIGURE_FRONTIER ? point->error_px : point->triangles;
}

static double point_y(const struct report_point *point, enum report_figure figure)
{
    return figure == FIGURE_FRONTIER ? point->ms : point->error_px;
}

static bool drawable(const struct report_point *point, enum report_figure figure)
{
    return point_x(point, figure) > 0 && point_y(point, figure) > 0;
}

static bool has_curve(const struct report_renderer *renderer, enum report_figure figure)
{
    if (renderer->role != ROLE_METHOD && renderer->role != ROLE_DECIMATED) return false;
    for (int i = 0; i < renderer->point_count; i++)
        if (drawable(&renderer->points[i], figure)) return true;
    return false;
}

static double
level_ms(const struct report_renderer *renderer) // of a renderer that stands as a line: brute, null
{
    bool line = renderer->role == ROLE_BRUTE || renderer->role == ROLE_EMPTY;
    return line && renderer->shown ? json_number(renderer->shown->json, "frame_ms.median") : (double)NAN;
}

static bool curve_axes(const struct report *report, enum report_figure figure, struct plot *plot)
{
    plot->x = plot->y = axis_empty(true);
    for (int i = 0; i < report->renderer_count; i++) {
        const struct report_renderer *renderer = &report->renderers[i];
        if (!has_curve(renderer, figure)) continue;
        for (int k = 0; k < renderer->point_count; k++) {
            if (!drawable(&renderer->points[k], figure)) continue;
            axis_include(&plot->x, point_x(&renderer->points[k], figure));
            axis_include(&plot->y, point_y(&renderer->points[k], figure));
            if (figure != FIGURE_FRONTIER) continue;
            axis_include(&plot->y, renderer->points[k].low_ms);
            axis_include(&plot->y, renderer->points[k].high_ms);
        }
    }
    for (int i = 0; figure == FIGURE_FRONTIER && i < report->renderer_count; i++) {
        double ms = level_ms(&report->renderers[i]); // a level far below the curves would only squeeze them
        if (ms > plot->y.low / 3) axis_include(&plot->y, ms);
    }
    return axis_pad(&plot->x, 0.06) && axis_pad(&plot->y, 0.08);
}

static void add_curve_data(const struct report *report, enum report_figure figure, struct text *data)
{
    text_add(data, figure == FIGURE_FRONTIER
                       ? "# error_px.p999  frame_ms.median  ci95 low  ci95 high; one block a renderer\n"
                       : "# visible_triangles.mean  error_px.p999; one block a renderer\n");
    for (int i = 0; i < report->renderer_count; i++) {
        const struct report_renderer *renderer = &report->renderers[i];
        if (!has_curve(renderer, figure)) continue;
        for (int k = 0; k < renderer->point_count; k++) {
            const struct report_point *point = &renderer->points[k];
            if (!drawable(point, figure)) continue;
            add_cell(data, point_x(point, figure));
            add_cell(data, point_y(point, figure));
            if (figure == FIGURE_FRONTIER) {
                add_cell(data, point->low_ms);
                add_cell(data, point->high_ms);
            }
            text_add(data, "\n");
        }
        text_add(data, "\n\n");
    }
}

static void label_curves(const struct report *report, enum report_figure figure, const struct plot *plot,
                         int height, struct text *script)
{
    struct boxes taken = {0};
    for (int pass = 0; pass < 2; pass++) // first everything that is drawn, then the labels
        for (int i = 0; i < report->renderer_count; i++) {
            const struct report_renderer *renderer = &report->renderers[i];
            double last_x = (double)NAN, last_y = (double)NAN, level = level_ms(renderer);
            if (pass == 0 && figure == FIGURE_FRONTIER && level >= plot->y.low) {
                double y = axis_place(&plot->y, level, plot->bottom, plot->top);
                take(&taken, (struct box){plot->left, y - 2, plot->right, y + 2});
            }
            for (int k = 0; has_curve(renderer, figure) && k < renderer->point_count; k++) {
                const struct report_point *point = &renderer->points[k];
                if (!drawable(point, figure)) continue;
                double x = axis_place(&plot->x, point_x(point, figure), plot->left, plot->right);
                double y = axis_place(&plot->y, point_y(point, figure), plot->bottom, plot->top);
                if (pass == 0) take_mark(&taken, x, y);
                if (pass == 0 && isfinite(last_x)) take_segment(&taken, last_x, last_y, x, y);
                if (pass == 1)
                    place_label(script, &taken, plot, height, x, y, point->run->knob, renderer->colour);
                last_x = x;
                last_y = y;
            }
        }
    free(taken.items);
}

static void add_curve_key(struct text *script, const struct report_renderer *renderer,
                          enum report_figure figure)
{
    char number[16], name[128];
    if (figure == FIGURE_TRIANGLES && isfinite(renderer->rank_correlation)) {
        snprintf(number, sizeof number, "%.2f", fabs(renderer->rank_correlation));
        snprintf(name, sizeof name, "%.80s (\u03c1 %s%s)", renderer->name,
                 renderer->rank_correlation < 0 ? "\u2212" : "", number);
    } else
        snprintf(name, sizeof name, "%.80s", renderer->name);
    add_quoted(script, name);
}

static void add_levels(const struct report *report, const struct plot *plot, struct text *script)
{
    for (int i = 0; i < report->renderer_count; i++) {
        const struct report_renderer *renderer = &report->renderers[i];
        double ms = level_ms(renderer);
        char number[NUMBER_TEXT], key[160];
        if (!(ms >= plot->y.low)) continue;
        snprintf(key, sizeof key, "%.60s: %s ms", renderer->name, number_text(ms, number));
        text_add(script, ", \\\n  %.9g with lines dt 2 lw 1.5 lc rgb '%s' title ", ms, renderer->colour);
        add_quoted(script, key);
    }
}

static bool write_curves(const struct report *report, enum report_figure figure, struct text *script,
                         struct text *data)
{
    int height = figure == FIGURE_FRONTIER ? 580 : 460;
    struct plot plot = {.left = 84, .right = WIDTH - 30, .top = 48, .bottom = height - 72};
    if (!curve_axes(report, figure, &plot)) return false;
    add_curve_data(report, figure, data);
    add_opening(script, figure, height);
    add_axes(script, &plot, height);
    text_add(script,
             "set key at screen 0.5,%.4f center top horizontal maxrows 1 Left reverse samplen 2 tc rgb "
             "'#222222'\n",
             1 - 10.0 / height);
    text_add(script, figure == FIGURE_FRONTIER ? "set xlabel 'error on the screen, p99.9 (px)' offset "
                                                 "0,0.3\nset ylabel 'frame time, median (ms)'\n"
                                               : "set xlabel 'visible triangles, mean' offset 0,0.3\nset "
                                                 "ylabel 'error on the screen, p99.9 (px)'\n");
    if (figure == FIGURE_FRONTIER && plot.x.low < 1 && plot.x.high > 1)
        text_add(script, "set arrow from 1,graph 0 to 1,graph 1 nohead lc rgb '#999999' lw 1.2\n");
    if (figure == FIGURE_TRIANGLES && plot.y.low < 1 && plot.y.high > 1)
        text_add(script,
                 "set arrow from graph 0,first 1 to graph 1,first 1 nohead lc rgb '#999999' lw 1.2\n");
    label_curves(report, figure, &plot, height, script);
    const char *opening = "plot ";
    for (int i = 0, block = 0; i < report->renderer_count; i++) {
        const struct report_renderer *renderer = &report->renderers[i];
        if (!has_curve(renderer, figure)) continue;
        if (figure == FIGURE_FRONTIER)
            text_add(script,
                     "%s'frontier.dat' index %d using 1:2:3:4 with yerrorbars pt 0 ps 0 lw 1.2 lc rgb '%s' "
                     "notitle",
                     opening, block, renderer->colour),
                opening = ", \\\n  ";
        text_add(script,
                 "%s'%s.dat' index %d using 1:2 with linespoints lw 2.4 pt %d ps 1 lc rgb '%s' title ",
                 opening, figure_names[figure], block++, renderer->mark, renderer->colour);
        add_curve_key(script, renderer, figure);
        opening = ", \\\n  ";
    }
    if (figure == FIGURE_FRONTIER) add_levels(report, &plot, script);
    text_add(script, "\n");
    return true;
}

// ---- over the path ------------------------------------------------------------------------------

enum { FRAME, FRAME_MS, FRAME_ERROR, FRAME_COLUMNS };
static const char *const frame_columns[FRAME_COLUMNS] = {"frame", "frame_ms", "error_px_p999"};

// Adds a renderer's frames as a block; false when it has none that could be drawn.
static bool add_path_block(const struct report *report, const struct report_renderer *renderer,
                           struct text *data, struct axis *frames, struct axis *ms, struct axis *error)
{
    double *values;
    bool any = false;
    if (renderer->role != ROLE_METHOD || !renderer->shown) return false;
    int rows = report_csv(report, json_text(renderer->shown->json, "frames_csv"), frame_columns,
                          FRAME_COLUMNS, &values);
    for (int row = 0; row < rows; row++) {
        const double *cells = values + row * FRAME_COLUMNS;
        bool drawn = isfinite(cells[FRAME]) && (isfinite(cells[FRAME_MS]) || cells[FRAME_ERROR] > 0);
        if (!drawn) continue;
        any = true;
        axis_include(frames, cells[FRAME]);
        axis_include(ms, cells[FRAME_MS]);
        axis_include(error, cells[FRAME_ERROR]);
        add_cell(data, cells[FRAME]);
        add_cell(data, cells[FRAME_MS]);
        add_cell(data, cells[FRAME_ERROR] > 0 ? cells[FRAME_ERROR] : (double)NAN);
        text_add(data, "\n");
    }
    free(values);
    if (any) text_add(data, "\n\n");
    return any;
}

static void add_path_lines(const struct report *report, const bool *drawn, int column, struct text *script)
{
    const char *opening = "plot ";
    for (int i = 0, block = 0; i < report->renderer_count; i++) {
        if (!drawn[i]) continue;
        text_add(script,
                 "%s'path.dat' index %d using 1:%d with linespoints lw 2 pt %d ps 0.45 lc rgb '%s' title ",
                 opening, block++, column, report->renderers[i].mark, report->renderers[i].colour);
        add_quoted(script, report->renderers[i].shown->name);
        opening = ", \\\n  ";
    }
    text_add(script, "\n");
}

static bool write_path(const struct report *report, struct text *script, struct text *data)
{
    int height = 620;
    struct axis frames = axis_empty(false), ms = axis_empty(false), error = axis_empty(true);
    bool *drawn = calloc((size_t)report->renderer_count + 1, sizeof *drawn), any = false;
    text_add(data, "# frame  frame_ms  error_px_p999; one block a renderer\n");
    for (int i = 0; drawn && i < report->renderer_count; i++)
        any |= drawn[i] = add_path_block(report, &report->renderers[i], data, &frames, &ms, &error);
    if (any) {
        bool has_ms = ms.high >= ms.low, has_error = error.high >= error.low;
        double left = 84, right = WIDTH - 30, middle = !has_error ? height - 72 : !has_ms ? 48 : 305;
        ms.low = 0;
        if (!(frames.high > frames.low)) frames.high = frames.low + 1;
        add_opening(script, FIGURE_PATH, height);
        text_add(script,
                 "set multiplot\nset key at screen 0.5,%.4f center top horizontal maxrows 1 Left reverse "
                 "samplen 2 tc "
                 "rgb '#222222'\n",
                 1 - 10.0 / height);
        if (has_ms) {
            struct plot plot = {left, right, 48, middle, frames, ms};
            axis_pad(&plot.y, 0.08);
            add_axes(script, &plot, height);
            text_add(script,
                     has_error ? "set format x ''\n" : "set xlabel 'frame of the path' offset 0,0.3\n");
            text_add(script, "set ylabel 'frame time (ms)'\n");
            add_path_lines(report, drawn, 2, script);
        }
        if (has_error) {
            struct plot plot = {left, right, has_ms ? middle + 24 : 48, height - 72, frames, error};
            axis_pad(&plot.y, 0.06);
            if (has_ms) text_add(script, "unset key\n");
            text_add(script, "set format x '%%g'\nset xlabel 'frame of the path' offset 0,0.3\nset ylabel "
                             "'error, p99.9 (px)'\n");
            add_axes(script, &plot, height);
            if (plot.y.low < 1 && plot.y.high > 1)
                text_add(
                    script,
                    "set arrow from graph 0,first 1 to graph 1,first 1 nohead lc rgb '#999999' lw 1.2\n");
            add_path_lines(report, drawn, 3, script);
        }
        text_add(script, "unset multiplot\n");
    }
    free(drawn);
    return any;
}

// ---- gnuplot ------------------------------------------------------------------------------------

enum { GNUPLOT_MISSING = 127 };

// Runs `gnuplot NAME.gp > NAME.svg.tmp` in the folder and gives its exit code.
static int run_gnuplot(const char *folder, const char *script, const char *output)
{
    pid_t child = fork();
    if (child == 0) {
        int out = chdir(folder) == 0 ? open(output, O_CREAT | O_TRUNC | O_WRONLY, 0666) : -1;
        int nothing = open("/dev/null", O_RDWR);
        if (out < 0 || nothing < 0 || dup2(out, 1) < 0 || dup2(nothing, 0) < 0 || dup2(nothing, 2) < 0)
            _exit(126);
        execlp("gnuplot", "gnuplot", script, (char *)NULL);
        _exit(errno == ENOENT ? GNUPLOT_MISSING : 126);
    }
    int status;
    if (child < 0 || waitpid(child, &status, 0) != child) return 126;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 126;
}

// Copies a figure for use inside HTML: no XML declaration and namespaces, its size left to the page, and its
// ids with the figure's name in front, since one page holds many figures and ids must not clash.
static void embed_svg(struct text *out, const char *svg, enum report_figure figure)
{
    static const char *const links[] = {" id='", " id=\"", "url(#"};
    const char *root = strstr(svg, "<svg"), *view = root ? strstr(root, "viewBox=\"") : NULL;
    const char *body = root ? strchr(root, '>') : NULL;
    if (!view || !body || view > body) return;
    text_add(out, "<svg role=\"img\" aria-label=\"%s\" viewBox=\"%.*s\">", figure_titles[figure],
             (int)strcspn(view + 9, "\""), view + 9);
    for (const char *c = body + 1; *c;) {
        const char *skip = strncmp(c, "<title>", 7) == 0  ? "</title>"
                           : strncmp(c, "<desc>", 6) == 0 ? "</desc>"
                                                          : NULL;
        const char *end = skip ? strstr(c, skip) : NULL;
        if (end) {
            c = end + strlen(skip);
            continue;
        }
        if (strncmp(c, "xlink:href='#", 13) == 0) {
            text_add(out, "href='#%s_", figure_names[figure]);
            c += 13;
            continue;
        }
        size_t length = 0;
        for (int i = 0; i < 3 && length == 0; i++)
            if (strncmp(c, links[i], strlen(links[i])) == 0) length = strlen(links[i]);
        text_add_bytes(out, c, length ? length : 1);
        if (length) text_add(out, "%s_", figure_names[figure]);
        c += length ? length : 1;
    }
}

// True unless the folder cannot be written.  The SVG stays absent when gnuplot does not serve.
static bool draw_figure(const char *folder, enum report_figure figure, const struct text *script,
                        const struct text *data, struct report_figures *figures)
{
    char path[4200], temporary[4200], script_name[64], output[64];
    const char *name = figure_names[figure];
    snprintf(script_name, sizeof script_name, "%s.gp", name);
    snprintf(output, sizeof output, "%s.svg.tmp", name);
    snprintf(path, sizeof path, "%s/%s.dat", folder, name);
    if (!text_write(data, path)) return false;
    snprintf(path, sizeof path, "%s/%s.gp", folder, name);
    if (!text_write(script, path)) return false;
    snprintf(path, sizeof path, "%s/%s.svg", folder, name);
    snprintf(temporary, sizeof temporary, "%s/%s", folder, output);
    unlink(path); // a figure of an older run must not stand beside these numbers
    int code = figures->gnuplot_found ? run_gnuplot(folder, script_name, output) : GNUPLOT_MISSING;
    size_t size;
    char *svg = code == 0 ? file_read(temporary, &size) : NULL;
    bool whole = svg && strstr(svg, "</svg>") && rename(temporary, path) == 0;
    if (whole)
        embed_svg(&figures->svg[figure], svg, figure);
    else
        unlink(temporary);
    free(svg);
    if (code == GNUPLOT_MISSING && figures->gnuplot_found) {
        note("gnuplot is not installed: the report has no figures, their scripts are in %s", folder);
        figures->gnuplot_found = false;
    } else if (!whole && figures->gnuplot_found) {
        note("%s/%s: gnuplot could not draw it", folder, script_name);
    }
    return true;
}

bool report_draw_figures(const struct report *report, struct report_figures *figures)
{
    char folder[4100];
    bool good = true;
    *figures = (struct report_figures){.gnuplot_found = true};
    if ((size_t)snprintf(folder, sizeof folder, "%s/figures", report->folder) >= sizeof folder)
        return fail("%s: the name is too long", report->folder);
    if (mkdir(folder, 0777) != 0 && errno != EEXIST)
        return fail("%s: cannot be made (%s); expected a folder that can be written", folder,
                    strerror(errno));
    for (int figure = 0; good && figure < FIGURE_COUNT; figure++) {
        struct text script = {0}, data = {0};
        bool drawable_figure = figure == FIGURE_PATH ? write_path(report, &script, &data)
                                                     : write_curves(report, figure, &script, &data);
        if (drawable_figure) good = draw_figure(folder, figure, &script, &data, figures);
        text_finish(&script);
        text_finish(&data);
    }
    return good;
}

void report_figures_finish(struct report_figures *figures)
{
    for (int i = 0; i < FIGURE_COUNT; i++) text_finish(&figures->svg[i]);
}
