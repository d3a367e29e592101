// SPDX-License-Identifier: MIT
#include "pgm/pgm_atlas.h"

#include "common/integer.h"
#include "common/report.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

// Texels of one upload; smallest tile worth having; samples of a level that are waited for at the start.
enum { PIECE = 32768, SIDE_LEAST = 16, SOON = 1 << 18 };

static bool is_mipmapped(const struct pgm_atlas *atlas)
{
    return atlas->storage.fetch == PGM_FETCH_MIPMAP;
}

static bool holds_floats(const struct pgm_atlas *atlas)
{
    return is_mipmapped(atlas) || atlas->storage.fetch == PGM_FETCH_LINEAR;
}

// Of shading and of colour: the words of a cell, or of the sample alone.
static int words_a_sample(const struct pgm_atlas *atlas)
{
    return is_mipmapped(atlas) ? 1 : 4;
}

static size_t word_bytes(const struct pgm_atlas *atlas)
{
    return sizeof(uint32_t) * (size_t)words_a_sample(atlas);
}

static size_t first_bytes(const struct pgm_atlas *atlas)
{
    if (atlas->storage.picture) return word_bytes(atlas);
    switch (atlas->storage.fetch) {
    case PGM_FETCH_PACKED:
        return atlas->narrow ? 16 : 32;
    case PGM_FETCH_MIPMAP:
    case PGM_FETCH_LINEAR:
        return 4;
    default:
        return atlas->narrow ? 2 : 4;
    }
}

// Of a sample: height or colour, and shading.
static size_t texel_bytes(const struct pgm_atlas *atlas)
{
    return first_bytes(atlas) + (atlas->storage.shaded ? word_bytes(atlas) : 0);
}

static int texels_a_sample(const struct pgm_atlas *atlas)
{
    return atlas->storage.fetch == PGM_FETCH_PACKED && !atlas->narrow ? 2 : 1;
}

// ---- layout ----------------------------------------------------------------

// Columns from west to east, each as high as the finest level's tile at most; or rows, where that is wider
// than high.
static void place_slots(struct pgm_atlas *atlas)
{
    const struct pgm_window *first = &atlas->slots[0].window;
    int turned = first->width > first->height; // 1: x and y change places
    int most = turned ? first->width : first->height, at[2] = {0, 0}, breadth = 0;
    bool alone = atlas->storage.many || is_mipmapped(atlas); // in textures of their own
    atlas->width = atlas->height = 0;
    for (int k = 0; k < atlas->levels; k++) {
        struct pgm_slot *slot = &atlas->slots[k];
        int sizes[2] = {slot->window.width, slot->window.height};
        if (at[1] + sizes[!turned] > most) at[0] += breadth, at[1] = 0, breadth = 0;
        slot->x = alone ? 0 : at[turned];
        slot->y = alone ? 0 : at[!turned];
        at[1] += sizes[!turned];
        breadth = (int)larger(breadth, sizes[turned]);
        atlas->width = (int)larger(atlas->width, slot->x + sizes[0]);
        atlas->height = (int)larger(atlas->height, slot->y + sizes[1]);
    }
}

static void size_tiles(struct pgm_atlas *atlas, int64_t side)
{
    for (int k = 0; k < atlas->levels; k++) {
        struct pgm_window *window = &atlas->slots[k].window;
        window->width = (int)smaller(window->extent.x1 - window->extent.x0, side);
        window->height = (int)smaller(window->extent.y1 - window->extent.y0, side);
    }
    place_slots(atlas);
    atlas->side = (int)larger(atlas->slots[0].window.width, atlas->slots[0].window.height);
}

static size_t tile_bytes(const struct pgm_atlas *atlas)
{
    size_t texels = 0;
    for (int k = 0; k < atlas->levels; k++)
        texels += (size_t)atlas->slots[k].window.width * (size_t)atlas->slots[k].window.height;
    return texels * texel_bytes(atlas);
}

size_t pgm_atlas_bytes(const struct pgm_atlas *atlas)
{
    if (is_mipmapped(atlas) || atlas->storage.many) return tile_bytes(atlas);
    return (size_t)atlas->width * (size_t)atlas->height * texel_bytes(atlas);
}

int pgm_atlas_textures(const struct pgm_atlas *atlas)
{
    return atlas->storage.many ? atlas->levels : atlas->levels > 0;
}

