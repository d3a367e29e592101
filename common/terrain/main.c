// The `terrain` program: what is in an elevation file, other formats to ours, and made terrain.
// SPDX-License-Identifier: MIT
#include "common/cli.h"
#include "common/report.h"
#include "common/terrain/generate.h"
#include "common/terrain/heightfield.h"
#include "common/terrain/relief/relief_program.h"
#include "common/terrain/terrain.h"
#include "common/terrain/tint.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

static const char HELP[] =
    "usage: terrain info [--json] [--synthesize N] FILE\n"
    "       terrain import IN OUT.png\n"
    "       terrain tint IN OUT.png [--size WxH]\n"
    "       terrain generate OUT.png [--kind K] [--size WxH] [--spacing M] [--relief M] [--seed N]\n"
    "       terrain pack IN OUT.relief (--rms M | --max M | --lossless) [--codec C [--scaled]] [--memory "
    "MIB]\n"
    "                    [--threads N] [--restart] [--progress]\n"
    "       terrain unpack F.relief OUT.png\n"
    "       terrain compare [--json] A B\n"
    "       terrain compare [--json] MAP (--rms M | --max M | --lossless)\n"
    "       terrain --help | --version\n"
    "\n"
    "info      what an elevation file holds: its size, heights, voids, and the error of each level\n"
    "import    any elevation file to a 16-bit PNG with a JSON sidecar\n"
    "tint      a colour image for an elevation file that has none: an atlas's tints by height\n"
    "generate  made terrain: shapes with known answers and a seeded fractal\n"
    "pack      any elevation file, or a .json that tells what to generate, to a compressed one: to an rms "
    "error\n"
    "          (codec wavelet), or so that no sample of any level is off by more than M metres, or without "
    "loss\n"
    "          (codec bounded).  To compare: codecs pyramid (--max, --lossless; --scaled) as the clipmap "
    "paper\n"
    "          has it, mars, another's blocks, and raw.  Large maps are packed by regions, so that --memory "
    "(512 MiB) is kept; the "
    "work\n"
    "          lies in OUT.relief.part, and a pack that was interrupted goes on where it was, but with "
    "--restart\n"
    "unpack    a compressed file to a 16-bit PNG with a JSON sidecar\n"
    "compare   two elevation files of one size: rms and largest difference, bytes, bits a sample;\n"
    "          or one map through every coder here, JPEG 2000, JPEG-LS, LERC and zlib beside, at one error\n"
    "\n"
    "Accepted files: 16-bit grey .png with a .json beside it, SRTM .hgt, .relief, and .raw (also .bin .r16\n"
    ".r32 .f32 .flt .bil) with a .json that gives width, height, dtype and spacing_m"
#ifdef RELIEF_GDAL
    "; and what GDAL reads"
#endif
    ".\n"
    "Exit code: 0 good, 1 a file that does not serve, 2 the command line.\n";

// ---- info ------------------------------------------------------------------

static double metres(const struct terrain_info *info, int32_t q)
{
    return info->quantum_m * q + info->offset_m;
}

// NAN: nobody knows.
static void add_error(cJSON *item, const char *name, double error_m)
{
    cJSON_AddItemToObject(item, name, isnan(error_m) ? cJSON_CreateNull() : cJSON_CreateNumber(error_m));
}

static void print_json(const struct terrain *terrain)
{
    const struct terrain_info *info = terrain_info(terrain);
    struct terrain_level stored = terrain_level(terrain, 0);
    cJSON *root = cJSON_CreateObject();
    cJSON_AddStringToObject(root, "name", info->name);
    cJSON_AddNumberToObject(root, "width", (double)(stored.extent.x1 - stored.extent.x0));
    cJSON_AddNumberToObject(root, "height", (double)(stored.extent.y1 - stored.extent.y0));
    cJSON_AddItemToObject(root, "spacing_m", cJSON_CreateDoubleArray(info->spacing_m, 2));
    cJSON_AddNumberToObject(root, "height_scale", info->quantum_m);
    cJSON_AddNumberToObject(root, "height_offset", info->offset_m);
    cJSON_AddNumberToObject(root, "min_height_m", metres(info, stored.min_q));
    cJSON_AddNumberToObject(root, "max_height_m", metres(info, stored.max_q));
    cJSON_AddNumberToObject(root, "voids_filled", (double)info->voids_filled);
    cJSON_AddNumberToObject(root, "samples", (double)info->samples);
    // These formats lose nothing, and carry nothing beside the samples.
    cJSON_AddNumberToObject(root, "side_bytes", 0);
    cJSON_AddNumberToObject(root, "rms_m", 0);
    cJSON_AddNumberToObject(root, "max_m", 0);
    cJSON *levels = cJSON_AddArrayToObject(root, "levels");
    for (int l = info->finest; l <= info->coarsest; l++) {
        struct terrain_level level = terrain_level(terrain, l);
        cJSON *item = cJSON_CreateObject();
        cJSON_AddItemToArray(levels, item);
        cJSON_AddNumberToObject(item, "level", l);
        cJSON_AddNumberToObject(item, "width", (double)(level.extent.x1 - level.extent.x0));
        cJSON_AddNumberToObject(item, "height", (double)(level.extent.y1 - level.extent.y0));
        add_error(item, "rms_error_m", level.rms_error_m);
        if (level.rms_estimated) cJSON_AddTrueToObject(item, "rms_error_is_estimated");
        add_error(item, "max_error_m", level.max_error_m);
        if (level.max_estimated) cJSON_AddTrueToObject(item, "max_error_is_estimated");
    }
    char *text = cJSON_Print(root);
    if (text) puts(text);
    cJSON_free(text);
    cJSON_Delete(root);
}

