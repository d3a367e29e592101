// Normal maps in video memory: one toroidal texture a level (Losasso & Hoppe 2004, section 6.3).  GL; what
// is stored is computed by clipmap_normals, and clipmap.frag reads it.
//
// Textures repeat, and their size is that of the torus, so that neighbours across its seam are neighbours for
// a filter too.  For a bilinear filter that is twice the store's size; for others the next power of two: so
// mipmaps are tori as well, and so i / size is exact, on which llvmpipe's anisotropic filter relies.
// SPDX-License-Identifier: MIT
#ifndef CLIPMAP_CLIPMAP_SHADING_H
#define CLIPMAP_CLIPMAP_SHADING_H

#include "clipmap/clipmap_normals.h"
#include "common/gl/gpu.h"

// What decides how far away a normal is taken from: the level, blended as the geometry is, or the hardware.
enum clipmap_lod { CLIPMAP_LOD_LEVEL, CLIPMAP_LOD_MIPMAP };

enum { CLIPMAP_MIPMAPS = 5 };

struct clipmap_shading_rules {
    enum clipmap_lod lod;
    int anisotropy; // most samples of a filter along a slanted footprint; 1: none
};

struct clipmap_shading { // about one viewer; zeroed: no maps
    struct gpu *gpu;     // borrowed
    struct clipmap_shading_rules rules;
    int levels;
    struct clipmap_normals maps[CLIPMAP_MAX_LEVELS];
    GLuint textures[CLIPMAP_MAX_LEVELS];
    GLuint plain; // sampler without anisotropy, for places near the border of an active region
    struct clipmap_normals_scratch scratch;
};

// What the driver has of `wanted`.
int clipmap_shading_anisotropy(int wanted);

// size: of the levels' stores, samples on a side.  False after one line on stderr.
bool clipmap_shading_init(struct clipmap_shading *shading, struct gpu *gpu, const struct terrain *terrain,
                          const struct clipmap_shading_rules *rules, int levels, int size);
void clipmap_shading_finish(struct clipmap_shading *shading);
size_t clipmap_shading_bytes(const struct clipmap_shading *shading);

// What clipmap.frag is told beside the program's own lines; at most 64 characters.
void clipmap_shading_defines(const struct clipmap_shading_rules *rules, char defines[64]);

// Brings the map of level k up to the samples that its store holds; whole: all of it again.
void clipmap_shading_update(struct clipmap_shading *shading, int k, const struct clipmap_box *samples,
                            bool whole);

struct clipmap_shading_uniforms {
    GLint fine_normals, coarse_normals, fine_plain, coarse_plain;
    GLint fine_place, coarse_place, fine_inside, coarse_inside;
};
struct clipmap_shading_uniforms clipmap_shading_locate(GLuint program);

// Around the draws of a shaded pass.
void clipmap_shading_begin(const struct clipmap_shading *shading);
void clipmap_shading_end(void);

// Before level k is drawn with the program in use: its map and the next coarser one.  Filters read within the
// active regions only, so that a picture is a function of the view, whatever else is in memory.
void clipmap_shading_set_level(const struct clipmap_shading *shading,
                               const struct clipmap_shading_uniforms *uniforms, int k,
                               const struct clipmap_region *regions, const struct view_origin *eyes);

#endif
