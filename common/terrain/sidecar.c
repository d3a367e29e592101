// SPDX-License-Identifier: MIT
#include "common/terrain/sidecar.h"

#include "common/report.h"

#include <cjson/cJSON.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

struct sidecar sidecar_default(void)
{
    return (struct sidecar){.spacing_m = {30, 30}, .height_scale = 1};
}

void sidecar_path(const char *heights_path, char *path, size_t size)
{
    const char *slash = strrchr(heights_path, '/'), *name = slash ? slash + 1 : heights_path,
               *dot = strrchr(name, '.');
    int stem = (int)(dot && dot != name ? (size_t)(dot - heights_path) : strlen(heights_path));
    snprintf(path, size, "%.*s.json", stem, heights_path);
}

// A finite number, or the fallback when the key is absent.
static bool read_number(const cJSON *root, const char *path, const char *key, double *value)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(root, key);
    if (!item) return true;
    if (!cJSON_IsNumber(item) || !isfinite(item->valuedouble))
        return fail("%s: \"%s\" is not a number; a finite number is expected", path, key);
    *value = item->valuedouble;
    return true;
}

// Of a key that other maps may use in another form, which is then none of ours.
static double number_or_0(const cJSON *root, const char *key)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(root, key);
    return cJSON_IsNumber(item) && isfinite(item->valuedouble) ? item->valuedouble : 0;
}

static bool read_count(const cJSON *root, const char *path, const char *key, int64_t *count)
{
    double value = 0;
    if (!cJSON_HasObjectItem(root, key)) return true;
    if (!read_number(root, path, key, &value)) return false;
    if (value < 1 || value > 1e9 || value != floor(value))
        return fail("%s: \"%s\" is %g; a whole number of samples from 1 is expected", path, key, value);
    *count = (int64_t)value;
    return true;
}

// Degrees on a sphere of a known radius may stand in for metres.
static bool read_spacing(const cJSON *root, const char *path, const struct sidecar *sidecar,
                         double spacing_m[2])
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(root, "spacing_m");
    if (!item && sidecar->radius_m > 0 && sidecar->spacing_deg > 0) {
        spacing_m[0] = spacing_m[1] = sidecar->radius_m * sidecar->spacing_deg * 0.017453292519943295;
        return true;
    }
    if (!item)
        return fail("%s: lacks \"spacing_m\"; metres between samples, a number or [x, y], are expected",
                    path);
    bool pair = cJSON_IsArray(item) && cJSON_GetArraySize(item) == 2;
    for (int axis = 0; axis < 2; axis++) {
        const cJSON *number = pair ? cJSON_GetArrayItem(item, axis) : item;
        if (!cJSON_IsNumber(number) || !(number->valuedouble > 0) || !isfinite(number->valuedouble))
            return fail("%s: \"spacing_m\" is not a positive number or a pair [x, y] of them", path);
        spacing_m[axis] = number->valuedouble;
    }
    return true;
}

static bool read_type(const cJSON *root, const char *path, struct sidecar *sidecar)
{
    static const char *const NAMES[] = {"uint16", "int16", "float32"};
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(root, "dtype");
    if (!item) return true;
    for (int i = 0; i < 3; i++)
        if (cJSON_IsString(item) && strcmp(item->valuestring, NAMES[i]) == 0) {
            sidecar->type = (enum sidecar_type)i;
            sidecar->has_type = true;
            return true;
        }
    return fail("%s: \"dtype\" is not known; \"uint16\", \"int16\" or \"float32\" is expected", path);
}

static bool read_endian(const cJSON *root, const char *path, bool *big_endian)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(root, "endian");
    if (!item) return true;
    *big_endian = cJSON_IsString(item) && strcmp(item->valuestring, "big") == 0;
    if (*big_endian || (cJSON_IsString(item) && strcmp(item->valuestring, "little") == 0)) return true;
    return fail("%s: \"endian\" is not known; \"little\" or \"big\" is expected", path);
}

static bool read_nodata(const cJSON *root, const char *path, struct sidecar *sidecar)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(root, "nodata");
    if (!item || cJSON_IsNull(item)) return true;
    if (cJSON_IsString(item) && strcasecmp(item->valuestring, "nan") == 0) return true; // NaN is always void
    sidecar->has_nodata = true;
    return read_number(root, path, "nodata", &sidecar->nodata);
}

static bool read_keys(const cJSON *root, const char *path, struct sidecar *sidecar)
{
    if (!cJSON_IsObject(root))
        return fail("%s: not JSON; an object with the key \"spacing_m\" is expected", path);
    sidecar->radius_m = number_or_0(root, "radius_m");
    sidecar->spacing_deg = number_or_0(root, "spacing_deg");
    if (!read_count(root, path, "width", &sidecar->width) ||
        !read_count(root, path, "height", &sidecar->height) ||
        !read_spacing(root, path, sidecar, sidecar->spacing_m) || !read_type(root, path, sidecar) ||
        !read_endian(root, path, &sidecar->big_endian) || !read_nodata(root, path, sidecar) ||
        !read_number(root, path, "height_scale", &sidecar->height_scale) ||
        !read_number(root, path, "height_offset", &sidecar->height_offset))
        return false;
    return sidecar->height_scale > 0 ||
           fail("%s: \"height_scale\" is %g; a positive number of metres is expected", path,
                sidecar->height_scale);
}

bool sidecar_parse(struct sidecar *sidecar, const char *path, const char *text, size_t size)
{
    *sidecar = sidecar_default();
    cJSON *root = cJSON_ParseWithLength(text, size);
    bool good = read_keys(root, path, sidecar);
    cJSON_Delete(root);
    return good;
}

enum sidecar_found sidecar_load(struct sidecar *sidecar, const char *heights_path)
{
    enum { LARGEST = 1 << 20 };
    char path[4096];
    sidecar_path(heights_path, path, sizeof path);
    FILE *file = fopen(path, "rb");
    if (!file && errno == ENOENT) return SIDECAR_ABSENT;
    if (!file) return fail("%s: %s; a JSON file is expected", path, strerror(errno)), SIDECAR_BAD;
    char *text = malloc(LARGEST);
    size_t size = text ? fread(text, 1, LARGEST, file) : 0;
    bool good = text && !ferror(file) && size < LARGEST;
    fclose(file);
    if (!good)
        fail("%s: cannot be read; a JSON file of less than a megabyte is expected", path);
    else
        good = sidecar_parse(sidecar, path, text, size);
    free(text);
    return good ? SIDECAR_GOOD : SIDECAR_BAD;
}

bool sidecar_agrees(const struct sidecar *sidecar, const char *heights_path, int64_t width, int64_t height)
{
    if ((sidecar->width == 0 || sidecar->width == width) &&
        (sidecar->height == 0 || sidecar->height == height))
        return true;
    return fail("%s: holds %lld x %lld samples, but its sidecar says %lld x %lld; they must agree",
                heights_path, (long long)width, (long long)height,
                (long long)(sidecar->width ? sidecar->width : width),
                (long long)(sidecar->height ? sidecar->height : height));
}