bool pgm_atlas_is_whole(const struct pgm_atlas *atlas)
{
    for (int k = 0; k < atlas->levels; k++)
        if (!pgm_window_is_whole(&atlas->slots[k].window)) return false;
    return true;
}

bool pgm_atlas_is_full(const struct pgm_atlas *atlas)
{
    for (int k = 0; k < (is_mipmapped(atlas) ? 1 : atlas->levels); k++) // the hardware makes the others
        if (!pgm_window_is_full(&atlas->slots[k].window)) return false;
    return true;
}

// With tiles of this side: within memory and texture size, a line of each within a frame's budget, and the
// coarsest level whole, so that there is always something to draw.
static bool fits(struct pgm_atlas *atlas, int64_t side)
{
    const struct pgm_storage *storage = &atlas->storage;
    size_tiles(atlas, side);
    return (storage->memory_bytes == 0 || pgm_atlas_bytes(atlas) <= storage->memory_bytes) &&
           atlas->width * texels_a_sample(atlas) <= storage->most_texels &&
           atlas->height <= storage->most_texels &&
           (pgm_atlas_is_whole(atlas) || (size_t)side * texel_bytes(atlas) <= storage->budget_bytes) &&
           pgm_window_is_whole(&atlas->slots[atlas->levels - 1].window);
}

static void describe_picture(struct pgm_atlas *atlas)
{
    const struct pgm_picture *picture = atlas->storage.picture;
    atlas->finest = 0;
    atlas->levels = picture->levels;
    atlas->narrow = true;
    for (int k = 0; k < atlas->levels; k++)
        atlas->slots[k] = (struct pgm_slot){.window.extent = {0, 0, picture->width[k], picture->height[k]}};
}

static void describe_levels(struct pgm_atlas *atlas, const struct terrain *terrain)
{
    const struct terrain_info *info = terrain_info(terrain);
    atlas->finest = info->finest;
    atlas->levels = info->coarsest - info->finest + 1;
    if (atlas->levels > PGM_LEVELS_MAX) atlas->levels = PGM_LEVELS_MAX;
    int32_t low = info->min_q, high = info->max_q;
    for (int k = 0; k < atlas->levels; k++) {
        struct terrain_level level = terrain_level(terrain, info->finest + k);
        atlas->slots[k] = (struct pgm_slot){.window.extent = level.extent};
        if (level.min_q < low) low = level.min_q;
        if (level.max_q > high) high = level.max_q;
    }
    atlas->narrow = (int64_t)high - low <= UINT16_MAX;
    atlas->base_q = atlas->narrow && !holds_floats(atlas) ? low - INT16_MIN : 0;
}

static void describe(struct pgm_atlas *atlas, const struct terrain *terrain,
                     const struct pgm_storage *storage)
{
    atlas->storage = *storage;
    if (storage->picture)
        describe_picture(atlas);
    else
        describe_levels(atlas, terrain);
}

size_t pgm_atlas_whole_bytes(const struct terrain *terrain, const struct pgm_storage *storage)
{
    struct pgm_atlas atlas = {0};
    size_t samples = 0;
    describe(&atlas, terrain, storage);
    for (int k = 0; k < atlas.levels; k++) {
        const struct terrain_extent *extent = &atlas.slots[k].window.extent;
        samples += (size_t)(extent->x1 - extent->x0) * (size_t)(extent->y1 - extent->y0);
    }
    return samples * texel_bytes(&atlas);
}

bool pgm_atlas_layout(struct pgm_atlas *atlas, const struct terrain *terrain,
                      const struct pgm_storage *storage)
{
    const char *name = storage->picture ? storage->picture->image->name : terrain_info(terrain)->name;
    describe(atlas, terrain, storage);
    if (storage->many && atlas->levels > PGM_TEXTURES_MAX)
        return fail("pgm: textures=many takes at most %d levels, but %s has %d", PGM_TEXTURES_MAX, name,
                    atlas->levels);
    const struct terrain_extent *finest = &atlas->slots[0].window.extent;
    int64_t too_large = larger(finest->x1 - finest->x0, finest->y1 - finest->y0);
    if (fits(atlas, too_large)) return true;
    if (is_mipmapped(atlas))
        return fail("pgm: fetch=mipmap holds the whole of %s, which takes %zu bytes in a texture of %d x "
                    "%d; accepted are %zu bytes (memory=) and %d texels a side",
                    name, pgm_atlas_bytes(atlas), atlas->width, atlas->height, storage->memory_bytes,
                    storage->most_texels);
    int64_t side = SIDE_LEAST;
    if (!fits(atlas, side))
        return fail("pgm: %s needs tiles of at least %d texels, %zu bytes for %d levels: memory= is "
                    "too small",
                    name, SIDE_LEAST, pgm_atlas_bytes(atlas), atlas->levels);
    while (too_large - side > 1) {
        int64_t middle = side + (too_large - side) / 2;
        if (fits(atlas, middle))
            side = middle;
        else
            too_large = middle;
    }
    return fits(atlas, side);
}

