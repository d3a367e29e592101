// Persistent grid mapping: one grid, kept on the GPU, that a sampling camera lays over the visible ground
// each frame.  Livny, Sokolovsky, Grinshpoun and El-Sana, "A GPU persistent grid mapping for terrain
// rendering", The Visual Computer 24(2), 2008.  What the method promises about its error: nothing.
// SPDX-License-Identifier: MIT
#ifndef PGM_PGM_H
#define PGM_PGM_H

#include "common/renderer.h"

extern const struct renderer_type pgm_renderer;

#endif
