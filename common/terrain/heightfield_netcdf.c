// SPDX-License-Identifier: MIT
#include "common/terrain/heightfield_netcdf.h"

#include "common/report.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_DIMENSIONS = 64, MOST_VARIABLES = 64, NAME = 64 };
enum { TAG_DIMENSIONS = 10, TAG_VARIABLES = 11, TAG_ATTRIBUTES = 12 };
enum { TYPE_BYTE = 1, TYPE_CHAR, TYPE_SHORT, TYPE_INT, TYPE_FLOAT, TYPE_DOUBLE };

struct variable {
    char name[NAME];
    int dimensions[2], dimension_count, type;
    bool has_fill;
    double fill;
    uint64_t begin;
};

struct netcdf {
    const unsigned char *data;
    size_t size, at;
    bool good; // nothing was read beyond the end so far
    int offset_bytes;
    struct {
        char name[NAME];
        int64_t length;
    } dimensions[MOST_DIMENSIONS];
    int dimension_count;
    struct variable variables[MOST_VARIABLES];
    int variable_count;
};

// ---- the header ------------------------------------------------------------

static uint64_t word_at(const unsigned char *data, int bytes)
{
    uint64_t word = 0;
    for (int k = 0; k < bytes; k++) word = word << 8 | data[k];
    return word;
}

static uint64_t take_word(struct netcdf *n, int bytes)
{
    n->good = n->good && n->size - n->at >= (size_t)bytes;
    if (!n->good) return 0;
    n->at += (size_t)bytes;
    return word_at(n->data + n->at - bytes, bytes);
}

static void skip(struct netcdf *n, uint64_t bytes)
{
    bytes = (bytes + 3) / 4 * 4;
    n->good = n->good && bytes <= n->size - n->at;
    if (n->good) n->at += (size_t)bytes;
}

static void take_name(struct netcdf *n, char name[NAME])
{
    uint64_t length = take_word(n, 4), kept = length < NAME - 1 ? length : NAME - 1;
    const unsigned char *from = n->data + n->at;
    skip(n, length);
    name[0] = 0;
    if (!n->good) return;
    memcpy(name, from, (size_t)kept);
    name[kept] = 0;
}

// How many entries a list has: its tag and their number, or twice 0.
static uint64_t take_list(struct netcdf *n, uint64_t tag)
{
    uint64_t found = take_word(n, 4), count = take_word(n, 4);
    n->good = n->good && (found == tag || (found == 0 && count == 0));
    return n->good ? count : 0;
}

static int type_bytes(uint64_t type)
{
    static const int BYTES[] = {0, 1, 1, 2, 4, 4, 8};
    return type <= TYPE_DOUBLE ? BYTES[type] : 0;
}

static double number_at(const unsigned char *data, int type)
{
    uint64_t word = word_at(data, type_bytes((uint64_t)type));
    uint32_t half = (uint32_t)word;
    float single;
    double number;
    switch (type) {
    case TYPE_BYTE:
        return (int8_t)word;
    case TYPE_SHORT:
        return (int16_t)word;
    case TYPE_INT:
        return (int32_t)word;
    case TYPE_FLOAT:
        memcpy(&single, &half, sizeof single);
        return (double)single;
    case TYPE_DOUBLE:
        memcpy(&number, &word, sizeof number);
        return number;
    default:
        return NAN;
    }
}

// variable: NULL for those of the file.
static void take_attributes(struct netcdf *n, struct variable *variable)
{
    uint64_t count = take_list(n, TAG_ATTRIBUTES);
    for (uint64_t k = 0; k < count && n->good; k++) {
        char name[NAME];
        take_name(n, name);
        uint64_t type = take_word(n, 4), length = take_word(n, 4);
        const unsigned char *values = n->data + n->at;
        int bytes = type_bytes(type);
        n->good = n->good && bytes > 0 && length <= n->size;
        skip(n, length * (uint64_t)bytes);
        bool fill = strcmp(name, "_FillValue") == 0 || strcmp(name, "missing_value") == 0;
        if (!n->good || !variable || !fill || length < 1 || type == TYPE_CHAR) continue;
        variable->has_fill = true;
        variable->fill = number_at(values, (int)type);
    }
}

static void take_variable(struct netcdf *n, struct variable *variable)
{
    take_name(n, variable->name);
    uint64_t dimensions = take_word(n, 4);
    n->good = n->good && dimensions <= MOST_DIMENSIONS;
    variable->dimension_count = (int)dimensions;
    for (uint64_t k = 0; k < dimensions && n->good; k++) {
        uint64_t dimension = take_word(n, 4);
        n->good = n->good && dimension < (uint64_t)n->dimension_count;
        if (k < 2) variable->dimensions[k] = (int)dimension;
    }
    take_attributes(n, variable);
    uint64_t type = take_word(n, 4);
    take_word(n, 4); // its size, which is rounded up
    variable->begin = take_word(n, n->offset_bytes);
    variable->type = (int)type;
    n->good = n->good && type_bytes(type) > 0;
}