struct pgm_place pgm_atlas_place(const struct pgm_atlas *atlas, const struct terrain *terrain,
                                 const struct view *view, int k)
{
    const struct terrain_info *info = terrain_info(terrain);
    const struct pgm_picture *picture = atlas->storage.picture;
    struct pgm_place place;
    struct view_origin origin = {0};
    if (!picture) origin = view_level_origin(view, atlas->finest + k);
    for (int axis = 0; axis < 2; axis++) {
        if (!picture) {
            place.cell[axis] = origin.base[axis];
            place.fraction[axis] = origin.fraction[axis];
            place.spacing_m[axis] = ldexp(info->spacing_m[axis], atlas->finest + k);
            continue;
        }
        int pixels = axis ? picture->height[0] : picture->width[0];
        place.spacing_m[axis] = ldexp((info->outline_m[axis + 2] - info->outline_m[axis]) / pixels, k);
        double at = (view->eye_m[axis] - info->outline_m[axis]) / place.spacing_m[axis] - 0.5;
        at = fmin(fmax(at, -0x1p60), 0x1p60);
        place.cell[axis] = (int64_t)floor(at);
        place.fraction[axis] = (float)(at - floor(at));
    }
    return place;
}

// ---- texels ----------------------------------------------------------------

// A window of samples; waits for it, or was asked for it before, in this frame.
static void read_window(const struct pgm_atlas *atlas, const struct terrain *terrain, int level, int64_t x,
                        int64_t y, int width, int height, int32_t *out)
{
    if (!atlas->reader || !terrain_reader_window(atlas->reader, level, x, y, width, height, out))
        terrain_window(terrain, level, x, y, width, height, out, TERRAIN_WAIT);
}

static int64_t half_of(int64_t index) // rounds towards minus infinity
{
    return index >= 0 ? index / 2 : -((1 - index) / 2);
}

static uint32_t pair_of(const struct pgm_atlas *atlas, int32_t low, int32_t high)
{
    return (uint32_t)(uint16_t)(low - atlas->base_q) | (uint32_t)(uint16_t)(high - atlas->base_q) << 16;
}

// Corners of a cell of `stride` samples a row, south-west first, eastwards.
static void write_corners(const struct pgm_atlas *atlas, const int32_t *corner, size_t stride, uint32_t *out)
{
    if (atlas->narrow) {
        out[0] = pair_of(atlas, corner[0], corner[1]);
        out[1] = pair_of(atlas, corner[stride], corner[stride + 1]);
    } else {
        for (int i = 0; i < 4; i++) out[i] = (uint32_t)corner[(size_t)(i / 2) * stride + (size_t)(i % 2)];
    }
}

static void pack(const struct pgm_atlas *atlas, const struct terrain *terrain, int k,
                 const struct terrain_extent *box)
{
    int width = (int)(box->x1 - box->x0), height = (int)(box->y1 - box->y0);
    int parent = k + 1 < atlas->levels; // the coarsest has none and stands in for it
    int64_t px = parent ? half_of(box->x0) : box->x0, py = parent ? half_of(box->y0) : box->y0;
    int parent_width = (int)((parent ? half_of(box->x1 - 1) : box->x1 - 1) - px) + 2;
    int parent_height = (int)((parent ? half_of(box->y1 - 1) : box->y1 - 1) - py) + 2;
    read_window(atlas, terrain, atlas->finest + k, box->x0, box->y0, width + 1, height + 1, atlas->heights);
    read_window(atlas, terrain, atlas->finest + k + parent, px, py, parent_width, parent_height,
                atlas->parents);
    uint32_t *out = atlas->texels;
    int words = atlas->narrow ? 2 : 4;
    for (int j = 0; j < height; j++)
        for (int i = 0; i < width; i++, out += 2 * words) {
            int64_t row = (parent ? half_of(box->y0 + j) : box->y0 + j) - py;
            int64_t column = (parent ? half_of(box->x0 + i) : box->x0 + i) - px;
            write_corners(atlas, atlas->heights + (size_t)j * (size_t)(width + 1) + i, (size_t)width + 1,
                          out);
            write_corners(atlas, atlas->parents + row * parent_width + column, (size_t)parent_width,
                          out + words);
        }
}

