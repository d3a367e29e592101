// SPDX-License-Identifier: MIT
#include "common/terrain/relief/relief_source.h"

#include "common/report.h"
#include "common/terrain/amplify.h"
#include "common/terrain/relief/file_source.h"
#include "common/terrain/relief/relief_file.h"
#include "common/terrain/sphere.h"
#include "common/terrain/upsample.h"
#include "common/terrain/voids.h"

#include <stdlib.h>
#include <string.h>
#include <strings.h>

uint64_t relief_source_hashed(uint64_t hash, const void *data, size_t size)
{
    const uint8_t *at = data; // FNV-1a over words of 4 bytes
    for (size_t i = 0; i + 4 <= size; i += 4) {
        uint32_t word;
        memcpy(&word, at + i, 4);
        hash = (hash ^ word) * 0x100000001b3u;
    }
    return hash ^ hash >> 29;
}

uint64_t relief_source_described(const struct relief_source *s)
{
    uint64_t hash = relief_source_hashed(0xcbf29ce484222325u, s->size, sizeof s->size);
    hash = relief_source_hashed(hash, s->spacing_m, sizeof s->spacing_m);
    hash = relief_source_hashed(hash, &s->quantum_m, sizeof s->quantum_m);
    hash = relief_source_hashed(hash, &s->offset_m, sizeof s->offset_m);
    return relief_source_hashed(hash, &s->radius_m, sizeof s->radius_m);
}

void relief_source_finish(struct relief_source *source)
{
    if (source->finish) source->finish(source);
    memset(source, 0, sizeof *source);
}

bool relief_is_planet(const char *name, int64_t columns, int64_t rows)
{
    return (columns >= 4 && columns % 2 == 0 && rows >= 3 && rows % 2 == 1) ||
           fail("%s: %lld x %lld samples are not a whole planet; an even number of columns and an odd one of "
                "rows, from pole to pole, are accepted",
                name, (long long)columns, (long long)rows);
}

static bool ends_in(const char *path, const char *ending)
{
    size_t length = strlen(path), tail = strlen(ending);
    return length >= tail && strcasecmp(path + length - tail, ending) == 0;
}

// ---- a map in memory -------------------------------------------------------

static bool field_window(const struct relief_source *source, const struct patch *to)
{
    const struct heightfield *field = source->data;
    for (int64_t y = to->rect.y0; y < to->rect.y1; y++)
        memcpy(patch_at(to, to->rect.x0, y), field->samples + y * field->width + to->rect.x0,
               (size_t)rect_width(&to->rect) * sizeof(int32_t));
    return true;
}

bool relief_source_lines(struct heightfield *field)
{
    int32_t *samples =
        field->width % 2 ? NULL : sphere_from_pixels(field->samples, field->width, field->height);
    if (!samples) return fail("%s: out of memory, or an odd number of columns", field->name);
    free(field->samples);
    field->samples = samples;
    field->height++;
    field->pixel_centred = false;
    return true;
}

bool relief_source_field(struct relief_source *s, struct heightfield *field)
{
    size_t count = (size_t)field->width * (size_t)field->height;
    memset(s, 0, sizeof *s);
    s->voids_filled = voids_count(field->samples, count);
    if (s->voids_filled == count)
        return fail("%s: every sample is void; at least one height is expected", field->name);
    if (s->voids_filled && !voids_fill(field->samples, field->width, field->height))
        return fail("%s: out of memory", field->name);
    if (field->radius_m > 0 && field->pixel_centred && !relief_source_lines(field)) return false;
    if (field->radius_m > 0 && !relief_is_planet(field->name, field->width, field->height)) return false;
    count = (size_t)field->width * (size_t)field->height;
    for (size_t i = 0; i < count; i++)
        if (abs(field->samples[i]) > s->magnitude_q) s->magnitude_q = abs(field->samples[i]);
    if (s->magnitude_q > QUANTA_LIMIT)
        return fail("%s: a height of %d quanta; at most %d are accepted", field->name, s->magnitude_q,
                    QUANTA_LIMIT);
    memcpy(s->name, field->name, sizeof s->name);
    s->size[0] = field->width, s->size[1] = field->height;
    memcpy(s->spacing_m, field->spacing_m, sizeof s->spacing_m);
    s->quantum_m = field->quantum_m, s->offset_m = field->offset_m, s->radius_m = field->radius_m;
    s->identity = relief_source_described(s);
    for (int64_t y = 0; y < field->height; y++) // by rows, as where they are read one by one
        s->identity = relief_source_hashed(s->identity, field->samples + y * field->width,
                                           (size_t)field->width * sizeof *field->samples);
    s->window = field_window;
    s->data = field;
    return true;
}

static void finish_loaded(struct relief_source *source)
{
    heightfield_finish(source->data);
    free(source->data);
}

static bool relief_source_load(struct relief_source *s, struct heightfield *field)
{
    struct heightfield *kept = malloc(sizeof *kept);
    bool good = kept || fail("%s: out of memory", field->name);
    if (good) *kept = *field;
    if (good && relief_source_field(s, kept)) {
        s->finish = finish_loaded;
        return true;
    }
    heightfield_finish(field);
    free(kept);
    return false;
}

// ---- any -------------------------------------------------------------------

bool relief_source_open(struct relief_source *source, const char *path, size_t memory_bytes,
                        const char *beside)
{
    struct heightfield field;
    memset(source, 0, sizeof *source);
    if (ends_in(path, ".json")) {
        struct amplify *world = NULL;
        if (!generate_spec_read(path, &field, &world)) return false;
        return world ? amplify_source(source, world) : relief_source_load(source, &field);
    }
    switch (file_source_open(source, path, memory_bytes, beside)) {
    case FILE_SOURCE_GOOD:
        return true;
    case FILE_SOURCE_BAD:
        return false;
    case FILE_SOURCE_WHOLE:
        break;
    }
    return heightfield_load(&field, path) && relief_source_load(source, &field);
}
