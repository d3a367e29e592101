// SPDX-License-Identifier: MIT
#include "common/terrain/heightfield.h"

#include "common/image.h"
#include "common/report.h"
#include "common/terrain/sidecar.h"

#include <cjson/cJSON.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { NODATA = 65535 };

// sample = (q - base) / step, rounded
struct packing {
    int32_t base;
    int64_t step;
    bool has_voids;
};

// Samples are kept as they are where they fit; else they start at 0, and if they must they are rounded.
static struct packing choose_packing(const struct heightfield *field, const char *path)
{
    struct packing packing = {0, 1, false};
    int32_t low = INT32_MAX, high = INT32_MIN;
    for (int64_t i = 0; i < field->width * field->height; i++) {
        int32_t q = field->samples[i];
        packing.has_voids |= q == HEIGHTFIELD_VOID;
        if (q == HEIGHTFIELD_VOID) continue;
        low = q < low ? q : low;
        high = q > high ? q : high;
    }
    int64_t most = packing.has_voids ? NODATA - 1 : NODATA;
    if (low > high || (low >= 0 && high <= most)) return packing;
    packing.base = low;
    packing.step = ((int64_t)high - low + most - 1) / most;
    if (packing.step < 1) packing.step = 1;
    if (packing.step > 1)
        note("%s: heights are rounded to steps of %g m, so that 16 bits hold them", path,
             field->quantum_m * (double)packing.step);
    return packing;
}

static uint16_t *pack(const struct heightfield *field, const struct packing *packing)
{
    uint16_t *out = malloc((size_t)field->width * (size_t)field->height * sizeof *out);
    for (int64_t y = 0; out && y < field->height; y++)
        for (int64_t x = 0; x < field->width; x++) {
            int32_t q = field->samples[y * field->width + x];
            uint16_t *to = &out[(field->height - 1 - y) * field->width + x];
            *to = q == HEIGHTFIELD_VOID
                      ? NODATA
                      : (uint16_t)(((int64_t)q - packing->base + packing->step / 2) / packing->step);
        }
    return out;
}

static char *describe(const struct heightfield *field, const struct packing *packing, const char *path,
                      const char *origin)
{
    const char *slash = strrchr(path, '/');
    cJSON *root = cJSON_CreateObject();
    cJSON_AddStringToObject(root, "file", slash ? slash + 1 : path);
    cJSON_AddNumberToObject(root, "width", (double)field->width);
    cJSON_AddNumberToObject(root, "height", (double)field->height);
    cJSON_AddStringToObject(root, "dtype", "uint16");
    cJSON_AddStringToObject(root, "encoding", "height_m = sample*height_scale + height_offset");
    cJSON_AddNumberToObject(root, "height_scale", field->quantum_m * (double)packing->step);
    cJSON_AddNumberToObject(root, "height_offset", field->offset_m + packing->base * field->quantum_m);
    if (packing->has_voids)
        cJSON_AddNumberToObject(root, "nodata", NODATA);
    else
        cJSON_AddNullToObject(root, "nodata");
    cJSON_AddItemToObject(root, "spacing_m", cJSON_CreateDoubleArray(field->spacing_m, 2));
    if (field->radius_m > 0) { // a whole planet
        cJSON_AddNumberToObject(root, "radius_m", field->radius_m);
        cJSON_AddNumberToObject(root, "spacing_deg", 360.0 / (double)field->width);
    }
    cJSON_AddStringToObject(root, "source", origin);
    char *text = cJSON_Print(root);
    cJSON_Delete(root);
    return text;
}

static bool write_text(const char *path, const char *text)
{
    FILE *file = fopen(path, "w");
    if (!file) return false;
    bool good = fputs(text, file) >= 0 && fputc('\n', file) != EOF;
    return (fclose(file) == 0) && good;
}

bool heightfield_save(const struct heightfield *field, const char *path, const char *origin)
{
    char side[4096], new_side[4160], new_png[4160];
    if (strlen(path) < 5 || strcmp(path + strlen(path) - 4, ".png") != 0 || strlen(path) >= sizeof side)
        return fail("%s: a name that ends in .png is expected", path);
    sidecar_path(path, side, sizeof side);
    snprintf(new_side, sizeof new_side, "%s.%ld.part", side, (long)getpid());
    snprintf(new_png, sizeof new_png, "%s.%ld.part", path, (long)getpid());
    struct packing packing = choose_packing(field, path);
    char *text = describe(field, &packing, path, origin);
    uint16_t *samples = pack(field, &packing);
    bool good = text && samples;
    if (!good) fail("%s: out of memory", path);
    // Both files are written before either takes its name.
    if (good && !write_text(new_side, text)) good = fail("%s: cannot be written (%s)", side, strerror(errno));
    if (good) good = image_write_grey16(new_png, (int)field->width, (int)field->height, samples);
    if (good && rename(new_side, side) != 0) good = fail("%s: cannot be written (%s)", side, strerror(errno));
    if (good && rename(new_png, path) != 0) {
        good = fail("%s: cannot be written (%s)", path, strerror(errno));
        unlink(side);
    }
    if (!good) {
        unlink(new_side);
        unlink(new_png);
    }
    cJSON_free(text);
    free(samples);
    return good;
}
