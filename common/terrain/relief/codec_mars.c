// SPDX-License-Identifier: MIT
#include "common/terrain/relief/codec_mars.h"

#include <stdlib.h>
#include <string.h>

enum { MOST_LEVELS = 16, LEAST = 8, RUNS = 0 }; // a first byte of 2 or 4: so many bytes a value

// ---- run lengths -----------------------------------------------------------

static uint32_t folded(int32_t value) // small numbers of either sign become small
{
    return (uint32_t)value << 1 ^ (value < 0 ? ~0u : 0u);
}

static int32_t unfolded(uint32_t value)
{
    return (int32_t)(value >> 1 ^ (0u - (value & 1)));
}

struct writer {
    uint8_t *out;
    size_t size, room;
    bool full;
};

static void put_varint(struct writer *w, uint32_t value)
{
    do {
        if (w->size == w->room) {
            w->full = true;
            return;
        }
        w->out[w->size++] = (uint8_t)((value & 127) | (value > 127 ? 128 : 0));
        value >>= 7;
    } while (value);
}

size_t runs_encode(const int32_t *values, size_t count, uint8_t *out)
{
    int plain = 2;
    for (size_t i = 0; i < count; i++)
        if (values[i] != (int16_t)values[i]) plain = 4;
    struct writer w = {.out = out, .size = 1, .room = (size_t)plain * count + 1};
    out[0] = RUNS;
    for (size_t i = 0; i < count && !w.full;) {
        size_t run = 0;
        while (i + run < count && values[i + run] == 0) run++;
        put_varint(&w, run ? 0 : folded(values[i]));
        if (run) put_varint(&w, (uint32_t)(run - 1));
        i += run ? run : 1;
    }
    if (!w.full) return w.size;
    out[0] = (uint8_t)plain;
    for (size_t i = 0, at = 1; i < count; i++)
        for (int byte = 0; byte < plain; byte++) out[at++] = (uint8_t)((uint32_t)values[i] >> 8 * byte);
    return (size_t)plain * count + 1;
}

static bool get_varint(const uint8_t *data, size_t size, size_t *at, uint32_t *value)
{
    *value = 0;
    for (int shift = 0; shift < 35 && *at < size; shift += 7) {
        uint8_t byte = data[(*at)++];
        if (shift == 28 && byte > 15) return false;
        *value |= (uint32_t)(byte & 127) << shift;
        if (!(byte & 128)) return true;
    }
    return false;
}

static size_t plain_decode(const uint8_t *data, size_t size, int32_t *values, size_t count)
{
    size_t plain = data[0];
    if ((size - 1) / plain < count) return 0;
    for (size_t i = 0; i < count; i++) {
        const uint8_t *at = data + 1 + plain * i;
        uint32_t low = at[0] | (uint32_t)at[1] << 8;
        values[i] =
            plain == 2 ? (int16_t)low : (int32_t)(low | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24);
    }
    return plain * count + 1;
}

size_t runs_decode(const uint8_t *data, size_t size, int32_t *values, size_t count)
{
    if (size == 0 || (data[0] != RUNS && data[0] != 2 && data[0] != 4)) return 0;
    if (data[0] != RUNS) return plain_decode(data, size, values, count);
    size_t at = 1;
    for (size_t i = 0; i < count;) {
        uint32_t value, more = 0;
        if (!get_varint(data, size, &at, &value)) return 0;
        if (value == 0 && (!get_varint(data, size, &at, &more) || more >= count - i)) return 0;
        values[i++] = unfolded(value);
        for (; more > 0; more--) values[i++] = 0;
    }
    return at;
}

// ---- a block's pyramid -----------------------------------------------------

struct levels {
    int count, width[MOST_LEVELS], height[MOST_LEVELS];
    size_t start[MOST_LEVELS], samples; // of all levels together
};

static struct levels levels_of(int width, int height, const struct mars_form *form)
{
    int least = form->least > 0 ? form->least : LEAST;
    struct levels l = {.count = 1, .width = {width}, .height = {height}};
    l.samples = (size_t)width * (size_t)height;
    while (l.count < MOST_LEVELS && (width > least || height > least) && (width > 1 || height > 1)) {
        width = (width + 1) / 2, height = (height + 1) / 2;
        l.width[l.count] = width, l.height[l.count] = height;
        l.start[l.count++] = l.samples;
        l.samples += (size_t)width * (size_t)height;
    }
    return l;
}

size_t mars_most(int width, int height)
{
    return 4 * (2 * (size_t)width * (size_t)height + 64) + MOST_LEVELS; // less than twice the samples
}

static int within(int index, int size)
{
    return index < 0 ? 0 : index >= size ? size - 1 : index;
}

