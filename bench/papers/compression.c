// Compression: Losasso & Hoppe 2004, sections 7 and 9 and Table 3, and Table 1 of geometry clipmapping for
// Mars. SPDX-License-Identifier: MIT
#include "bench/papers/papers.h"
#include "bench/statistics.h"
#include "clipmap/clipmap.h"
#include "clipmap/clipmap_levels.h"
#include "common/report.h"
#include "common/terrain/heightfield.h"
#include "common/terrain/relief/codec_mars.h"
#include "common/terrain/relief/filter_fit.h"
#include "common/terrain/relief/relief_file.h"
#include "common/terrain/relief/relief_pack.h"
#include "common/terrain/upsample.h"
#include "common/terrain/voids.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

// ---- a map and its file ------------------------------------------------------------------------

struct packed {
    struct heightfield field; // the source, voids filled
    struct relief_header header;
    struct relief *relief;
    char folder[32], path[64];
};

static bool packed_open(struct packed *p, const char *map)
{
    memset(p, 0, sizeof *p);
    strcpy(p->folder, "/tmp/relief-XXXXXX");
    if (!mkdtemp(p->folder)) return p->folder[0] = 0, fail("papers: /tmp cannot be written");
    snprintf(p->path, sizeof p->path, "%s/map.relief", p->folder);
    bool good = heightfield_load(&p->field, map);
    p->field.radius_m = 0; // the raster, as other coders see it
    return good;
}

static void packed_close(struct packed *p)
{
    relief_close(p->relief);
    heightfield_finish(&p->field);
    if (p->folder[0]) unlink(p->path), rmdir(p->folder);
}

static bool pack(struct packed *p, const struct relief_pack_options *options)
{
    relief_close(p->relief);
    p->relief = NULL;
    return relief_pack(&p->field, options, p->path, &p->header) && (p->relief = relief_open(p->path)) != NULL;
}

// Codecs that keep a largest error, at an rms error.
static bool pack_to_rms(struct packed *p, struct relief_pack_options options, double rms_m)
{
    return relief_pack_max_for_rms(&p->field, &options, rms_m) && pack(p, &options);
}

static double bits_of(const struct packed *p)
{
    return 8 * (double)relief_sample_bytes(p->relief) /
           ((double)p->header.size[0] * (double)p->header.size[1]);
}

// rms of a level of a pyramid's file against the level that D makes of the source; NAN when memory runs out.
static double level_rms_m(const struct packed *p, int level)
{
    struct patch wanted = {{0, 0, p->field.width, p->field.height}, p->field.samples};
    double squares = 0;
    int32_t *decoded = NULL;
    bool good = true;
    for (int l = 0; good && l < level; l++) {
        struct patch bands[CODER_BANDS] = {{{0, 0, 0, 0}, NULL}};
        bands[0].samples =
            malloc((size_t)(rect_width(&wanted.rect) * rect_height(&wanted.rect)) * sizeof(int32_t));
        good = bands[0].samples && layout_pyramid_reduce(&wanted, bands);
        if (l > 0) free(wanted.samples);
        wanted = bands[0];
    }
    int64_t width = rect_width(&wanted.rect), height = rect_height(&wanted.rect);
    if (good) decoded = malloc((size_t)(width * height) * sizeof *decoded);
    good = decoded && relief_window(p->relief, level, 0, 0, width, height, decoded);
    for (int64_t i = 0; good && i < width * height; i++) {
        double off = decoded[i] - wanted.samples[i];
        squares += off * off;
    }
    free(decoded);
    if (level > 0) free(wanted.samples);
    return good ? p->field.quantum_m * sqrt(squares / (double)(width * height)) : (double)NAN;
}

// ---- section 9, compression error --------------------------------------------------------------

enum { RMS_PRINTED, RMS, BITS_PRINTED, BITS, FACTOR_PRINTED, FACTOR, MAX, COARSE, COMPRESSION_COLUMNS };
enum { COARSE_LEVEL = 4 };

