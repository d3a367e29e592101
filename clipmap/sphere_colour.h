// The scene's colour image over a planet, level by level in toroidal textures about the viewer, as its
// heights are (Clasen & Hege 2006, sections 4.1, 4.3 and 6): the renderer's own shading.
//
// Level 0 is the image, level l + 1 the mean of squares of 2 x 2 of its pixels.  Pixels are cells: number i
// stands at i + 1/2, column 0 east of longitude 0, row 0 north of the equator.
// SPDX-License-Identifier: MIT
#ifndef CLIPMAP_SPHERE_COLOUR_H
#define CLIPMAP_SPHERE_COLOUR_H

#include "clipmap/sphere_levels.h"
#include "common/gl/gpu.h"

enum { SPHERE_COLOUR_LEVELS = 12 };

struct sphere_image { // the levels of an image.  PURE.
    const uint8_t *pixels[SPHERE_COLOUR_LEVELS];
    int width, height, count; // of level 0; levels
    uint8_t *coarser;         // storage of levels 1 and up
};
// The colour's pixels are borrowed until finish.  False after one line on stderr.
bool sphere_image_init(struct sphere_image *image, const struct scene_colour *colour);
void sphere_image_finish(struct sphere_image *image); // accepts zeroed
// RGBA of texels, each the mean of 2^decimation columns, row by row northwards, over seam and poles.
void sphere_image_read(const struct sphere_image *image, int level, int decimation,
                       const struct clipmap_box *box, uint8_t (*texels)[4]);
// Levels as rings sample them.  texture: as sphere_shape_init's.
void sphere_image_shape(const struct sphere_image *image, double radius_m, int azimuths, double texture,
                        struct sphere_shape *shape);

struct sphere_colours { // of one view
    struct sphere_store stores[SPHERE_COLOUR_LEVELS];
    double least; // level that the innermost rings show
    GLuint texture;
};

struct sphere_colour { // what views share
    struct gpu *gpu;
    struct scene_colour *held; // NULL: not yet
    struct sphere_image image;
    struct sphere_shape shape;
    uint8_t (*scratch)[4];
};
bool sphere_colour_init(struct sphere_colour *colour, struct gpu *gpu, struct scene_colour *image,
                        double radius_m, int azimuths, double texture);
void sphere_colour_finish(struct sphere_colour *colour); // accepts zeroed

void sphere_colours_init(struct sphere_colours *colours, const struct sphere_colour *shared);
void sphere_colours_finish(struct sphere_colours *colours); // accepts zeroed
// Moves the levels to a place, no finer than an innermost ring needs; returns how many texels were read.
uint64_t sphere_colours_update(struct sphere_colours *colours, struct sphere_colour *shared,
                               const double place_m[2], double innermost_angle);
// Sets the uniforms of a program in use.
void sphere_colours_use(const struct sphere_colours *colours, const struct sphere_colour *shared,
                        GLuint program, const double place_m[2]);
uint64_t sphere_colours_bytes(const struct sphere_colour *shared);

#endif
