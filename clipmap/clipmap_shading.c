// SPDX-License-Identifier: MIT
#include "clipmap/clipmap_shading.h"

#include "common/report.h"

#include <stdio.h>

enum { FINE_UNIT = 1, COARSE_UNIT, FINE_PLAIN_UNIT, COARSE_PLAIN_UNIT }; // heights are on 0

// A filter reads up to this share of a texel beyond where it is told to, by rounding of texture coordinates:
// they are at most 4, 2^-22 in float32, of at most 2^11 texels, 2^-11; hardware keeps 2^-8.
static const double SLACK_TEXELS = 1.0 / 64;

int clipmap_shading_anisotropy(int wanted)
{
    GLfloat most = 1;
    if (epoxy_gl_version() >= 46 || epoxy_has_gl_extension("GL_ARB_texture_filter_anisotropic") ||
        epoxy_has_gl_extension("GL_EXT_texture_filter_anisotropic"))
        glGetFloatv(GL_MAX_TEXTURE_MAX_ANISOTROPY_EXT, &most);
    return wanted < (int)most ? wanted : (int)most;
}

static GLint minifying(const struct clipmap_shading *shading)
{
    return shading->rules.lod == CLIPMAP_LOD_MIPMAP ? GL_LINEAR_MIPMAP_LINEAR : GL_LINEAR;
}

static void create_plain_sampler(struct clipmap_shading *shading)
{
    glGenSamplers(1, &shading->plain);
    glSamplerParameteri(shading->plain, GL_TEXTURE_MIN_FILTER, minifying(shading));
    glSamplerParameteri(shading->plain, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
    glSamplerParameteri(shading->plain, GL_TEXTURE_WRAP_S, GL_REPEAT);
    glSamplerParameteri(shading->plain, GL_TEXTURE_WRAP_T, GL_REPEAT);
}

static void create_texture(const struct clipmap_shading *shading, GLuint texture, int size)
{
    bool mipmap = shading->rules.lod == CLIPMAP_LOD_MIPMAP;
    glBindTexture(GL_TEXTURE_2D, texture);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, minifying(shading));
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_S, GL_REPEAT);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_T, GL_REPEAT);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAX_LEVEL, mipmap ? CLIPMAP_MIPMAPS : 0);
    if (shading->rules.anisotropy > 1)
        glTexParameterf(GL_TEXTURE_2D, GL_TEXTURE_MAX_ANISOTROPY_EXT, (GLfloat)shading->rules.anisotropy);
    glTexImage2D(GL_TEXTURE_2D, 0, GL_RG16_SNORM, size, size, 0, GL_RG, GL_SHORT, NULL);
    if (mipmap) glGenerateMipmap(GL_TEXTURE_2D);
}

static bool is_bilinear(const struct clipmap_shading_rules *rules)
{
    return rules->lod == CLIPMAP_LOD_LEVEL && rules->anisotropy <= 1;
}

static int torus_size(const struct clipmap_shading_rules *rules, int texels)
{
    int size = 1 << CLIPMAP_MIPMAPS;
    while (size < texels) size *= 2;
    return is_bilinear(rules) ? texels : size;
}

bool clipmap_shading_init(struct clipmap_shading *shading, struct gpu *gpu, const struct terrain *terrain,
                          const struct clipmap_shading_rules *rules, int levels, int size)
{
    int texels = torus_size(rules, 2 * size), most = gpu_info(gpu)->max_texture_size;
    *shading = (struct clipmap_shading){.gpu = gpu, .rules = *rules, .levels = levels};
    if (texels > most)
        return fail("clipmap: a normal map of %d x %d texels: textures of this OpenGL driver have at most %d",
                    texels, texels, most);
    if (!clipmap_normals_scratch_init(&shading->scratch, 2 * size)) return false;
    create_plain_sampler(shading);
    glGenTextures(levels, shading->textures);
    glActiveTexture(GL_TEXTURE0 + FINE_UNIT);
    for (int k = 0; k < levels; k++) {
        int level = terrain_info(terrain)->finest + k;
        shading->maps[k] = (struct clipmap_normals){terrain, level, texels, clipmap_empty};
        create_texture(shading, shading->textures[k], texels);
    }
    return true;
}

void clipmap_shading_finish(struct clipmap_shading *shading)
{
    clipmap_normals_scratch_finish(&shading->scratch);
    if (shading->textures[0]) glDeleteTextures(shading->levels, shading->textures);
    if (shading->plain) glDeleteSamplers(1, &shading->plain);
    *shading = (struct clipmap_shading){NULL};
}

size_t clipmap_shading_bytes(const struct clipmap_shading *shading)
{
    size_t bytes = 0;
    for (int k = 0; k < shading->levels; k++)
        for (int mip = 0; mip <= (shading->rules.lod == CLIPMAP_LOD_MIPMAP ? CLIPMAP_MIPMAPS : 0); mip++) {
            size_t side = (size_t)(shading->maps[k].size >> mip);
            bytes += side * side * 2 * sizeof(int16_t);
        }
    return bytes;
}

