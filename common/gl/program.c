// SPDX-License-Identifier: MIT
#include "common/embedded.h"
#include "common/gl/context.h"
#include "common/gl/planet_image.h"
#include "common/report.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_PIECES = 8 };

// A shader in pieces.  Piece numbers are the source numbers of #line, so that a message can be traced to its
// file.
struct source {
    const char *names[MAX_PIECES];
    const GLchar *texts[2 * MAX_PIECES];
    GLint lengths[2 * MAX_PIECES];
    int pieces;
};

static const char *const line_directives[MAX_PIECES] = {"#version 330 core\n#line 1 0\n",
                                                        "\n#line 1 1\n",
                                                        "\n#line 1 2\n",
                                                        "\n#line 1 3\n",
                                                        "\n#line 1 4\n",
                                                        "\n#line 1 5\n",
                                                        "\n#line 1 6\n",
                                                        "\n#line 1 7\n"};

static void add_text(struct source *source, const char *name, const char *text, size_t length)
{
    int i = source->pieces++;
    source->names[i] = name;
    source->texts[2 * i] = line_directives[i];
    source->lengths[2 * i] = (GLint)strlen(line_directives[i]);
    source->texts[2 * i + 1] = text;
    source->lengths[2 * i + 1] = (GLint)length;
}

static bool add_file(struct source *source, const char *path)
{
    const struct embedded_file *file = embedded_find(path);
    if (!file) return fail("%s: the program does not carry this shader file", path);
    add_text(source, path, (const char *)file->data, (size_t)(file->end - file->data));
    return true;
}

// Drivers write "2:14(5): error: ..." (Mesa), "2(14) : error ..." (NVIDIA) or "ERROR: 2:14: ..." (others).
static void report_log(const struct source *source, const char *log)
{
    const char *error = strstr(log, "error");
    if (!error) error = strstr(log, "ERROR");
    if (!error) error = log;
    const char *line = error;
    while (line > log && line[-1] != '\n') line--;
    int length = (int)strcspn(error, "\n"), piece, number;
    const char *place = strncmp(line, "ERROR: ", 7) == 0 ? line + 7 : line;
    bool placed =
        sscanf(place, "%d:%d", &piece, &number) == 2 || sscanf(place, "%d(%d", &piece, &number) == 2;
    if (placed && piece >= 0 && piece < source->pieces)
        fail("%s:%d: %.*s", source->names[piece], number, length, error);
    else
        fail("%s: %.*s", source->names[source->pieces - 1], length, error);
}

static GLuint compile(GLenum stage, const struct source *source)
{
    GLuint shader = glCreateShader(stage);
    glShaderSource(shader, 2 * source->pieces, source->texts, source->lengths);
    glCompileShader(shader);
    GLint good;
    glGetShaderiv(shader, GL_COMPILE_STATUS, &good);
    if (good) return shader;
    char log[4096] = "";
    glGetShaderInfoLog(shader, sizeof log, NULL, log);
    report_log(source, log);
    glDeleteShader(shader);
    return 0;
}

static const char *pass_define(enum render_pass pass)
{
    static const char *const defines[PASS_COUNT] = {"#define PASS_SHADED\n", "#define PASS_POSITION\n",
                                                    "#define PASS_DEPTH\n"};
    return defines[pass];
}

// What a program is assembled from.
struct parts {
    const char *vertex_file, *defines;
    const struct scene_effects *effects;
    enum render_pass pass;
    bool own_shading;
};

static void add_defines(struct source *source, const struct parts *parts)
{
    static const char own[] = "#define SHADING_OWN\n";
    add_text(source, "(defines)", parts->defines, strlen(parts->defines));
    add_text(source, "(pass)", pass_define(parts->pass), strlen(pass_define(parts->pass)));
    if (parts->own_shading) add_text(source, "(shading)", own, sizeof own - 1);
}

static GLuint compile_vertex(const struct parts *parts)
{
    struct source source = {.pieces = 0};
    add_defines(&source, parts);
    if (!add_file(&source, "common/gl/frame.glsl") || !add_file(&source, parts->vertex_file) ||
        !add_file(&source, "common/gl/main.vert"))
        return 0;
    return compile(GL_VERTEX_SHADER, &source);
}

static GLuint compile_side(void)
{
    struct source source = {.pieces = 0};
    if (!add_file(&source, "common/gl/frame.glsl") || !add_file(&source, "common/gl/side.geom")) return 0;
    return compile(GL_GEOMETRY_SHADER, &source);
}

// The renderer's own shading stands beside its vertex file: clipmap/clipmap.frag.
static bool add_own_normal(struct source *source, const char *vertex_file)
{
    char path[256];
    snprintf(path, sizeof path, "%.*s.frag", (int)(strrchr(vertex_file, '.') - vertex_file), vertex_file);
    if (embedded_find(path)) return add_file(source, path);
    return fail("%.*s has no shading of its own; accepted in the scene is \"shading\": \"common\"",
                (int)strcspn(vertex_file, "/"), vertex_file);
}