static bool take_header(struct netcdf *n)
{
    if (n->size < 8 || memcmp(n->data, "CDF", 3) != 0 || (n->data[3] != 1 && n->data[3] != 2)) return false;
    n->offset_bytes = n->data[3] == 1 ? 4 : 8;
    n->at = 8; // behind the number of records
    n->good = true;
    uint64_t count = take_list(n, TAG_DIMENSIONS);
    n->good = n->good && count <= MOST_DIMENSIONS;
    for (n->dimension_count = 0; n->good && n->dimension_count < (int)count; n->dimension_count++) {
        take_name(n, n->dimensions[n->dimension_count].name);
        n->dimensions[n->dimension_count].length = (int64_t)take_word(n, 4);
    }
    take_attributes(n, NULL);
    count = take_list(n, TAG_VARIABLES);
    n->good = n->good && count <= MOST_VARIABLES;
    for (n->variable_count = 0; n->good && n->variable_count < (int)count; n->variable_count++)
        take_variable(n, &n->variables[n->variable_count]);
    return n->good;
}

// ---- the map ---------------------------------------------------------------

static bool is_whole(const struct netcdf *n, const struct variable *variable, int64_t count)
{
    uint64_t bytes = (uint64_t)count * (uint64_t)type_bytes((uint64_t)variable->type);
    return variable->begin <= n->size && bytes <= n->size - variable->begin;
}

static double value(const struct netcdf *n, const struct variable *variable, int64_t index)
{
    int bytes = type_bytes((uint64_t)variable->type);
    return number_at(n->data + variable->begin + (uint64_t)index * (uint64_t)bytes, variable->type);
}

// First value and spacing of the coordinate variable that bears a dimension's name.
static bool find_axis(const struct netcdf *n, int dimension, double *first, double *step)
{
    int64_t length = n->dimensions[dimension].length;
    for (int k = 0; k < n->variable_count; k++) {
        const struct variable *v = &n->variables[k];
        if (v->dimension_count != 1 || v->dimensions[0] != dimension || !is_whole(n, v, length) ||
            strcmp(v->name, n->dimensions[dimension].name) != 0)
            continue;
        *first = value(n, v, 0);
        *step = (value(n, v, length - 1) - *first) / (double)(length - 1);
        return isfinite(*first) && isfinite(*step) && *step != 0;
    }
    return false;
}

// Where the file says what stands for a void, -9999 is a depth.
static bool is_void(const struct variable *map, double raw)
{
    if (!map->has_fill) return heightfield_is_void(raw, false, 0);
    return !(fabs(raw) < 1e30) || raw == map->fill;
}

static bool take_map(struct heightfield *field, const char *path, const struct netcdf *n,
                     const struct variable *map)
{
    double first[2], step[2]; // latitude, longitude
    int64_t height = n->dimensions[map->dimensions[0]].length,
            width = n->dimensions[map->dimensions[1]].length;
    if (width < 2 || height < 2 || width > INT32_MAX || height > INT32_MAX ||
        !is_whole(n, map, width * height))
        return fail("%s: holds less than the %lld x %lld heights that it tells of", path, (long long)width,
                    (long long)height);
    for (int k = 0; k < 2; k++)
        if (!find_axis(n, map->dimensions[k], &first[k], &step[k]))
            return fail("%s: no values are given along %s; degrees are expected", path,
                        n->dimensions[map->dimensions[k]].name);
    double *heights = malloc((size_t)(width * height) * sizeof *heights);
    if (!heights) return fail("%s: does not fit in memory", path);
    // All around, within half a sample: some files' degrees are rounded.
    bool around = step[1] > 0 && fabs((double)width * step[1] - 360) < 0.5 * step[1];
    int64_t turn = around ? llround((-180 - first[1]) / step[1]) : 0; // column that comes first
    for (int64_t y = 0; y < height; y++)
        for (int64_t x = 0; x < width; x++) {
            int64_t from = ((x + turn) % width + width) % width, row = step[0] > 0 ? y : height - 1 - y;
            double raw = value(n, map, row * width + from);
            heights[y * width + x] = is_void(map, raw) ? (double)NAN : raw;
        }
    field->width = width;
    field->height = height;
    struct sidecar sidecar = sidecar_default();
    double degree_m = M_PI / 180 * HEIGHTFIELD_EARTH_RADIUS_M;
    double middle = first[0] + 0.5 * step[0] * (double)(height - 1);
    sidecar.spacing_m[0] = fabs(step[1]) * degree_m * cos(M_PI / 180 * middle);
    sidecar.spacing_m[1] = fabs(step[0]) * degree_m;
    if (around) sidecar.radius_m = HEIGHTFIELD_EARTH_RADIUS_M, sidecar.spacing_deg = 360.0 / (double)width;
    heightfield_describe(field, &sidecar);
    bool good = heightfield_quantise(field, heights, HEIGHTFIELD_FLOAT_BITS);
    free(heights);
    return good;
}

bool heightfield_load_netcdf(struct heightfield *field, const char *path, const unsigned char *data,
                             size_t size)
{
    struct netcdf *n = calloc(1, sizeof *n);
    if (!n) return fail("%s: out of memory", path);
    n->data = data;
    n->size = size;
    bool good = take_header(n);
    const struct variable *map = NULL;
    for (int k = 0; good && k < n->variable_count && !map; k++)
        if (n->variables[k].dimension_count == 2 && n->variables[k].type != TYPE_CHAR) map = &n->variables[k];
    if (!good)
        fail("%s: not a file of NetCDF's classic format, or a harmed one", path);
    else if (!map)
        good = fail("%s: has no variable over two dimensions", path);
    else
        good = take_map(field, path, n, map);
    free(n);
    return good;
}
