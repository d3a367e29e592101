// SPDX-License-Identifier: MIT
#include "common/terrain/heightfield.h"

#include "common/image.h"
#include "common/report.h"
#include "common/terrain/heightfield_gdal.h"
#include "common/terrain/heightfield_netcdf.h"
#include "common/terrain/relief/relief_file.h"
#include "common/terrain/sidecar.h"

#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

static const double DEGREE = 0.017453292519943295;

// ---- names -----------------------------------------------------------------

static const char *file_name(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

static bool ends_in(const char *path, const char *ending)
{
    size_t length = strlen(path), tail = strlen(ending);
    return length >= tail && strcasecmp(path + length - tail, ending) == 0;
}

static void name_field(struct heightfield *field, const char *path)
{
    const char *name = file_name(path), *dot = strrchr(name, '.');
    int length = dot && dot != name ? (int)(dot - name) : (int)strlen(name);
    snprintf(field->name, sizeof field->name, "%.*s", length, name);
}

// ---- files -----------------------------------------------------------------

// The whole file, with a zero byte behind it; NULL after one line on stderr.
static void *read_whole(const char *path, const char *expected, size_t *size)
{
    FILE *file = fopen(path, "rb");
    unsigned char *data = NULL;
    long length = -1;
    if (file && fseek(file, 0, SEEK_END) == 0) length = ftell(file);
    if (length == LONG_MAX) errno = EISDIR;
    if (length >= 0 && length < LONG_MAX && fseek(file, 0, SEEK_SET) == 0) data = malloc((size_t)length + 1);
    if (data && fread(data, 1, (size_t)length, file) != (size_t)length) {
        free(data);
        data = NULL;
        errno = errno ? errno : EIO;
    }
    if (!data) fail("%s: %s; %s is expected", path, strerror(errno), expected);
    if (file) fclose(file);
    if (!data) return NULL;
    data[length] = 0;
    *size = (size_t)length;
    return data;
}

static bool allocate(struct heightfield *field, const char *path)
{
    field->samples = malloc((size_t)field->width * (size_t)field->height * sizeof *field->samples);
    return field->samples || fail("%s: %lld x %lld samples do not fit in memory", path,
                                  (long long)field->width, (long long)field->height);
}

void heightfield_finish(struct heightfield *field)
{
    free(field->samples);
    memset(field, 0, sizeof *field);
}

// ---- 16-bit samples --------------------------------------------------------

bool heightfield_is_void(double raw, bool has_nodata, double nodata)
{
    return !isfinite(raw) || fabs(raw) >= 1e30 || raw == -32768 || raw == -9999 ||
           (has_nodata && raw == nodata);
}

static int32_t decode(uint16_t raw, const struct sidecar *sidecar)
{
    int32_t value =
        sidecar->type == SIDECAR_INT16 ? (int16_t)raw : (int32_t)raw; // unsigned: never -32768 or -9999
    return heightfield_is_void(value, sidecar->has_nodata, sidecar->nodata) ? HEIGHTFIELD_VOID : value;
}

// A whole planet, when the sidecar's samples go all around and from pole to pole.
static void describe_planet(struct heightfield *field, const struct sidecar *sidecar)
{
    double turn = (double)field->width * sidecar->spacing_deg, rows = 180 / sidecar->spacing_deg;
    if (!(sidecar->radius_m > 0) || !(sidecar->spacing_deg > 0) || fabs(turn - 360) > 1e-6) return;
    bool pixels = fabs((double)field->height - rows) < 1e-3;
    if (!pixels && fabs((double)(field->height - 1) - rows) >= 1e-3) return;
    field->radius_m = sidecar->radius_m;
    field->pixel_centred = pixels;
    field->spacing_m[0] = field->spacing_m[1] = sidecar->radius_m * sidecar->spacing_deg * DEGREE;
}

void heightfield_describe(struct heightfield *field, const struct sidecar *sidecar)
{
    memcpy(field->spacing_m, sidecar->spacing_m, sizeof field->spacing_m);
    field->quantum_m = sidecar->height_scale;
    field->offset_m = sidecar->height_offset;
    describe_planet(field, sidecar);
}

// Rows from north to south, as files have them, to rows from south to north.
static bool take_grey16(struct heightfield *field, const char *path, const uint16_t *raw,
                        const struct sidecar *sidecar)
{
    heightfield_describe(field, sidecar);
    if (!allocate(field, path)) return false;
    for (int64_t y = 0; y < field->height; y++)
        for (int64_t x = 0; x < field->width; x++)
            field->samples[(field->height - 1 - y) * field->width + x] =
                decode(raw[y * field->width + x], sidecar);
    return true;
}

// ---- PNG -------------------------------------------------------------------

static bool take_png(struct heightfield *field, const char *path, const void *png, size_t size,
                     const struct sidecar *sidecar)
{
    int width, height;
    uint16_t *raw;
    if (sidecar->type == SIDECAR_FLOAT32)
        return fail("%s: its sidecar says dtype float32; a PNG is uint16 or int16", path);
    if (!image_read_grey16(path, png, size, &width, &height, &raw)) return false;
    field->width = width;
    field->height = height;
    bool good = sidecar_agrees(sidecar, path, width, height) && take_grey16(field, path, raw, sidecar);
    free(raw);
    return good;
}

static bool load_png(struct heightfield *field, const char *path)
{
    struct sidecar sidecar = sidecar_default();
    enum sidecar_found found = sidecar_load(&sidecar, path);
    if (found == SIDECAR_BAD || !take_png(field, path, NULL, 0, &sidecar)) return false;
    if (found == SIDECAR_ABSENT) heightfield_note_assumed(path, &sidecar);
    return true;
}

bool heightfield_load_memory(struct heightfield *field, const char *path, const void *png, size_t png_size,
                             const char *text, size_t text_size)
{
    struct sidecar sidecar;
    memset(field, 0, sizeof *field);
    name_field(field, path);
    if (sidecar_parse(&sidecar, path, text, text_size) && take_png(field, path, png, png_size, &sidecar))
        return true;
    heightfield_finish(field);
    return false;
}

// ---- SRTM ------------------------------------------------------------------

// Latitude of the south edge from a name such as N47W122.hgt.
static bool latitude_of(const char *path, int *degrees)
{
    char north_south, east_west;
    int latitude, longitude, used = 0;
    if (sscanf(file_name(path), "%c%2d%c%3d%n", &north_south, &latitude, &east_west, &longitude, &used) !=
            4 ||
        used != 7 || !strchr("NnSs", north_south) || !strchr("EeWw", east_west) || latitude > 90)
        return false;
    *degrees = strchr("Nn", north_south) ? latitude : -latitude;
    return true;
}

static const char HGT[] = "an SRTM tile (a square of big-endian 16-bit samples: 1201 or 3601 a side)";

bool heightfield_describe_hgt(const char *path, size_t size, struct sidecar *sidecar, bool *placed)
{
    int64_t side = (int64_t)llround(sqrt((double)(size / 2)));
    if (side < 2 || (size_t)side * (size_t)side * 2 != size)
        return fail("%s: %zu bytes are no square of 16-bit samples; %s is expected", path, size, HGT);
    int south = 0;
    *placed = latitude_of(path, &south);
    *sidecar = sidecar_default();
    sidecar->type = SIDECAR_INT16;
    sidecar->big_endian = true;
    sidecar->width = sidecar->height = side;
    double step_m = HEIGHTFIELD_EARTH_RADIUS_M * DEGREE / (double)(side - 1); // a tile is one degree
    sidecar->spacing_m[0] = *placed ? step_m * cos((south + 0.5) * DEGREE) : step_m;
    sidecar->spacing_m[1] = step_m;
    return true;
}

static bool load_hgt(struct heightfield *field, const char *path)
{
    struct sidecar sidecar;
    bool placed = false;
    size_t size = 0;
    unsigned char *data = read_whole(path, HGT, &size);
    if (!data) return false;
    bool good = heightfield_describe_hgt(path, size, &sidecar, &placed);
    if (good) {
        field->width = field->height = sidecar.width;
        uint16_t *raw = (uint16_t *)(void *)data; // as malloc aligned it
        for (size_t i = 0; i < size / 2; i++) raw[i] = (uint16_t)(data[2 * i] << 8 | data[2 * i + 1]);
        good = take_grey16(field, path, raw, &sidecar);
    }
    free(data);
    if (good && !placed) heightfield_note_assumed(path, &sidecar);
    return good;
}

// ---- raw -------------------------------------------------------------------

static uint32_t read_word(const unsigned char *at, int bytes, bool big_endian)
{
    uint32_t word = 0;
    for (int i = 0; i < bytes; i++) word |= (uint32_t)at[i] << 8 * (big_endian ? bytes - 1 - i : i);
    return word;
}

static double float_height(float value, const struct sidecar *sidecar)
{
    double nodata = (double)(float)sidecar->nodata; // as the file can hold it
    bool is_void = heightfield_is_void((double)value, sidecar->has_nodata, nodata);
    return is_void ? (double)NAN : (double)value * sidecar->height_scale + sidecar->height_offset;
}

static bool take_floats(struct heightfield *field, const char *path, const unsigned char *data,
                        const struct sidecar *sidecar)
{
    heightfield_describe(field, sidecar);
    double *height_m = malloc((size_t)(field->width * field->height) * sizeof *height_m);
    if (!height_m) return fail("%s: does not fit in memory", path);
    for (int64_t y = 0; y < field->height; y++)
        for (int64_t x = 0; x < field->width; x++, data += 4) {
            uint32_t word = read_word(data, 4, sidecar->big_endian);
            float value;
            memcpy(&value, &word, sizeof value);
            height_m[(field->height - 1 - y) * field->width + x] = float_height(value, sidecar);
        }
    bool good = heightfield_quantise(field, height_m, HEIGHTFIELD_FLOAT_BITS);
    free(height_m);
    return good;
}

static bool take_raw(struct heightfield *field, const char *path, unsigned char *data, size_t size,
                     const struct sidecar *sidecar)
{
    int bytes = sidecar->type == SIDECAR_FLOAT32 ? 4 : 2;
    if (sidecar->width == 0 || sidecar->height == 0 || !sidecar->has_type)
        return fail("%s: its sidecar lacks width, height or dtype, which a raw file needs", path);
    field->width = sidecar->width;
    field->height = sidecar->height;
    if ((double)size != (double)field->width * (double)field->height * bytes)
        return fail(
            "%s: holds %zu bytes, but its sidecar says %lld x %lld samples of %d bytes; they must agree",
            path, size, (long long)field->width, (long long)field->height, bytes);
    if (sidecar->type == SIDECAR_FLOAT32) return take_floats(field, path, data, sidecar);
    uint16_t *raw = (uint16_t *)(void *)data; // as malloc aligned it
    for (size_t i = 0; i < size / 2; i++) raw[i] = (uint16_t)read_word(data + 2 * i, 2, sidecar->big_endian);
    return take_grey16(field, path, raw, sidecar);
}

static bool load_raw(struct heightfield *field, const char *path)
{
    struct sidecar sidecar;
    size_t size = 0;
    enum sidecar_found found = sidecar_load(&sidecar, path);
    if (found == SIDECAR_BAD) return false;
    unsigned char *data = read_whole(path, "a file of raw heights with a sidecar .json", &size);
    if (!data) return false;
    bool good = found == SIDECAR_GOOD;
    if (!good) {
        char missing[4096];
        sidecar_path(path, missing, sizeof missing);
        fail("%s: needs the sidecar %s with width, height, dtype and spacing_m", path, missing);
    }
    good = good && take_raw(field, path, data, size, &sidecar);
    free(data);
    return good;
}

static bool load_netcdf(struct heightfield *field, const char *path)
{
    size_t size = 0;
    unsigned char *data = read_whole(path, "a file of NetCDF's classic format", &size);
    bool good = data && heightfield_load_netcdf(field, path, data, size);
    free(data);
    return good;
}

// ---- floats to integers ----------------------------------------------------

bool heightfield_quantise(struct heightfield *field, const double *height_m, int bits)
{
    enum { FINEST = -20 };
    size_t count = (size_t)field->width * (size_t)field->height;
    double low = INFINITY, high = -INFINITY;
    for (size_t i = 0; i < count; i++) {
        if (!isfinite(height_m[i])) continue;
        low = height_m[i] < low ? height_m[i] : low;
        high = height_m[i] > high ? height_m[i] : high;
    }
    bool any = low <= high, flat = low == high;
    field->offset_m = !any ? 0 : flat ? low : rint(low + (high - low) / 2);
    double reach = any ? fmax(high - field->offset_m, field->offset_m - low) : 0;
    int exponent = FINEST;
    if (reach > 0 && frexp(reach, &exponent) == 0.5) exponent--; // reach <= 2^exponent
    exponent = exponent - bits > FINEST ? exponent - bits : FINEST;
    if (!allocate(field, field->name)) return false;
    uint32_t used = 0; // bits that any height needs
    for (size_t i = 0; i < count; i++) {
        bool known = isfinite(height_m[i]);
        int32_t q =
            known ? (int32_t)lrint(ldexp(height_m[i] - field->offset_m, -exponent)) : HEIGHTFIELD_VOID;
        if (known) used |= (uint32_t)q;
        field->samples[i] = q;
    }
    int spare = 0; // whole metres stay whole metres
    while (exponent + spare < 0 && !(used >> spare & 1)) spare++;
    for (size_t i = 0; i < count; i++)
        if (field->samples[i] != HEIGHTFIELD_VOID) field->samples[i] /= 1 << spare;
    field->quantum_m = ldexp(1, exponent + spare);
    return true;
}

// ---- any file --------------------------------------------------------------

void heightfield_note_assumed(const char *path, const struct sidecar *sidecar)
{
    if (ends_in(path, ".hgt"))
        note("%s: the name tells no latitude (as N47W122.hgt does); the spacing of the equator is assumed",
             path);
    else
        note("%s: has no sidecar .json; %g m between samples and 1 m a step are assumed", path,
             sidecar->spacing_m[0]);
}

bool heightfield_is_raw(const char *path)
{
    static const char *const ENDINGS[] = {".raw", ".bin", ".r16", ".r32", ".f32", ".flt", ".bil"};
    for (size_t i = 0; i < sizeof ENDINGS / sizeof *ENDINGS; i++)
        if (ends_in(path, ENDINGS[i])) return true;
    return false;
}

static bool load_any(struct heightfield *field, const char *path)
{
    if (ends_in(path, ".png")) return load_png(field, path);
    if (ends_in(path, ".hgt")) return load_hgt(field, path);
    if (ends_in(path, ".relief")) return relief_load(field, path);
    if (heightfield_is_raw(path)) return load_raw(field, path);
    if (ends_in(path, ".nc") || ends_in(path, ".cdf")) return load_netcdf(field, path);
#ifdef RELIEF_GDAL
    return heightfield_load_gdal(field, path);
#else
    return fail("%s: not a kind of file that is known; .png, .hgt, .relief, .nc or .raw is accepted (more "
                "when built with GDAL)",
                path);
#endif
}

bool heightfield_load(struct heightfield *field, const char *path)
{
    memset(field, 0, sizeof *field);
    name_field(field, path);
    if (load_any(field, path)) return true;
    heightfield_finish(field);
    return false;
}