static bool add_shading(struct source *source, const struct parts *parts)
{
    return add_file(source, parts->effects->colour ? "common/gl/image_colour.glsl"
                                                   : "common/gl/height_colour.glsl") &&
           (parts->own_shading ? add_own_normal(source, parts->vertex_file)
                               : add_file(source, "common/gl/face_normal.glsl"));
}

static GLuint compile_fragment(const struct parts *parts)
{
    struct source source = {.pieces = 0};
    add_defines(&source, parts);
    if (!add_file(&source, "common/gl/frame.glsl") || !add_file(&source, "common/gl/outline.glsl") ||
        (parts->pass == PASS_SHADED && !add_shading(&source, parts)) ||
        !add_file(&source, "common/gl/terrain.frag"))
        return 0;
    return compile(GL_FRAGMENT_SHADER, &source);
}

static bool link_program(GLuint name, const GLuint *shaders, int count, const char *vertex_file)
{
    static const char *const captured = "v_relative";
    for (int i = 0; i < count; i++) glAttachShader(name, shaders[i]);
    glTransformFeedbackVaryings(name, 1, &captured, GL_INTERLEAVED_ATTRIBS);
    glLinkProgram(name);
    for (int i = 0; i < count; i++) glDetachShader(name, shaders[i]);
    GLint good;
    glGetProgramiv(name, GL_LINK_STATUS, &good);
    if (!good) {
        char log[1024] = "";
        glGetProgramInfoLog(name, sizeof log, NULL, log);
        return fail("%s: does not link: %.*s", vertex_file, (int)strcspn(log, "\n"), log);
    }
    glUniformBlockBinding(name, glGetUniformBlockIndex(name, "frame"), GPU_FRAME_BINDING);
    return true;
}

static void upload_level(int level, int width, int height, const uint8_t *pixels)
{
    glTexImage2D(GL_TEXTURE_2D, level, GL_RGBA8, width, height, 0, GL_RGBA, GL_UNSIGNED_BYTE, pixels);
}

static bool upload_planet(const struct scene_colour *image)
{
    int width = image->width, height = image->height, level = 0;
    size_t size = 4 * (size_t)width * (size_t)height;
    const uint8_t *pixels = image->pixels;
    uint8_t *half = malloc(size / 4), *round = malloc(size);
    bool good = half && round;
    do {
        good = good && planet_image_round(pixels, width, height, round);
        if (good) upload_level(level++, width, height, round);
    } while (good && planet_image_halve(pixels, &width, &height, half) && (pixels = half));
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAX_LEVEL, level - 1);
    free(half);
    free(round);
    return good || fail("%s: out of memory", image->name);
}

// Draped as far as the eye sees: filtered between mipmaps.
static bool hold_colour(struct gpu *gpu, struct scene_colour *image, bool planet)
{
    struct gpu_colour *held = &gpu->colour;
    int most = gpu->info.max_texture_size;
    if (strcmp(held->sha256, image->sha256) == 0 && held->planet == planet) return true;
    if (image->width > most || image->height > most)
        return fail("%s: %d x %d pixels; textures of this OpenGL driver have at most %d", image->name,
                    image->width, image->height, most);
    if (!scene_colour_hold(image)) return false;
    if (held->texture) glDeleteTextures(1, &held->texture);
    glGenTextures(1, &held->texture);
    glActiveTexture(GL_TEXTURE0 + GPU_COLOUR_UNIT);
    glBindTexture(GL_TEXTURE_2D, held->texture);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_LINEAR_MIPMAP_LINEAR);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_S, planet ? GL_REPEAT : GL_CLAMP_TO_EDGE);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    bool good = true;
    if (planet) {
        good = upload_planet(image);
    } else {
        upload_level(0, image->width, image->height, image->pixels);
        glGenerateMipmap(GL_TEXTURE_2D);
    }
    scene_colour_release(image);
    glActiveTexture(GL_TEXTURE0);
    snprintf(held->sha256, sizeof held->sha256, "%s", good ? image->sha256 : "");
    held->planet = planet;
    return good;
}

static bool set_colour(struct gpu *gpu, const struct gpu_program *program, const struct parts *parts)
{
    struct scene_colour *colour = parts->effects->colour;
    GLint image = glGetUniformLocation(program->name, "colour_image");
    if (!colour || image < 0) return true; // absent, too, where a renderer drapes it itself
    if (!hold_colour(gpu, colour, strstr(parts->defines, GPU_SPHERE) != NULL)) return false;
    glUseProgram(program->name);
    glUniform1i(image, GPU_COLOUR_UNIT);
    gpu->program = program->name;
    return true;
}