static void compression_row(struct papers_table *table, const char *name, const struct packed *p)
{
    double *values = papers_row(table, "%s", name);
    values[RMS] = p->header.rms_m;
    values[BITS] = bits_of(p);
    values[FACTOR] = 16 / values[BITS];
    values[MAX] = p->header.max_m;
    if (p->header.layout == LAYOUT_PYRAMID) values[COARSE] = level_rms_m(p, COARSE_LEVEL);
}

static void printed_row(struct papers_table *table, const char *name, double rms_m, double bytes,
                        double samples)
{
    double *values = papers_row(table, "%s", name);
    values[RMS_PRINTED] = rms_m;
    values[BITS_PRINTED] = 8 * bytes / samples;
    values[FACTOR_PRINTED] = 16 / values[BITS_PRINTED];
}

// As accurate for its spacing as the paper's Puget Sound set: an rms error of a tenth of the spacing.
static bool compression_rows(struct papers_table *table, const char *short_name, struct packed *p)
{
    char name[96];
    double rms_m = 0.1 * p->field.spacing_m[1];
    struct relief_pack_options options = {.layout = LAYOUT_WAVELET, .rms_m = rms_m};
    snprintf(name, sizeof name, "%s, wavelet", short_name);
    if (!pack(p, &options)) return false;
    compression_row(table, name, p);
    options.layout = LAYOUT_PYRAMID;
    for (int scaled = 0; scaled < 2; scaled++) {
        options.scaled = scaled;
        snprintf(name, sizeof name, "%s, pyramid%s", short_name, scaled ? ", scaled by 2^l" : "");
        if (!pack_to_rms(p, options, rms_m)) return false;
        compression_row(table, name, p);
    }
    return true;
}

bool papers_clipmap_compression(struct papers *papers, struct papers_table *table)
{
    static const struct {
        const char *file, *name;
    } MAPS[] = {{"puget_cascades_72m_2049x2817.png", "Cascades, 72 m"},
                {"puget_srtm3_strip_3601x1201.png", "Puget strip, 90 m"},
                {"puget_1k_160m.png", "Puget Sound, 160 m"}};
    char path[1024];
    (void)papers;
    snprintf(table->title, sizeof table->title, "Compression at an rms error of a tenth of the spacing");
    snprintf(table->row_name, sizeof table->row_name, "terrain, codec");
    static const char *const NAMES[] = {"rms",    "rms",    "bits", "bits",
                                        "factor", "factor", "max",  "level 4 rms"};
    static const char *const UNITS[] = {"m",          "m",          "a sample", "a sample",
                                        "of 16 bits", "of 16 bits", "m",        "m"};
    for (int c = 0; c < COMPRESSION_COLUMNS; c++)
        papers_column(table, NAMES[c], UNITS[c], c < MAX && c % 2 == 0);
    printed_row(table, "Puget Sound, 16385 x 16385, 10 m", 1.0, 8.5e6, 16385.0 * 16385);
    printed_row(table, "United States, 216000 x 93600, 30 m", 1.8, 355e6, 216000.0 * 93600);
    for (size_t i = 0; i < sizeof MAPS / sizeof *MAPS; i++) {
        struct packed p;
        if (!papers_data(table, MAPS[i].file, path)) return true;
        bool good = packed_open(&p, path) && compression_rows(table, MAPS[i].name, &p);
        if (good && i == 0) {
            const struct relief_pack_options options = {.layout = LAYOUT_WAVELET, .rms_m = 1};
            good = pack(&p, &options);
            if (good) compression_row(table, "Cascades, 72 m, wavelet, rms 1 m", &p);
        }
        packed_close(&p);
        if (!good) return false;
    }
    papers_note(
        table,
        "The 10 m and 30 m sets are not to be had here.  The paper's rms errors are 10 %% and 6 %% of the "
        "sample spacing; ours are held to 10 %%, so that coarser ground stands in for finer.");
    papers_note(
        table,
        "pyramid is the paper's scheme, residuals of every level against U of the decoded coarser one "
        "(4/3 as many as samples), with our tile coder, not PTC.  Scaled: level l is quantised 2^l times "
        "as coarsely, the paper's first approach; level 4 then differs from its filtered self by the "
        "figure in the last column, which is what shows in normals and colours.  In a closed loop it costs "
        "bits as well: the finer level has to code what the coarser one's steps left.");
    papers_note(table,
                "Bits count header, tiles, base and index; the side section (extrema and errors of tiles, "
                "checksums) is at most 0.03 bit a sample more.");
    return true;
}

