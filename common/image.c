// SPDX-License-Identifier: MIT
#include "common/image.h"

#include "common/report.h"

#include <errno.h>
#include <png.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

struct message { // libpng's own words, kept until the file's name can be put in front
    char text[160];
};

static void on_error(png_structp png, png_const_charp text)
{
    struct message *message = png_get_error_ptr(png);
    snprintf(message->text, sizeof message->text, "%s", text);
    longjmp(png_jmpbuf(png), 1);
}

static void on_warning(png_structp png, png_const_charp text)
{
    (void)png, (void)text;
}

// ---- reading ---------------------------------------------------------------

struct bytes {
    const unsigned char *at;
    size_t left;
};

static void read_bytes(png_structp png, png_bytep out, size_t size)
{
    struct bytes *bytes = png_get_io_ptr(png);
    if (size > bytes->left) png_error(png, "the file ends too early");
    memcpy(out, bytes->at, size);
    bytes->at += size;
    bytes->left -= size;
}

static void read_file(png_structp png, png_bytep out, size_t size)
{
    if (fread(out, 1, size, png_get_io_ptr(png)) != size) png_error(png, "the file ends too early");
}

struct decoded { // outlives a longjmp, so it lives in the caller's frame
    int width, height;
    uint16_t *samples;
    bool copies; // to `to`, with a row in memory
    int to;
    bool own_words; // the message is not libpng's
};

static bool write_row(int to, const void *row, size_t size)
{
    for (size_t done = 0; done < size;) {
        ssize_t n = write(to, (const char *)row + done, size - done);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) return false;
        done += (size_t)n;
    }
    return true;
}

// Rows of big-endian samples from the top, to memory or to a file.
static bool decode_rows(png_structp png, int passes, struct message *message, struct decoded *decoded)
{
    size_t width = (size_t)decoded->width;
    for (int pass = 0; pass < passes; pass++)
        for (int y = 0; y < decoded->height; y++) {
            uint16_t *row = decoded->samples + (decoded->copies ? 0 : (size_t)y * width);
            png_read_row(png, (png_bytep)row, NULL);
            if (!decoded->copies || write_row(decoded->to, row, 2 * width)) continue;
            decoded->own_words = true;
            snprintf(message->text, sizeof message->text, "its samples cannot be written out (%s)",
                     strerror(errno));
            return false;
        }
    png_read_end(png, NULL); // a file cut after its last row is still a damaged file
    return true;
}

static bool decode(png_structp png, png_infop info, struct message *message, struct decoded *decoded)
{
    if (setjmp(png_jmpbuf(png))) return false;
    png_set_user_limits(png, 1 << 20, 1 << 20);
    png_read_info(png, info);
    int depth = png_get_bit_depth(png, info), colour = png_get_color_type(png, info);
    if (depth != 16 || colour != PNG_COLOR_TYPE_GRAY) {
        decoded->own_words = true;
        snprintf(message->text, sizeof message->text, "is a %d-bit %s PNG; 16-bit grey is expected", depth,
                 colour == PNG_COLOR_TYPE_GRAY ? "grey" : "colour");
        return false;
    }
    decoded->width = (int)png_get_image_width(png, info);
    decoded->height = (int)png_get_image_height(png, info);
    int passes = png_set_interlace_handling(png);
    png_read_update_info(png, info);
    if (decoded->copies && passes > 1) png_error(png, "it is interlaced");
    size_t count = (size_t)decoded->width * (size_t)(decoded->copies ? 1 : decoded->height);
    decoded->samples = calloc(count, sizeof *decoded->samples);
    if (!decoded->samples) png_error(png, "it does not fit in memory");
    if (!decode_rows(png, passes, message, decoded)) return false;
    for (size_t i = 0; !decoded->copies && i < count; i++) { // PNG is big-endian, whatever this machine is
        const unsigned char *b = (const unsigned char *)&decoded->samples[i];
        decoded->samples[i] = (uint16_t)(b[0] << 8 | b[1]);
    }
    return true;
}

