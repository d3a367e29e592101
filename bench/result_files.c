// SPDX-License-Identifier: MIT
#include "bench/result_files.h"
#include "common/image.h"
#include "common/report.h"

#include <dirent.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define COUNT(array) ((int)(sizeof(array) / sizeof(array)[0]))

const char *const moment_names[MOMENT_COUNT] = {"start", "middle", "worst"};

bool result_prepare_folder(const char *folder)
{
    char path[1024];
    if (strlen(folder) > 900 || !*folder) return fail("--out: the name of a folder is expected");
    snprintf(path, sizeof path, "%s", folder);
    for (char *c = path + 1; *c; c++)
        if (*c == '/') {
            *c = 0;
            mkdir(path, 0777); // what matters is whether the last one can be written
            *c = '/';
        }
    if (mkdir(path, 0777) != 0 && errno != EEXIST)
        return fail("--out %s: cannot be made (%s); a folder that can be written is expected", folder,
                    strerror(errno));
    snprintf(path, sizeof path, "%s/results.json.part", folder);
    FILE *probe = fopen(path, "wb");
    if (!probe)
        return fail("--out %s: cannot be written (%s); a folder that can be written is expected", folder,
                    strerror(errno));
    fclose(probe);
    unlink(path);
    return true;
}

bool result_write_text(const char *path, const char *text)
{
    char part[1100];
    snprintf(part, sizeof part, "%s.part", path);
    FILE *file = fopen(part, "wb");
    bool good = file && fputs(text, file) >= 0;
    if (file && fclose(file) != 0) good = false;
    if (good && rename(part, path) != 0) good = false;
    if (!good) {
        int error = errno;
        unlink(part);
        return fail("%s: cannot be written: %s", path, strerror(error));
    }
    return true;
}

static int csv_cell(char *out, size_t size, double value)
{
    return isfinite(value) ? snprintf(out, size, ",%.9g", value) : snprintf(out, size, ",");
}

double frame_tightness(const struct frame_record *record)
{
    return record->error_px_certain > 0 ? record->claimed_px / record->error_px_certain : (double)NAN;
}

bool result_write_csv(const struct setting *setting, const char *folder)
{
    static const char head[] =
        "frame,frame_ms,update_ms,draw_ms,wall_ms,worker_ms,roofline_ms,triangles,visible_triangles,"
        "draw_calls,upload_bytes,error_px_mean,error_px_p999,error_px_max,holes,misses,spills,"
        "temporal_px_p999,claimed_px,tightness\n";
    size_t size = sizeof head + (size_t)setting->frame_count * 512, length = sizeof head - 1;
    char *text = malloc(size), path[1024];
    if (!text) return fail("out of memory");
    memcpy(text, head, sizeof head);
    for (int i = 0; i < setting->frame_count; i++) {
        const struct frame_record *r = &setting->records[i];
        const double cells[] = {r->frame_ms,         r->update_ms,    r->draw_ms,        r->wall_ms,
                                r->worker_ms,        r->roofline_ms,  r->triangles,      r->visible_triangles,
                                r->draw_calls,       r->upload_bytes, r->error_px_mean,  r->error_px_p999,
                                r->error_px_max,     r->holes,        r->misses,         r->spills,
                                r->temporal_px_p999, r->claimed_px,   frame_tightness(r)};
        length += (size_t)snprintf(text + length, size - length, "%d", setting->frames[i]);
        for (int c = 0; c < COUNT(cells); c++)
            length += (size_t)csv_cell(text + length, size - length, cells[c]);
        length += (size_t)snprintf(text + length, size - length, "\n");
    }
    snprintf(path, sizeof path, "%s/frames/%s.csv", folder, setting->slug);
    bool good = result_write_text(path, text);
    free(text);
    return good;
}

bool result_write_pictures(const struct run *run, const struct setting *setting, const char *folder)
{
    int width = run->scene->width, height = run->scene->height;
    for (int m = 0; m < MOMENT_COUNT; m++) {
        const struct snapshot *snapshot = &setting->snapshots[m];
        char path[1024];
        if (snapshot->frame < 0) continue;
        snprintf(path, sizeof path, "%s/pictures/%s_%s.png", folder, setting->slug, moment_names[m]);
        if (!image_write_png(path, width, height, 4, snapshot->picture)) return false;
        snprintf(path, sizeof path, "%s/pictures/%s_%s_error.png", folder, setting->slug, moment_names[m]);
        if (!image_write_png(path, width, height, 3, snapshot->error)) return false;
    }
    return true;
}

// Files of an earlier run must not stand beside those of this one.
static void remove_files(const char *folder, const char *ending)
{
    DIR *directory = opendir(folder);
    for (struct dirent *entry; directory && (entry = readdir(directory));) {
        size_t length = strlen(entry->d_name), tail = strlen(ending);
        char path[2048];
        if (length <= tail || strcmp(entry->d_name + length - tail, ending) != 0) continue;
        snprintf(path, sizeof path, "%s/%s", folder, entry->d_name);
        unlink(path);
    }
    if (directory) closedir(directory);
}

bool result_make_folders(const char *folder)
{
    static const char *const names[] = {"frames", "pictures"}, *const endings[] = {".csv", ".png"};
    char path[1024];
    snprintf(path, sizeof path, "%s/results.json", folder);
    unlink(path);
    for (int i = 0; i < COUNT(names); i++) {
        snprintf(path, sizeof path, "%s/%s", folder, names[i]);
        if (mkdir(path, 0777) != 0 && errno != EEXIST)
            return fail("%s: cannot be made: %s", path, strerror(errno));
        remove_files(path, endings[i]);
    }
    return true;
}