static void write_colours(const struct pgm_atlas *atlas, int k, const struct terrain_extent *box)
{
    uint32_t *out = atlas->texels;
    int words = words_a_sample(atlas);
    for (int64_t y = box->y0; y < box->y1; y++)
        for (int64_t x = box->x0; x < box->x1; x++)
            for (int corner = 0; corner < words; corner++)
                *out++ = pgm_picture_word(atlas->storage.picture, k, x + corner % 2, y + corner / 2);
}

void pgm_atlas_texels(const struct pgm_atlas *atlas, const struct terrain *terrain, int k,
                      const struct terrain_extent *box)
{
    if (atlas->storage.picture) {
        write_colours(atlas, k, box);
        return;
    }
    int width = (int)(box->x1 - box->x0), height = (int)(box->y1 - box->y0);
    size_t count = (size_t)width * (size_t)height;
    if (atlas->storage.fetch == PGM_FETCH_PACKED) {
        pack(atlas, terrain, k, box);
        return;
    }
    read_window(atlas, terrain, atlas->finest + k, box->x0, box->y0, width, height, atlas->heights);
    if (holds_floats(atlas))
        for (size_t i = 0; i < count; i++) ((float *)atlas->texels)[i] = (float)atlas->heights[i];
    else if (atlas->narrow)
        for (size_t i = 0; i < count; i++)
            ((int16_t *)atlas->texels)[i] = (int16_t)(atlas->heights[i] - atlas->base_q);
    else
        memcpy(atlas->texels, atlas->heights, count * sizeof(int32_t));
}

static uint32_t normal_word(const int32_t *at, size_t stride, const double slope_m[2])
{
    double x = slope_m[0] * ((double)at[-1] - at[1]);
    double y = slope_m[1] * ((double)at[-(ptrdiff_t)stride] - at[stride]);
    double scale = 32767 / sqrt(x * x + y * y + 1);
    return (uint32_t)(uint16_t)lrint(x * scale) | (uint32_t)(uint16_t)lrint(y * scale) << 16;
}

void pgm_atlas_shading(const struct pgm_atlas *atlas, const struct terrain *terrain, int k,
                       const struct terrain_extent *box)
{
    const struct terrain_info *info = terrain_info(terrain);
    int width = (int)(box->x1 - box->x0), height = (int)(box->y1 - box->y0), level = atlas->finest + k;
    int words = words_a_sample(atlas);
    size_t stride = (size_t)width + 3;
    double slope_m[2]; // of a difference over two cells, a quantum
    for (int axis = 0; axis < 2; axis++)
        slope_m[axis] = info->quantum_m / ldexp(info->spacing_m[axis], level + 1);
    read_window(atlas, terrain, level, box->x0 - 1, box->y0 - 1, width + 3, height + 3, atlas->heights);
    uint32_t *out = atlas->texels;
    for (int j = 0; j < height; j++)
        for (int i = 0; i < width; i++)
            for (int corner = 0; corner < words; corner++) {
                size_t row = (size_t)(j + 1 + corner / 2), column = (size_t)(i + 1 + corner % 2);
                *out++ = normal_word(atlas->heights + row * stride + column, stride, slope_m);
            }
}

// ---- textures --------------------------------------------------------------

struct texel_format {
    GLenum internal, format, type;
};

static struct texel_format words_format(const struct pgm_atlas *atlas, bool shading)
{
    if (!is_mipmapped(atlas)) return (struct texel_format){GL_RGBA32UI, GL_RGBA_INTEGER, GL_UNSIGNED_INT};
    return shading ? (struct texel_format){GL_RG16_SNORM, GL_RG, GL_SHORT}
                   : (struct texel_format){GL_RGBA8, GL_RGBA, GL_UNSIGNED_BYTE};
}