bool gpu_program_build(struct gpu *gpu, struct gpu_program *program, const char *vertex_file,
                       const char *defines, const struct scene_effects *effects, enum render_pass pass)
{
    const struct parts parts = {vertex_file, defines ? defines : "", effects, pass,
                                pass == PASS_SHADED && effects->shading == SCENE_SHADING_OWN};
    *program = (struct gpu_program){.pass = pass};
    GLuint shaders[3] = {0};
    int count = 0;
    bool good = (shaders[count++] = compile_vertex(&parts)) != 0;
    good = good && (shaders[count++] = compile_fragment(&parts)) != 0;
    if (pass == PASS_POSITION) good = good && (shaders[count++] = compile_side()) != 0;
    if (good) {
        program->name = glCreateProgram();
        if (!link_program(program->name, shaders, count, vertex_file) || !set_colour(gpu, program, &parts))
            gpu_program_finish(program);
    }
    for (int i = 0; i < count; i++) glDeleteShader(shaders[i]);
    return program->name != 0;
}

void gpu_program_finish(struct gpu_program *program)
{
    if (program->name) glDeleteProgram(program->name);
    program->name = 0;
}

void gpu_use_program(struct gpu *gpu, const struct gpu_program *program)
{
    if (gpu->capture.session) {
        if (gpu->program == program->name) return;
        gpu_capture_flush(gpu); // the program may not change inside a session
    }
    glUseProgram(program->name);
    gpu->program = program->name;
}

void gpu_set_frame(struct gpu *gpu, const struct gpu_frame *frame)
{
    glBindBuffer(GL_UNIFORM_BUFFER, gpu->frame_buffer);
    glBufferSubData(GL_UNIFORM_BUFFER, 0, sizeof *frame, frame);
    glBindBufferBase(GL_UNIFORM_BUFFER, GPU_FRAME_BINDING, gpu->frame_buffer);
}

void gpu_frame_without_clip_control(struct gpu_frame *frame)
{
    float *clip = frame->clip_from_relative;
    for (int column = 0; column < 4; column++)
        clip[4 * column + 2] = 2 * clip[4 * column + 2] - clip[4 * column + 3];
}

// An edge of the map relative to the eye, in cells first, as vertices are placed: where the edge is a line of
// samples, the edge and the vertices on it come out bitwise equal (numerics.md, B2).
static float relative_edge(const struct terrain_info *info, const struct view *view, int edge)
{
    int axis = edge & 1;
    double spacing = info->spacing_m[axis], line = info->outline_m[edge] / spacing;
    if (fabs(line - rint(line)) > 1e-6) return (float)(info->outline_m[edge] - view->eye_m[axis]);
    struct view_origin eye = view_level_origin(view, 0);
    double cells = (rint(line) - (double)eye.base[axis]) - (double)eye.fraction[axis];
    return (float)cells * (float)spacing;
}

void gpu_set_view(struct gpu *gpu, const struct terrain *terrain, const struct view *view)
{
    const struct terrain_info *info = terrain_info(terrain);
    struct gpu_frame frame;
    memcpy(frame.clip_from_relative, view->clip_from_relative, sizeof frame.clip_from_relative);
    if (!gpu->info.clip_control) gpu_frame_without_clip_control(&frame);
    const double unit = 1.0 / (1 << VIEW_HEIGHT_BITS);
    double eye_q = (double)view->eye_height * unit;
    float whole_q = (float)(view->eye_height >> VIEW_HEIGHT_BITS);
    frame.height[0] = whole_q;
    frame.height[1] = (float)(eye_q - (double)whole_q);
    frame.height[2] = (float)info->quantum_m;
    frame.height[3] = 0;
    double relief_m = info->max_q > info->min_q ? info->quantum_m * ((double)info->max_q - info->min_q) : 1;
    frame.shade[0] =
        (float)((info->offset_m + info->quantum_m * info->min_q - view->eye_place[2]) / relief_m);
    frame.shade[1] = (float)(1 / relief_m);
    bool whole = info->datum == TERRAIN_SPHERE; // a planet has no outline
    for (int i = 0; i < 4; i++)
        frame.outline[i] = whole ? (i < 2 ? -1e30f : 1e30f) : relative_edge(info, view, i) * frame.shade[1];
    for (int row = 0; row < 3; row++)
        for (int k = 0; k < 3; k++) frame.axes[row][k] = (float)view->axes[row][k];
    frame.axes[0][3] = view->radius_m > 0 ? (float)(1 / view->radius_m) : 0;
    frame.axes[1][3] = (float)view->radius_m;
    frame.axes[2][3] = 0;
    frame.shade[2] = (float)view->width;
    frame.shade[3] = (float)view->height;
    gpu_set_frame(gpu, &frame);
}
