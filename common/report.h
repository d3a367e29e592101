// Says what went wrong: one line on stderr, at the place that knows why.
// SPDX-License-Identifier: MIT
#ifndef COMMON_REPORT_H
#define COMMON_REPORT_H

#include <stdbool.h>

// Exit codes of every program.
enum {
    EXIT_GOOD = 0,
    EXIT_WORLD = 1,        // a file, a folder, the content of a scene or sidecar, or a GL that does not serve
    EXIT_COMMAND_LINE = 2, // the command line
    EXIT_REGRESSION = 3,
    EXIT_INTERRUPTED = 130,
};

// Prints "relief: <text>\n" and returns false, so that a caller can write `return fail(...)`.
// The text names the file or option and says what is accepted.
bool fail(const char *format, ...) __attribute__((format(printf, 1, 2)));

// Prints one plain line on stderr: a fact worth knowing that is not a failure.
void note(const char *format, ...) __attribute__((format(printf, 1, 2)));

#endif