// ---- Table 1: decompression --------------------------------------------------------------------

enum { REFILL = 255 }; // samples on a side

// The next level alone, the coarser one being there: as a refill needs it, in quanta.
static bool time_decoding(struct papers *papers, const struct packed *p, double *times, int count)
{
    const struct grid *grid = relief_grid(p->relief);
    struct random_state random = {PAPERS_SEED};
    struct patch coarse = {.rect = {0, 0, grid->size[1][0], grid->size[1][1]}}, wanted;
    coarse.samples = malloc((size_t)(grid->size[1][0] * grid->size[1][1]) * sizeof(int32_t));
    wanted.samples = malloc((size_t)REFILL * REFILL * sizeof(int32_t));
    bool good = coarse.samples && wanted.samples ? relief_units(p->relief, 1, &coarse)
                                                 : fail("papers: out of memory");
    for (int i = 0; good && i < count; i++) {
        int64_t x0 = (int64_t)random_below(&random, (uint64_t)(grid->size[0][0] - REFILL + 1));
        int64_t y0 = (int64_t)random_below(&random, (uint64_t)(grid->size[0][1] - REFILL + 1));
        wanted.rect = (struct rect){x0, y0, x0 + REFILL, y0 + REFILL};
        double start = papers_clock_ms(papers);
        good = relief_refine(p->relief, 0, &coarse, &wanted);
        relief_quanta(p->relief, wanted.samples, REFILL * REFILL);
        times[i] = papers_clock_ms(papers) - start;
    }
    free(coarse.samples);
    free(wanted.samples);
    return good;
}

bool papers_decompression(struct papers *papers, double *times, int count)
{
    char path[1024];
    struct papers_table aside = {.id = ""}; // takes the reason, should there be no data
    struct packed p;
    times[0] = NAN;
    if (!papers_data(&aside, "puget_1k_160m.png", path)) return true;
    bool good = packed_open(&p, path);
    const struct relief_pack_options options = {.layout = LAYOUT_WAVELET,
                                                .rms_m = 0.1 * p.field.spacing_m[1]};
    good = good && pack(&p, &options) && time_decoding(papers, &p, times, count);
    packed_close(&p);
    return good;
}

// ---- section 7, footnote: the filter D ---------------------------------------------------------

