// SPDX-License-Identifier: MIT
#include "common/terrain/relief/relief_program.h"

#include "common/cli.h"
#include "common/report.h"
#include "common/terrain/heightfield.h"
#include "common/terrain/relief/relief_file.h"
#include "common/terrain/relief/relief_pack.h"

#include <cjson/cJSON.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

static const struct cli_option END = {NULL, NULL, NULL, CLI_FLAG, NULL, 0, 0, NULL};

bool relief_is_name(const char *path)
{
    size_t length = strlen(path);
    return length > 7 && strcasecmp(path + length - 7, ".relief") == 0;
}

static double cpu_seconds(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
}

static double file_bytes(const char *path)
{
    struct stat status;
    return stat(path, &status) == 0 ? (double)status.st_size : 0;
}

// ---- pack ------------------------------------------------------------------

// What the words ask for; false after one line on stderr.
static bool choose(const char *codec, double rms_m, double max_m, bool lossless,
                   struct relief_pack_options *options)
{
    int said = (rms_m >= 0) + (max_m >= 0) + lossless, layout = rms_m >= 0 ? LAYOUT_WAVELET : LAYOUT_BOUNDED;
    for (int i = 0; codec && i < LAYOUTS; i++)
        if (strcmp(codec, LAYOUT_NAMES[i]) == 0) layout = i;
    bool aimless = layout == LAYOUT_MARS || layout == LAYOUT_RAW;
    *options = (struct relief_pack_options){
        .layout = (enum layout)layout, .rms_m = rms_m >= 0 ? rms_m : 0, .max_m = max_m >= 0 ? max_m : 0};
    if (said != 1 && !aimless) return fail("pack: one of --rms M, --max M and --lossless is expected");
    if (said != 0 && aimless) return fail("pack: --codec %s takes no aim", codec);
    if (rms_m >= 0 && !(rms_m > 0)) return fail("pack: --rms 0 is --lossless; more than 0 is accepted");
    if (!aimless && (layout == LAYOUT_WAVELET) != (rms_m > 0))
        return fail("pack: --codec %s does not serve that aim; wavelet takes --rms, bounded and pyramid take "
                    "--max and --lossless",
                    codec);
    return true;
}

static double wall_seconds(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
}

static double peak_mib(void)
{
    struct rusage usage;
    return getrusage(RUSAGE_SELF, &usage) == 0 ? (double)usage.ru_maxrss / 1024 : 0;
}

// Samples of a level along an axis, a planet's margin not counted.
static int64_t size_of(const struct relief_header *h, int level, int axis)
{
    struct grid grid;
    grid_init(&grid, h->size[0], h->size[1]);
    return grid.size[level][axis] - 2 * ((int64_t)h->margin >> level);
}

static double samples_of(const struct relief_header *h)
{
    return (double)size_of(h, 0, 0) * (double)size_of(h, 0, 1);
}

static int levels_of(const struct relief *relief)
{
    const struct relief_header *h = relief_header(relief);
    return h->radius_m > 0 ? h->coarsest + 1 : relief_grid(relief)->count;
}

static void print_packed(const char *path, const struct relief_header *h, double wall_s)
{
    double samples = samples_of(h);
    double bytes = (double)(RELIEF_HEADER + h->payload_bytes + h->base_bytes + h->index_bytes);
    printf("%s: %s, %lld x %lld samples\n", path, LAYOUT_NAMES[h->layout], (long long)size_of(h, 0, 0),
           (long long)size_of(h, 0, 1));
    printf("%.0f bytes of samples, %.4f bits a sample; side section %.0f bytes, %.4f bits a sample\n", bytes,
           8 * bytes / samples, (double)h->side_bytes, 8 * (double)h->side_bytes / samples);
    printf("rms %.4g m, max %.4g m against the source; packed in %.2f s, %.2f s of CPU time, %.0f MiB at the "
           "peak\n",
           h->rms_m, h->max_m, wall_s, cpu_seconds(), peak_mib());
}

static volatile sig_atomic_t interrupted;

static void on_interrupt(int number)
{
    (void)number;
    interrupted = 1;
}

static int run_pack(const char *from, const char *to, struct relief_pack_options *pack)
{
    struct relief_source source;
    struct relief_header header;
    double start = wall_seconds();
    signal(SIGINT, on_interrupt);
    signal(SIGTERM, on_interrupt);
    pack->interrupted = &interrupted;
    if (!relief_source_open(&source, from, pack->memory_bytes, to)) return EXIT_WORLD;
    bool good = relief_pack_source(&source, pack, to, &header);
    if (good) print_packed(to, &header, wall_seconds() - start);
    relief_source_finish(&source);
    if (!good && interrupted) note("%s: interrupted; the same command goes on from here", to);
    return good ? EXIT_GOOD : interrupted ? EXIT_INTERRUPTED : EXIT_WORLD;
}

