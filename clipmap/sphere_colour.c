// SPDX-License-Identifier: MIT
#include "clipmap/sphere_colour.h"

#include "common/report.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { COLOURS_UNIT = 1 };

// ---- the image's levels ------------------------------------------------------

static void halve(const uint8_t *fine, int width, int height, uint8_t *coarse)
{
    for (int j = 0; j < height / 2; j++)
        for (int i = 0; i < width / 2; i++)
            for (int k = 0; k < 4; k++) {
                const uint8_t *at = fine + 4 * ((size_t)(2 * j) * (size_t)width + (size_t)(2 * i)) + k;
                coarse[4 * ((size_t)j * (size_t)(width / 2) + (size_t)i) + (size_t)k] =
                    (uint8_t)((at[0] + at[4] + at[4 * width] + at[4 * width + 4] + 2) / 4);
            }
}

// Half a turn is whole columns in every level, and the equator lies between rows.
bool sphere_image_init(struct sphere_image *image, const struct scene_colour *colour)
{
    *image = (struct sphere_image){
        .pixels = {colour->pixels}, .width = colour->width, .height = colour->height, .count = 1};
    if (colour->width % 2 || colour->height % 2)
        return fail("%s: %d x %d pixels; around a planet both are even", colour->name, colour->width,
                    colour->height);
    uint8_t *to = image->coarser = malloc((size_t)colour->width * (size_t)colour->height * 2);
    if (!to) return fail("%s: no memory for its levels", colour->name);
    int width = colour->width, height = colour->height;
    while (image->count < SPHERE_COLOUR_LEVELS && width % 4 == 0 && height % 4 == 0) {
        halve(image->pixels[image->count - 1], width, height, to);
        width /= 2, height /= 2;
        image->pixels[image->count++] = to;
        to += 4 * (size_t)width * (size_t)height;
    }
    return true;
}

void sphere_image_finish(struct sphere_image *image)
{
    free(image->coarser);
}

static int64_t floor_mod(int64_t a, int64_t b)
{
    int64_t rest = a % b;
    return rest < 0 ? rest + b : rest;
}

void sphere_image_read(const struct sphere_image *image, int level, int decimation,
                       const struct clipmap_box *box, uint8_t (*texels)[4])
{
    int64_t width = image->width >> level, height = image->height >> level, count = (int64_t)1 << decimation;
    for (int64_t j = box->lo[1]; j <= box->hi[1]; j++) {
        int64_t row = floor_mod(j + height / 2, 2 * height), beyond = 0; // from the south pole
        if (row >= height) row = 2 * height - 1 - row, beyond = width / 2;
        const uint8_t *from = image->pixels[level] + 4 * (height - 1 - row) * width;
        for (int64_t i = box->lo[0]; i <= box->hi[0]; i++, texels++) {
            int64_t sum[4] = {0, 0, 0, 0}, at = floor_mod(i * count + width / 2 + beyond, width);
            for (int64_t c = 0; c < count; c++, at = at + 1 == width ? 0 : at + 1)
                for (int k = 0; k < 4; k++) sum[k] += from[4 * at + k];
            for (int k = 0; k < 4; k++) (*texels)[k] = (uint8_t)((sum[k] + count / 2) / count);
        }
    }
}

void sphere_image_shape(const struct sphere_image *image, double radius_m, int azimuths, double texture,
                        struct sphere_shape *shape)
{
    *shape = (struct sphere_shape){
        .azimuths = azimuths,
        .texture = texture,
        .radius_m = radius_m,
        .spacing_m = {2 * M_PI * radius_m / image->width, M_PI * radius_m / image->height},
        .offset = 0.5,
        .columns = image->width,
        .first = -image->width / 2,
        .pole = image->height / 2};
    while (shape->coarsest + 1 < image->count && shape->coarsest < sphere_level_at(shape, M_PI))
        shape->coarsest++;
    sphere_shape_size(shape);
    shape->size = shape->whole = shape->size > shape->whole ? shape->size : shape->whole; // one array
}

// ---- what views share --------------------------------------------------------

bool sphere_colour_init(struct sphere_colour *colour, struct gpu *gpu, struct scene_colour *image,
                        double radius_m, int azimuths, double texture)
{
    *colour = (struct sphere_colour){.gpu = gpu};
    if (!scene_colour_hold(image)) return false;
    colour->held = image;
    if (!sphere_image_init(&colour->image, image)) return false;
    sphere_image_shape(&colour->image, radius_m, azimuths, texture, &colour->shape);
    int size = colour->shape.size, most = gpu_info(gpu)->max_texture_size;
    if (size > most)
        return fail("clipmap: colours of %d x %d texels: textures of this OpenGL driver have at most %d",
                    size, size, most);
    colour->scratch = malloc((size_t)size * (size_t)size * sizeof *colour->scratch);
    return colour->scratch || fail("clipmap: no memory for %d x %d colours", size, size);
}

