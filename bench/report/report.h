// Writes the report of a result folder: index.html (self-contained, readable without JavaScript) and
// every figure as SVG with its plot script.  Reads DIR/results.json, DIR/frames/*.csv and
// DIR/pictures/*.png; needs no GL.
// SPDX-License-Identifier: MIT
#ifndef BENCH_REPORT_REPORT_H
#define BENCH_REPORT_REPORT_H

#include <stdbool.h>

bool report_write(const char *folder); // false after one line on stderr

#endif
