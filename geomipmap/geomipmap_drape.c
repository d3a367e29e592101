// SPDX-License-Identifier: MIT
#include "geomipmap/geomipmap_drape.h"

#include "common/report.h"

#include <math.h>
#include <stdlib.h>

enum { ABSENT = -1, OVERVIEW_SHARE = 16 }; // the overview takes a sixteenth of the ceiling

struct geomipmap_sub {
    GLuint texture;
    int level;               // resident; ABSENT
    uint64_t used, foreseen; // frame of the last need, and of the last that saw it coming
};

// ---- sizes --------------------------------------------------------------------------------------

static void block_part(const struct geomipmap_drape *drape, int block, double part[4])
{
    const struct geomipmap_blocks *b = &drape->blocks;
    const double *area = drape->area_m;
    double west = b->origin_m[0] + block % b->columns * b->size_m[0];
    double south = b->origin_m[1] + block / b->columns * b->size_m[1];
    part[0] = (west - area[0]) / (area[2] - area[0]);
    part[1] = (area[3] - south - b->size_m[1]) / (area[3] - area[1]);
    part[2] = (west + b->size_m[0] - area[0]) / (area[2] - area[0]);
    part[3] = (area[3] - south) / (area[3] - area[1]);
}

static struct geomipmap_rect block_rect(const struct geomipmap_drape *drape, int block, int level)
{
    double part[4];
    block_part(drape, block, part);
    return geomipmap_picture_rect(&drape->picture, level, part);
}

static size_t block_bytes(const struct geomipmap_drape *drape, int block, int level)
{
    return geomipmap_rect_bytes(&drape->picture, block_rect(drape, block, level));
}

static struct geomipmap_rect whole(const struct geomipmap_drape *drape, int level)
{
    return (struct geomipmap_rect){0, 0, drape->picture.level[level].width,
                                   drape->picture.level[level].height};
}

// ---- textures -----------------------------------------------------------------------------------

static GLuint load(struct geomipmap_drape *drape, int level, struct geomipmap_rect rect)
{
    const struct geomipmap_picture_level *l = &drape->picture.level[level];
    bool grey = drape->picture.channels == 1;
    GLuint texture;
    glGenTextures(1, &texture);
    glBindTexture(GL_TEXTURE_2D, texture);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_LINEAR_MIPMAP_LINEAR);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAX_LEVEL, GEOMIPMAP_MIPMAPS);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
    glTexImage2D(GL_TEXTURE_2D, 0, grey ? GL_R8 : GL_RGBA8, rect.width, rect.height, 0,
                 grey ? GL_RED : GL_RGBA, GL_UNSIGNED_BYTE, NULL);
    glPixelStorei(GL_UNPACK_ROW_LENGTH, l->width);
    gpu_texture_sub_image(drape->gpu, GL_TEXTURE_2D, -1, 0, 0, rect.width, rect.height,
                          grey ? GL_RED : GL_RGBA, GL_UNSIGNED_BYTE,
                          l->pixels + ((size_t)rect.y * (size_t)l->width + (size_t)rect.x) *
                                          (size_t)drape->picture.channels);
    glPixelStorei(GL_UNPACK_ROW_LENGTH, 0);
    glGenerateMipmap(GL_TEXTURE_2D);
    return texture;
}

static void drop(struct geomipmap_drape *drape, int block)
{
    struct geomipmap_sub *sub = &drape->subs[block];
    glDeleteTextures(1, &sub->texture);
    drape->resident_bytes -= block_bytes(drape, block, sub->level);
    drape->drops++;
    *sub = (struct geomipmap_sub){.level = ABSENT};
}

// ---- fitting ------------------------------------------------------------------------------------

// Level that a block should have: its pixels as wide as the screen's, and no side too long.
static int wanted_level(const struct geomipmap_drape *drape, const struct geomipmap_need *need,
                        double pixels_per_tangent)
{
    double spacing = need->depth_m / pixels_per_tangent / (drape->area_m[2] - drape->area_m[0]);
    int level = geomipmap_picture_level_for(&drape->picture, spacing);
    for (; level + 1 < drape->picture.levels; level++) {
        struct geomipmap_rect rect = block_rect(drape, need->block, level);
        if (rect.width <= drape->most_px && rect.height <= drape->most_px) break;
    }
    return level;
}