static void print_text(const struct terrain *terrain)
{
    const struct terrain_info *info = terrain_info(terrain);
    struct terrain_level stored = terrain_level(terrain, 0);
    long long width = stored.extent.x1 - stored.extent.x0, height = stored.extent.y1 - stored.extent.y0;
    printf("%s: %lld x %lld samples, %g x %g m apart (%.4g x %.4g km)\n", info->name, width, height,
           info->spacing_m[0], info->spacing_m[1], (double)(width - 1) * info->spacing_m[0] / 1000,
           (double)(height - 1) * info->spacing_m[1] / 1000);
    printf("heights %g to %g m in steps of %g m, %llu voids filled\n", metres(info, stored.min_q),
           metres(info, stored.max_q), info->quantum_m, (unsigned long long)info->voids_filled);
    printf("\n level      samples   spacing m   error against the finest level, m: rms        max\n");
    for (int l = info->finest; l <= info->coarsest; l++) {
        struct terrain_level level = terrain_level(terrain, l);
        char size[48];
        snprintf(size, sizeof size, "%lld x %lld", (long long)(level.extent.x1 - level.extent.x0),
                 (long long)(level.extent.y1 - level.extent.y0));
        printf("%6d %12s %11.6g", l, size, level.spacing_m[0]);
        if (isnan(level.rms_error_m))
            printf(" %43s %10s\n", "-", "-");
        else
            printf(" %43.3f %10.3f\n", level.rms_error_m, level.max_error_m);
    }
    struct terrain_level coarsest = terrain_level(terrain, info->coarsest);
    if (isnan(coarsest.rms_error_m))
        printf("synthesised levels of a planet are made where they are looked at: no level was compared with "
               "the finest\n");
    else if (coarsest.rms_estimated)
        printf("rms%s: estimated, from a few blocks spread over the map%s\n",
               coarsest.max_estimated ? " and max" : "", coarsest.max_estimated ? "" : "; max: of all of it");
}

static int info_main(int argc, char **argv)
{
    bool json = false;
    int finer = 0;
    const char *words[1] = {NULL};
    int count = 1;
    const struct cli_option options[] = {
        {"json", NULL, "print JSON", CLI_FLAG, &json, 0, 0, NULL},
        {"synthesize", "N", "finer levels to add, 0..8; to a planet 0..18", CLI_INT, &finer, 0, 18, NULL},
        {NULL, NULL, NULL, CLI_FLAG, NULL, 0, 0, NULL},
    };
    if (!cli_parse(argc, argv, options, words, &count)) return EXIT_COMMAND_LINE;
    if (count != 1) return fail("info: the name of an elevation file is expected"), EXIT_COMMAND_LINE;
    if (relief_is_name(words[0]) && finer == 0) return relief_print_info(words[0], json);
    struct terrain_options build = {.synthesize_levels = finer};
    struct terrain *terrain = terrain_load(words[0], &build);
    if (!terrain) return EXIT_WORLD;
    if (json)
        print_json(terrain);
    else
        print_text(terrain);
    terrain_destroy(terrain);
    return EXIT_GOOD;
}

// ---- import ----------------------------------------------------------------

static bool is_png(const char *path)
{
    size_t length = strlen(path);
    return length > 4 && strcmp(path + length - 4, ".png") == 0;
}

