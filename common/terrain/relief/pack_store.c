// SPDX-License-Identifier: MIT
#include "common/terrain/relief/pack_store.h"

#include "common/report.h"
#include "common/terrain/relief/relief_format.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

static const char *const LEVEL_NAMES[STORE_LEVELS] = {"wanted", "level"};

static bool keep_error(struct pack_store *store, const char *name)
{
    int error = errno ? errno : EIO;
    pthread_mutex_lock(&store->lock);
    if (!store->error) {
        store->error = error;
        snprintf(store->wrong, sizeof store->wrong, "%s", name);
    }
    pthread_mutex_unlock(&store->lock);
    return false;
}

bool store_fail(struct pack_store *store)
{
    if (!store->error) return false;
    return fail("%s/%s: %s; what is done is kept, the same command goes on from there", store->folder,
                store->wrong, strerror(store->error));
}

static bool write_at(int file, const void *from, size_t size, uint64_t offset)
{
    for (size_t put = 0; put < size;) {
        ssize_t n = pwrite(file, (const char *)from + put, size - put, (off_t)(offset + put));
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) return false;
        put += (size_t)n;
    }
    return true;
}

static bool read_at(int file, void *to, size_t size, uint64_t offset)
{
    for (size_t got = 0; got < size;) {
        ssize_t n = pread(file, (char *)to + got, size - got, (off_t)(offset + got));
        if (n < 0 && errno == EINTR) continue;
        if (n == 0) errno = EIO;
        if (n <= 0) return false;
        got += (size_t)n;
    }
    return true;
}

// ---- the folder ------------------------------------------------------------

static void name_level(char name[32], enum store_level kind, int level)
{
    snprintf(name, 32, "%s-%02d", LEVEL_NAMES[kind], level);
}

static int open_in(const struct pack_store *store, const char *name)
{
    char path[4300];
    snprintf(path, sizeof path, "%s/%s", store->folder, name);
    return open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0666);
}

static void remove_in(const struct pack_store *store, const char *name)
{
    char path[4300];
    snprintf(path, sizeof path, "%s/%s", store->folder, name);
    unlink(path);
}

bool store_has_level(const struct pack_store *store, enum store_level kind, int level)
{
    char name[32], path[4300];
    name_level(name, kind, level);
    snprintf(path, sizeof path, "%s/%s", store->folder, name);
    return access(path, F_OK) == 0;
}

void store_drop_level(struct pack_store *store, enum store_level kind, int level)
{
    char name[32];
    if (store->levels[kind][level] >= 0) close(store->levels[kind][level]);
    store->levels[kind][level] = -1;
    name_level(name, kind, level);
    remove_in(store, name);
}

static void remove_levels(const struct pack_store *store, int kept)
{
    char name[32];
    for (int kind = 0; kind < STORE_LEVELS; kind++)
        for (int l = 0; l < LAYOUT_LEVELS; l++) {
            if (kind == STORE_WANTED && l == kept) continue;
            name_level(name, (enum store_level)kind, l);
            remove_in(store, name);
        }
}

static void close_levels(struct pack_store *store)
{
    for (int kind = 0; kind < STORE_LEVELS; kind++)
        for (int l = 0; l < LAYOUT_LEVELS; l++) {
            if (store->levels[kind][l] >= 0) close(store->levels[kind][l]);
            store->levels[kind][l] = -1;
        }
}

void store_drop_levels(struct pack_store *store, int kept)
{
    close_levels(store);
    remove_levels(store, kept);
}

void store_close(struct pack_store *store)
{
    close_levels(store);
    if (store->tiles >= 0) close(store->tiles);
    if (store->journal >= 0) close(store->journal);
    store->tiles = store->journal = -1;
    pthread_mutex_destroy(&store->lock);
}

void store_remove(struct pack_store *store)
{
    store_drop_levels(store, -1);
    remove_in(store, "out");
    remove_in(store, "tiles");
    remove_in(store, "journal"); // the last: without it nothing is believed
    rmdir(store->folder);
    store_close(store);
}

// ---- the journal -----------------------------------------------------------

static uint32_t record_crc(const struct store_record *record)
{
    return relief_crc((const uint8_t *)record, offsetof(struct store_record, crc));
}

// Records up to the first that is not whole; what follows is cut off.
static bool read_journal(struct pack_store *store, struct store_record **records, size_t *count)
{
    struct stat status;
    if (fstat(store->journal, &status) != 0) return keep_error(store, "journal");
    size_t most = (size_t)status.st_size / sizeof **records;
    *records = malloc((most + 1) * sizeof **records);
    if (!*records) return fail("%s: out of memory", store->folder);
    if (!read_at(store->journal, *records, most * sizeof **records, 0)) return keep_error(store, "journal");
    for (*count = 0; *count < most; ++*count)
        if ((*records)[*count].crc != record_crc(&(*records)[*count])) break;
    off_t end = (off_t)(*count * sizeof **records);
    return (ftruncate(store->journal, end) == 0 && lseek(store->journal, end, SEEK_SET) == end) ||
           keep_error(store, "journal");
}