static struct texel_format format_of(const struct pgm_atlas *atlas)
{
    if (atlas->storage.picture) return words_format(atlas, false);
    if (holds_floats(atlas)) return (struct texel_format){GL_R32F, GL_RED, GL_FLOAT};
    if (atlas->storage.fetch == PGM_FETCH_PACKED)
        return atlas->narrow ? (struct texel_format){GL_RGBA32UI, GL_RGBA_INTEGER, GL_UNSIGNED_INT}
                             : (struct texel_format){GL_RGBA32I, GL_RGBA_INTEGER, GL_INT};
    return atlas->narrow ? (struct texel_format){GL_R16I, GL_RED_INTEGER, GL_SHORT}
                         : (struct texel_format){GL_R32I, GL_RED_INTEGER, GL_INT};
}

struct upload {
    struct pgm_atlas *atlas;
    struct gpu *gpu;
    const struct terrain *terrain;
    int k;
};

// The samples that the texels of a box are made of, those of its parent included.
static bool is_there(void *user, const struct terrain_extent *box)
{
    const struct upload *upload = user;
    const struct pgm_atlas *atlas = upload->atlas;
    int level = atlas->finest + upload->k, rim = atlas->storage.shaded ? 1 : 0;
    int more = rim || atlas->storage.fetch == PGM_FETCH_PACKED ? 1 : 0;
    int width = (int)(box->x1 - box->x0) + 2 * rim + more, height = (int)(box->y1 - box->y0) + 2 * rim + more;
    if (!atlas->reader || atlas->storage.picture) return true;
    if (!terrain_reader_window(atlas->reader, level, box->x0 - rim, box->y0 - rim, width, height, NULL))
        return false;
    if (atlas->storage.fetch != PGM_FETCH_PACKED || upload->k + 1 == atlas->levels) return true;
    int64_t x = half_of(box->x0), y = half_of(box->y0);
    return terrain_reader_window(atlas->reader, level + 1, x, y, (int)(half_of(box->x1 - 1) - x) + 2,
                                 (int)(half_of(box->y1 - 1) - y) + 2, NULL);
}

static void upload_box(void *user, const struct terrain_extent *samples, int x, int y)
{
    const struct upload *upload = user;
    struct pgm_atlas *atlas = upload->atlas;
    const struct pgm_slot *slot = &atlas->slots[upload->k];
    struct texel_format format = format_of(atlas), shading = words_format(atlas, true);
    int width = (int)(samples->x1 - samples->x0), wide = texels_a_sample(atlas);
    int texture = atlas->storage.many ? upload->k : 0;
    int64_t rows = larger(1, PIECE / width);
    for (int64_t from = samples->y0; from < samples->y1; from += rows) {
        struct terrain_extent piece = {samples->x0, from, samples->x1, smaller(from + rows, samples->y1)};
        int column = slot->x + x, row = slot->y + y + (int)(from - samples->y0);
        int height = (int)(piece.y1 - piece.y0);
        glBindTexture(GL_TEXTURE_2D, atlas->textures[texture]);
        pgm_atlas_texels(atlas, upload->terrain, upload->k, &piece);
        gpu_texture_sub_image(upload->gpu, GL_TEXTURE_2D, -1, column * wide, row, width * wide, height,
                              format.format, format.type, atlas->texels);
        if (!atlas->storage.shaded) continue;
        glBindTexture(GL_TEXTURE_2D, atlas->shading[texture]);
        pgm_atlas_shading(atlas, upload->terrain, upload->k, &piece);
        gpu_texture_sub_image(upload->gpu, GL_TEXTURE_2D, -1, column, row, width, height, shading.format,
                              shading.type, atlas->texels);
    }
}

static void follow_level(struct pgm_atlas *atlas, struct gpu *gpu, const struct terrain *terrain, int k,
                         const int64_t eye[2], uint64_t *budget)
{
    struct upload upload = {atlas, gpu, terrain, k};
    const struct pgm_loader loader = {&upload, is_there, upload_box};
    pgm_window_follow(&atlas->slots[k].window, eye, budget, &loader);
}

void pgm_atlas_follow(struct pgm_atlas *atlas, struct gpu *gpu, const struct terrain *terrain,
                      struct terrain_reader *reader, const struct view *view)
{
    atlas->reader = reader;
    uint64_t budget = atlas->storage.budget_bytes / texel_bytes(atlas);
    for (int k = (pgm_atlas_is_full(atlas) ? 0 : atlas->levels) - 1; k >= 0; k--) {
        if (pgm_window_is_full(&atlas->slots[k].window)) continue;
        struct pgm_place place = pgm_atlas_place(atlas, terrain, view, k);
        follow_level(atlas, gpu, terrain, k, place.cell, &budget);
    }
}

