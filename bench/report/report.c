// SPDX-License-Identifier: MIT
#include "bench/report/report.h"
#include "bench/report/parts.h"
#include "common/report.h"

#include <stdio.h>

bool report_write(const char *folder)
{
    struct report report;
    struct report_figures figures = {0};
    struct text page = {0};
    char path[4200];
    bool good = report_load(&report, folder);
    if (good && (size_t)snprintf(path, sizeof path, "%s/index.html", folder) >= sizeof path)
        good = fail("%s: the name is too long", folder);
    if (good) good = report_draw_figures(&report, &figures);
    if (good) {
        report_page(&report, &figures, &page);
        good = text_write(&page, path);
    }
    text_finish(&page);
    report_figures_finish(&figures);
    report_finish(&report);
    return good;
}