bool papers_clipmap_filter(struct papers *papers, struct papers_table *table)
{
    static const char *const FILES[] = {"puget_srtm3_strip_3601x1201.png", "puget_1k_160m.png",
                                        "puget_cascades_72m_2049x2817.png", "mars_mola_4ppd_1440x720.png"};
    static const char *const MAPS[] = {"Puget strip", "Puget 160 m", "Cascades", "Mars"};
    static const char *const NAMES[TERRAIN_FILTERS] = {"(-1 2 6 2 -1)/8", "(-1 0 9 16 9 0 -1)/32",
                                                       "(1 2 1)/4", "every other sample",
                                                       "11 taps, solved on other maps"};
    enum { COUNT = 4 };
    char path[1024];
    double *rows[TERRAIN_FILTERS + 1];
    (void)papers;
    snprintf(table->title, sizeof table->title, "rms of U(D(T)) - T by the filter D");
    snprintf(table->row_name, sizeof table->row_name, "D along each axis");
    for (int m = 0; m < COUNT; m++) papers_column(table, MAPS[m], "m", false);
    for (int f = 0; f < TERRAIN_FILTERS; f++) rows[f] = papers_row(table, "%s", NAMES[f]);
    rows[TERRAIN_FILTERS] = papers_row(table, "11 taps, solved on this map");
    for (int m = 0; m < COUNT; m++) {
        struct heightfield field;
        struct filter_sums sums = {0};
        double half[FILTER_HALF];
        if (!papers_data(table, FILES[m], path)) return true;
        if (!heightfield_load(&field, path)) return false;
        bool good = voids_fill(field.samples, field.width, field.height);
        for (int f = 0; good && f < TERRAIN_FILTERS; f++) {
            const struct filter_taps *taps = filter_taps((enum terrain_filter)f);
            for (int k = 0; k < FILTER_HALF; k++) half[k] = ldexp(taps->half[k], -taps->shift);
            rows[f][m] = field.quantum_m * filter_rms_q(field.samples, field.width, field.height, half);
        }
        filter_sums_add(&sums, field.samples, field.width, field.height);
        if (good && filter_solve(&sums, half))
            rows[TERRAIN_FILTERS][m] =
                field.quantum_m * filter_rms_q(field.samples, field.width, field.height, half);
        heightfield_finish(&field);
        if (!good) return fail("%s: out of memory", path);
    }
    papers_note(
        table,
        "The paper fits 11 x 11 weights to a part of its terrain and prints no figure.  Ours are a tensor "
        "product of one symmetric line, six unknowns under the constraint that they sum to 1, solved on "
        "three maps that no figure is quoted for; what solving on the map itself would add is the last "
        "row.");
    return true;
}

// ---- section 9: compression error and level-of-detail error, apart and together ----------------

struct surfaces { // of one level, at every sample of level 0 that its cells cover
    const int32_t *level, *decoded, *source;
    const int64_t *size, *finest; // samples of the level, of level 0
    int number;
};

// Height of the level's surface at a sample of level 0, in quanta; cells are split along (i, j)-(i+1, j+1).
static double surface_at(const struct surfaces *s, int64_t x, int64_t y)
{
    int64_t i = x >> s->number, j = y >> s->number;
    i = i > s->size[0] - 2 ? s->size[0] - 2 : i, j = j > s->size[1] - 2 ? s->size[1] - 2 : j;
    double u = ldexp((double)x, -s->number) - (double)i, v = ldexp((double)y, -s->number) - (double)j;
    const int32_t *c = s->level + j * s->size[0] + i, *n = c + s->size[0];
    return u < v ? c[0] + v * (n[0] - c[0]) + u * (n[1] - n[0])
                 : c[0] + u * (c[1] - c[0]) + v * (n[1] - c[1]);
}

enum { LOD, COMPRESSION, TOGETHER, KINDS };

static void error_columns(const struct surfaces *s, double scale, double *errors, double *values)
{
    int64_t across = (s->size[0] - 1) << s->number, along = (s->size[1] - 1) << s->number;
    for (int kind = 0; kind < KINDS; kind++) {
        double squares = 0;
        size_t count = 0;
        for (int64_t y = 0; y <= along && y < s->finest[1]; y++)
            for (int64_t x = 0; x <= across && x < s->finest[0]; x++) {
                int64_t at = y * s->finest[0] + x;
                double drawn = kind == COMPRESSION ? s->decoded[at] : surface_at(s, x, y);
                double off = fabs(drawn - (kind == LOD ? s->decoded[at] : s->source[at])) * scale;
                squares += off * off;
                errors[count++] = off;
            }
        values[2 * kind] = sqrt(squares / (double)count);
        values[2 * kind + 1] = percentile(errors, count, 999);
    }
}