// Gives every need a level, or ABSENT for the overview.  Returns the bytes of all.
static size_t fit(struct geomipmap_drape *drape, const struct geomipmap_need *needs, int count,
                  double pixels_per_tangent, size_t room)
{
    int last = drape->picture.levels - 1;
    size_t total = 0;
    for (int bias = 0; bias <= last; bias++) {
        total = 0;
        drape->bias = bias;
        for (int i = 0; i < count; i++) {
            const struct geomipmap_sub *sub = &drape->subs[needs[i].block];
            int level = wanted_level(drape, &needs[i], pixels_per_tangent) + bias;
            drape->levels[i] = level < last ? level : last;
            // One level finer than needed is no reason to load another.
            if (sub->level != ABSENT && sub->level == drape->levels[i] - 1 && bias == 0)
                drape->levels[i] = sub->level;
            total += block_bytes(drape, needs[i].block, drape->levels[i]);
        }
        if (total <= room) return total;
    }
    for (int i = count - 1; i >= 0 && total > room; i--) {
        total -= block_bytes(drape, needs[i].block, drape->levels[i]);
        drape->levels[i] = ABSENT;
    }
    return total;
}

// Drops what the frame does not need, oldest first, until `bytes` fit.  foreseen: of this frame; kept, or
// dropped like the others.
static void make_room(struct geomipmap_drape *drape, size_t bytes, bool keep_foreseen)
{
    int blocks = drape->blocks.columns * drape->blocks.rows;
    while (drape->resident_bytes + bytes > drape->ceiling_bytes) {
        int oldest = ABSENT;
        for (int b = 0; b < blocks; b++)
            if (drape->subs[b].level != ABSENT && drape->subs[b].used != drape->frame &&
                !(keep_foreseen && drape->subs[b].foreseen == drape->frame) &&
                (oldest == ABSENT || drape->subs[b].used < drape->subs[oldest].used))
                oldest = b;
        if (oldest == ABSENT) return;
        drop(drape, oldest);
    }
}

static bool reserve(struct geomipmap_drape *drape, int count)
{
    if (count <= drape->level_room) return true;
    int *levels = realloc(drape->levels, (size_t)count * sizeof *levels);
    if (!levels) return fail("geomipmap: no memory to choose %d sub-textures", count);
    drape->levels = levels;
    drape->level_room = count;
    return true;
}

static void load_block(struct geomipmap_drape *drape, int block, int level)
{
    drape->subs[block] = (struct geomipmap_sub){
        .texture = load(drape, level, block_rect(drape, block, level)), .level = level};
    drape->resident_bytes += block_bytes(drape, block, level);
    drape->loads++;
}

bool geomipmap_drape_ask(struct geomipmap_drape *drape, const struct geomipmap_need *needs, int count,
                         double pixels_per_tangent)
{
    if (!reserve(drape, count)) return false;
    drape->frame++;
    drape->shown_by_overview = 0;
    size_t overview = geomipmap_rect_bytes(&drape->picture, whole(drape, drape->overview_level));
    fit(drape, needs, count, pixels_per_tangent, drape->ceiling_bytes - overview);
    size_t missing = 0;
    for (int i = 0; i < count; i++) {
        struct geomipmap_sub *sub = &drape->subs[needs[i].block];
        if (sub->level != ABSENT && sub->level != drape->levels[i]) drop(drape, needs[i].block);
        if (sub->level != ABSENT) sub->used = drape->frame;
        if (sub->level == ABSENT && drape->levels[i] != ABSENT)
            missing += block_bytes(drape, needs[i].block, drape->levels[i]);
        drape->shown_by_overview += drape->levels[i] == ABSENT;
    }
    make_room(drape, missing, false);
    for (int i = 0; i < count; i++) {
        struct geomipmap_sub *sub = &drape->subs[needs[i].block];
        int level = drape->levels[i];
        if (level == ABSENT || sub->level == level) continue;
        load_block(drape, needs[i].block, level);
        sub->used = drape->frame;
    }
    return true;
}

