// The figures: which numbers stand in them, how they are drawn and labelled.
// SPDX-License-Identifier: MIT
#include "bench/report/plot.h"
#include "common/report.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

static const char *const figure_names[FIGURE_COUNT] = {"frontier", "path", "motion", "triangles"};
static const char *const figure_titles[FIGURE_COUNT] = {
    "Error on the screen against frame time, one curve a renderer",
    "Frame time and error over the path, one line a renderer",
    "How far drawn ground moves from frame to frame, one line a renderer",
    "Error on the screen against visible triangles, one curve a renderer",
};

// Where axes stand on the canvas, in pixels.
enum { LEFT = 108, RIGHT = PLOT_WIDTH - 30, TOP = 48, BELOW = 72, PATH_HEIGHT = 620, MOTION_HEIGHT = 400 };
#define ONE_PIXEL_ACROSS "set arrow from graph 0,first 1 to graph 1,first 1 nohead lc rgb '#999999' lw 1.2\n"

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

// The time of a renderer that stands as a line: brute, null.
static double level_ms(const struct report_renderer *renderer)
{
    bool line = renderer->role == ROLE_BRUTE || renderer->role == ROLE_EMPTY;
    return line && renderer->shown ? json_number(renderer->shown->json, "frame_ms.median") : (double)NAN;
}

// A baseline that errs far more than every method would squeeze their curves into a corner: beyond four times
// the methods' largest error its points lie outside the figure.
static double error_ceiling(const struct report *report)
{
    double largest = 0;
    for (int i = 0; i < report->renderer_count; i++)
        if (report->renderers[i].role == ROLE_METHOD && report->renderers[i].point_count > 0)
            largest = fmax(largest, report->renderers[i].points[0].error_px);
    return largest > 0 ? 4 * largest : (double)INFINITY;
}

int report_points_outside(const struct report *report)
{
    int count = 0;
    for (int i = 0; i < report->renderer_count; i++)
        for (int k = 0;
             has_curve(&report->renderers[i], FIGURE_FRONTIER) && k < report->renderers[i].point_count; k++)
            count += report->renderers[i].points[k].error_px > error_ceiling(report);
    return count;
}

