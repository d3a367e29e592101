// Geometry clipmaps: nested regular grids about the viewer (Losasso & Hoppe 2004), with the corrections of
// numerics.md.
//
// clang-format off
//   clipmap_levels    what to draw and to keep: regions, snapping, morph, dirty rectangles      (sections 3 to 6.2)
//   clipmap_store     the heights z and z_c of a level at their toroidal slots, their bounds    (sections 3 and 5)
//   clipmap_normals   the normals of a level, at twice its resolution, likewise                 (section 6.3)
//   clipmap_mesh      index lists of blocks and stitches                                        (sections 6.1, 6.2)
//   clipmap_select    the blocks of a view that the frustum meets                               (section 6.4)
//   clipmap_shading   normal maps in video memory: GL                                           (section 6.3)
//   clipmap           the renderer: GL
// clang-format on
//
// It claims no error bound.
// SPDX-License-Identifier: MIT
#ifndef CLIPMAP_CLIPMAP_H
#define CLIPMAP_CLIPMAP_H

#include "common/renderer.h"

extern const struct renderer_type clipmap_renderer;

#endif