int relief_pack_main(int argc, char **argv)
{
    const char *words[2] = {NULL, NULL}, *codec = NULL;
    double rms_m = -1, max_m = -1;
    bool lossless = false, scaled = false, restart = false, progress = false;
    int count = 2, threads = 0, memory_mib = 512;
    const struct cli_option options[] = {
        {"rms", "M", "rms error to reach, metres", CLI_NUMBER, &rms_m, 0, 1e6, NULL},
        {"max", "M", "largest error allowed, metres", CLI_NUMBER, &max_m, 0, 1e6, NULL},
        {"lossless", NULL, "no error at all", CLI_FLAG, &lossless, 0, 0, NULL},
        {"codec", "NAME", "how", CLI_TEXT, &codec, 0, 0, "wavelet|bounded|pyramid|mars|raw"},
        {"scaled", NULL, "pyramid: level l may be 2^l times less accurate", CLI_FLAG, &scaled, 0, 0, NULL},
        {"memory", "MIB", "not to be exceeded", CLI_INT, &memory_mib, 1, 1 << 20, NULL},
        {"threads", "N", "by default one for each processor; changes no byte", CLI_INT, &threads, 1, 64,
         NULL},
        {"restart", NULL, "throw away what an interrupted pack has done", CLI_FLAG, &restart, 0, 0, NULL},
        {"progress", NULL, "tell how far it is, though stderr is no terminal", CLI_FLAG, &progress, 0, 0,
         NULL},
        END,
    };
    struct relief_pack_options pack;
    if (!cli_parse(argc, argv, options, words, &count)) return EXIT_COMMAND_LINE;
    if (count != 2 || !relief_is_name(words[1]))
        return fail("pack: an elevation file or a .json that tells what to generate, and a name that ends in "
                    ".relief are expected"),
               EXIT_COMMAND_LINE;
    if (!choose(codec, rms_m, max_m, lossless, &pack)) return EXIT_COMMAND_LINE;
    if (scaled && pack.layout != LAYOUT_PYRAMID)
        return fail("pack: --scaled goes with --codec pyramid alone"), EXIT_COMMAND_LINE;
    pack.memory_bytes = (size_t)memory_mib << 20;
    pack.threads = threads;
    pack.scaled = scaled;
    pack.restart = restart;
    pack.progress = progress || isatty(STDERR_FILENO);
    return run_pack(words[0], words[1], &pack);
}

// ---- unpack ----------------------------------------------------------------

int relief_unpack_main(int argc, char **argv)
{
    const char *words[2] = {NULL, NULL};
    int count = 2;
    if (!cli_parse(argc, argv, &END, words, &count)) return EXIT_COMMAND_LINE;
    size_t length = count == 2 ? strlen(words[1]) : 0;
    if (count != 2 || !relief_is_name(words[0]) || length < 5 || strcmp(words[1] + length - 4, ".png") != 0)
        return fail("unpack: a .relief file and a name that ends in .png are expected"), EXIT_COMMAND_LINE;
    struct heightfield field;
    if (!heightfield_load(&field, words[0])) return EXIT_WORLD;
    bool good = heightfield_save(&field, words[1], words[0]);
    heightfield_finish(&field);
    return good ? EXIT_GOOD : EXIT_WORLD;
}

// ---- info ------------------------------------------------------------------

static double level_error_m(const struct relief *relief, int level)
{
    const struct grid *grid = relief_grid(relief);
    uint32_t most = 0;
    if (level < grid->count - 1)
        for (int64_t i = 0; i < grid->tiles[level][0] * grid->tiles[level][1]; i++) {
            uint32_t error_q = relief_tile_error(relief, grid->first_tile[level] + i);
            most = error_q > most ? error_q : most;
        }
    return most * relief_header(relief)->quantum_m;
}

static void add_levels(cJSON *root, const struct relief *relief)
{
    const struct relief_header *h = relief_header(relief);
    cJSON *levels = cJSON_AddArrayToObject(root, "levels");
    for (int l = 0; l < levels_of(relief); l++) {
        cJSON *item = cJSON_CreateObject();
        cJSON_AddItemToArray(levels, item);
        cJSON_AddNumberToObject(item, "level", l);
        cJSON_AddNumberToObject(item, "width", (double)size_of(h, l, 0));
        cJSON_AddNumberToObject(item, "height", (double)size_of(h, l, 1));
        if (relief_level_rms(relief, l) >= 0)
            cJSON_AddNumberToObject(item, "rms_error_m", relief_level_rms(relief, l) * h->quantum_m);
        else
            cJSON_AddNullToObject(item, "rms_error_m"); // the file does not know
        if (l < relief_grid(relief)->count - 1)
            cJSON_AddNumberToObject(item, "max_error_m", level_error_m(relief, l));
        else
            cJSON_AddNullToObject(item, "max_error_m"); // the base has no tiles
    }
}