static bool apart_rows(struct papers_table *table, const struct packed *p)
{
    const struct grid *grid = relief_grid(p->relief);
    const int64_t *finest = grid->size[0];
    size_t count = (size_t)(finest[0] * finest[1]);
    int32_t *decoded = malloc(count * sizeof *decoded), *level = malloc(count * sizeof *level);
    double *errors = malloc(count * sizeof *errors);
    bool good = decoded && level && errors;
    if (!good) fail("papers: out of memory");
    good = good && relief_window(p->relief, 0, 0, 0, finest[0], finest[1], decoded);
    for (int l = 0; good && l < grid->count && grid->size[l][0] > 2 && grid->size[l][1] > 2; l++) {
        struct surfaces s = {level, decoded, p->field.samples, grid->size[l], finest, l};
        double spacing_m = ldexp(p->field.spacing_m[1], l);
        good = relief_window(p->relief, l, 0, 0, s.size[0], s.size[1], level);
        if (!good) break;
        // Pixels: e / g x s, as Table 2 has it.
        double px = p->field.quantum_m / spacing_m * clipmap_spacing_px(255, 640, 1);
        error_columns(&s, px, errors, papers_row(table, "%d (%.0f m)", l, spacing_m));
    }
    free(decoded);
    free(level);
    free(errors);
    return good;
}

bool papers_clipmap_apart(struct papers *papers, struct papers_table *table)
{
    char path[1024];
    struct packed p;
    (void)papers;
    static const char *const NAMES[] = {"LOD rms",     "LOD p99.9", "coder rms",
                                        "coder p99.9", "both rms",  "both p99.9"};
    snprintf(table->title, sizeof table->title,
             "Level-of-detail error, compression error, and both together, e / g_l x s");
    snprintf(table->row_name, sizeof table->row_name, "level (spacing)");
    for (int c = 0; c < 2 * KINDS; c++) papers_column(table, NAMES[c], "px", false);
    if (!papers_data(table, "puget_1k_160m.png", path)) return true;
    bool good = packed_open(&p, path);
    const struct relief_pack_options options = {.layout = LAYOUT_WAVELET,
                                                .rms_m = good ? 0.1 * p.field.spacing_m[1] : 1};
    good = good && pack(&p, &options) && apart_rows(table, &p);
    if (good)
        papers_note(
            table,
            "puget_1k_160m packed to an rms error of %.2f m, a tenth of its spacing, %.3f bits a sample.  "
            "LOD: the "
            "level's surface against the finest decoded one.  Coder: the finest decoded one against the "
            "source.  Both: the level's surface against the source.  Pixels as in Table 2, at the "
            "average depth of the level; a compression error of a tenth of the finest spacing is %.2f px "
            "there, and half of that on each coarser level.",
            p.header.rms_m, bits_of(&p), 0.1 * clipmap_spacing_px(255, 640, 1));
    packed_close(&p);
    return good;
}

// ---- Table 3: space at run time ----------------------------------------------------------------

static bool space_row(struct papers *papers, struct papers_table *table, const char *path)
{
    struct terrain *terrain = terrain_load(path, NULL);
    struct scene *scene = terrain ? papers_scene(papers, terrain) : NULL;
    if (!scene) return false;
    struct papers_flight flight = {.type = &clipmap_renderer, .knobs = {"n", "255"}};
    bool good = papers_fly(papers, scene, 8, &flight, 1);
    double samples = (double)terrain_info(terrain)->samples, held = (double)terrain_resident_bytes(terrain);
    double *values = papers_row(table, "Cascades, 72 m, .relief at rms 1 m, read on demand");
    values[1] = samples * 1e-6;
    values[3] = (held + (double)flight.stats.resident_bytes) / (1 << 20);
    values[5] = (held + (double)flight.stats.resident_bytes) / samples;
    scene_destroy(scene);
    return good;
}

