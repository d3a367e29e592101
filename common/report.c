// SPDX-License-Identifier: MIT
#include "common/report.h"

#include <stdarg.h>
#include <stdio.h>

static void print_line(const char *format, va_list arguments)
{
    char line[1024];
    vsnprintf(line, sizeof line, format, arguments);
    for (char *c = line; *c; c++)
        if (*c == '\n' || *c == '\r') *c = ' '; // a file name may hold one; the promise is one line
    fprintf(stderr, "relief: %s\n", line);
}

bool fail(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    print_line(format, arguments);
    va_end(arguments);
    return false;
}

void note(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    print_line(format, arguments);
    va_end(arguments);
}
