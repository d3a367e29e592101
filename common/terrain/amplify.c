// SPDX-License-Identifier: MIT
#include "common/terrain/amplify.h"

#include "common/report.h"
#include "common/terrain/detail.h"
#include "common/terrain/generate.h"
#include "common/terrain/relief/relief_format.h"
#include "common/terrain/relief/relief_source.h"
#include "common/terrain/synthesis.h"
#include "common/terrain/terrain.h"
#include "common/terrain/upsample.h"

#include <cjson/cJSON.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum {
    MOST_LEVELS = 12,
    LIMIT = 1 << 20, // of a height in quanta: four fraction bits are left for coding
    ROWS_AT_ONCE = 128,
};

struct amplify {
    char name[64];
    int64_t size[2], base_size[2];
    double spacing_m[2], quantum_m, offset_m;
    int levels;
    uint64_t seed;
    double radius_m;             // 0: a plane
    double sigma_q[MOST_LEVELS]; // of the noise of each level
    int32_t *base;               // quanta
    uint32_t crc;                // of all of this
    struct detail planet;        // of a planet: its levels below that of base
};

// ---- samples ---------------------------------------------------------------

static int64_t mirrored(int64_t index, int64_t size) // 0 1 2 1 0 1 2 ...
{
    int64_t period = size > 1 ? 2 * (size - 1) : 1, rest = index % period;
    if (rest < 0) rest += period;
    return rest < size ? rest : period - rest;
}

static inline int32_t limited(int32_t q)
{
    return q > LIMIT ? LIMIT : q < -LIMIT ? -LIMIT : q;
}

static void fill_base(const struct amplify *a, int64_t x0, int64_t y0, int width, int height, int32_t *out)
{
    for (int y = 0; y < height; y++) {
        const int32_t *row = a->base + mirrored(y0 + y, a->base_size[1]) * a->base_size[0];
        for (int x = 0; x < width; x++) *out++ = row[mirrored(x0 + x, a->base_size[0])];
    }
}

static bool fill(const struct amplify *a, int level, int64_t x0, int64_t y0, int width, int height,
                 int32_t *out)
{
    if (level == a->levels) {
        fill_base(a, x0, y0, width, height, out);
        return true;
    }
    int columns = upsample_coarse_size(x0, width), rows = upsample_coarse_size(y0, height);
    int32_t *coarse = malloc((size_t)columns * (size_t)rows * sizeof *coarse);
    bool good = coarse && fill(a, level + 1, (x0 >> 1) - 1, (y0 >> 1) - 1, columns, rows, coarse);
    if (good) upsample(coarse, x0, y0, width, height, out);
    free(coarse);
    for (int y = 0; good && y < height; y++) {
        int32_t *row = out + (int64_t)y * width;
        synthesis_add_row(row, width, x0, y0 + y, level, a->seed, a->sigma_q[level]);
        for (int x = 0; x < width; x++) row[x] = limited(row[x]);
    }
    return good;
}

static void planet_window(const struct amplify *a, const struct rect *r, int32_t *out)
{
    const struct sphere_grid grid = sphere_level(&a->planet.grid, -a->levels);
    detail_window(&a->planet, -a->levels, r->x0 + grid.first, r->y0 - grid.pole, (int)rect_width(r),
                  (int)rect_height(r), out);
    for (int64_t i = 0; i < rect_width(r) * rect_height(r); i++) out[i] = limited(out[i]);
}

static bool window(const struct relief_source *source, const struct patch *to)
{
    const struct amplify *a = source->data;
    int width = (int)rect_width(&to->rect);
    if (a->radius_m > 0) {
        planet_window(a, &to->rect, to->samples);
        return true;
    }
    for (int64_t y = to->rect.y0; y < to->rect.y1; y += ROWS_AT_ONCE) { // coarse rows stay in the cache
        int64_t rows = to->rect.y1 - y < ROWS_AT_ONCE ? to->rect.y1 - y : ROWS_AT_ONCE;
        if (!fill(a, 0, to->rect.x0, y, width, (int)rows, patch_at(to, to->rect.x0, y)))
            return fail("%s: out of memory", a->name);
    }
    return true;
}

static void amplify_free(struct amplify *a)
{
    if (a) free(a->base);
    free(a);
}

static void finish(struct relief_source *source)
{
    amplify_free(source->data);
}

