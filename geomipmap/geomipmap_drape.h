// One picture draped over the map in sub-textures, one a map block, of which only those that are needed are
// in texture memory, and only the sizes that are needed (Brodersen 2005, sections 5 and 7).
//
// Before a frame is drawn, the blocks that it shows are asked for, nearest first, each at the level whose
// pixels are as wide as the screen's where the block is nearest.  Where these do not fit the ceiling, all
// take coarser levels, and when not even the coarsest fit, the farthest blocks show the overview: the whole
// picture at one level, which always stays.  Sub-textures that no frame needs any more stay until their
// memory is needed, the least recently used going first.
//
// What frames to come will show may be loaded ahead, one sub-texture a frame, into room that this frame does
// not need: then no frame has to load many at once.
//
// Bytes are those of the pixels and their mipmaps; they never exceed the ceiling.
// SPDX-License-Identifier: MIT
#ifndef GEOMIPMAP_GEOMIPMAP_DRAPE_H
#define GEOMIPMAP_GEOMIPMAP_DRAPE_H

#include "common/gl/gpu.h"
#include "geomipmap/geomipmap_picture.h"

struct geomipmap_blocks { // cuts of the map, row by row from the south-west
    int columns, rows;
    double origin_m[2], size_m[2]; // south-west corner of the first, and of one
};

struct geomipmap_need {
    int block;
    double depth_m; // least depth at which it is seen
};

struct geomipmap_sub;

struct geomipmap_drape {
    struct gpu *gpu; // borrowed
    struct geomipmap_picture picture;
    struct geomipmap_blocks blocks;
    double area_m[4]; // that the picture covers: west, south, east, north
    int most_px;      // longest side of a sub-texture
    size_t ceiling_bytes, resident_bytes;
    GLuint overview;
    int overview_level;
    struct geomipmap_sub *subs; // by block
    int *levels;                // of the needs, while fitting
    int level_room;
    uint64_t frame;
    int bias;              // levels coarser than wanted, so that all needs of the last frame fit
    uint64_t loads, drops; // of sub-textures, since init
    uint64_t ahead;        // loads that no frame had asked for yet
    int shown_by_overview; // blocks of the last frame
};

// Borrows the pixels.  False after one line on stderr, also when the ceiling is too low for a single pixel.
bool geomipmap_drape_init(struct geomipmap_drape *drape, struct gpu *gpu,
                          const struct geomipmap_picture *picture, const double area_m[4],
                          const struct geomipmap_blocks *blocks, int most_px, size_t ceiling_bytes);
void geomipmap_drape_finish(struct geomipmap_drape *drape); // accepts a zeroed drape; leaves the picture

// Of memory, its lists; pixels and textures not counted.
size_t geomipmap_drape_bytes(const struct geomipmap_drape *drape);

// Makes what a frame needs resident.  pixels_per_tangent: the largest of its views'.  False after one line on
// stderr.
bool geomipmap_drape_ask(struct geomipmap_drape *drape, const struct geomipmap_need *needs, int count,
                         double pixels_per_tangent);

// After asking: loads the nearest of the blocks foreseen that is not resident, if it fits beside what the
// frame needs and the other blocks foreseen.
void geomipmap_drape_foresee(struct geomipmap_drape *drape, const struct geomipmap_need *needs, int count,
                             double pixels_per_tangent);

// Binds what a block shows to the active unit; place: factors and offsets from eye-relative metres (x, y) to
// texture coordinates.
void geomipmap_drape_bind(const struct geomipmap_drape *drape, int block, const double eye_m[3],
                          float place[4]);

#endif