static void print_info_json(const struct relief *relief, double bytes)
{
    const struct relief_header *h = relief_header(relief);
    const struct grid *grid = relief_grid(relief);
    double samples = samples_of(h);
    cJSON *root = cJSON_CreateObject();
    cJSON_AddStringToObject(root, "name", h->name);
    cJSON_AddNumberToObject(root, "width", (double)size_of(h, 0, 0));
    cJSON_AddNumberToObject(root, "height", (double)size_of(h, 0, 1));
    cJSON_AddItemToObject(root, "spacing_m", cJSON_CreateDoubleArray(h->spacing_m, 2));
    if (h->radius_m > 0) {
        cJSON_AddNumberToObject(root, "radius_m", h->radius_m);
        cJSON_AddNumberToObject(root, "spacing_deg", 360.0 / (double)size_of(h, 0, 0));
        cJSON_AddNumberToObject(root, "margin", h->margin);
    }
    cJSON_AddNumberToObject(root, "height_scale", h->quantum_m);
    cJSON_AddNumberToObject(root, "height_offset", h->offset_m);
    cJSON_AddNumberToObject(root, "min_height_m", h->quantum_m * h->min_q + h->offset_m);
    cJSON_AddNumberToObject(root, "max_height_m", h->quantum_m * h->max_q + h->offset_m);
    cJSON_AddNumberToObject(root, "voids_filled", (double)h->voids_filled);
    cJSON_AddNumberToObject(root, "samples", samples);
    cJSON_AddNumberToObject(root, "format_version", h->version);
    cJSON_AddStringToObject(root, "codec", LAYOUT_NAMES[h->layout]);
    cJSON_AddNumberToObject(root, "tiles", (double)grid->tile_count);
    cJSON_AddNumberToObject(root, "file_bytes", bytes);
    cJSON_AddNumberToObject(root, "sample_bytes", (double)relief_sample_bytes(relief));
    cJSON_AddNumberToObject(root, "side_bytes", (double)h->side_bytes);
    cJSON_AddNumberToObject(root, "bits_per_sample", 8 * (double)relief_sample_bytes(relief) / samples);
    cJSON_AddNumberToObject(root, "rms_m", h->rms_m);
    cJSON_AddNumberToObject(root, "max_m", h->max_m);
    add_levels(root, relief);
    char *text = cJSON_Print(root);
    if (text) puts(text);
    cJSON_free(text);
    cJSON_Delete(root);
}

static void print_info_text(const struct relief *relief, double bytes)
{
    const struct relief_header *h = relief_header(relief);
    const struct grid *grid = relief_grid(relief);
    double samples = samples_of(h);
    printf("%s: %lld x %lld samples, %g x %g m apart, codec %s\n", h->name, (long long)size_of(h, 0, 0),
           (long long)size_of(h, 0, 1), h->spacing_m[0], h->spacing_m[1], LAYOUT_NAMES[h->layout]);
    if (h->radius_m > 0)
        printf("a planet of radius %g m, with a margin of %d samples over the seam and the poles\n",
               h->radius_m, h->margin);
    printf("heights %g to %g m in steps of %g m, %llu voids filled\n", h->quantum_m * h->min_q + h->offset_m,
           h->quantum_m * h->max_q + h->offset_m, h->quantum_m, (unsigned long long)h->voids_filled);
    printf("rms %.4g m, max %.4g m against the source\n", h->rms_m, h->max_m);
    printf("%.0f bytes: samples %.4f bits each, side section %.4f bits a sample\n", bytes,
           8 * (double)relief_sample_bytes(relief) / samples, 8 * (double)h->side_bytes / samples);
    printf(
        "format version %d: header %d, %lld tiles %llu, base %llu, index %llu bytes; side section (checksum, "
        "lowest, highest and largest error of each tile) %llu bytes\n",
        h->version, RELIEF_HEADER, (long long)grid->tile_count, (unsigned long long)h->payload_bytes,
        (unsigned long long)h->base_bytes, (unsigned long long)h->index_bytes,
        (unsigned long long)h->side_bytes);
    printf("\n level      samples   from level 0, m: rms    at most\n");
    for (int l = 0; l < levels_of(relief); l++) {
        char size[48], rms[24] = "unknown", most[24] = "(no tiles)";
        snprintf(size, sizeof size, "%lld x %lld", (long long)size_of(h, l, 0), (long long)size_of(h, l, 1));
        if (relief_level_rms(relief, l) >= 0)
            snprintf(rms, sizeof rms, "%.3f", relief_level_rms(relief, l) * h->quantum_m);
        if (l < grid->count - 1) snprintf(most, sizeof most, "%.3f", level_error_m(relief, l));
        printf("%6d %12s %22s %10s\n", l, size, rms, most);
    }
}

int relief_print_info(const char *path, bool json)
{
    struct relief *relief = relief_open(path);
    if (!relief) return EXIT_WORLD;
    if (json)
        print_info_json(relief, file_bytes(path));
    else
        print_info_text(relief, file_bytes(path));
    relief_close(relief);
    return EXIT_GOOD;
}