// A filter along a slanted footprint reads half of its length to either side, llvmpipe's all of it.  A
// mipmap's texel is at most twice as wide as the footprint, and a bilinear filter reads one and a half of it:
// 3, and the footprint again.
void clipmap_shading_defines(const struct clipmap_shading_rules *rules, char defines[64])
{
    bool mipmap = rules->lod == CLIPMAP_LOD_MIPMAP;
    const char *reach = mipmap ? "#define REACH 4.0\n" : "#define REACH 1.0\n";
    snprintf(defines, 64, "%s%s", mipmap ? "#define MIPMAP\n" : "", is_bilinear(rules) ? "" : reach);
}

// ---- update ----------------------------------------------------------------

static void write_texels(void *user, int slot_x, int slot_y, int width, int height,
                         const int16_t (*texels)[2])
{
    gpu_texture_sub_image(user, GL_TEXTURE_2D, -1, slot_x, slot_y, width, height, GL_RG, GL_SHORT, texels);
}

void clipmap_shading_update(struct clipmap_shading *shading, int k, const struct clipmap_box *samples,
                            bool whole)
{
    if (whole) shading->maps[k].clip = clipmap_empty;
    glActiveTexture(GL_TEXTURE0 + FINE_UNIT);
    glBindTexture(GL_TEXTURE_2D, shading->textures[k]);
    uint64_t texels =
        clipmap_normals_move(&shading->maps[k], samples, &shading->scratch, write_texels, shading->gpu);
    if (texels && shading->rules.lod == CLIPMAP_LOD_MIPMAP) glGenerateMipmap(GL_TEXTURE_2D);
}

// ---- draw ------------------------------------------------------------------

struct clipmap_shading_uniforms clipmap_shading_locate(GLuint program)
{
    return (struct clipmap_shading_uniforms){
        .fine_normals = glGetUniformLocation(program, "fine_normals"),
        .coarse_normals = glGetUniformLocation(program, "coarse_normals"),
        .fine_plain = glGetUniformLocation(program, "fine_plain"),
        .coarse_plain = glGetUniformLocation(program, "coarse_plain"),
        .fine_place = glGetUniformLocation(program, "fine_place"),
        .coarse_place = glGetUniformLocation(program, "coarse_place"),
        .fine_inside = glGetUniformLocation(program, "fine_inside"),
        .coarse_inside = glGetUniformLocation(program, "coarse_inside"),
    };
}

// Texture coordinates count texels from the eye's cell, unwrapped, so that they stay small and go on evenly
// across the seam.
static void set_map(const struct clipmap_normals *map, const struct clipmap_box *active,
                    const struct view_origin *eye, GLint place, GLint inside)
{
    struct terrain_level level = terrain_level(map->terrain, map->level);
    float places[4], insides[4];
    for (int axis = 0; axis < 2; axis++) {
        int64_t base = 2 * eye->base[axis];
        double size = map->size, first = clipmap_slot(base, map->size) + 0.5;
        places[axis] = (float)(2 / (level.spacing_m[axis] * size));
        places[axis + 2] = (float)((2 * (double)eye->fraction[axis] + first) / size);
        insides[axis] = (float)(((double)(2 * active->lo[axis] - base) + SLACK_TEXELS + first) / size);
        insides[axis + 2] = (float)(((double)(2 * active->hi[axis] - base) - SLACK_TEXELS + first) / size);
    }
    glUniform4fv(place, 1, places);
    glUniform4fv(inside, 1, insides);
}

static void bind(GLint uniform, int unit, GLuint texture)
{
    if (uniform < 0) return; // this program does not read it
    glUniform1i(uniform, unit);
    glActiveTexture(GL_TEXTURE0 + (GLenum)unit);
    glBindTexture(GL_TEXTURE_2D, texture);
}

void clipmap_shading_set_level(const struct clipmap_shading *shading,
                               const struct clipmap_shading_uniforms *uniforms, int k,
                               const struct clipmap_region *regions, const struct view_origin *eyes)
{
    int coarse = k + 1 < shading->levels ? k + 1 : k; // the coarsest is never blended
    set_map(&shading->maps[k], &regions[k].active, &eyes[k], uniforms->fine_place, uniforms->fine_inside);
    set_map(&shading->maps[coarse], &regions[coarse].active, &eyes[coarse], uniforms->coarse_place,
            uniforms->coarse_inside);
    bind(uniforms->coarse_plain, COARSE_PLAIN_UNIT, shading->textures[coarse]);
    bind(uniforms->fine_plain, FINE_PLAIN_UNIT, shading->textures[k]);
    bind(uniforms->coarse_normals, COARSE_UNIT, shading->textures[coarse]);
    bind(uniforms->fine_normals, FINE_UNIT, shading->textures[k]);
}

void clipmap_shading_begin(const struct clipmap_shading *shading)
{
    glBindSampler(FINE_PLAIN_UNIT, shading->plain);
    glBindSampler(COARSE_PLAIN_UNIT, shading->plain);
}

void clipmap_shading_end(void)
{
    glBindSampler(FINE_PLAIN_UNIT, 0);
    glBindSampler(COARSE_PLAIN_UNIT, 0);
}
