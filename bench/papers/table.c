// A table of a paper as text, JSON and HTML.
// SPDX-License-Identifier: MIT
#include "bench/papers/papers.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

int papers_column(struct papers_table *table, const char *name, const char *unit, bool printed)
{
    struct papers_column *column = &table->columns[table->column_count];
    snprintf(column->name, sizeof column->name, "%s", name);
    snprintf(column->unit, sizeof column->unit, "%s", unit);
    column->printed = printed;
    return table->column_count++;
}

double *papers_row(struct papers_table *table, const char *format, ...)
{
    struct papers_row *row = &table->rows[table->row_count++];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(row->label, sizeof row->label, format, arguments);
    va_end(arguments);
    for (int c = 0; c < PAPERS_COLUMNS; c++) row->values[c] = NAN;
    return row->values;
}

void papers_note(struct papers_table *table, const char *format, ...)
{
    char *note = table->notes[table->note_count++];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(note, sizeof table->notes[0], format, arguments);
    va_end(arguments);
}

// ---- text --------------------------------------------------------------------------------------

enum { CELL_TEXT = 32, INDENT = 2, GAP = 3, LINE = 110 };

// Three significant digits, in ASCII: terminals and scripts read it.
static const char *cell_text(double value, char out[CELL_TEXT])
{
    if (!isfinite(value)) return strcpy(out, "-");
    double size = fabs(value);
    int decimals = value == floor(value) || size >= 100 ? 0
                   : size >= 10                         ? 1
                   : size >= 1                          ? 2
                   : size >= 0.1                        ? 3
                                                        : 4;
    snprintf(out, CELL_TEXT, "%.*f", decimals, value);
    return out;
}

// "printed" and "measured" head their columns, so that no reader mistakes one for the other.
static const char *origin(const struct papers_column *column)
{
    return column->printed ? "printed" : "measured";
}

static int widest(int width, const char *text)
{
    int length = (int)strlen(text);
    return length > width ? length : width;
}

static void add_line(struct text *out, const char *label, int label_width, const char *const *cells,
                     const int *widths, int count)
{
    text_add(out, "%*s%-*s", INDENT, "", label_width, label);
    for (int c = 0; c < count; c++) text_add(out, "%*s%*s", GAP, "", widths[c], cells[c]);
    text_add(out, "\n");
}

static void add_rows(const struct papers_table *table, struct text *out)
{
    char cells[PAPERS_ROWS][PAPERS_COLUMNS][CELL_TEXT];
    const char *line[PAPERS_COLUMNS];
    int widths[PAPERS_COLUMNS], label_width = widest(0, table->row_name);
    for (int r = 0; r < table->row_count; r++) label_width = widest(label_width, table->rows[r].label);
    for (int c = 0; c < table->column_count; c++) {
        const struct papers_column *column = &table->columns[c];
        widths[c] = widest(widest(widest(0, column->name), column->unit), origin(column));
        for (int r = 0; r < table->row_count; r++)
            widths[c] = widest(widths[c], cell_text(table->rows[r].values[c], cells[r][c]));
    }
    for (int c = 0; c < table->column_count; c++) line[c] = table->columns[c].name;
    add_line(out, table->row_name, label_width, line, widths, table->column_count);
    for (int c = 0; c < table->column_count; c++) line[c] = origin(&table->columns[c]);
    add_line(out, "", label_width, line, widths, table->column_count);
    for (int c = 0; c < table->column_count; c++) line[c] = table->columns[c].unit;
    add_line(out, "", label_width, line, widths, table->column_count);
    for (int r = 0; r < table->row_count; r++) {
        for (int c = 0; c < table->column_count; c++) line[c] = cells[r][c];
        add_line(out, table->rows[r].label, label_width, line, widths, table->column_count);
    }
}

// Breaks a note into lines at spaces.
static void add_note(const char *note, struct text *out)
{
    const char *lead = "- ";
    while (*note) {
        int length = (int)strlen(note), end = length;
        if (length > LINE)
            for (end = LINE; end > 0 && note[end] != ' ';) end--;
        if (end == 0) end = length;
        text_add(out, "%*s%s%.*s\n", INDENT, "", lead, end, note);
        note += end;
        while (*note == ' ') note++;
        lead = "  ";
    }
}