bool amplify_source(struct relief_source *s, struct amplify *a)
{
    memset(s, 0, sizeof *s);
    memcpy(s->name, a->name, sizeof s->name);
    memcpy(s->size, a->size, sizeof s->size);
    memcpy(s->spacing_m, a->spacing_m, sizeof s->spacing_m);
    s->quantum_m = a->quantum_m, s->offset_m = a->offset_m;
    s->radius_m = a->radius_m;
    s->identity = (uint64_t)a->crc << 32 | (uint32_t)a->size[0];
    s->magnitude_q = LIMIT;
    s->window = window;
    s->finish = finish;
    s->data = a;
    return true;
}

// ---- the source of the coarsest level --------------------------------------

static struct terrain *load_terrain(const char *spec, const char *name)
{
    const struct terrain_options options = {.synthesize_levels = 2}; // these tell the spread of finer ones
    if (strcmp(name, "jacksboro") == 0) return terrain_builtin(&options);
    char path[4352];
    const char *slash = strrchr(spec, '/'), *data = getenv("RELIEF_DATA");
    snprintf(path, sizeof path, "%.*s%s", slash && name[0] != '/' ? (int)(slash + 1 - spec) : 0, spec, name);
    if (access(path, R_OK) != 0 && data) snprintf(path, sizeof path, "%s/%s", data, name);
    return terrain_load(path, &options);
}

// Four samples and the weights that they have at a fraction of the way from the second to the third: the
// cubic through them, which is U at the half.
static double cubic(const double z[4], double t)
{
    double a = -t * (t - 1) * (t - 2) / 6, b = (t + 1) * (t - 1) * (t - 2) / 2;
    double c = -(t + 1) * t * (t - 2) / 2, d = (t + 1) * t * (t - 1) / 6;
    return a * z[0] + b * z[1] + c * z[2] + d * z[3];
}

// The source's height in its quanta at sample (i, j) of a planet of `grid`.
static double planet_height(const struct terrain *terrain, const struct sphere_grid *from,
                            const struct sphere_grid *grid, int64_t i, int64_t j)
{
    double x = (double)(i * from->columns) / (double)grid->columns,
           y = (double)(j * from->pole) / (double)grid->pole;
    int64_t west = (int64_t)floor(x), south = (int64_t)floor(y);
    int32_t samples[16];
    terrain_window(terrain, 0, west - 1, south - 1, 4, 4, samples, TERRAIN_WAIT);
    double across[4];
    for (int row = 0; row < 4; row++) {
        double z[4];
        for (int k = 0; k < 4; k++) z[k] = samples[4 * row + k];
        across[row] = cubic(z, x - (double)west);
    }
    return cubic(across, y - (double)south);
}

static bool keep_height(struct amplify *a, int64_t at, double q)
{
    a->base[at] = (int32_t)rint(q);
    return fabs(q) <= LIMIT ||
           fail("%s: heights of %g quanta; at most %d are accepted, so a coarser quantum_m", a->name, fabs(q),
                LIMIT);
}

static bool take_planet(struct amplify *a, const struct terrain *terrain, double scale)
{
    struct terrain_extent e = terrain_level(terrain, 0).extent;
    const struct sphere_grid from = sphere_grid(e.x0, e.x1 - e.x0, e.y1 - e.y0);
    const struct sphere_grid grid = sphere_grid(-a->base_size[0] / 2, a->base_size[0], a->base_size[1]);
    for (int64_t j = -grid.pole; j <= grid.pole; j++)
        for (int64_t i = 0; i < grid.columns; i++)
            if (!keep_height(a, (j + grid.pole) * grid.columns + i,
                             scale * planet_height(terrain, &from, &grid, i + grid.first, j)))
                return false;
    sphere_level_poles(&grid, a->base);
    a->planet = (struct detail){.grid = grid, .samples = a->base, .seed = a->seed};
    for (int l = 0; l < a->levels; l++) a->planet.sigma_q[a->levels - l] = a->sigma_q[l];
    return true;
}

static bool take_plane(struct amplify *a, const struct terrain *terrain, double scale)
{
    struct terrain_extent e = terrain_level(terrain, 0).extent;
    terrain_window(terrain, 0, e.x0, e.y0, (int)a->base_size[0], (int)a->base_size[1], a->base, TERRAIN_WAIT);
    for (int64_t i = 0; i < a->base_size[0] * a->base_size[1]; i++)
        if (!keep_height(a, i, scale * a->base[i])) return false;
    return true;
}

// How many of the source's samples one of base's is, along an axis: 1 on the plane.
static double finer(const struct amplify *a, const struct terrain *terrain)
{
    struct terrain_extent e = terrain_level(terrain, 0).extent;
    return (double)a->base_size[0] / (double)(e.x1 - e.x0);
}

