// What the rooms of the report share: text that grows, the results as the report reads them, and who
// writes which part.  Inside bench/report/ only.  Every number that was not measured is NAN here and
// a dash on the page.
// SPDX-License-Identifier: MIT
#ifndef BENCH_REPORT_PARTS_H
#define BENCH_REPORT_PARTS_H

#include <cjson/cJSON.h>
#include <stdbool.h>
#include <stddef.h>

// ---- text.c: text, numbers, files --------------------------------------------------------

struct text { // starts zeroed; out_of_memory is found out by text_write
    char *data;
    size_t length, capacity;
    bool out_of_memory;
};
void text_add(struct text *text, const char *format, ...) __attribute__((format(printf, 2, 3)));
void text_add_bytes(struct text *text, const char *bytes, size_t count);
void text_add_escaped(struct text *text, const char *raw); // for XML content and attributes; NULL adds a dash
void text_finish(struct text *text);
// Length of the well-formed UTF-8 character here; 0 when it is none (overlong forms and surrogates included).
size_t utf8_length(const char *character);

enum { NUMBER_TEXT = 48 };
// Three significant digits as a reader writes them (12.3, 0.0123, 4.56×10⁻⁵, 1 234), whole numbers as such; a
// dash when not finite.
const char *number_text(double value, char out[NUMBER_TEXT]);
const char *short_text(double value,
                       char out[NUMBER_TEXT]); // the same without zeros at the end: for round values
const char *count_text(double value, char out[NUMBER_TEXT]); // a whole number in groups of three digits
const char *bytes_text(double value, char out[NUMBER_TEXT]); // B, KiB, MiB, GiB

// A whole file, ended by a 0 byte that size does not count; NULL when it cannot be read (errno says why).
char *file_read(const char *path, size_t *size);
// Writes under a temporary name and renames: whole or absent.  False after one line on stderr.
bool text_write(const struct text *text, const char *path);

// ---- data.c: what was measured -----------------------------------------------------------

enum report_role { ROLE_METHOD, ROLE_DECIMATED, ROLE_BRUTE, ROLE_EMPTY }; // ROLE_EMPTY: the renderer `null`

struct report_run {
    const cJSON *json;
    const char *name; // unique, as the tables show it: "clipmap n=127"
    const char *knob; // the part of the name behind the renderer: "n=127"
    int renderer;     // index into report.renderers
};

struct report_point { // one setting of a renderer
    const struct report_run *run;
    double error_px, ms;    // p99.9 and median; both finite
    double low_ms, high_ms; // 95 % interval of ms, NAN where there is none
    double triangles;       // visible, mean; may be NAN
    int sweep;              // settings of one sweep differ in the quality knob alone; 0, 1 ...
};

struct report_renderer {
    const char *name;
    const char *colour; // "#0072B2"; the same in every figure and table
    int mark;           // gnuplot's point type
    enum report_role role;
    struct report_point *points; // the frontier, coarse to fine (largest error first)
    int point_count, sweep_count;
    const struct report_run *shown; // the setting whose error is nearest to 1 px; NULL without runs
    double rank_correlation;        // of its sweep; NAN when not computed
};

struct report {
    const char *folder;
    cJSON *root;
    struct report_run *runs; // in the renderers' order, as measured within a renderer
    int run_count;
    struct report_renderer *renderers; // methods first, then decimated, brute, null
    int renderer_count;
};

// Reads DIR/results.json.  False after one line on stderr; report_finish then still is called.
bool report_load(struct report *report, const char *folder);
void report_finish(struct report *report);

// A value by its dotted name ("frame_ms.median"); NULL, NAN or NULL when absent, null or of another kind.
const cJSON *json_at(const cJSON *item, const char *dotted);
// The first child of an array or object, NULL of anything else: for (x = json_first(list); x; x = x->next).
const cJSON *json_first(const cJSON *item);
double json_number(const cJSON *item, const char *dotted);
const char *json_text(const cJSON *item, const char *dotted);
bool json_true(const cJSON *item, const char *dotted);

// Reads the named columns of DIR/<file>: *values holds rows x column_count numbers, NAN for empty cells, to
// be freed. Returns the number of rows, 0 when the file cannot be used.
int report_csv(const struct report *report, const char *file, const char *const *columns, int column_count,
               double **values);
// DIR/<file> as path, or false for a name that leaves the folder.
bool report_path(const struct report *report, const char *file, char *path, size_t size);

// ---- standing.c: who is faster, and verdict.c: in words ---------------------------

enum standing_kind {
    STANDING_AT,      // value holds
    STANDING_AT_MOST, // the curve ends before the row: its last point already does better, at value
    STANDING_NOT, // its finest setting misses the error asked for, or its cheapest costs more than the time
    STANDING_UNKNOWN
};

struct standing {
    const struct report_renderer *renderer;
    enum standing_kind kind;
    double value, low, high; // ms at equal error, px at equal time; interval NAN where there is none
};

enum report_table { EQUAL_ERROR, EQUAL_TIME };

// How a renderer stands in one row of equal_error or equal_time.
struct standing report_standing(const struct report_renderer *renderer, const cJSON *row,
                                enum report_table table);
// The methods that reach the row, best first; returns how many.  standings has room for renderer_count.
int report_standings(const struct report *report, const cJSON *row, enum report_table table,
                     struct standing *standings);
// True when a is better than b beyond doubt: intervals known and apart, and at least 5 % between the values.
bool report_clearly_better(const struct standing *a, const struct standing *b);

void report_verdict(const struct report *report, struct text *page);

// ---- figures.c (with plot.h): DIR/figures/NAME.{dat,gp,svg} -----------------------

enum report_figure { FIGURE_FRONTIER, FIGURE_PATH, FIGURE_MOTION, FIGURE_TRIANGLES, FIGURE_COUNT };

struct report_figures {
    struct text svg[FIGURE_COUNT]; // ready to stand inside HTML; empty: not drawn
    bool gnuplot_found;
};
// Draws every figure that the results have numbers for.  False after one line on stderr (a folder that cannot
// be written); a missing gnuplot is no failure.
bool report_draw_figures(const struct report *report, struct report_figures *figures);
// Settings that err too much to stand inside the figures of curves.
int report_points_outside(const struct report *report);
void report_figures_finish(struct report_figures *figures);

// ---- tables.c, missing.c, pictures.c, html.c ------------------------

void report_equal_tables(const struct report *report, struct text *page);
void report_steadiness(const struct report *report, struct text *page);
void report_motion(const struct report *report, struct text *page); // popping and swimming
void report_run_tables(const struct report *report, struct text *page);
void report_missing(const struct report *report, struct text *page); // every null and its reason
void report_pictures(const struct report *report, struct text *page);
void report_page(const struct report *report, const struct report_figures *figures, struct text *page);

// Of any page: everything up to <main>, and the terms <dt>, <dd> of machine, GL and build out of a
// results.json.
void page_head(struct text *page, const char *title);
void page_machine(const cJSON *root, struct text *page);

// The name of a renderer, or of a run, with its colour.
void page_renderer(struct text *page, const struct report_renderer *renderer);
void page_run(struct text *page, const struct report *report, const struct report_run *run);

#endif