static void allocate(struct pgm_atlas *atlas, GLuint *textures, struct texel_format format, int texels,
                     GLint filter)
{
    glGenTextures(pgm_atlas_textures(atlas), textures);
    for (int i = 0; i < pgm_atlas_textures(atlas); i++) {
        const struct pgm_window *window = &atlas->slots[i].window;
        int width = atlas->storage.many ? window->width : atlas->width;
        int height = atlas->storage.many ? window->height : atlas->height;
        glBindTexture(GL_TEXTURE_2D, textures[i]);
        glTexImage2D(GL_TEXTURE_2D, 0, (GLint)format.internal, width * texels, height, 0, format.format,
                     format.type, NULL);
        glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, filter);
        glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, filter);
        glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAX_LEVEL, 0);
    }
}

// The levels that the hardware makes of the finest one.
static void let_the_hardware_filter(GLuint texture)
{
    if (!texture) return;
    glBindTexture(GL_TEXTURE_2D, texture);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAX_LEVEL, 1000);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_LINEAR_MIPMAP_LINEAR);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
    glGenerateMipmap(GL_TEXTURE_2D);
}

// A piece of w x h samples has w h <= PIECE, or one row; its corners and its parents' are (w + 1) x (h + 1)
// at most.
static bool make_room(struct pgm_atlas *atlas)
{
    size_t width = (size_t)larger(atlas->side, SIDE_LEAST), room = 4 * ((size_t)PIECE + width) + 16;
    atlas->heights = malloc(room * sizeof *atlas->heights);
    atlas->parents = malloc(room * sizeof *atlas->parents);
    atlas->texels = malloc(((size_t)PIECE + width) * texel_bytes(atlas));
    return atlas->heights && atlas->parents && atlas->texels;
}

// Levels that are held whole from the start: the coarsest, small ones, and those that take no reading.
static bool is_filled_first(const struct pgm_atlas *atlas, const struct terrain *terrain, int k)
{
    const struct pgm_window *window = &atlas->slots[k].window;
    size_t stride;
    return pgm_window_is_whole(window) &&
           (k == atlas->levels - 1 || (int64_t)window->width * window->height <= SOON ||
            is_mipmapped(atlas) || atlas->storage.picture ||
            terrain_samples(terrain, atlas->finest + k, &stride));
}

bool pgm_atlas_init(struct pgm_atlas *atlas, struct gpu *gpu, const struct terrain *terrain,
                    const struct pgm_storage *storage)
{
    if (!pgm_atlas_layout(atlas, terrain, storage)) return false;
    if (!make_room(atlas)) return fail("pgm: out of memory for a piece of heights");
    allocate(atlas, atlas->textures, format_of(atlas), texels_a_sample(atlas),
             storage->fetch == PGM_FETCH_LINEAR ? GL_LINEAR : GL_NEAREST);
    if (storage->shaded) allocate(atlas, atlas->shading, words_format(atlas, true), 1, GL_NEAREST);
    for (int k = 0; k < (is_mipmapped(atlas) ? 1 : atlas->levels); k++) {
        uint64_t all = UINT64_MAX;
        const struct pgm_window *window = &atlas->slots[k].window;
        const int64_t anywhere[2] = {window->extent.x0, window->extent.y0};
        if (is_filled_first(atlas, terrain, k)) follow_level(atlas, gpu, terrain, k, anywhere, &all);
    }
    if (is_mipmapped(atlas)) {
        let_the_hardware_filter(atlas->textures[0]);
        let_the_hardware_filter(atlas->shading[0]);
    }
    return true;
}

void pgm_atlas_finish(struct pgm_atlas *atlas)
{
    if (atlas->textures[0]) glDeleteTextures(pgm_atlas_textures(atlas), atlas->textures);
    if (atlas->shading[0]) glDeleteTextures(pgm_atlas_textures(atlas), atlas->shading);
    memset(atlas->textures, 0, sizeof atlas->textures);
    memset(atlas->shading, 0, sizeof atlas->shading);
    free(atlas->heights);
    free(atlas->parents);
    free(atlas->texels);
    atlas->heights = atlas->parents = NULL;
    atlas->texels = NULL;
}
