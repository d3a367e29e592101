// SPDX-License-Identifier: MIT
#include "bench/report/plot.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { FONT = 15, LABEL_FONT = 12 };

// ---- axes ---------------------------------------------------------------------------------------

void axis_include(struct axis *axis, double value)
{
    if (!isfinite(value) || (axis->logarithmic && value <= 0)) return;
    axis->low = fmin(axis->low, value);
    axis->high = fmax(axis->high, value);
}

struct axis axis_empty(bool logarithmic)
{
    return (struct axis){INFINITY, -INFINITY, logarithmic};
}

bool axis_pad(struct axis *axis, double share)
{
    if (!(axis->low <= axis->high)) return false;
    if (axis->logarithmic) {
        double span = fmax(axis->high / axis->low, 3); // less would hold no round values for ticks
        double factor = pow(span, share) * sqrt(span / (axis->high / axis->low));
        axis->low /= factor;
        axis->high *= factor;
    } else {
        axis->high += share * fmax(axis->high - axis->low, 1e-9);
    }
    return true;
}

bool axis_shows(const struct axis *axis, double value)
{
    return axis->low < value && value < axis->high;
}

static double axis_place(const struct axis *axis, double value, double from, double to)
{
    double t = axis->logarithmic ? log(value / axis->low) / log(axis->high / axis->low)
                                 : (value - axis->low) / (axis->high - axis->low);
    return from + t * (to - from);
}

double plot_x(const struct plot *plot, double value)
{
    return axis_place(&plot->x, value, plot->left, plot->right);
}

double plot_y(const struct plot *plot, double value)
{
    return axis_place(&plot->y, value, plot->bottom, plot->top);
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

void plot_add_quoted(struct text *script, const char *raw)
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

void plot_add_opening(struct text *script, const char *name, const char *title, double height)
{
    text_add(script, "# %s.  Draw it again: gnuplot %s.gp > %s.svg\n", title, name, name);
    text_add(script,
             "set terminal svg size %d,%.0f noenhanced font 'sans-serif,%d' background '#ffffff' name '%s'\n",
             PLOT_WIDTH, height, FONT, name);
    text_add(script,
             "set encoding utf8\nset datafile missing '?'\nset border 3 lc rgb '#777777'\nset tics nomirror "
             "tc rgb '#333333'\nset grid lc rgb '#e6e6e6' lw 1 lt 1\n");
    text_add(script,
             "set key at screen 0.5,%.4f center top horizontal maxrows 1 Left reverse samplen 2 "
             "tc rgb '#222222'\n",
             1 - 10 / height);
}

void plot_add_axes(struct text *script, const struct plot *plot)
{
    text_add(script, "set margins screen %.5f, screen %.5f, screen %.5f, screen %.5f\n",
             plot->left / PLOT_WIDTH, plot->right / PLOT_WIDTH, 1 - plot->bottom / plot->height,
             1 - plot->top / plot->height);
    text_add(script, "set xrange [%.9g:%.9g]\nset yrange [%.9g:%.9g]\n", plot->x.low, plot->x.high,
             plot->y.low, plot->y.high);
    if (plot->x.logarithmic) add_ticks(script, 'x', &plot->x);
    if (plot->y.logarithmic) add_ticks(script, 'y', &plot->y);
}

void plot_add_value(struct text *data, double value)
{
    if (isfinite(value))
        text_add(data, " %.9g", value);
    else
        text_add(data, " ?");
}

// ---- labels beside points -----------------------------------------------------------------------

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
void boxes_take_line(struct boxes *taken, double x0, double y0, double x1, double y1)
{
    int steps = 1 + (int)(hypot(x1 - x0, y1 - y0) / 6);
    for (int i = 0; i <= steps; i++) {
        double x = x0 + (x1 - x0) * i / steps, y = y0 + (y1 - y0) * i / steps;
        take(taken, (struct box){x - 2, y - 2, x + 2, y + 2});
    }
}

void boxes_take_mark(struct boxes *taken, double x, double y)
{
    take(taken, (struct box){x - 6, y - 6, x + 6, y + 6});
}

void plot_add_label(struct text *script, struct boxes *taken, const struct plot *plot, double x, double y,
                    const char *label, const char *colour)
{
    static const double places[][2] = {{1, -0.7}, {-1, 0.7}, {1, 0.7}, {-1, -0.7},
                                       {0, -1},   {0, 1},    {1, 0},   {-1, 0}};
    double width = 0.58 * LABEL_FONT * (double)strlen(label), tall = LABEL_FONT;
    for (size_t i = 0; i < sizeof places / sizeof places[0]; i++) {
        double middle_x = x + places[i][0] * (width / 2 + 9), middle_y = y + places[i][1] * (tall / 2 + 9);
        struct box box = {middle_x - width / 2, middle_y - tall / 2, middle_x + width / 2,
                          middle_y + tall / 2};
        if (box.left < plot->left + 2 || box.right > PLOT_WIDTH - 2 || box.top < plot->top ||
            box.bottom > plot->bottom - 2)
            continue;
        if (!is_free(taken, box)) continue;
        take(taken, box);
        text_add(script, "set label ");
        plot_add_quoted(script, label);
        text_add(script, " at screen %.5f,%.5f center font 'sans-serif,%d' tc rgb '%s'\n",
                 middle_x / PLOT_WIDTH, 1 - middle_y / plot->height, LABEL_FONT, colour);
        return;
    }
}