static void reduce(const int32_t *fine, int width, int height, int32_t *coarse)
{
    static const int WEIGHT[3] = {1, 2, 1};
    for (int j = 0; j < (height + 1) / 2; j++)
        for (int i = 0; i < (width + 1) / 2; i++) {
            int32_t sum = 8;
            for (int b = -1; b <= 1; b++)
                for (int a = -1; a <= 1; a++)
                    sum += WEIGHT[a + 1] * WEIGHT[b + 1] *
                           fine[within(2 * j + b, height) * width + within(2 * i + a, width)];
            *coarse++ = sum >> 4;
        }
}

// Sums wrap, as those of a harmed file do.
static int32_t predict(const int32_t *coarse, int width, int height, int x, int y)
{
    static const uint32_t BETWEEN[4] = {~0u, 9, 9, ~0u}, ON[4] = {0, 16, 0, 0};
    const uint32_t *across = x & 1 ? BETWEEN : ON, *along = y & 1 ? BETWEEN : ON;
    uint32_t sum = 128;
    for (int b = 0; b < 4; b++)
        for (int a = 0; a < 4; a++)
            if (across[a] && along[b])
                sum += across[a] * along[b] *
                       (uint32_t)coarse[within(y / 2 + b - 1, height) * width + within(x / 2 + a - 1, width)];
    return (int32_t)sum >> 8;
}

static int32_t halved(int32_t residual, const struct mars_form *form)
{
    int32_t up =
        form->rounded ? residual >> 1 & 1 : 0; // odd ones half up, half down; or the last bit dropped
    return (residual + up) >> 1;
}

static int32_t sum_of(int32_t a, int32_t b)
{
    return (int32_t)((uint32_t)a + (uint32_t)b);
}

// What the decoder adds to a level predicted from the coarser one it has.
static void add_level(const struct levels *l, int level, const int32_t *k, int32_t *decoded)
{
    const int32_t *coarse = decoded + l->start[level + 1];
    int32_t *out = decoded + l->start[level];
    for (int y = 0; y < l->height[level]; y++)
        for (int x = 0; x < l->width[level]; x++, k++, out++)
            *out = sum_of(predict(coarse, l->width[level + 1], l->height[level + 1], x, y), sum_of(*k, *k));
}

size_t mars_encode(const int32_t *samples, int width, int height, const struct mars_form *form, uint8_t *out,
                   size_t room)
{
    struct levels l = levels_of(width, height, form);
    int top = l.count - 1;
    int32_t *image = malloc(3 * l.samples * sizeof *image);
    if (!image || room < mars_most(width, height)) return free(image), 0;
    int32_t *decoded = image + l.samples, *k = decoded + l.samples;
    memcpy(image, samples, (size_t)width * (size_t)height * sizeof *image);
    for (int n = 0; n < top; n++) reduce(image + l.start[n], l.width[n], l.height[n], image + l.start[n + 1]);
    size_t count = (size_t)l.width[top] * (size_t)l.height[top], size;
    memcpy(decoded + l.start[top], image + l.start[top], count * sizeof *image);
    size = runs_encode(image + l.start[top], count, out);
    for (int n = top - 1; n >= 0; n--) {
        const int32_t *coarse = (form->closed ? decoded : image) + l.start[n + 1],
                      *wanted = image + l.start[n];
        count = (size_t)l.width[n] * (size_t)l.height[n];
        for (size_t i = 0; i < count; i++)
            k[i] = halved(wanted[i] - predict(coarse, l.width[n + 1], l.height[n + 1], (int)i % l.width[n],
                                              (int)i / l.width[n]),
                          form);
        size += runs_encode(k, count, out + size);
        add_level(&l, n, k, decoded);
    }
    free(image);
    return size;
}

bool mars_decode(const uint8_t *data, size_t size, int width, int height, const struct mars_form *form,
                 int32_t *samples)
{
    struct levels l = levels_of(width, height, form);
    int top = l.count - 1;
    int32_t *decoded = malloc(2 * l.samples * sizeof *decoded);
    if (!decoded) return false;
    int32_t *k = decoded + l.samples;
    size_t at = runs_decode(data, size, decoded + l.start[top], (size_t)l.width[top] * (size_t)l.height[top]);
    bool good = at > 0;
    for (int n = top - 1; good && n >= 0; n--) {
        size_t taken = runs_decode(data + at, size - at, k, (size_t)l.width[n] * (size_t)l.height[n]);
        good = taken > 0;
        at += taken;
        if (good) add_level(&l, n, k, decoded);
    }
    good = good && at == size;
    if (good) memcpy(samples, decoded, (size_t)width * (size_t)height * sizeof *samples);
    free(decoded);
    return good;
}