void papers_table_text(const struct papers_table *table, struct text *out)
{
    text_add(out, "%s: %s\n", table->paper, table->title);
    if (table->skipped[0]) text_add(out, "%*sskipped: %s\n", INDENT, "", table->skipped);
    if (table->row_count > 0) add_rows(table, out);
    for (int n = 0; n < table->note_count; n++) add_note(table->notes[n], out);
}

// ---- JSON --------------------------------------------------------------------------------------

cJSON *papers_table_json(const struct papers_table *table)
{
    cJSON *json = cJSON_CreateObject();
    cJSON_AddStringToObject(json, "id", table->id);
    cJSON_AddStringToObject(json, "paper", table->paper);
    cJSON_AddStringToObject(json, "title", table->title);
    if (table->skipped[0])
        cJSON_AddStringToObject(json, "skipped", table->skipped);
    else
        cJSON_AddNullToObject(json, "skipped");
    cJSON *columns = cJSON_AddArrayToObject(json, "columns");
    for (int c = 0; c < table->column_count; c++) {
        cJSON *column = cJSON_CreateObject();
        cJSON_AddStringToObject(column, "name", table->columns[c].name);
        cJSON_AddStringToObject(column, "unit", table->columns[c].unit);
        cJSON_AddBoolToObject(column, "printed", table->columns[c].printed);
        cJSON_AddItemToArray(columns, column);
    }
    cJSON *rows = cJSON_AddArrayToObject(json, "rows");
    for (int r = 0; r < table->row_count; r++) {
        cJSON *row = cJSON_CreateObject();
        cJSON_AddStringToObject(row, "label", table->rows[r].label);
        cJSON *values = cJSON_AddArrayToObject(row, "values");
        for (int c = 0; c < table->column_count; c++) {
            double value = table->rows[r].values[c];
            cJSON_AddItemToArray(values, isfinite(value) ? cJSON_CreateNumber(value) : cJSON_CreateNull());
        }
        cJSON_AddItemToArray(rows, row);
    }
    cJSON *notes = cJSON_AddArrayToObject(json, "notes");
    for (int n = 0; n < table->note_count; n++)
        cJSON_AddItemToArray(notes, cJSON_CreateString(table->notes[n]));
    return json;
}

// ---- HTML --------------------------------------------------------------------------------------

static void add_head(const struct papers_table *table, struct text *page)
{
    text_add(page, "<div class=\"scroll\"><table><thead><tr><th class=\"word\">");
    text_add_escaped(page, table->row_name);
    text_add(page, "</th>");
    for (int c = 0; c < table->column_count; c++) {
        text_add(page, "<th>");
        text_add_escaped(page, table->columns[c].name);
        text_add(page, "<small>%s", origin(&table->columns[c]));
        if (table->columns[c].unit[0]) text_add(page, ", ");
        if (table->columns[c].unit[0]) text_add_escaped(page, table->columns[c].unit);
        text_add(page, "</small></th>");
    }
    text_add(page, "</tr></thead><tbody>\n");
}

void papers_table_html(const struct papers_table *table, struct text *page)
{
    char number[NUMBER_TEXT];
    text_add(page, "<section id=\"%s\"><h2>", table->id);
    text_add_escaped(page, table->paper);
    text_add(page, "</h2>\n<p>");
    text_add_escaped(page, table->title);
    text_add(page, ".</p>\n");
    if (table->skipped[0]) {
        text_add(page, "<p class=\"absent\">Skipped: ");
        text_add_escaped(page, table->skipped);
        text_add(page, ".</p>\n");
    }
    if (table->row_count > 0) {
        add_head(table, page);
        for (int r = 0; r < table->row_count; r++) {
            text_add(page, "<tr><th class=\"word\">");
            text_add_escaped(page, table->rows[r].label);
            text_add(page, "</th>");
            for (int c = 0; c < table->column_count; c++)
                text_add(page, "<td>%s</td>", number_text(table->rows[r].values[c], number));
            text_add(page, "</tr>\n");
        }
        text_add(page, "</tbody></table></div>\n");
    }
    for (int n = 0; n < table->note_count; n++) {
        text_add(page, "<p class=\"note\">");
        text_add_escaped(page, table->notes[n]);
        text_add(page, "</p>\n");
    }
    text_add(page, "</section>\n");
}
