// SPDX-License-Identifier: MIT
#include "common/terrain/relief/relief_source.h"

#include "common/report.h"
#include "common/terrain/amplify.h"
#include "common/terrain/relief/relief_file.h"
#include "common/terrain/sidecar.h"
#include "common/terrain/sphere.h"
#include "common/terrain/upsample.h"
#include "common/terrain/voids.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

static uint64_t hashed(uint64_t hash, const void *data, size_t size) // FNV-1a over words of 4 bytes
{
    const uint8_t *at = data;
    for (size_t i = 0; i + 4 <= size; i += 4) {
        uint32_t word;
        memcpy(&word, at + i, 4);
        hash = (hash ^ word) * 0x100000001b3u;
    }
    return hash ^ hash >> 29;
}

static uint64_t identity_of(const struct relief_source *s, const void *more, size_t size)
{
    uint64_t hash = hashed(0xcbf29ce484222325u, s->size, sizeof s->size);
    hash = hashed(hash, s->spacing_m, sizeof s->spacing_m);
    hash = hashed(hash, &s->quantum_m, sizeof s->quantum_m);
    hash = hashed(hash, &s->offset_m, sizeof s->offset_m);
    hash = hashed(hash, &s->radius_m, sizeof s->radius_m);
    return hashed(hash, more, size);
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
    s->identity = identity_of(s, field->samples, count * sizeof *field->samples);
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

// ---- a raw file of 16-bit samples ------------------------------------------

struct raw_file {
    char path[1024];
    int file;
    struct sidecar sidecar;
};

static int32_t raw_sample(const struct raw_file *raw, const uint8_t *at)
{
    int big = raw->sidecar.big_endian;
    uint16_t word = (uint16_t)(at[!big] << 8 | at[big]);
    int32_t value = raw->sidecar.type == SIDECAR_INT16 ? (int16_t)word : (int32_t)word;
    return heightfield_is_void(value, raw->sidecar.has_nodata, raw->sidecar.nodata) ? HEIGHTFIELD_VOID
                                                                                    : value;
}

static bool raw_window(const struct relief_source *source, const struct patch *to)
{
    const struct raw_file *raw = source->data;
    int64_t count = rect_width(&to->rect);
    for (int64_t y = to->rect.y0; y < to->rect.y1; y++) {
        int32_t *row = patch_at(to, to->rect.x0, y);
        uint8_t *bytes = (uint8_t *)row + 2 * count; // the row's second half: read before it is written
        off_t offset = (off_t)(((source->size[1] - 1 - y) * source->size[0] + to->rect.x0) * 2);
        for (int64_t got = 0; got < 2 * count;) {
            ssize_t n = pread(raw->file, bytes + got, (size_t)(2 * count - got), offset + got);
            if (n < 0 && errno == EINTR) continue;
            if (n <= 0) return fail("%s: cannot be read (%s)", raw->path, n ? strerror(errno) : "cut short");
            got += n;
        }
        for (int64_t x = 0; x < count; x++) row[x] = raw_sample(raw, bytes + 2 * x);
    }
    return true;
}

static void finish_raw(struct relief_source *source)
{
    close(((struct raw_file *)source->data)->file);
    free(source->data);
}

static bool scan_raw(struct relief_source *s)
{
    struct patch row = {{0, 0, s->size[0], 1}, malloc((size_t)s->size[0] * sizeof(int32_t))};
    bool good = row.samples || fail("%s: a row does not fit in memory", s->name), void_found = false;
    for (; good && row.rect.y0 < s->size[1]; row.rect.y0++) {
        row.rect.y1 = row.rect.y0 + 1;
        good = raw_window(s, &row);
        for (int64_t x = 0; good && x < s->size[0]; x++) {
            int32_t size = row.samples[x] < 0 ? -row.samples[x] : row.samples[x];
            void_found |= row.samples[x] == HEIGHTFIELD_VOID;
            if (size > s->magnitude_q) s->magnitude_q = size;
        }
    }
    free(row.samples);
    if (good && void_found)
        good =
            fail("%s: has voids, which are filled only in maps that --memory holds whole (4 bytes a sample)",
                 ((struct raw_file *)s->data)->path);
    return good;
}

// Opens a raw file that is read by windows; *serves tells whether it is one and too large to load.
static bool open_raw(struct relief_source *s, const char *path, size_t memory_bytes, bool *serves)
{
    struct sidecar sidecar;
    struct stat status;
    struct heightfield map = {0};
    *serves = false;
    if (!heightfield_is_raw(path) || stat(path, &status) != 0 || (size_t)status.st_size <= memory_bytes / 8 ||
        sidecar_load(&sidecar, path) != SIDECAR_GOOD || sidecar.type == SIDECAR_FLOAT32 ||
        !sidecar.has_type || sidecar.width < 1 || sidecar.height < 1 ||
        (double)status.st_size != 2.0 * (double)sidecar.width * (double)sidecar.height)
        return true; // loading says what is wrong, if anything is
    map.width = sidecar.width, map.height = sidecar.height;
    heightfield_describe(&map, &sidecar);
    if (map.pixel_centred) return true;
    *serves = true;
    struct raw_file *raw = calloc(1, sizeof *raw);
    if (!raw) return fail("%s: out of memory", path);
    snprintf(raw->path, sizeof raw->path, "%s", path);
    raw->sidecar = sidecar;
    raw->file = open(path, O_RDONLY | O_CLOEXEC);
    if (raw->file < 0) {
        free(raw);
        return fail("%s: %s", path, strerror(errno));
    }
    const char *slash = strrchr(path, '/'), *name = slash ? slash + 1 : path, *dot = strrchr(name, '.');
    snprintf(s->name, sizeof s->name, "%.*s", (int)(dot - name), name);
    s->size[0] = sidecar.width, s->size[1] = sidecar.height;
    memcpy(s->spacing_m, map.spacing_m, sizeof s->spacing_m);
    s->quantum_m = map.quantum_m, s->offset_m = map.offset_m, s->radius_m = map.radius_m;
    s->data = raw;
    s->finish = finish_raw;
    s->window = raw_window;
    const int64_t file[4] = {status.st_size, status.st_mtim.tv_sec, status.st_mtim.tv_nsec,
                             (int64_t)status.st_ino};
    s->identity = identity_of(s, file, sizeof file);
    return scan_raw(s);
}

// ---- any -------------------------------------------------------------------

bool relief_source_open(struct relief_source *source, const char *path, size_t memory_bytes)
{
    struct heightfield field;
    bool serves = false;
    memset(source, 0, sizeof *source);
    if (ends_in(path, ".json")) {
        struct amplify *world = NULL;
        if (!generate_spec_read(path, &field, &world)) return false;
        return world ? amplify_source(source, world) : relief_source_load(source, &field);
    }
    if (open_raw(source, path, memory_bytes, &serves) && serves) return true;
    if (serves) {
        relief_source_finish(source);
        return false;
    }
    return heightfield_load(&field, path) && relief_source_load(source, &field);
}
