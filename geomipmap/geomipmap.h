// GeoMipMaps (Brodersen 2005): tiles of the finest level, each drawn at the coarsest level whose error
// stays within tau, with borders that fit any neighbour, from one vertex buffer that an LRU manager fills.
//
//   geomipmap_mesh    index sets, geomipmap_strip as strips, for every combination of levels
//   geomipmap_lod     error of a level, error allowed
//   geomipmap_tiles   the terrain's tiles, measured
//   geomipmap_select  a view's tiles, levels and sets
//   geomipmap_cache   which slot holds which tile
//   geomipmap_picture pictures over the map, cut along blocks; the light map
//   geomipmap_drape   sub-textures of a picture under a ceiling
//   geomipmap_shading the tiler's own shading with those
//   geomipmap         uploads and draws what those decided
//
// Bytes, for tiles of 17 x 17 (604 each as published, or 2.4 a sample of the 256 that are its own):
//   held in the vertex buffer  578  heights, 16 bits each            geomipmap.c, vertices
//                               16  place, height and base           places
//                               24  name, neighbours in use, batch   geomipmap_cache, slots
//                           5 - 11  its entry in the hash            table
//                                9  steps its heights come from      forms; only with heights=levels
//   known                       25  range, error of four levels      geomipmap_tiles, facts and errors
//                                4  an eighth of its group's slot    groups
//   in view                     40  what to draw of it               geomipmap_select, picks
//                               32  node, and a third of its parent  nodes
//                          11 - 22  its corner, in a hash            corners; only with heights=levels
//                               16  the draw call                    geomipmap.c, counts, first, base_vertex
// and 88,896 for the index sets.  Lists have a sixteenth to spare at most, and hashes are powers of two.
// A tile that is held, known and in view costs some 770 bytes, 3 a sample; tiles that were not looked at
// cost nothing.  Of a map of 2049 x 2049, where distant tiles merge (the default) at most 0.15 bytes a
// sample are held; without (merge=0) 2.4 with 72 % of the map's tiles in view at once, and 3.2 with all.
// SPDX-License-Identifier: MIT
#ifndef GEOMIPMAP_GEOMIPMAP_H
#define GEOMIPMAP_GEOMIPMAP_H

#include "common/renderer.h"

extern const struct renderer_type geomipmap_renderer;

#endif
