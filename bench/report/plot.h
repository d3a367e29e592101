// What the report's figures are made with: axes, ticks, labels that cover nothing, and gnuplot itself.
// Ranges, ticks and label places are settled here and written into the scripts, so that a script holds
// no surprises.  Inside bench/report/ only.
// SPDX-License-Identifier: MIT
#ifndef BENCH_REPORT_PLOT_H
#define BENCH_REPORT_PLOT_H

#include "bench/report/parts.h"

enum { PLOT_WIDTH = 1120 }; // pixels

struct axis {
    double low, high; // values at its ends; low > high: nothing on it yet
    bool logarithmic;
};

struct plot { // where the axes stand: pixels, origin at the top left
    double left, right, top, bottom, height;
    struct axis x, y;
};

struct box {
    double left, top, right, bottom;
};

struct boxes { // places that are taken; starts zeroed, items to be freed
    struct box *items;
    int count, capacity;
};

struct axis axis_empty(bool logarithmic);
void axis_include(struct axis *axis, double value); // passes over what the axis cannot show
bool axis_pad(struct axis *axis, double share);     // room beyond the values; false when there are none
bool axis_shows(const struct axis *axis, double value);
double plot_x(const struct plot *plot, double value); // pixels
double plot_y(const struct plot *plot, double value);

void plot_add_opening(struct text *script, const char *name, const char *title, double height);
void plot_add_axes(struct text *script, const struct plot *plot);
void plot_add_quoted(struct text *script, const char *raw); // in single quotes, where gnuplot expands nothing
void plot_add_value(struct text *data, double value);       // a cell of a data file; "?" when not a number

void boxes_take_line(struct boxes *taken, double x0, double y0, double x1, double y1);
void boxes_take_mark(struct boxes *taken, double x, double y);
// Puts the label on the first free place around (x, y), or leaves it out: one that covers another tells less
// than none.
void plot_add_label(struct text *script, struct boxes *taken, const struct plot *plot, double x, double y,
                    const char *label, const char *colour);

// Writes FOLDER/NAME.dat and NAME.gp, runs gnuplot for NAME.svg and appends the figure to svg, ready to stand
// inside HTML. When gnuplot is missing: *gnuplot_found becomes false after one line, and svg stays as it was.
// False, after one line, when the folder cannot be written.
bool plot_draw(const char *folder, const char *name, const char *title, const struct text *script,
               const struct text *data, struct text *svg, bool *gnuplot_found);
// Removes the three files of a figure that is not drawn, so that an old one cannot stand beside new numbers.
void plot_remove(const char *folder, const char *name);

#endif