void sphere_colour_finish(struct sphere_colour *colour)
{
    sphere_image_finish(&colour->image);
    scene_colour_release(colour->held);
    free(colour->scratch);
}

uint64_t sphere_colours_bytes(const struct sphere_colour *shared)
{
    return (uint64_t)shared->shape.size * (uint64_t)shared->shape.size *
           (uint64_t)(shared->shape.coarsest + 1) * 4;
}

// ---- levels about a viewer ---------------------------------------------------

void sphere_colours_init(struct sphere_colours *colours, const struct sphere_colour *shared)
{
    *colours = (struct sphere_colours){.least = 0};
    for (int k = 0; k < SPHERE_COLOUR_LEVELS; k++) colours->stores[k].held.box = clipmap_empty;
    glGenTextures(1, &colours->texture);
    glActiveTexture(GL_TEXTURE0 + COLOURS_UNIT);
    glBindTexture(GL_TEXTURE_2D_ARRAY, colours->texture);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MAX_LEVEL, 0);
    glTexImage3D(GL_TEXTURE_2D_ARRAY, 0, GL_RGBA8, shared->shape.size, shared->shape.size,
                 shared->shape.coarsest + 1, 0, GL_RGBA, GL_UNSIGNED_BYTE, NULL);
    glActiveTexture(GL_TEXTURE0);
}

void sphere_colours_finish(struct sphere_colours *colours)
{
    if (colours->texture) glDeleteTextures(1, &colours->texture);
}

static void read_colours(void *user, int level, int decimation, const struct clipmap_box *box, int slot_x,
                         int slot_y)
{
    struct sphere_colour *shared = user;
    sphere_image_read(&shared->image, level, decimation, box, shared->scratch);
    gpu_texture_sub_image(shared->gpu, GL_TEXTURE_2D_ARRAY, level, slot_x, slot_y,
                          (int)(box->hi[0] - box->lo[0] + 1), (int)(box->hi[1] - box->lo[1] + 1), GL_RGBA,
                          GL_UNSIGNED_BYTE, shared->scratch);
}

uint64_t sphere_colours_update(struct sphere_colours *colours, struct sphere_colour *shared,
                               const double place_m[2], double innermost_angle)
{
    const struct sphere_shape *shape = &shared->shape;
    const struct sphere_source source = {read_colours, NULL, shared};
    uint64_t read = 0;
    double least = innermost_angle > 0 ? sphere_level_at(shape, innermost_angle) : 0;
    colours->least = fmin(fmax(least, 0), shape->coarsest);
    glActiveTexture(GL_TEXTURE0 + COLOURS_UNIT);
    glBindTexture(GL_TEXTURE_2D_ARRAY, colours->texture);
    for (int level = shape->coarsest; level >= (int)colours->least; level--) {
        struct sphere_window wanted = sphere_window_wanted(shape, level, place_m);
        read += sphere_store_move(&colours->stores[level], shape->size, level, &wanted, UINT64_MAX, true,
                                  &source);
    }
    glActiveTexture(GL_TEXTURE0);
    return read;
}

void sphere_colours_use(const struct sphere_colours *colours, const struct sphere_colour *shared,
                        GLuint program, const double place_m[2])
{
    const struct sphere_shape *shape = &shared->shape;
    GLint windows[SPHERE_COLOUR_LEVELS][4] = {{0}};
    GLfloat grids[SPHERE_COLOUR_LEVELS][4] = {{0}};
    double latitude = place_m[1] / shape->radius_m;
    for (int level = 0; level <= shape->coarsest; level++)
        sphere_window_uniforms(shape, level, &colours->stores[level].held, place_m, windows[level],
                               grids[level]);
    glUniform1i(glGetUniformLocation(program, "colours"), COLOURS_UNIT);
    glUniform4iv(glGetUniformLocation(program, "colour_windows"), shape->coarsest + 1, &windows[0][0]);
    glUniform4fv(glGetUniformLocation(program, "colour_grids"), shape->coarsest + 1, &grids[0][0]);
    glUniform4f(glGetUniformLocation(program, "colour_levels"), (float)sphere_level_at(shape, 1),
                (float)colours->least, (float)shape->coarsest, (float)shape->size);
    glUniform2f(glGetUniformLocation(program, "colour_viewer"), (float)cos(latitude), (float)sin(latitude));
    glActiveTexture(GL_TEXTURE0 + COLOURS_UNIT);
    glBindTexture(GL_TEXTURE_2D_ARRAY, colours->texture);
    glActiveTexture(GL_TEXTURE0);
}
