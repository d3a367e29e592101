// Tables of the papers: their text is aligned, their JSON is whole, and the errors of levels are those of the
// terrain. SPDX-License-Identifier: MIT
#include "bench/papers/papers.h"
#include "common/terrain/generate.h"
#include "tests/test.h"

#include <string.h>

static struct papers_table sample_table(void)
{
    struct papers_table table = {
        .id = "t-1", .paper = "A & B, Table 1", .title = "times <ms>", .row_name = "step"};
    papers_column(&table, "time", "ms", true);
    papers_column(&table, "time", "ms", false);
    double *values = papers_row(&table, "a step with a long name");
    values[0] = 26;
    values[1] = 0.0123456;
    papers_row(&table, "b")[1] = 1234567;
    papers_note(&table,
                "A note of %d words that goes on and on until it is longer than a line of a terminal should "
                "be, so that it must be broken somewhere, \"here\" or there.",
                30);
    return table;
}

static void text_is_aligned(void **state)
{
    (void)state;
    struct papers_table table = sample_table();
    struct text out = {0};
    papers_table_text(&table, &out);
    int lines = 0;
    size_t width = 0;
    for (char *line = strtok(out.data, "\n"); line; line = strtok(NULL, "\n"), lines++) {
        assert_true(strlen(line) <= 114);
        if (lines >= 2 && lines <= 5)
            assert_int_equal(strlen(line), width); // all rows end in the same column
        if (lines == 1) width = strlen(line);
        if (lines == 4) assert_string_equal(strrchr(line, ' ') + 1, "0.0123");
        if (lines == 5) assert_non_null(strstr(line, "  -  ")); // what was not printed
    }
    assert_int_equal(lines, 8); // title, three of heads, two rows, two of the note
    text_finish(&out);
}

static void skipped_tables_say_why(void **state)
{
    (void)state;
    struct papers_table table = {.id = "t-2", .paper = "P", .title = "t", .skipped = "no data"};
    struct text text = {0}, page = {0};
    papers_table_text(&table, &text);
    papers_table_html(&table, &page);
    assert_non_null(strstr(text.data, "skipped: no data"));
    assert_non_null(strstr(page.data, "Skipped: no data"));
    assert_null(strstr(page.data, "<table"));
    cJSON *json = papers_table_json(&table);
    assert_string_equal(json_text(json, "skipped"), "no data");
    cJSON_Delete(json);
    text_finish(&text);
    text_finish(&page);
}

static void json_is_whole(void **state)
{
    (void)state;
    struct papers_table table = sample_table();
    cJSON *json = papers_table_json(&table);
    const cJSON *rows = json_at(json, "rows"), *columns = json_at(json, "columns");
    assert_int_equal(cJSON_GetArraySize(rows), 2);
    assert_int_equal(cJSON_GetArraySize(columns), 2);
    assert_true(json_true(cJSON_GetArrayItem(columns, 0), "printed"));
    assert_false(json_true(cJSON_GetArrayItem(columns, 1), "printed"));
    const cJSON *first = json_at(cJSON_GetArrayItem(rows, 0), "values");
    const cJSON *second = json_at(cJSON_GetArrayItem(rows, 1), "values");
    assert_true(cJSON_GetArrayItem(first, 1)->valuedouble == 0.0123456); // never rounded
    assert_true(cJSON_IsNull(cJSON_GetArrayItem(second, 0)));
    assert_true(cJSON_IsNull(cJSON_GetObjectItem(json, "skipped")));
    cJSON_Delete(json);
}

static void html_is_escaped_and_balanced(void **state)
{
    (void)state;
    struct papers_table table = sample_table();
    struct text page = {0};
    papers_table_html(&table, &page);
    assert_non_null(strstr(page.data, "A &amp; B"));
    assert_non_null(strstr(page.data, "times &lt;ms&gt;"));
    assert_null(strstr(page.data, "<script"));
    static const char *const tags[] = {"section", "table", "tr", "td", "th>", "p", "small", "thead", "tbody"};
    for (size_t t = 0; t < sizeof tags / sizeof tags[0]; t++) {
        int open = 0, closed = 0;
        char name[16];
        snprintf(name, sizeof name, "%s", tags[t]);
        name[strcspn(name, ">")] = 0;
        size_t length = strlen(name);
        for (const char *at = page.data; (at = strchr(at, '<')); at++) {
            bool end = at[1] == '/';
            const char *word = at + 1 + end;
            if (strncmp(word, name, length) == 0 && strchr("> ", word[length])) *(end ? &closed : &open) += 1;
        }
        assert_true(open > 0);
        assert_int_equal(open, closed);
    }
    text_finish(&page);
}

// Two ways to the same figures: sample by sample here, row by row and in parts in the pyramid.  Sums of the
// same squares in another order differ by less than n ulp.
static void errors_are_those_of_the_terrain(void **state)
{
    (void)state;
    for (int seed = 0; seed < test_size(6, 60); seed++) {
        struct heightfield field;
        struct generate_options made = {.kind = "fractal",
                                        .width = 60 + 37 * (seed % 5),
                                        .height = 171 - 13 * (seed % 7),
                                        .spacing_m = 10,
                                        .seed = (uint64_t)seed};
        assert_true(generate(&field, &made));
        int64_t first = (seed - 3) * 1001;
        struct terrain_grid grid = {"fractal",       field.samples, field.width,     field.height,
                                    {first, -first}, {10, 10},      field.quantum_m, field.offset_m};
        struct terrain *terrain =
            terrain_from_grid(&grid, &(struct terrain_options){.synthesize_levels = seed % 2});
        const struct terrain_info *info = terrain_info(terrain);
        size_t count = (size_t)info->samples;
        double *errors = malloc(count * sizeof *errors);
        for (int level = info->finest; level <= info->coarsest; level++) {
            struct terrain_level expected = terrain_level(terrain, level);
            double squares = 0, max = 0;
            papers_level_errors(terrain, level, errors);
            for (size_t i = 0; i < count; i++) {
                squares += errors[i] * errors[i];
                max = fmax(max, errors[i]);
            }
            double rms_m = sqrt(squares / (double)count) * info->quantum_m;
            assert_true(max * info->quantum_m == expected.max_error_m);
            assert_true(fabs(rms_m - expected.rms_error_m) <= (double)count * 0x1p-52 * expected.rms_error_m);
        }
        free(errors);
        terrain_destroy(terrain);
        heightfield_finish(&field);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(text_is_aligned),
        cmocka_unit_test(skipped_tables_say_why),
        cmocka_unit_test(json_is_whole),
        cmocka_unit_test(html_is_escaped_and_balanced),
        cmocka_unit_test(errors_are_those_of_the_terrain),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