bool store_note(struct pack_store *store, struct store_record *record)
{
    record->crc = record_crc(record);
    pthread_mutex_lock(&store->lock);
    ssize_t n = write(store->journal, record, sizeof *record);
    bool good = n == (ssize_t)sizeof *record;
    if (!good && n > 0) errno = ENOSPC;
    pthread_mutex_unlock(&store->lock);
    return good || keep_error(store, "journal");
}

bool store_open(struct pack_store *store, const char *path, bool restart, struct store_record **records,
                size_t *count)
{
    memset(store, 0, sizeof *store);
    memset(store->levels, -1, sizeof store->levels);
    store->journal = store->tiles = -1;
    pthread_mutex_init(&store->lock, NULL);
    if (strlen(path) >= sizeof store->path) return fail("%s: the name is too long", path);
    snprintf(store->path, sizeof store->path, "%s", path);
    snprintf(store->folder, sizeof store->folder, "%s.part", path);
    if (mkdir(store->folder, 0777) != 0 && errno != EEXIST)
        return fail("%s: cannot be made (%s)", store->folder, strerror(errno));
    store->journal = open_in(store, "journal");
    if (store->journal < 0)
        return fail("%s: cannot be worked in (%s); a folder of a pack begun earlier, or nothing, is accepted",
                    store->folder, strerror(errno));
    if (flock(store->journal, LOCK_EX | LOCK_NB) != 0)
        return fail("%s: another process packs there", store->folder);
    if (restart) {
        if (ftruncate(store->journal, 0) != 0) return keep_error(store, "journal") || store_fail(store);
        remove_levels(store, -1);
        remove_in(store, "tiles");
        remove_in(store, "out");
    }
    store->tiles = open_in(store, "tiles");
    if (store->tiles < 0) return keep_error(store, "tiles") || store_fail(store);
    return read_journal(store, records, count) || store_fail(store);
}

// ---- levels ----------------------------------------------------------------

static int level_file(struct pack_store *store, enum store_level kind, int level)
{
    pthread_mutex_lock(&store->lock);
    int *file = &store->levels[kind][level];
    char name[32];
    name_level(name, kind, level);
    if (*file < 0) *file = open_in(store, name);
    pthread_mutex_unlock(&store->lock);
    return *file;
}

static bool level_error(struct pack_store *store, enum store_level kind, int level)
{
    char name[32];
    int error = errno;
    name_level(name, kind, level);
    errno = error;
    return keep_error(store, name);
}

bool store_write_level(struct pack_store *store, enum store_level kind, int level, const struct patch *from,
                       const struct rect *part)
{
    int file = level_file(store, kind, level);
    if (file < 0) return level_error(store, kind, level);
    for (int64_t y = part->y0; y < part->y1; y++)
        if (!write_at(file, patch_at(from, part->x0, y), (size_t)rect_width(part) * sizeof(int32_t),
                      (uint64_t)(y * store->width[level] + part->x0) * sizeof(int32_t)))
            return level_error(store, kind, level);
    return true;
}

bool store_read_level(struct pack_store *store, enum store_level kind, int level, const struct patch *to)
{
    int file = level_file(store, kind, level);
    if (file < 0) return level_error(store, kind, level);
    const struct rect *r = &to->rect;
    for (int64_t y = r->y0; y < r->y1; y++)
        if (!read_at(file, patch_at(to, r->x0, y), (size_t)rect_width(r) * sizeof(int32_t),
                     (uint64_t)(y * store->width[level] + r->x0) * sizeof(int32_t)))
            return level_error(store, kind, level);
    return true;
}

// ---- tiles -----------------------------------------------------------------

bool store_add_tiles(struct pack_store *store, const void *data, size_t bytes, uint64_t *offset)
{
    pthread_mutex_lock(&store->lock);
    *offset = store->tiles_bytes;
    store->tiles_bytes += bytes;
    pthread_mutex_unlock(&store->lock);
    return write_at(store->tiles, data, bytes, *offset) || keep_error(store, "tiles");
}

bool store_read_tiles(struct pack_store *store, void *data, size_t bytes, uint64_t offset)
{
    return read_at(store->tiles, data, bytes, offset) || keep_error(store, "tiles");
}

bool store_forget_tiles(struct pack_store *store)
{
    store->tiles_bytes = 0;
    return ftruncate(store->tiles, 0) == 0 || keep_error(store, "tiles");
}