static bool read_grey16(const char *path, FILE *file, struct bytes *bytes, struct decoded *decoded)
{
    struct message message = {""};
    png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &message, on_error, on_warning);
    png_infop info = png ? png_create_info_struct(png) : NULL;
    bool good = false;
    if (info) {
        if (file)
            png_set_read_fn(png, file, read_file);
        else
            png_set_read_fn(png, bytes, read_bytes);
        good = decode(png, info, &message, decoded);
    } else
        snprintf(message.text, sizeof message.text, "out of memory");
    png_destroy_read_struct(&png, &info, NULL);
    if (good) return true;
    free(decoded->samples);
    if (decoded->own_words) return fail("%s: %s", path, message.text);
    return fail("%s: not a whole PNG (%s); a 16-bit grey PNG is expected", path, message.text);
}

bool image_read_grey16(const char *path, const void *data, size_t size, int *width, int *height,
                       uint16_t **samples)
{
    struct decoded decoded = {0};
    struct bytes bytes = {data, size};
    FILE *file = data ? NULL : fopen(path, "rb");
    if (!data && !file) return fail("%s: %s; a 16-bit grey PNG is expected", path, strerror(errno));
    bool good = read_grey16(path, file, &bytes, &decoded);
    if (file) fclose(file);
    if (!good) return false;
    *width = decoded.width;
    *height = decoded.height;
    *samples = decoded.samples;
    return true;
}

bool image_size_grey16(const char *path, int *width, int *height, bool *interlaced)
{
    enum { WIDTH = 16, DEPTH = 24, COLOUR, METHOD = 28, HEADER = 33 }; // the signature, then the chunk IHDR
    uint8_t head[HEADER];
    FILE *file = fopen(path, "rb");
    bool good = file && fread(head, 1, HEADER, file) == HEADER && png_sig_cmp(head, 0, 8) == 0 &&
                memcmp(head + 12, "IHDR", 4) == 0 && head[DEPTH] == 16 && head[COLOUR] == PNG_COLOR_TYPE_GRAY;
    if (file) fclose(file);
    if (!good) return false;
    int *const sizes[2] = {width, height};
    for (int axis = 0; axis < 2; axis++) {
        uint32_t size = png_get_uint_32(head + WIDTH + 4 * axis);
        if (size < 1 || size > 1 << 20) return false;
        *sizes[axis] = (int)size;
    }
    *interlaced = head[METHOD] != 0;
    return true;
}

bool image_copy_grey16(const char *path, int to)
{
    struct decoded decoded = {.copies = true, .to = to};
    FILE *file = fopen(path, "rb");
    if (!file) return fail("%s: %s; a 16-bit grey PNG is expected", path, strerror(errno));
    bool good = read_grey16(path, file, NULL, &decoded);
    fclose(file);
    if (good) free(decoded.samples);
    return good;
}

// Whatever the file holds becomes 8-bit RGBA, 4 bytes a pixel.
static void ask_for_rgba8(png_structp png)
{
    png_set_expand(png);
    png_set_scale_16(png);
    png_set_gray_to_rgb(png);
    png_set_add_alpha(png, 0xff, PNG_FILLER_AFTER);
}

struct colours { // outlives a longjmp, so it lives in the caller's frame
    int width, height;
    uint8_t *pixels;
};

static bool decode_colours(png_structp png, png_infop info, FILE *file, struct colours *colours)
{
    if (setjmp(png_jmpbuf(png))) return false;
    png_set_read_fn(png, file, read_file);
    png_set_user_limits(png, 1 << 20, 1 << 20);
    png_read_info(png, info);
    ask_for_rgba8(png);
    int passes = png_set_interlace_handling(png);
    png_read_update_info(png, info);
    colours->width = (int)png_get_image_width(png, info);
    colours->height = (int)png_get_image_height(png, info);
    size_t row = png_get_rowbytes(png, info);
    colours->pixels = malloc(row * (size_t)colours->height);
    if (!colours->pixels) png_error(png, "it does not fit in memory");
    for (int pass = 0; pass < passes; pass++)
        for (int y = 0; y < colours->height; y++) png_read_row(png, colours->pixels + row * (size_t)y, NULL);
    png_read_end(png, NULL);
    return true;
}