static bool take_base(struct amplify *a, const struct terrain *terrain, double height_scale)
{
    double scale = terrain_info(terrain)->quantum_m * height_scale / a->quantum_m;
    double first = terrain_level(terrain, -1).noise_q * scale,
           next = terrain_level(terrain, -2).noise_q * scale;
    for (int l = 0; l < a->levels; l++) {
        double above =
            a->levels - 1 - l + log2(finer(a, terrain)); // levels between the source's first and this
        a->sigma_q[l] = first > 0 ? first * pow(next / first, above) : 0;
    }
    a->base = malloc((size_t)(a->base_size[0] * a->base_size[1]) * sizeof *a->base);
    if (!a->base) return fail("%s: out of memory", a->name);
    return a->radius_m > 0 ? take_planet(a, terrain, scale) : take_plane(a, terrain, scale);
}

// The sizes of a planet and of what it is made from; false after one line on stderr.
static bool size_planet(struct amplify *a, const struct terrain *terrain, const char *path)
{
    struct terrain_extent e = terrain_level(terrain, 0).extent;
    int64_t scale = (int64_t)1 << a->levels;
    if (a->size[0] == 0) a->size[0] = (e.x1 - e.x0) * scale;
    if (a->size[1] == 0) a->size[1] = (e.y1 - e.y0 - 1) * scale + 1;
    a->base_size[0] = a->size[0] / scale, a->base_size[1] = (a->size[1] - 1) / scale + 1;
    if (a->size[0] % scale || (a->size[1] - 1) % scale || a->base_size[0] < 4 || a->base_size[0] % 2 ||
        a->base_size[1] < 3 || a->base_size[1] % 2 == 0)
        return fail(
            "%s: %lld x %lld samples are no planet of %d levels; a width of 2^levels times an even number "
            "and a height of 2^levels times an even number and one more are accepted",
            path, (long long)a->size[0], (long long)a->size[1], a->levels);
    a->radius_m = terrain_info(terrain)->radius_m;
    a->spacing_m[0] = 2 * M_PI * a->radius_m / (double)a->size[0];
    a->spacing_m[1] = M_PI * a->radius_m / (double)(a->size[1] - 1);
    return true;
}

static bool size_plane(struct amplify *a, const struct terrain *terrain, const char *path, double spacing_m)
{
    const struct terrain_info *info = terrain_info(terrain);
    struct terrain_extent e = terrain_level(terrain, 0).extent;
    if (a->size[0] == 0 || a->size[1] == 0) return fail("%s: lacks \"width\" or \"height\"", path);
    a->base_size[0] = e.x1 - e.x0, a->base_size[1] = e.y1 - e.y0;
    for (int axis = 0; axis < 2; axis++)
        a->spacing_m[axis] = spacing_m > 0 ? spacing_m : ldexp(info->spacing_m[axis], -a->levels);
    return true;
}

// ---- the spec --------------------------------------------------------------

struct spec {
    const char *generate, *source, *name;
    double width, height, levels, spacing_m, height_scale, quantum_m, relief_m, seed;
};

static bool read_spec(const cJSON *root, const char *path, struct spec *spec)
{
    const struct {
        const char *key;
        double *number, low, high;
        const char **text;
    } KEYS[] = {{"generate", NULL, 0, 0, &spec->generate},
                {"source", NULL, 0, 0, &spec->source},
                {"name", NULL, 0, 0, &spec->name},
                {"width", &spec->width, 1, 1e9, NULL},
                {"height", &spec->height, 1, 1e9, NULL},
                {"levels", &spec->levels, 0, MOST_LEVELS, NULL},
                {"spacing_m", &spec->spacing_m, 1e-6, 1e6, NULL},
                {"height_scale", &spec->height_scale, 1e-6, 1e6, NULL},
                {"quantum_m", &spec->quantum_m, 1e-6, 1e6, NULL},
                {"relief_m", &spec->relief_m, -1e5, 1e7, NULL},
                {"seed", &spec->seed, 0, 4294967295.0, NULL}};
    enum { COUNT = sizeof KEYS / sizeof *KEYS };
    if (!cJSON_IsObject(root))
        return fail("%s: not JSON; an object that tells what to \"generate\" is expected", path);
    for (const cJSON *item = root->child; item; item = item->next) {
        int i = 0;
        while (i < COUNT && strcmp(item->string, KEYS[i].key) != 0) i++;
        if (i == COUNT) return fail("%s: \"%s\" is no key of a spec", path, item->string);
        if (KEYS[i].text) {
            if (!cJSON_IsString(item)) return fail("%s: \"%s\" is no text", path, item->string);
            *KEYS[i].text = item->valuestring;
            continue;
        }
        if (!cJSON_IsNumber(item) || !(item->valuedouble >= KEYS[i].low && item->valuedouble <= KEYS[i].high))
            return fail("%s: \"%s\" does not serve; a number from %g to %g is expected", path, item->string,
                        KEYS[i].low, KEYS[i].high);
        *KEYS[i].number = item->valuedouble;
    }
    const double whole[4] = {spec->width, spec->height, spec->levels, spec->seed};
    for (int i = 0; i < 4; i++)
        if (whole[i] != floor(whole[i])) return fail("%s: %g is no whole number", path, whole[i]);
    bool made = spec->generate && strcmp(spec->generate, "amplify") == 0; // a planet may do without a size
    return (spec->generate && (made || (spec->width > 0 && spec->height > 0))) ||
           fail("%s: lacks \"generate\", \"width\" or \"height\"", path);
}

