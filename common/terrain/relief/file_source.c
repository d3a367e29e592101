// SPDX-License-Identifier: MIT
#include "common/terrain/relief/file_source.h"

#include "common/image.h"
#include "common/report.h"
#include "common/terrain/sidecar.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

enum kind { KIND_RAW, KIND_HGT, KIND_PNG };

struct plain { // rows from the north, as the sidecar says
    char path[4096];
    int file;
    enum kind kind;
    struct sidecar sidecar;
    bool assumed; // what the file does not tell
};

// ---- windows ---------------------------------------------------------------

static int32_t sample_of(const struct sidecar *sidecar, const uint8_t *at)
{
    int big = sidecar->big_endian;
    uint16_t word = (uint16_t)(at[!big] << 8 | at[big]);
    int32_t value = sidecar->type == SIDECAR_INT16 ? (int16_t)word : (int32_t)word;
    return heightfield_is_void(value, sidecar->has_nodata, sidecar->nodata) ? HEIGHTFIELD_VOID : value;
}

static bool plain_window(const struct relief_source *source, const struct patch *to)
{
    const struct plain *plain = source->data;
    int64_t count = rect_width(&to->rect);
    for (int64_t y = to->rect.y0; y < to->rect.y1; y++) {
        int32_t *row = patch_at(to, to->rect.x0, y);
        uint8_t *bytes = (uint8_t *)row + 2 * count; // the row's second half: read before it is written
        off_t offset = (off_t)(((source->size[1] - 1 - y) * source->size[0] + to->rect.x0) * 2);
        for (int64_t got = 0; got < 2 * count;) {
            ssize_t n = pread(plain->file, bytes + got, (size_t)(2 * count - got), offset + got);
            if (n < 0 && errno == EINTR) continue;
            if (n <= 0)
                return fail("%s: cannot be read (%s)", plain->path, n ? strerror(errno) : "cut short");
            got += n;
        }
        for (int64_t x = 0; x < count; x++) row[x] = sample_of(&plain->sidecar, bytes + 2 * x);
    }
    return true;
}

static void finish_plain(struct relief_source *source)
{
    close(((struct plain *)source->data)->file);
    free(source->data);
}

// ---- what it is ------------------------------------------------------------

static enum file_source whole(const char *path, const char *why)
{
    note("%s: %s; the map is held in memory whole, beside what --memory allows", path, why);
    return FILE_SOURCE_WHOLE;
}

static bool ends_in(const char *path, const char *ending)
{
    size_t length = strlen(path), tail = strlen(ending);
    return length >= tail && strcasecmp(path + length - tail, ending) == 0;
}

static enum file_source describe_raw(struct plain *plain, size_t size)
{
    const struct sidecar *s = &plain->sidecar;
    enum sidecar_found found = sidecar_load(&plain->sidecar, plain->path);
    if (found == SIDECAR_BAD) return FILE_SOURCE_BAD;
    bool serves = found == SIDECAR_GOOD && s->has_type && s->type != SIDECAR_FLOAT32 && s->width > 0 &&
                  s->height > 0 && (double)size == 2.0 * (double)s->width * (double)s->height;
    return serves ? FILE_SOURCE_GOOD : FILE_SOURCE_WHOLE; // loading says what is wrong, if anything is
}

static enum file_source describe_png(struct plain *plain, size_t small_bytes)
{
    int width, height;
    bool interlaced;
    if (!image_size_grey16(plain->path, &width, &height, &interlaced) ||
        (size_t)width * (size_t)height * 2 <= small_bytes)
        return FILE_SOURCE_WHOLE;
    plain->sidecar = sidecar_default();
    enum sidecar_found found = sidecar_load(&plain->sidecar, plain->path);
    if (found == SIDECAR_BAD) return FILE_SOURCE_BAD;
    if (plain->sidecar.type == SIDECAR_FLOAT32) return FILE_SOURCE_WHOLE;
    if (!sidecar_agrees(&plain->sidecar, plain->path, width, height)) return FILE_SOURCE_BAD;
    if (interlaced) return whole(plain->path, "is interlaced");
    plain->sidecar.width = width, plain->sidecar.height = height;
    plain->sidecar.big_endian = true; // as a PNG's samples are written out
    plain->assumed = found == SIDECAR_ABSENT;
    return FILE_SOURCE_GOOD;
}

static enum file_source describe(struct plain *plain, size_t memory_bytes)
{
    enum { SMALL = 64 }; // a part of the ceiling that whole maps may take beside it
    struct stat status;
    const char *path = plain->path;
    if (ends_in(path, ".png")) {
        plain->kind = KIND_PNG;
        return describe_png(plain, memory_bytes / SMALL);
    }
    bool hgt = ends_in(path, ".hgt");
    if ((!hgt && !heightfield_is_raw(path)) || stat(path, &status) != 0 || !S_ISREG(status.st_mode) ||
        (size_t)status.st_size <= memory_bytes / SMALL)
        return FILE_SOURCE_WHOLE;
    plain->kind = hgt ? KIND_HGT : KIND_RAW;
    if (!hgt) return describe_raw(plain, (size_t)status.st_size);
    bool placed;
    if (!heightfield_describe_hgt(path, (size_t)status.st_size, &plain->sidecar, &placed))
        return FILE_SOURCE_BAD;
    plain->assumed = !placed;
    return FILE_SOURCE_GOOD;
}

