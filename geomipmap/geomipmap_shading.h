// The tiler's own shading: which map block a tile belongs to, and the pictures draped over the blocks.
//
// Blocks are squares of tiles, as large as the longest side of a sub-texture allows and at least as large as
// the largest tile.  The light map takes its share of the ceiling by size, a colour image the rest.
// SPDX-License-Identifier: MIT
#ifndef GEOMIPMAP_GEOMIPMAP_SHADING_H
#define GEOMIPMAP_GEOMIPMAP_SHADING_H

#include "geomipmap/geomipmap_drape.h"
#include "geomipmap/geomipmap_select.h"

enum geomipmap_blend { GEOMIPMAP_MODULATE, GEOMIPMAP_BLEND_ADD, GEOMIPMAP_REPLACE };

struct geomipmap_colour { // an image over the map's outline; RGBA, the north row first; borrowed
    int width, height;
    const uint8_t *pixels; // NULL: none
};

struct geomipmap_shading {
    int block_height; // a block is 2^this tiles of height 0 a side
    struct geomipmap_blocks blocks;
    struct geomipmap_drape light, colour; // colour: zeroed without an image
    struct geomipmap_picture light_picture, colour_picture;
    uint8_t *light_pixels;
    double light_ms; // that making the light map took
    int *need_of;    // by block: its number in needs, or -1
    struct geomipmap_need *needs;
    int need_count;
    int *starts;                    // by need, while ordering
    struct geomipmap_pick *ordered; // likewise
    int ordered_room;
    struct geomipmap_range *ranges; // by block
    struct geomipmap_need *coming;  // blocks of the view foreseen
    double pixels_per_tangent;
    GLint light_unit, light_place, colour_unit, colour_place; // of the program
};

// most_px: longest side of a sub-texture; ceiling_bytes: of all textures.  False after one line on stderr.
bool geomipmap_shading_init(struct geomipmap_shading *shading, struct gpu *gpu,
                            const struct geomipmap_tiles *tiles, const struct geomipmap_colour *colour,
                            int most_px, size_t ceiling_bytes);
void geomipmap_shading_finish(struct geomipmap_shading *shading);        // accepts a zeroed shading
size_t geomipmap_shading_bytes(const struct geomipmap_shading *shading); // of memory; images not counted
void geomipmap_shading_use_program(struct geomipmap_shading *shading, GLuint program);

int geomipmap_shading_block(const struct geomipmap_shading *shading, struct geomipmap_place place);

// A frame: begin; each view's selection, the first `drawn` of whose picks are put in order of blocks, the
// block of the first pick first; end.  False after one line on stderr.
void geomipmap_shading_begin(struct geomipmap_shading *shading);
bool geomipmap_shading_add(struct geomipmap_shading *shading, struct geomipmap_selection *selection,
                           int drawn, double pixels_per_tangent);
bool geomipmap_shading_end(struct geomipmap_shading *shading);

// After end: loads ahead for a view whose eye has gone on by step_m.
void geomipmap_shading_foresee(struct geomipmap_shading *shading, const struct geomipmap_tiles *tiles,
                               const struct view *view, const double step_m[3]);

// Binds what a block shows, for the program in use.
void geomipmap_shading_bind(const struct geomipmap_shading *shading, int block, const double eye_m[3]);

#endif