static bool make_amplify(const struct spec *spec, const char *path, struct amplify **world)
{
    struct amplify *a = calloc(1, sizeof *a);
    struct terrain *terrain = a ? load_terrain(path, spec->source ? spec->source : "jacksboro") : NULL;
    if (!terrain) {
        free(a);
        return a != NULL ? false : fail("%s: out of memory", path);
    }
    const struct terrain_info *info = terrain_info(terrain);
    snprintf(a->name, sizeof a->name, "%s", spec->name ? spec->name : info->name);
    a->size[0] = (int64_t)spec->width, a->size[1] = (int64_t)spec->height;
    a->levels = (int)spec->levels;
    a->seed = (uint64_t)spec->seed;
    a->quantum_m = spec->quantum_m > 0 ? spec->quantum_m : 1.0 / 16;
    a->offset_m = info->offset_m * spec->height_scale;
    bool good = (info->datum == TERRAIN_SPHERE ? size_planet(a, terrain, path)
                                               : size_plane(a, terrain, path, spec->spacing_m)) &&
                take_base(a, terrain, spec->height_scale);
    terrain_destroy(terrain);
    if (!good) {
        amplify_free(a);
        return false;
    }
    a->crc = relief_crc((const uint8_t *)a, offsetof(struct amplify, base));
    a->crc ^=
        relief_crc((const uint8_t *)a->base, (size_t)(a->base_size[0] * a->base_size[1]) * sizeof *a->base);
    *world = a;
    return true;
}

static bool make_field(const struct spec *spec, const char *path, struct heightfield *field)
{
    const struct generate_options made = {.kind = spec->generate,
                                          .width = spec->width < 32768 ? (int)spec->width : 32768,
                                          .height = spec->height < 32768 ? (int)spec->height : 32768,
                                          .spacing_m = spec->spacing_m > 0 ? spec->spacing_m : 30,
                                          .relief_m = spec->relief_m,
                                          .seed = (uint64_t)spec->seed};
    if (spec->source || spec->levels > 0 || spec->height_scale != 1 || spec->quantum_m > 0)
        return fail("%s: source, levels, height_scale and quantum_m go with \"amplify\" alone", path);
    if (spec->width > 32768 || spec->height > 32768)
        return fail("%s: %g x %g samples; at most 32768 each are made but by \"amplify\"", path, spec->width,
                    spec->height);
    if (!generate(field, &made)) return false;
    if (spec->name) snprintf(field->name, sizeof field->name, "%s", spec->name);
    return true;
}

static char *read_text(const char *path, size_t *size)
{
    enum { LARGEST = 1 << 20 };
    FILE *file = fopen(path, "rb");
    char *text = file ? malloc(LARGEST) : NULL;
    *size = text ? fread(text, 1, LARGEST, file) : 0;
    bool good = text && !ferror(file) && *size < LARGEST;
    if (!good) fail("%s: %s; a JSON file is expected", path, errno ? strerror(errno) : "cannot be read");
    if (file) fclose(file);
    if (good) return text;
    free(text);
    return NULL;
}

bool generate_spec_read(const char *path, struct heightfield *field, struct amplify **world)
{
    size_t size = 0;
    char *text = read_text(path, &size);
    if (!text) return false;
    cJSON *root = cJSON_ParseWithLength(text, size);
    struct spec spec = {.height_scale = 1, .seed = 1};
    bool good = read_spec(root, path, &spec);
    *world = NULL;
    memset(field, 0, sizeof *field);
    if (good)
        good = strcmp(spec.generate, "amplify") == 0 ? make_amplify(&spec, path, world)
                                                     : make_field(&spec, path, field);
    cJSON_Delete(root);
    free(text);
    return good;
}