bool image_read_rgba8(const char *path, int *width, int *height, uint8_t **pixels)
{
    FILE *file = fopen(path, "rb");
    if (!file) return fail("%s: %s; a PNG is expected", path, strerror(errno));
    struct message message = {""};
    struct colours colours = {0};
    png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &message, on_error, on_warning);
    png_infop info = png ? png_create_info_struct(png) : NULL;
    bool good = info && decode_colours(png, info, file, &colours);
    png_destroy_read_struct(&png, &info, NULL);
    fclose(file);
    if (!good) {
        free(colours.pixels);
        return fail("%s: not a whole PNG (%s)", path, *message.text ? message.text : "out of memory");
    }
    *width = colours.width;
    *height = colours.height;
    *pixels = colours.pixels;
    return true;
}

// ---- writing ---------------------------------------------------------------

struct picture {
    int width, height, depth, channels;
    const unsigned char *first_row; // of the file: the top
    ptrdiff_t row_step;             // bytes from a row to the one below it
};

static void write_file(png_structp png, png_bytep data, size_t size)
{
    if (fwrite(data, 1, size, png_get_io_ptr(png)) != size) png_error(png, strerror(errno));
}

static void flush_file(png_structp png)
{
    if (fflush(png_get_io_ptr(png)) != 0) png_error(png, strerror(errno));
}

static bool encode(png_structp png, png_infop info, const struct picture *picture)
{
    static const int COLOURS[] = {0, PNG_COLOR_TYPE_GRAY, 0, PNG_COLOR_TYPE_RGB, PNG_COLOR_TYPE_RGB_ALPHA};
    static const uint16_t ONE = 1;
    if (setjmp(png_jmpbuf(png))) return false;
    png_set_IHDR(png, info, (png_uint_32)picture->width, (png_uint_32)picture->height, picture->depth,
                 COLOURS[picture->channels], PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
                 PNG_FILTER_TYPE_DEFAULT);
    png_set_compression_level(png, 6);
    png_write_info(png, info);
    if (picture->depth == 16 && *(const unsigned char *)&ONE == 1) png_set_swap(png);
    for (int y = 0; y < picture->height; y++) png_write_row(png, picture->first_row + y * picture->row_step);
    png_write_end(png, info);
    return true;
}

static bool write_picture(FILE *file, const struct picture *picture, struct message *message)
{
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, message, on_error, on_warning);
    png_infop info = png ? png_create_info_struct(png) : NULL;
    bool good = false;
    if (info) {
        png_set_write_fn(png, file, write_file, flush_file);
        good = encode(png, info, picture);
    } else
        snprintf(message->text, sizeof message->text, "out of memory");
    png_destroy_write_struct(&png, &info);
    return good;
}

// Writes under a temporary name beside the file, then renames.
static bool write_whole(const char *path, const struct picture *picture)
{
    if (picture->width < 1 || picture->height < 1)
        return fail("%s: a picture of %dx%d; at least 1x1 is expected", path, picture->width,
                    picture->height);
    size_t size = strlen(path) + 32;
    char *temporary = malloc(size);
    if (!temporary) return fail("%s: out of memory", path);
    snprintf(temporary, size, "%s.%ld.part", path, (long)getpid());
    FILE *file = fopen(temporary, "wb");
    struct message message = {""};
    bool good = file != NULL;
    if (!file) snprintf(message.text, sizeof message.text, "%s", strerror(errno));
    if (file && !write_picture(file, picture, &message)) good = false;
    if (file && fclose(file) != 0 && good) {
        good = false;
        snprintf(message.text, sizeof message.text, "%s", strerror(errno));
    }
    if (good && rename(temporary, path) != 0) {
        good = false;
        snprintf(message.text, sizeof message.text, "%s", strerror(errno));
    }
    if (!good && file) unlink(temporary);
    free(temporary);
    return good || fail("%s: cannot be written (%s)", path, message.text);
}

bool image_write_png(const char *path, int width, int height, int channels, const uint8_t *pixels)
{
    ptrdiff_t row = (ptrdiff_t)width * channels;
    struct picture picture = {width, height, 8, channels, pixels + row * (height - 1), -row};
    return write_whole(path, &picture);
}

bool image_write_grey16(const char *path, int width, int height, const uint16_t *samples)
{
    struct picture picture = {width, height, 16, 1, (const unsigned char *)samples, (ptrdiff_t)width * 2};
    return write_whole(path, &picture);
}