// ---- opening ---------------------------------------------------------------

// The PNG's samples in a file without a name: whoever is killed leaves nothing.  -1 after one line on stderr.
static int written_out(const char *path, const char *beside)
{
    char name[4200];
    snprintf(name, sizeof name, "%s.samples-XXXXXX", beside ? beside : path);
    int file = mkstemp(name);
    if (file < 0)
        return fail("%s: %s; a file of the map's samples is to stand there", name, strerror(errno)), -1;
    unlink(name);
    if (image_copy_grey16(path, file)) return file;
    close(file);
    return -1;
}

static int open_plain(const struct plain *plain, const char *beside)
{
    if (plain->kind == KIND_PNG) return written_out(plain->path, beside);
    int file = open(plain->path, O_RDONLY | O_CLOEXEC);
    if (file < 0) fail("%s: %s", plain->path, strerror(errno));
    return file;
}

// Reads all of it, for its identity, its largest sample and whether it has voids.
static bool scan(struct relief_source *s, bool *void_found)
{
    struct patch row = {{0, 0, s->size[0], 1}, malloc((size_t)s->size[0] * sizeof(int32_t))};
    bool good = row.samples || fail("%s: a row does not fit in memory", s->name);
    for (s->identity = relief_source_described(s); good && row.rect.y0 < s->size[1]; row.rect.y0++) {
        row.rect.y1 = row.rect.y0 + 1;
        good = plain_window(s, &row);
        for (int64_t x = 0; good && x < s->size[0]; x++) {
            int32_t q = row.samples[x];
            if (q == HEIGHTFIELD_VOID)
                *void_found = true;
            else if (abs(q) > s->magnitude_q)
                s->magnitude_q = abs(q);
        }
        if (good)
            s->identity =
                relief_source_hashed(s->identity, row.samples, (size_t)s->size[0] * sizeof *row.samples);
    }
    free(row.samples);
    return good;
}

static void take(struct relief_source *s, struct plain *plain, const struct heightfield *map)
{
    const char *slash = strrchr(plain->path, '/'), *name = slash ? slash + 1 : plain->path;
    const char *dot = strrchr(name, '.');
    snprintf(s->name, sizeof s->name, "%.*s", dot != name ? (int)(dot - name) : (int)strlen(name), name);
    s->size[0] = map->width, s->size[1] = map->height;
    memcpy(s->spacing_m, map->spacing_m, sizeof s->spacing_m);
    s->quantum_m = map->quantum_m, s->offset_m = map->offset_m, s->radius_m = map->radius_m;
    s->data = plain;
    s->finish = finish_plain;
    s->window = plain_window;
}

static enum file_source open_source(struct relief_source *s, struct plain *plain, size_t memory_bytes)
{
    bool void_found = false,
         too_large = 2 * (double)s->size[0] * (double)s->size[1] > (double)memory_bytes / 8;
    if (s->radius_m > 0 && !relief_is_planet(s->name, s->size[0], s->size[1])) return FILE_SOURCE_BAD;
    if (!scan(s, &void_found)) return FILE_SOURCE_BAD;
    if (void_found && plain->kind == KIND_RAW && too_large)
        return fail("%s: has voids, which are filled only in maps that --memory holds whole (4 bytes a "
                    "sample)",
                    plain->path),
               FILE_SOURCE_BAD;
    if (void_found) return whole(plain->path, "has voids, and filling them takes all of it");
    if (plain->assumed) heightfield_note_assumed(plain->path, &plain->sidecar);
    return FILE_SOURCE_GOOD;
}

enum file_source file_source_open(struct relief_source *source, const char *path, size_t memory_bytes,
                                  const char *beside)
{
    struct plain *plain = calloc(1, sizeof *plain);
    if (!plain) return fail("%s: out of memory", path), FILE_SOURCE_BAD;
    snprintf(plain->path, sizeof plain->path, "%s", path);
    enum file_source found = describe(plain, memory_bytes);
    struct heightfield map = {.width = plain->sidecar.width, .height = plain->sidecar.height};
    if (found == FILE_SOURCE_GOOD) {
        heightfield_describe(&map, &plain->sidecar);
        if (map.pixel_centred) found = whole(path, "is a planet whose samples are the middles of cells");
    }
    if (found == FILE_SOURCE_GOOD && (plain->file = open_plain(plain, beside)) < 0) found = FILE_SOURCE_BAD;
    if (found != FILE_SOURCE_GOOD) {
        free(plain);
        return found;
    }
    take(source, plain, &map);
    found = open_source(source, plain, memory_bytes);
    if (found != FILE_SOURCE_GOOD) relief_source_finish(source);
    return found;
}
