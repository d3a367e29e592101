// Geometry clipmaps: nested regular grids about the viewer (Losasso & Hoppe 2004), with the corrections of
// numerics.md.
//
//   clipmap_levels   what to draw and to keep: regions, snapping, morph, dirty rectangles       (sections 3
//   to 6.2) clipmap_store    the heights z and z_c of a level at their toroidal slots, and their bounds
//   (sections 3 and 5) clipmap_mesh     index lists of blocks and stitches (section 6.1, 6.2) clipmap_select
//   the blocks of a view that the frustum meets                                 (section 6.4) clipmap the
//   renderer: the only file that knows GL
//
// It claims no error bound.
// SPDX-License-Identifier: MIT
#ifndef CLIPMAP_CLIPMAP_H
#define CLIPMAP_CLIPMAP_H

#include "common/renderer.h"

extern const struct renderer_type clipmap_renderer;

#endif
