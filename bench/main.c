// The bench program: measures, and rebuilds reports.
// SPDX-License-Identifier: MIT
#include "bench/fly.h"
#include "bench/papers/papers.h"
#include "bench/report/report.h"
#include "bench/run.h"
#include "common/cli.h"
#include "common/report.h"

#include <stdio.h>
#include <string.h>

static const char usage[] =
    "usage: bench COMMAND [options]\n"
    "  run [options]     fly one path through every renderer; leave results.json and the report\n"
    "  fly [options]     long flights, for maps that only fit on disk: times, memory, holes\n"
    "  report DIR        rebuild the report from DIR/results.json, no GL needed\n"
    "  papers [options]  tables of the papers, measured again beside the printed figures\n"
    "  --help, --version; `bench run --help` (fly, papers) lists the options\n";

static int report_main(int argc, char **argv)
{
    if (argc == 3 && strcmp(argv[2], "--help") == 0) return fputs(usage, stdout), EXIT_GOOD;
    if (argc != 3) return fail("report: the folder of a results.json is expected"), EXIT_COMMAND_LINE;
    if (!report_write(argv[2])) return EXIT_WORLD;
    printf("report: %s/index.html\n", argv[2]);
    return EXIT_GOOD;
}

int main(int argc, char **argv)
{
    const char *command = argc > 1 ? argv[1] : "";
    if (strcmp(command, "run") == 0) return run_main(argc, argv);
    if (strcmp(command, "fly") == 0) return fly_main(argc, argv);
    if (strcmp(command, "report") == 0) return report_main(argc, argv);
    if (strcmp(command, "papers") == 0) return papers_main(argc, argv);
    if (strcmp(command, "--help") == 0) return fputs(usage, stdout), EXIT_GOOD;
    if (strcmp(command, "--version") == 0)
        return printf("relief bench %s (%s)\n", RELIEF_VERSION, RELIEF_COMMIT), EXIT_GOOD;
    fail("'%s' is not a command; accepted are run, fly, report, papers, --help and --version", command);
    return EXIT_COMMAND_LINE;
}