bool papers_clipmap_space(struct papers *papers, struct papers_table *table)
{
    static const struct {
        const char *scheme;
        double samples_million, mib, bytes;
    } PRINTED[] = {{"Hoppe 1998, 4K x 2K", 8, 50, 6.0},
                   {"Lindstrom 2002, 16K x 16K", 256, 5.0 * 1024, 19.5},
                   {"Cignoni et al. 2003a, 8K x 8K", 64, 115, 1.8},
                   {"Cignoni et al. 2003b, 6 x 13313^2", 1000, 4.5 * 1024, 4.5},
                   {"Geometry clipmaps, 16K x 16K", 256, 25, 0.10},
                   {"Geometry clipmaps, 216K x 94K", 20000, 375, 0.02}};
    char path[1024];
    struct packed p;
    snprintf(table->title, sizeof table->title, "Space at run time, without normals");
    snprintf(table->row_name, sizeof table->row_name, "scheme, grid");
    for (int c = 0; c < 6; c++) {
        static const char *const NAMES[] = {"samples", "space", "bytes"};
        static const char *const UNITS[] = {"million", "MiB", "a sample"};
        papers_column(table, NAMES[c / 2], UNITS[c / 2], c % 2 == 0);
    }
    for (size_t i = 0; i < sizeof PRINTED / sizeof *PRINTED; i++) {
        double *values = papers_row(table, "%s", PRINTED[i].scheme);
        values[0] = PRINTED[i].samples_million, values[2] = PRINTED[i].mib, values[4] = PRINTED[i].bytes;
    }
    if (!papers_data(table, "puget_cascades_72m_2049x2817.png", path)) return true;
    const struct relief_pack_options options = {.layout = LAYOUT_WAVELET, .rms_m = 1};
    bool good = packed_open(&p, path) && pack(&p, &options) && space_row(papers, table, p.path);
    if (good)
        papers_note(
            table,
            "Ours: what the terrain holds (index, side section and the cache of decoded blocks as far as it "
            "is filled) and the buffers and textures of the clipmap, n = 255, after 8 frames.  The "
            "compressed "
            "samples, %.1f MiB, stay on disk; the paper holds them in memory.  Clipmap and cache do not grow "
            "with the map: on 5.8 million samples they are nearly all of it.",
            (double)relief_sample_bytes(p.relief) / (1 << 20));
    packed_close(&p);
    return good;
}

// ---- Mars, Table 1 -----------------------------------------------------------------------------

bool papers_mars_compression(struct papers *papers, struct papers_table *table)
{
    char path[1024];
    struct packed p;
    (void)papers;
    snprintf(table->title, sizeof table->title, "Compression ratio");
    snprintf(table->row_name, sizeof table->row_name, "coder, terrain");
    static const char *const NAMES[] = {"data", "ratio", "ratio", "bits", "rms", "mean", "max"};
    static const char *const UNITS[] = {"GB", "of 16 bits", "of 16 bits", "a sample", "m", "m", "m"};
    for (int c = 0; c < 7; c++) papers_column(table, NAMES[c], UNITS[c], c < 2);
    double *values = papers_row(table, "Losasso & Hoppe");
    values[0] = 40, values[1] = 100;
    values = papers_row(table, "the paper's blocks");
    values[0] = 2, values[1] = 26;
    if (!papers_data(table, "mars_mola_4ppd_1440x720.png", path)) return true;
    bool good = packed_open(&p, path);
    for (int i = 0; good && i < 5; i++) {
        static const enum layout LAYOUT[] = {LAYOUT_MARS, LAYOUT_RAW, LAYOUT_BOUNDED, LAYOUT_PYRAMID,
                                             LAYOUT_WAVELET};
        static const char *const AIM[] = {"as published", "plain", "max 2 m", "max 2 m", "rms 1.5 m"};
        const struct relief_pack_options options = {.layout = LAYOUT[i], .max_m = 2, .rms_m = 1.5};
        struct heightfield back = {0};
        good = pack(&p, &options) && relief_load(&back, p.path);
        if (!good) break;
        double sum = 0, count = (double)back.width * (double)back.height;
        for (int64_t k = 0; k < back.width * back.height; k++) sum += back.samples[k] - p.field.samples[k];
        values = papers_row(table, "Mars, 1440 x 720, %s, %s", LAYOUT_NAMES[LAYOUT[i]], AIM[i]);
        values[2] = 16 / bits_of(&p), values[3] = bits_of(&p), values[4] = p.header.rms_m;
        values[5] = p.field.quantum_m * sum / count, values[6] = p.header.max_m;
        free(back.samples);
    }
    packed_close(&p);
    if (!good) return false;
    papers_note(
        table,
        "mars: a pyramid of its own in every tile of 64 x 64 samples of every level, residuals in the open "
        "loop, their last bit dropped, runs of zeros.  Every level is stored so (4/3), and a residual that "
        "is not zero takes a byte or two: rough ground hardly shrinks.  The paper's 26 is of ground that "
        "it says varies from 3 to 300 KB a MB.");
    papers_note(table, "Its mean error is not 0, since a dropped bit always lowers, and its errors add up "
                       "level by level: three of them in these tiles; mars-growth has seven.");
    papers_note(
        table,
        "What the paper would improve the other rows have: a transform and steps in place of the "
        "dropped bit (wavelet; in a closed loop bounded and pyramid), entropy coding in place of run "
        "lengths and whole bytes (rANS with contexts, all three), and a loss that follows from the aim "
        "and the ground instead of one factor for all blocks.");
    return true;
}

