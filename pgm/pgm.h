// Persistent grid mapping: one grid, kept on the GPU, that a sampling camera lays over the visible ground
// each frame.  Livny, Sokolovsky, Grinshpoun and El-Sana, "A GPU persistent grid mapping for terrain
// rendering", The Visual Computer 24(2), 2008.  What the method promises about its error: nothing.
//
//   pgm_sampler   where the grid begins and ends on the ground, and how wide it is; plain C
//   pgm_rows      how many rows it has, how they are spread and which level they read; plain C
//   pgm_mesh      vertices and indices of the grid; plain C
//   pgm_tiles     which tiles of it are seen, and lie wholly within the map and the view; plain C
//   pgm_windows   which samples of each level are in texture memory; plain C
//   pgm_picture   a colour image as a pyramid; plain C
//   pgm_atlas     the heights, or the colours, of all levels in one texture, or in one each
//   pgm.vert      row table to place, place to height; pgm_levels.glsl: where the samples are
//   pgm.frag      shading of its own: words of normals and of colours, fetched by each fragment
//   pgm.c         the renderer: a row table a frame, a draw for each way to draw tiles
//
// The defaults are those that err least for their triangles.  At 180 000 triangles on the default flight they
// take p99.9 of the error from 5.9 px, with 4 columns a row and the level of the farther neighbour rounded
// up, to 1.0 px.  The published choices stay selectable: aspect=4 law=uniform camera=published
// extension=published widening=off lod=published spread=far filter=bilinear mapping=published,
// on the grids grid=150x600 to grid=400x1600.  Tiles outside the view are not culled: the rows fit the view
// so well that on the flights measured there were under 2 %.  Tiles wholly inside it are drawn without back
// faces, those wholly on the map without a look at its outline: together 14 % of the default flight's time.
// SPDX-License-Identifier: MIT
#ifndef PGM_PGM_H
#define PGM_PGM_H

#include "common/renderer.h"

extern const struct renderer_type pgm_renderer;

#endif