static int import_main(int argc, char **argv)
{
    const char *words[2] = {NULL, NULL};
    int count = 2;
    const struct cli_option options[] = {{NULL, NULL, NULL, CLI_FLAG, NULL, 0, 0, NULL}};
    if (!cli_parse(argc, argv, options, words, &count)) return EXIT_COMMAND_LINE;
    if (count != 2 || !is_png(words[1]))
        return fail("import: an elevation file and a name that ends in .png are expected"), EXIT_COMMAND_LINE;
    struct heightfield field;
    if (!heightfield_load(&field, words[0])) return EXIT_WORLD;
    bool good = heightfield_save(&field, words[1], words[0]);
    heightfield_finish(&field);
    return good ? EXIT_GOOD : EXIT_WORLD;
}

// ---- tint ------------------------------------------------------------------

static int tint_main(int argc, char **argv)
{
    const char *words[2] = {NULL, NULL};
    int count = 2, size[2] = {2048, 1024};
    const struct cli_option options[] = {
        {"size", "WxH", "pixels of the image", CLI_SIZE, size, 1, 16384, NULL},
        {0},
    };
    if (!cli_parse(argc, argv, options, words, &count)) return EXIT_COMMAND_LINE;
    if (count != 2 || !is_png(words[1]))
        return fail("tint: an elevation file and a name that ends in .png are expected"), EXIT_COMMAND_LINE;
    struct heightfield field;
    if (!heightfield_load(&field, words[0])) return EXIT_WORLD;
    bool good = tint_save(&field, words[1], size[0], size[1]);
    heightfield_finish(&field);
    return good ? EXIT_GOOD : EXIT_WORLD;
}

// ---- generate --------------------------------------------------------------

static int generate_main(int argc, char **argv)
{
    struct generate_options made = {.kind = "fractal", .spacing_m = 30};
    int size[2] = {1025, 1025}, seed = 1;
    const char *words[1] = {NULL};
    int count = 1;
    const struct cli_option options[] = {
        {"kind", "K", "what to make", CLI_TEXT, &made.kind, 0, 0, GENERATE_KINDS},
        {"size", "WxH", "samples, 1..32768 each", CLI_SIZE, size, 1, 32768, NULL},
        {"spacing", "M", "metres between samples", CLI_NUMBER, &made.spacing_m, 1e-6, 1e6, NULL},
        {"relief", "M", "height of the shape in metres; by default the kind's own", CLI_NUMBER,
         &made.relief_m, -1e5, 1e7, NULL},
        {"seed", "N", "of the fractal and of the voids", CLI_INT, &seed, 0, 2147483647, NULL},
        {NULL, NULL, NULL, CLI_FLAG, NULL, 0, 0, NULL},
    };
    if (!cli_parse(argc, argv, options, words, &count)) return EXIT_COMMAND_LINE;
    if (count != 1 || !is_png(words[0]))
        return fail("generate: a name that ends in .png is expected"), EXIT_COMMAND_LINE;
    made.width = size[0];
    made.height = size[1];
    made.seed = (uint64_t)seed;
    struct heightfield field;
    char origin[160];
    snprintf(origin, sizeof origin,
             "generated: --kind %s --size %dx%d --spacing %.10g --relief %.10g --seed %d", made.kind, size[0],
             size[1], made.spacing_m, made.relief_m != 0 ? made.relief_m : generate_default_relief(&made),
             seed);
    if (!generate(&field, &made)) return EXIT_WORLD;
    bool good = heightfield_save(&field, words[0], origin);
    heightfield_finish(&field);
    return good ? EXIT_GOOD : EXIT_WORLD;
}

int main(int argc, char **argv)
{
    static const struct {
        const char *name;
        int (*run)(int argc, char **argv);
    } COMMANDS[] = {{"info", info_main},
                    {"import", import_main},
                    {"tint", tint_main},
                    {"generate", generate_main},
                    {"pack", relief_pack_main},
                    {"unpack", relief_unpack_main},
                    {"compare", relief_compare_main}};
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--help") == 0 || strcmp(argv[i], "-h") == 0) return fputs(HELP, stdout) < 0;
        if (strcmp(argv[i], "--version") == 0) return printf("terrain (relief) %s\n", RELIEF_VERSION) < 0;
    }
    for (size_t i = 0; argc > 1 && i < sizeof COMMANDS / sizeof *COMMANDS; i++)
        if (strcmp(argv[1], COMMANDS[i].name) == 0) return COMMANDS[i].run(argc - 1, argv + 1);
    fail("%s: info, import, tint, generate, pack, unpack or compare is expected; --help tells more",
         argc > 1 ? argv[1] : "terrain");
    return EXIT_COMMAND_LINE;
}