// ---- Mars, how errors add up -------------------------------------------------------------------

static bool growth_row(struct papers_table *table, const struct heightfield *field, int levels)
{
    static const struct mars_form FORMS[] = {
        {0}, {.rounded = true}, {.closed = true}, {.closed = true, .rounded = true}};
    int width = (int)field->width, height = (int)field->height;
    int least = width > height ? width : height; // the side that so many levels leave
    for (int l = 0; l < levels; l++) least = (least + 1) / 2;
    size_t count = (size_t)width * (size_t)height, room = mars_most(width, height);
    uint8_t *bytes = malloc(room);
    int32_t *back = malloc(count * sizeof *back);
    bool good = bytes && back;
    double *values = papers_row(table, "%d level%s", levels, levels > 1 ? "s" : "");
    for (int f = 0; good && f < 4; f++) {
        struct mars_form form = FORMS[f];
        form.least = least;
        size_t size = mars_encode(field->samples, width, height, &form, bytes, room);
        good = size > 0 && mars_decode(bytes, size, width, height, &form, back);
        double sum = 0, most = 0;
        for (size_t i = 0; good && i < count; i++) {
            double off = back[i] - field->samples[i];
            sum += off;
            most = fmax(most, fabs(off));
        }
        values[2 * f] = most * field->quantum_m, values[2 * f + 1] = sum / (double)count * field->quantum_m;
    }
    free(bytes);
    free(back);
    return good || fail("papers: %s: its pyramid does not fit in memory", field->name);
}

bool papers_mars_growth(struct papers *papers, struct papers_table *table)
{
    enum { LEVELS = 7 };
    char path[1024];
    struct heightfield field;
    (void)papers;
    snprintf(table->title, sizeof table->title, "Errors of the block coder, by levels in a block's pyramid");
    snprintf(table->row_name, sizeof table->row_name, "Mars, 1440 x 720, one block");
    static const char *const NAMES[] = {"as published", "rounded", "closed loop", "closed, rounded"};
    for (int c = 0; c < 8; c++) papers_column(table, NAMES[c / 2], c % 2 ? "mean, m" : "max, m", false);
    if (!papers_data(table, "mars_mola_4ppd_1440x720.png", path)) return true;
    bool good = heightfield_load(&field, path);
    for (int levels = 1; good && levels <= LEVELS; levels++) good = growth_row(table, &field, levels);
    papers_note(table,
                "A residual's last bit is dropped: steps of 2 x %g m.  As published residuals are taken "
                "against levels as they were (an open loop), so what each level lost stays: .5 in the mean, "
                "all one way.  Rounded to even numbers it loses both ways, but stays as well.  In a closed "
                "loop, against levels as decoded, only the finest level's own loss is left, however many "
                "there are.  The paper prints no figure.",
                good ? field.quantum_m : 0.0);
    if (good) heightfield_finish(&field);
    return good;
}