void geomipmap_drape_foresee(struct geomipmap_drape *drape, const struct geomipmap_need *needs, int count,
                             double pixels_per_tangent)
{
    const struct geomipmap_need *next = NULL;
    int next_level = 0, last = drape->picture.levels - 1;
    for (int i = 0; i < count; i++) {
        struct geomipmap_sub *sub = &drape->subs[needs[i].block];
        int level = wanted_level(drape, &needs[i], pixels_per_tangent) + drape->bias;
        if (level > last) level = last;
        if (sub->used == drape->frame) continue;
        sub->foreseen = drape->frame;
        if (sub->level != ABSENT && sub->level <= level) continue;
        if (next && next->depth_m <= needs[i].depth_m) continue;
        next = &needs[i];
        next_level = level;
    }
    if (!next) return;
    if (drape->subs[next->block].level != ABSENT) drop(drape, next->block);
    size_t bytes = block_bytes(drape, next->block, next_level);
    make_room(drape, bytes, true);
    if (drape->resident_bytes + bytes > drape->ceiling_bytes) return;
    load_block(drape, next->block, next_level);
    drape->subs[next->block].foreseen = drape->frame;
    drape->ahead++;
}

// ---- life ---------------------------------------------------------------------------------------

bool geomipmap_drape_init(struct geomipmap_drape *drape, struct gpu *gpu,
                          const struct geomipmap_picture *picture, const double area_m[4],
                          const struct geomipmap_blocks *blocks, int most_px, size_t ceiling_bytes)
{
    size_t count = (size_t)blocks->columns * (size_t)blocks->rows;
    int hardware = gpu_info(gpu)->max_texture_size;
    *drape = (struct geomipmap_drape){.gpu = gpu,
                                      .picture = *picture,
                                      .blocks = *blocks,
                                      .area_m = {area_m[0], area_m[1], area_m[2], area_m[3]},
                                      .most_px = most_px < hardware ? most_px : hardware,
                                      .ceiling_bytes = ceiling_bytes};
    int level = 0, last = picture->levels - 1;
    for (; level < last; level++) {
        struct geomipmap_rect all = whole(drape, level);
        if (geomipmap_rect_bytes(picture, all) <= ceiling_bytes / OVERVIEW_SHARE &&
            all.width <= drape->most_px && all.height <= drape->most_px)
            break;
    }
    if (geomipmap_rect_bytes(picture, whole(drape, level)) > ceiling_bytes)
        return fail("geomipmap: textures of %zu bytes hold no overview of a picture of %d x %d",
                    ceiling_bytes, picture->level[0].width, picture->level[0].height);
    drape->subs = malloc(count * sizeof *drape->subs);
    if (!drape->subs) return fail("geomipmap: no memory for %zu sub-textures", count);
    for (size_t b = 0; b < count; b++) drape->subs[b] = (struct geomipmap_sub){.level = ABSENT};
    drape->overview_level = level;
    drape->overview = load(drape, level, whole(drape, level));
    drape->resident_bytes = geomipmap_rect_bytes(picture, whole(drape, level));
    return true;
}

void geomipmap_drape_finish(struct geomipmap_drape *drape)
{
    int blocks = drape->subs ? drape->blocks.columns * drape->blocks.rows : 0;
    for (int b = 0; b < blocks; b++)
        if (drape->subs[b].level != ABSENT) glDeleteTextures(1, &drape->subs[b].texture);
    if (drape->overview) glDeleteTextures(1, &drape->overview);
    free(drape->subs);
    free(drape->levels);
    *drape = (struct geomipmap_drape){0};
}

size_t geomipmap_drape_bytes(const struct geomipmap_drape *drape)
{
    size_t blocks = drape->subs ? (size_t)drape->blocks.columns * (size_t)drape->blocks.rows : 0;
    return blocks * sizeof *drape->subs + (size_t)drape->level_room * sizeof *drape->levels;
}

void geomipmap_drape_bind(const struct geomipmap_drape *drape, int block, const double eye_m[3],
                          float place[4])
{
    const struct geomipmap_sub *sub = &drape->subs[block];
    int level = sub->level == ABSENT ? drape->overview_level : sub->level;
    struct geomipmap_rect rect = sub->level == ABSENT ? whole(drape, level) : block_rect(drape, block, level);
    const struct geomipmap_picture_level *l = &drape->picture.level[level];
    const double *area = drape->area_m;
    double across = l->width / (area[2] - area[0]), down = l->height / (area[3] - area[1]);
    glBindTexture(GL_TEXTURE_2D, sub->level == ABSENT ? drape->overview : sub->texture);
    place[0] = (float)(across / rect.width);
    place[1] = (float)(-down / rect.height);
    place[2] = (float)(((eye_m[0] - area[0]) * across - rect.x) / rect.width);
    place[3] = (float)(((area[3] - eye_m[1]) * down - rect.y) / rect.height);
}
