// SPDX-License-Identifier: MIT
#include "pgm/pgm_atlas.h"

#include "common/report.h"

#include <stdlib.h>

enum { STRIP_ROWS = 64 };

static int slot_width(const struct pgm_slot *slot)
{
    return (int)(slot->extent.x1 - slot->extent.x0);
}

static int slot_height(const struct pgm_slot *slot)
{
    return (int)(slot->extent.y1 - slot->extent.y0);
}

static int larger(int a, int b)
{
    return a > b ? a : b;
}

// Coarser levels beside the finest one: in a column east of it, or in a row north of it.
static void place_slots(struct pgm_atlas *atlas, bool column)
{
    int x = column ? slot_width(&atlas->slots[0]) : 0, y = column ? 0 : slot_height(&atlas->slots[0]);
    atlas->width = slot_width(&atlas->slots[0]);
    atlas->height = slot_height(&atlas->slots[0]);
    for (int k = 1; k < atlas->levels; k++) {
        struct pgm_slot *slot = &atlas->slots[k];
        slot->x = x;
        slot->y = y;
        atlas->width = larger(atlas->width, x + slot_width(slot));
        atlas->height = larger(atlas->height, y + slot_height(slot));
        if (column)
            y += slot_height(slot);
        else
            x += slot_width(slot);
    }
}

void pgm_atlas_layout(struct pgm_atlas *atlas, const struct terrain *terrain)
{
    const struct terrain_info *info = terrain_info(terrain);
    atlas->finest = info->finest;
    atlas->levels = info->coarsest - info->finest + 1;
    if (atlas->levels > PGM_LEVELS_MAX) atlas->levels = PGM_LEVELS_MAX;
    int32_t low = info->min_q, high = info->max_q;
    for (int k = 0; k < atlas->levels; k++) {
        struct terrain_level level = terrain_level(terrain, info->finest + k);
        atlas->slots[k] = (struct pgm_slot){.extent = level.extent};
        if (level.min_q < low) low = level.min_q;
        if (level.max_q > high) high = level.max_q;
    }
    place_slots(atlas, slot_width(&atlas->slots[0]) <= slot_height(&atlas->slots[0]));
    atlas->narrow = (int64_t)high - low <= UINT16_MAX;
    atlas->base_q = atlas->narrow ? low - INT16_MIN : 0;
}

size_t pgm_atlas_bytes(const struct pgm_atlas *atlas)
{
    return (size_t)atlas->width * (size_t)atlas->height * (atlas->narrow ? 2 : 4);
}

// `rows` rows of slot k from `row` on.  `narrow` has room for as many texels as `heights`.
static void upload_strip(const struct pgm_atlas *atlas, struct gpu *gpu, const struct terrain *terrain, int k,
                         int row, int rows, int32_t *heights, int16_t *narrow)
{
    const struct pgm_slot *slot = &atlas->slots[k];
    int width = slot_width(slot);
    size_t count = (size_t)width * (size_t)rows;
    terrain_window(terrain, atlas->finest + k, slot->extent.x0, slot->extent.y0 + row, width, rows, heights,
                   TERRAIN_WAIT);
    if (atlas->narrow)
        for (size_t i = 0; i < count; i++) narrow[i] = (int16_t)(heights[i] - atlas->base_q);
    gpu_texture_sub_image(gpu, GL_TEXTURE_2D, -1, slot->x, slot->y + row, width, rows, GL_RED_INTEGER,
                          atlas->narrow ? GL_SHORT : GL_INT, atlas->narrow ? (void *)narrow : heights);
}

static bool upload(const struct pgm_atlas *atlas, struct gpu *gpu, const struct terrain *terrain)
{
    size_t most = STRIP_ROWS * (size_t)slot_width(&atlas->slots[0]);
    int32_t *heights = malloc(most * sizeof *heights);
    int16_t *narrow = malloc(most * sizeof *narrow);
    bool good = heights && narrow;
    for (int k = 0; good && k < atlas->levels; k++) {
        int height = slot_height(&atlas->slots[k]);
        for (int row = 0; row < height; row += STRIP_ROWS)
            upload_strip(atlas, gpu, terrain, k, row, height - row < STRIP_ROWS ? height - row : STRIP_ROWS,
                         heights, narrow);
    }
    free(heights);
    free(narrow);
    return good || fail("pgm: out of memory for a strip of heights");
}

static void allocate(struct pgm_atlas *atlas)
{
    glGenTextures(1, &atlas->texture);
    glBindTexture(GL_TEXTURE_2D, atlas->texture);
    glTexImage2D(GL_TEXTURE_2D, 0, atlas->narrow ? GL_R16I : GL_R32I, atlas->width, atlas->height, 0,
                 GL_RED_INTEGER, atlas->narrow ? GL_SHORT : GL_INT, NULL);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAX_LEVEL, 0);
}

bool pgm_atlas_init(struct pgm_atlas *atlas, struct gpu *gpu, const struct terrain *terrain)
{
    pgm_atlas_layout(atlas, terrain);
    int most = gpu_info(gpu)->max_texture_size;
    if (atlas->width > most || atlas->height > most)
        return fail("pgm: terrain %s needs a height texture of %d x %d texels, but this driver takes at most "
                    "%d a side",
                    terrain_info(terrain)->name, atlas->width, atlas->height, most);
    allocate(atlas);
    return upload(atlas, gpu, terrain);
}

void pgm_atlas_finish(struct pgm_atlas *atlas)
{
    if (atlas->texture) glDeleteTextures(1, &atlas->texture);
    atlas->texture = 0;
}
