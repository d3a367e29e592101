// Table 3 of Livny et al. 2008 as Equation 3 gives it (numerics.md, PG6).
// SPDX-License-Identifier: MIT
#include "tests/test.h"

#include "bench/papers/papers.h"

#include <string.h>

static void check_row(const struct papers_table *table, const char *label, const double expected[4])
{
    for (int r = 0; r < table->row_count; r++) {
        if (strcmp(table->rows[r].label, label) != 0) continue;
        for (int k = 0; k < 4; k++) assert_true(fabs(table->rows[r].values[2 * k + 1] - expected[k]) <= 0.51);
        return;
    }
    fail_msg("no row %s", label);
}

static void test_extension_follows_the_equation(void **state)
{
    (void)state;
    static struct papers_table table;
    struct papers papers = {.repeats = 1};
    assert_true(papers_pgm_extension(&papers, &table));
    assert_true(table.column_count == 8 && table.row_count == 10 && table.note_count > 0);
    check_row(&table, "45 degrees, of the angle", (const double[]){25, 20, 12, 5});
    check_row(&table, "45 degrees, of the image plane", (const double[]){37, 28, 16, 6});
    check_row(&table, "30 degrees, of the angle", (const double[]){50, 39, 23, 9});
    check_row(&table, "30 degrees, of the image plane", (const double[]){100, 67, 33, 11});
    check_row(&table, "60 degrees, of the angle", (const double[]){0, 0, 0, 0});
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_extension_follows_the_equation)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
