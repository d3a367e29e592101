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
// SPDX-License-Identifier: MIT
#ifndef GEOMIPMAP_GEOMIPMAP_H
#define GEOMIPMAP_GEOMIPMAP_H

#include "common/renderer.h"

extern const struct renderer_type geomipmap_renderer;

#endif
