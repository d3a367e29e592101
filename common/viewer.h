// The standalone program around any renderer: a window to fly in, or headless frames and a snapshot.
// SPDX-License-Identifier: MIT
#ifndef COMMON_VIEWER_H
#define COMMON_VIEWER_H

#include "common/renderer.h"

// Runs the program; returns its exit code.  Every knob of the renderer is an option: --tau 2, --metric safe.
int viewer_main(int argc, char **argv, const struct renderer_type *type);

#endif