static bool curve_axes(const struct report *report, enum report_figure figure, struct plot *plot)
{
    double ceiling = error_ceiling(report);
    plot->x = plot->y = axis_empty(true);
    for (int i = 0; i < report->renderer_count; i++) {
        const struct report_renderer *renderer = &report->renderers[i];
        if (!has_curve(renderer, figure)) continue;
        for (int k = 0; k < renderer->point_count; k++) {
            if (!drawable(&renderer->points[k], figure) || renderer->points[k].error_px > ceiling) continue;
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

// Adds the points of one sweep, after a gap; false when there are none.
static bool add_sweep_data(const struct report_renderer *renderer, int sweep, enum report_figure figure,
                           const char *gap, struct text *data)
{
    bool any = false;
    for (int k = 0; k < renderer->point_count; k++) {
        const struct report_point *point = &renderer->points[k];
        if (point->sweep != sweep || !drawable(point, figure)) continue;
        if (!any) text_add(data, "%s", gap);
        any = true;
        plot_add_value(data, point_x(point, figure));
        plot_add_value(data, point_y(point, figure));
        if (figure == FIGURE_FRONTIER) {
            plot_add_value(data, point->low_ms);
            plot_add_value(data, point->high_ms);
        }
        text_add(data, "\n");
    }
    return any;
}

static void add_curve_data(const struct report *report, enum report_figure figure, struct text *data)
{
    text_add(data, figure == FIGURE_FRONTIER
                       ? "# error_px.p999  frame_ms.median  ci95 low  ci95 high; one block a renderer\n"
                       : "# visible_triangles.mean  error_px.p999; one block a renderer\n");
    for (int i = 0; i < report->renderer_count; i++) {
        const struct report_renderer *renderer = &report->renderers[i];
        if (!has_curve(renderer, figure)) continue;
        const char *gap = ""; // one empty line ends a line, two a block
        for (int sweep = 0; sweep < renderer->sweep_count; sweep++)
            if (add_sweep_data(renderer, sweep, figure, gap, data)) gap = "\n";
        text_add(data, "\n\n");
    }
}

typedef void on_point(double x, double y, double last_x, double last_y, const struct report_point *point,
                      void *user);

struct walk { // over every point that is drawn, in pixels
    const struct report *report;
    enum report_figure figure;
    const struct plot *plot;
    on_point *visit; // last_x and last_y are NAN at the start of a line
    void *user;
};

static void walk_sweep(const struct walk *walk, const struct report_renderer *renderer, int sweep)
{
    double last_x = (double)NAN, last_y = (double)NAN;
    for (int k = 0; k < renderer->point_count; k++) {
        const struct report_point *point = &renderer->points[k];
        if (point->sweep != sweep || !drawable(point, walk->figure)) continue;
        double x = plot_x(walk->plot, point_x(point, walk->figure)),
               y = plot_y(walk->plot, point_y(point, walk->figure));
        if (point->error_px <= error_ceiling(walk->report))
            walk->visit(x, y, last_x, last_y, point, walk->user);
        last_x = x;
        last_y = y;
    }
}

static void each_point(const struct report *report, enum report_figure figure, const struct plot *plot,
                       on_point *visit, void *user)
{
    struct walk walk = {report, figure, plot, visit, user};
    for (int i = 0; i < report->renderer_count; i++) {
        const struct report_renderer *renderer = &report->renderers[i];
        if (!has_curve(renderer, figure)) continue;
        for (int sweep = 0; sweep < renderer->sweep_count; sweep++) walk_sweep(&walk, renderer, sweep);
    }
}

struct labelling {
    const struct report *report;
    const struct plot *plot;
    struct boxes taken;
    struct text *script;
};

static void take_point(double x, double y, double last_x, double last_y, const struct report_point *point,
                       void *user)
{
    struct labelling *labelling = user;
    (void)point;
    boxes_take_mark(&labelling->taken, x, y);
    if (isfinite(last_x)) boxes_take_line(&labelling->taken, last_x, last_y, x, y);
}

static void label_point(double x, double y, double last_x, double last_y, const struct report_point *point,
                        void *user)
{
    struct labelling *labelling = user;
    (void)last_x, (void)last_y;
    plot_add_label(labelling->script, &labelling->taken, labelling->plot, x, y, point->run->knob,
                   labelling->report->renderers[point->run->renderer].colour);
}

static void label_curves(const struct report *report, enum report_figure figure, const struct plot *plot,
                         struct text *script)
{
    struct labelling labelling = {report, plot, {0}, script};
    for (int i = 0; figure == FIGURE_FRONTIER && i < report->renderer_count; i++) {
        double level = level_ms(&report->renderers[i]);
        if (!(level >= plot->y.low)) continue;
        boxes_take_line(&labelling.taken, plot->left, plot_y(plot, level), plot->right, plot_y(plot, level));
    }
    each_point(report, figure, plot, take_point, &labelling); // first all that is drawn, then the labels
    each_point(report, figure, plot, label_point, &labelling);
    free(labelling.taken.items);
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
        plot_add_quoted(script, key);
    }
}

static bool has_interval(const struct report_renderer *renderer)
{
    for (int i = 0; i < renderer->point_count; i++)
        if (isfinite(renderer->points[i].low_ms)) return true;
    return false;
}

static void add_curve_lines(const struct report *report, enum report_figure figure, struct text *script)
{
    const char *opening = "plot ", *next = ", \\\n  ";
    for (int i = 0, block = 0; i < report->renderer_count; i++) {
        const struct report_renderer *renderer = &report->renderers[i];
        if (!has_curve(renderer, figure)) continue;
        if (figure == FIGURE_FRONTIER && has_interval(renderer)) {
            text_add(script,
                     "%s'frontier.dat' index %d using 1:2:3:4 with yerrorbars pt 0 ps 0 lw 1.2 lc rgb '%s' "
                     "notitle",
                     opening, block, renderer->colour);
            opening = next;
        }
        text_add(script,
                 "%s'%s.dat' index %d using 1:2 with linespoints lw 2.4 pt %d ps 1 lc rgb '%s' title ",
                 opening, figure_names[figure], block++, renderer->mark, renderer->colour);
        plot_add_quoted(script, renderer->name);
        opening = next;
    }
}

static bool write_curves(const struct report *report, enum report_figure figure, struct text *script,
                         struct text *data)
{
    bool frontier = figure == FIGURE_FRONTIER;
    double height = frontier ? 580 : 460;
    struct plot plot = {.left = LEFT, .right = RIGHT, .top = TOP, .bottom = height - BELOW, .height = height};
    if (!curve_axes(report, figure, &plot)) return false;
    add_curve_data(report, figure, data);
    plot_add_opening(script, figure_names[figure], figure_titles[figure], height);
    plot_add_axes(script, &plot);
    text_add(script, "set xlabel '%s' offset 0,0.3\nset ylabel '%s'\n",
             frontier ? "error on the screen, p99.9 (px)" : "visible triangles, mean",
             frontier ? "frame time, median (ms)" : "error on the screen, p99.9 (px)");
    if (frontier && axis_shows(&plot.x, 1))
        text_add(script, "set arrow from 1,graph 0 to 1,graph 1 nohead lc rgb '#999999' lw 1.2\n");
    if (!frontier && axis_shows(&plot.y, 1)) text_add(script, ONE_PIXEL_ACROSS);
    label_curves(report, figure, &plot, script);
    add_curve_lines(report, figure, script);
    if (frontier) add_levels(report, &plot, script);
    text_add(script, "\n");
    return true;
}

// ---- over the path ------------------------------------------------------------------------------

enum { FRAME, FRAME_MS, FRAME_ERROR, FRAME_COLUMNS };
static const char *const path_columns[FRAME_COLUMNS] = {"frame", "frame_ms", "error_px_p999"};
enum { MOTION_PX = 1, MOTION_COLUMNS };
static const char *const motion_columns[MOTION_COLUMNS] = {"frame", "temporal_px_p999"};

static bool shows(const struct axis *axis, double value)
{
    return isfinite(value) && (!axis->logarithmic || value > 0);
}

// Adds a renderer's frames as a block, an axis a column, frame numbers first; false when it has none that
// could be drawn.
static bool add_frames(const struct report *report, const struct report_renderer *renderer,
                       const char *const *columns, int count, struct axis *axes, struct text *data)
{
    double *values;
    bool any = false;
    if (renderer->role != ROLE_METHOD || !renderer->shown) return false;
    int rows = report_csv(report, json_text(renderer->shown->json, "frames_csv"), columns, count, &values);
    for (int row = 0; row < rows; row++) {
        const double *cells = values + row * count;
        bool drawn = false;
        for (int c = 1; c < count; c++) drawn = drawn || shows(&axes[c], cells[c]);
        if (!drawn || !isfinite(cells[FRAME])) continue;
        any = true;
        for (int c = 0; c < count; c++) {
            axis_include(&axes[c], cells[c]);
            plot_add_value(data, shows(&axes[c], cells[c]) ? cells[c] : (double)NAN);
        }
        text_add(data, "\n");
    }
    free(values);
    if (any) text_add(data, "\n\n");
    return any;
}

// Adds every renderer's frames; drawn[] tells which have any.
static bool add_all_frames(const struct report *report, const char *const *columns, int count,
                           struct axis *axes, bool *drawn, struct text *data)
{
    bool any = false;
    text_add(data, "#");
    for (int c = 0; c < count; c++) text_add(data, " %s", columns[c]);
    text_add(data, "; one block a renderer\n");
    for (int i = 0; i < report->renderer_count; i++) {
        drawn[i] = add_frames(report, &report->renderers[i], columns, count, axes, data);
        any = any || drawn[i];
    }
    if (!(axes[FRAME].high > axes[FRAME].low)) axes[FRAME].high = axes[FRAME].low + 1;
    return any;
}

static void add_frame_lines(const struct report *report, enum report_figure figure, const bool *drawn,
                            int column, struct text *script)
{
    const char *opening = "plot ";
    for (int i = 0, block = 0; i < report->renderer_count; i++) {
        if (!drawn[i]) continue;
        text_add(script,
                 "%s'%s.dat' index %d using 1:%d with linespoints lw 2 pt %d ps 0.45 lc rgb '%s' title ",
                 opening, figure_names[figure], block++, column, report->renderers[i].mark,
                 report->renderers[i].colour);
        plot_add_quoted(script, report->renderers[i].shown->name);
        opening = ", \\\n  ";
    }
    text_add(script, "\n");
}

static const char frame_label[] = "set format x '%g'\nset xlabel 'frame of the path' offset 0,0.3\n";

// Two panels over the same frames: time above, error below; one of them alone when the other has no numbers.
static void write_panels(const struct report *report, const bool *drawn, struct axis *axes,
                         struct text *script)
{
    struct axis *ms = &axes[FRAME_MS], *error = &axes[FRAME_ERROR];
    bool has_ms = axis_pad(ms, 0), has_error = axis_pad(error, 0.06);
    double height = PATH_HEIGHT, floor_px = height - BELOW, middle = has_ms && has_error ? 305 : floor_px;
    ms->logarithmic = ms->low > 0 && ms->high > 8 * ms->low; // the fast would lie on the floor
    if (!ms->logarithmic) ms->low = 0;
    axis_pad(ms, 0.08);
    text_add(script, "set multiplot\n");
    if (has_ms) {
        struct plot plot = {LEFT, RIGHT, TOP, middle, height, axes[FRAME], *ms};
        plot_add_axes(script, &plot);
        text_add(script, "%sset ylabel 'frame time (ms)'\n", has_error ? "set format x ''\n" : frame_label);
        add_frame_lines(report, FIGURE_PATH, drawn, 1 + FRAME_MS, script);
        text_add(script, "unset key\n");
    }
    if (has_error) {
        struct plot plot = {LEFT, RIGHT, has_ms ? middle + 24 : TOP, floor_px, height, axes[FRAME], *error};
        plot_add_axes(script, &plot);
        text_add(script, "%sset ylabel 'error, p99.9 (px)'\n", frame_label);
        if (axis_shows(&plot.y, 1)) text_add(script, ONE_PIXEL_ACROSS);
        add_frame_lines(report, FIGURE_PATH, drawn, 1 + FRAME_ERROR, script);
    }
    text_add(script, "unset multiplot\n");
}

static bool write_path(const struct report *report, struct text *script, struct text *data)
{
    struct axis axes[FRAME_COLUMNS] = {axis_empty(false), axis_empty(false), axis_empty(true)};
    bool *drawn = calloc((size_t)report->renderer_count + 1, sizeof *drawn);
    bool any = drawn && add_all_frames(report, path_columns, FRAME_COLUMNS, axes, drawn, data);
    plot_add_opening(script, figure_names[FIGURE_PATH], figure_titles[FIGURE_PATH], PATH_HEIGHT);
    if (any) write_panels(report, drawn, axes, script);
    free(drawn);
    return any;
}

static bool write_motion(const struct report *report, struct text *script, struct text *data)
{
    struct axis axes[MOTION_COLUMNS] = {axis_empty(false), axis_empty(true)};
    bool *drawn = calloc((size_t)report->renderer_count + 1, sizeof *drawn);
    bool any = drawn && add_all_frames(report, motion_columns, MOTION_COLUMNS, axes, drawn, data);
    plot_add_opening(script, figure_names[FIGURE_MOTION], figure_titles[FIGURE_MOTION], MOTION_HEIGHT);
    if (any && axis_pad(&axes[MOTION_PX], 0.06)) {
        struct plot plot = {LEFT,        RIGHT,          TOP, MOTION_HEIGHT - BELOW, MOTION_HEIGHT,
                            axes[FRAME], axes[MOTION_PX]};
        plot_add_axes(script, &plot);
        text_add(script, "%sset ylabel 'moved, p99.9 (px)'\n", frame_label);
        if (axis_shows(&plot.y, 1)) text_add(script, ONE_PIXEL_ACROSS);
        add_frame_lines(report, FIGURE_MOTION, drawn, 1 + MOTION_PX, script);
    }
    free(drawn);
    return any;
}

// ---- all -----------------------------------------------------------------------------------------

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
        bool any = figure == FIGURE_PATH     ? write_path(report, &script, &data)
                   : figure == FIGURE_MOTION ? write_motion(report, &script, &data)
                                             : write_curves(report, figure, &script, &data);
        if (any)
            good = plot_draw(folder, figure_names[figure], figure_titles[figure], &script, &data,
                             &figures->svg[figure], &figures->gnuplot_found);
        else
            plot_remove(folder, figure_names[figure]);
        text_finish(&script);
        text_finish(&data);
    }
    return good;
}

void report_figures_finish(struct report_figures *figures)
{
    for (int i = 0; i < FIGURE_COUNT; i++) text_finish(&figures->svg[i]);
}
