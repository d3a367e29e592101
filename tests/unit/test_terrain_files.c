// Elevation files: what is read is what was written, voids are found, and a bad file is one line that names
// it. SPDX-License-Identifier: MIT
#include "tests/folder.h"

#include "common/image.h"
#include "common/terrain/generate.h"
#include "common/terrain/heightfield.h"
#include "common/terrain/terrain.h"

#include <cjson/cJSON.h>
#include <fcntl.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>

// ---- stderr, kept ----------------------------------------------------------

static int kept_stderr;

static void hold_stderr(void)
{
    fflush(stderr);
    kept_stderr = dup(2);
    int file = open(in_folder("stderr"), O_CREAT | O_TRUNC | O_RDWR, 0600);
    dup2(file, 2);
    close(file);
}

// Gives stderr back; returns the number of lines that were written to it.
static int release_stderr(char *text, size_t size)
{
    fflush(stderr);
    dup2(kept_stderr, 2);
    close(kept_stderr);
    FILE *file = fopen(in_folder("stderr"), "r");
    size_t length = fread(text, 1, size - 1, file);
    fclose(file);
    text[length] = 0;
    int lines = 0;
    for (size_t i = 0; i < length; i++) lines += text[i] == '\n';
    return lines;
}

static struct terrain *load(const char *name)
{
    return terrain_load(in_folder(name), NULL);
}

// The file is refused with one line that holds both words.
static void refused(const char *name, const char *word, const char *other)
{
    char text[4096];
    hold_stderr();
    struct terrain *terrain = load(name);
    int lines = release_stderr(text, sizeof text);
    if (terrain || lines != 1 || !strstr(text, word) || !strstr(text, other))
        fail_msg("%s: %s, %d lines: %s", name, terrain ? "taken" : "refused", lines, text);
}

// The file is taken, with so many lines of notes.
static struct terrain *taken(const char *name, int notes)
{
    char text[4096];
    hold_stderr();
    struct terrain *terrain = load(name);
    int lines = release_stderr(text, sizeof text);
    if (!terrain || lines != notes) fail_msg("%s: %d lines: %s", name, lines, text);
    return terrain;
}

static double height_at(const struct terrain *terrain, int64_t x, int64_t row_from_north)
{
    struct terrain_extent e = terrain_level(terrain, 0).extent;
    int32_t q;
    terrain_window(terrain, 0, x, e.y1 - 1 - row_from_north, 1, 1, &q, TERRAIN_WAIT);
    return terrain_info(terrain)->quantum_m * q + terrain_info(terrain)->offset_m;
}

// ---- good files ------------------------------------------------------------

static void png_with_sidecar(void **state)
{
    (void)state;
    const uint16_t samples[6] = {0, 1, 65535, 100, 65106, 7};
    assert_true(image_write_grey16(in_folder("a.png"), 3, 2, samples));
    write_text(
        "a.json",
        "{\"spacing_m\": [10, 20.5], \"height_scale\": 0.5, \"height_offset\": -3, \"colour\": \"any\"}");
    struct terrain *terrain = taken("a.png", 0);
    const struct terrain_info *info = terrain_info(terrain);
    for (int i = 0; i < 6; i++) assert_true(height_at(terrain, i % 3, i / 3) == samples[i] * 0.5 - 3);
    assert_true(info->spacing_m[0] == 10 && info->spacing_m[1] == 20.5 && info->voids_filled == 0);
    assert_string_equal(info->name, "a");
    terrain_destroy(terrain);
    // Read as signed only when the sidecar says so (numerics.md, E2): -430 is kept, 65106 is not made of it.
    write_text("a.json", "{\"spacing_m\": 30, \"dtype\": \"int16\"}");
    terrain = taken("a.png", 0);
    assert_true(height_at(terrain, 1, 1) == -430 && height_at(terrain, 2, 0) == -1);
    terrain_destroy(terrain);
    write_text("a.json", "{\"spacing_m\": 30, \"nodata\": 65535, \"width\": 3, \"height\": 2}");
    terrain = taken("a.png", 1); // one note: a void was filled
    assert_int_equal(terrain_info(terrain)->voids_filled, 1);
    assert_true(height_at(terrain, 2, 0) <= 65106);
    terrain_destroy(terrain);
    unlink(in_folder("a.json"));
    terrain = taken("a.png", 1); // one note: what is assumed
    assert_true(terrain_info(terrain)->spacing_m[0] == 30 && height_at(terrain, 2, 0) == 65535);
    terrain_destroy(terrain);
}

static void srtm_tiles(void **state)
{
    (void)state;
    enum { SIDE = 13 };
    unsigned char data[SIDE * SIDE * 2];
    for (int i = 0; i < SIDE * SIDE; i++) {
        int height = i == 20 ? -32768 : i * 50 - 430;
        data[2 * i] = (unsigned char)(height >> 8 & 0xff);
        data[2 * i + 1] = (unsigned char)(height & 0xff);
    }
    write_file("N47W122.hgt", data, sizeof data);
    struct terrain *terrain = taken("N47W122.hgt", 1); // a void
    const struct terrain_info *info = terrain_info(terrain);
    assert_int_equal(info->voids_filled, 1);
    assert_true(height_at(terrain, 0, 0) == -430 && height_at(terrain, 3, 2) == 29 * 50 - 430);
    double degree_m = 6371007.2 * 3.14159265358979323846 / 180;
    assert_true(fabs(info->spacing_m[1] * (SIDE - 1) / degree_m - 1) < 1e-12);
    assert_true(fabs(info->spacing_m[0] / info->spacing_m[1] - cos(47.5 * 3.14159265358979323846 / 180)) <
                1e-12);
    terrain_destroy(terrain);
    write_file("s01e010.hgt", data, sizeof data);
    terrain = taken("s01e010.hgt", 1);
    assert_true(fabs(terrain_info(terrain)->spacing_m[0] / terrain_info(terrain)->spacing_m[1] -
                     cos(0.5 * 3.14159265358979323846 / 180)) < 1e-12);
    terrain_destroy(terrain);
    write_file("tile.hgt", data, sizeof data);
    terrain = taken("tile.hgt", 2); // a void, and no latitude
    assert_true(terrain_info(terrain)->spacing_m[0] == terrain_info(terrain)->spacing_m[1]);
    terrain_destroy(terrain);
    write_file("N01E001.hgt", data, sizeof data - 2);
    refused("N01E001.hgt", "N01E001.hgt", "square");
}

static void raw_files(void **state)
{
    (void)state;
    const unsigned char words[8] = {0x01, 0x02, 0xff, 0xfe,
                                    0xd8, 0xf1, 0x00, 0x80}; // 0xd8f1: -9999; 0x8000: -32768
    write_file("r.raw", words, sizeof words);
    write_text("r.json", "{\"width\": 2, \"height\": 2, \"dtype\": \"uint16\", \"spacing_m\": 5}");
    struct terrain *terrain = taken("r.raw", 0);
    assert_true(height_at(terrain, 0, 0) == 0x0201 && height_at(terrain, 1, 1) == 0x8000);
    assert_int_equal(terrain_info(terrain)->voids_filled, 0); // unsigned samples are no -32768
    terrain_destroy(terrain);
    write_text("r.json",
               "{\"width\": 2, \"height\": 2, \"dtype\": \"int16\", \"spacing_m\": 5, \"endian\": \"big\"}");
    terrain = taken("r.raw", 1);
    assert_true(height_at(terrain, 0, 0) == 0x0102 && height_at(terrain, 1, 0) == -2 &&
                height_at(terrain, 1, 1) == 0x80);
    assert_int_equal(terrain_info(terrain)->voids_filled, 1);
    terrain_destroy(terrain);

    float floats[12] = {0,         1.25f, -430,   8848.86f,       NAN,   INFINITY,
                        -INFINITY, -9999, -32768, -3.4028235e38f, 12345, 0.5f};
    write_file("f.raw", floats, sizeof floats);
    write_text("f.json",
               "{\"width\": 4, \"height\": 3, \"dtype\": \"float32\", \"spacing_m\": 5, \"nodata\": 12345}");
    terrain = taken("f.raw", 1);
    assert_int_equal(terrain_info(terrain)->voids_filled, 7);
    double half_step = terrain_info(terrain)->quantum_m / 2;
    assert_true(half_step <= 9300.0 / (1 << 20)); // about 20 bits over the range
    assert_true(height_at(terrain, 0, 0) == 0 && height_at(terrain, 1, 0) == 1.25 &&
                height_at(terrain, 2, 0) == -430);
    assert_true(fabs(height_at(terrain, 3, 0) - (double)8848.86f) <= half_step &&
                height_at(terrain, 3, 2) == 0.5);
    for (int i = 0; i < 12; i++) {
        double height = height_at(terrain, i % 4, i / 4);
        assert_true(height >= -430 && height <= 8848.87);
    }
    terrain_destroy(terrain);
}

// What GDAL reads: an Arc/Info grid, north row first, in metres and in degrees; nodata; a truncated one is
// refused.
static void gdal_rasters(void **state)
{
    (void)state;
#ifdef RELIEF_GDAL
    const char *grid = "ncols 3\nnrows 2\nxllcorner 10\nyllcorner 59\ncellsize 25\nNODATA_value -7\n"
                       "1.5 2 -7\n-430.25 5 6\n";
    write_text("metres.asc", grid);
    struct terrain *terrain = taken("metres.asc", 1);
    const struct terrain_info *info = terrain_info(terrain);
    assert_true(info->spacing_m[0] == 25 && info->spacing_m[1] == 25 && info->voids_filled == 1);
    assert_true(height_at(terrain, 0, 0) == 1.5 && height_at(terrain, 1, 0) == 2);
    assert_true(height_at(terrain, 0, 1) == -430.25 && height_at(terrain, 2, 1) == 6);
    terrain_destroy(terrain);

    write_text("degrees.asc", "ncols 2\nnrows 2\nxllcorner 10\nyllcorner 59\ncellsize 1\n1 2\n3 4\n");
    write_text("degrees.prj",
               "GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563]],"
               "PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]]\n");
    terrain = taken("degrees.asc", 0);
    info = terrain_info(terrain);
    double degree_m =
        HEIGHTFIELD_EARTH_RADIUS_M * M_PI / 180; // the middle of two rows from 59 on is at 60: half as wide
    assert_true(fabs(info->spacing_m[1] - degree_m) <= 1e-9 * degree_m);
    assert_true(fabs(info->spacing_m[0] - degree_m / 2) <= 1e-9 * degree_m);
    assert_true(height_at(terrain, 1, 0) == 2 && height_at(terrain, 0, 1) == 3);
    terrain_destroy(terrain);

    write_text("cut.asc", "ncols 300\nnrows 200\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2 3\n");
    refused("cut.asc", "cut.asc", "raster that GDAL reads");
    write_text("words.asc", "not a raster\n");
    refused("words.asc", "words.asc", "raster that GDAL reads");
#else
    printf("skipped: built without GDAL\n");
#endif
}

static void generated_and_imported(void **state)
{
    (void)state;
    char kinds[] = GENERATE_KINDS;
    int count = 0;
    for (char *kind = strtok(kinds, "|"); kind; kind = strtok(NULL, "|"), count++)
        for (int size = 0; size < 3; size++) {
            struct generate_options made = {
                kind, size == 0 ? 1 : size == 1 ? 2 : 70, size == 0 ? 1 : size == 1 ? 3 : 50, 30, 0, 9};
            struct heightfield field, back;
            assert_true(generate(&field, &made));
            uint64_t voids = 0;
            for (int i = 0; i < made.width * made.height; i++) voids += field.samples[i] == HEIGHTFIELD_VOID;
            if (voids == (uint64_t)(made.width * made.height)) {
                heightfield_finish(&field);
                continue;
            }
            assert_true(heightfield_save(&field, in_folder("made.png"), "test"));
            assert_true(heightfield_load(&back, in_folder("made.png")));
            assert_true(back.width == field.width && back.height == field.height && back.spacing_m[1] == 30);
            for (int i = 0; i < made.width * made.height; i++) {
                bool is_void = field.samples[i] == HEIGHTFIELD_VOID;
                assert_true(is_void == (back.samples[i] == HEIGHTFIELD_VOID));
                double a = field.samples[i] * field.quantum_m + field.offset_m;
                double b = back.samples[i] * back.quantum_m + back.offset_m;
                assert_true(is_void ||
                            fabs(a - b) <= 1e-9); // 15 bits either side of the middle: nothing is lost
            }
            heightfield_finish(&field);
            heightfield_finish(&back);
        }
    assert_int_equal(count, 11);
}

static void packing_rounds_what_16_bits_do_not_hold(void **state)
{
    (void)state;
    int32_t samples[5] = {-1000000, 1000000, 3, HEIGHTFIELD_VOID, 777777};
    struct heightfield field = {.name = "wide",
                                .width = 5,
                                .height = 1,
                                .samples = samples,
                                .spacing_m = {1, 1},
                                .quantum_m = 0.01,
                                .offset_m = 5},
                       back;
    char text[4096];
    hold_stderr();
    bool good = heightfield_save(&field, in_folder("wide.png"), "test") &&
                heightfield_load(&back, in_folder("wide.png"));
    assert_int_equal(release_stderr(text, sizeof text), 1);
    assert_true(good);
    assert_true(back.samples[3] == HEIGHTFIELD_VOID);
    for (int i = 0; i < 5; i++) {
        double a = samples[i] * 0.01 + 5, b = back.samples[i] * back.quantum_m + back.offset_m;
        assert_true(i == 3 ||
                    fabs(a - b) <= 20000.0 / 65534); // half a step of at most two 65,534ths of the range
    }
    heightfield_finish(&back);
}

static void data_sets(void **state)
{
    (void)state;
    static const struct {
        const char *name;
        int64_t width, height;
        double low, high;
    } SETS[] = {{"puget_1k_160m.png", 1025, 1025, 0, 4379.8},
                {"puget_srtm3_strip_3601x1201.png", 3601, 1201, 0, 2835},
                {"earth_etopo5_4320x2161.png", 4320, 2161, -10376, 7833}};
    for (size_t i = 0; i < sizeof SETS / sizeof *SETS; i++) {
        char path[1024];
        if (!test_data(SETS[i].name, path)) continue;
        struct terrain *terrain = terrain_load(path, NULL);
        assert_non_null(terrain);
        const struct terrain_info *info = terrain_info(terrain);
        struct terrain_extent e = terrain_level(terrain, 0).extent;
        assert_true(e.x1 - e.x0 == SETS[i].width && e.y1 - e.y0 == SETS[i].height);
        assert_true(fabs(info->min_q * info->quantum_m + info->offset_m - SETS[i].low) < 1e-6);
        assert_true(fabs(info->max_q * info->quantum_m + info->offset_m - SETS[i].high) < 1e-6);
        terrain_destroy(terrain);
    }
}

// ---- bad files -------------------------------------------------------------

static void bad_pngs(void **state)
{
    (void)state;
    uint16_t samples[64 * 64];
    uint64_t random = 1;
    for (int i = 0; i < 64 * 64; i++) samples[i] = (uint16_t)test_random(&random);
    assert_true(image_write_grey16(in_folder("whole.png"), 64, 64, samples));
    FILE *file = fopen(in_folder("whole.png"), "rb");
    static unsigned char data[20000], cut[20000];
    size_t size = fread(data, 1, sizeof data, file);
    fclose(file);
    assert_in_range(size, 8000, 19999);
    write_text("cut.json", "{\"spacing_m\": 30}");
    int cuts = 0;
    for (size_t length = 0; length < size; length += (size_t)test_size(97, 1), cuts++) {
        write_file("cut.png", data, length);
        refused("cut.png", "cut.png", "PNG");
    }
    write_file("cut.png", data, size - 1); // the last byte counts too
    refused("cut.png", "cut.png", "PNG");
    int harmed = 0;
    for (size_t at = 0; at < size;
         at += (size_t)test_size(97, 7)) { // one byte changed: refused, or a chunk that no height needs
        memcpy(cut, data, size);
        cut[at] ^= 0x55;
        write_file("cut.png", cut, size);
        char text[4096];
        hold_stderr();
        struct terrain *terrain = load("cut.png");
        int lines = release_stderr(text, sizeof text);
        assert_int_equal(lines, terrain ? 0 : 1);
        harmed += terrain == NULL;
        terrain_destroy(terrain);
    }
    FIGURE("truncated PNGs refused with one line: %d, harmed ones: %d", cuts, harmed);
    refused("missing.png", "missing.png", "No such file");
    uint8_t colours[12] = {0};
    assert_true(image_write_png(in_folder("colour.png"), 2, 2, 3, colours));
    refused("colour.png", "colour.png", "16-bit grey");
    mkdir(in_folder("folder.png"), 0700);
    refused("folder.png", "folder.png", "16-bit grey");
    refused("unknown.xyz", "unknown.xyz", ".hgt");
    write_text("empty.png", "");
    refused("empty.png", "empty.png", "PNG");
    for (int i = 0; i < 64 * 64; i++) samples[i] = 9;
    assert_true(image_write_grey16(in_folder("void.png"), 64, 64, samples));
    write_text("void.json", "{\"spacing_m\": 30, \"nodata\": 9}");
    refused("void.png", "void", "every sample is void");
}

static void bad_sidecars(void **state)
{
    (void)state;
    static const struct {
        const char *text, *word;
    } BAD[] = {
        {"{\"spacing_m\": 30, \"width\": 4}", "sidecar says 4 x 2"},
        {"{\"spacing_m\": 30, \"height\": 3}", "sidecar says 3 x 3"},
        {"{\"spacing_m\": 30, \"width\": \"3\"}", "width"},
        {"{\"spacing_m\": 30, \"width\": 2.5}", "width"},
        {"{}", "spacing_m"},
        {"{\"spacing_m\": 0}", "spacing_m"},
        {"{\"spacing_m\": -1}", "spacing_m"},
        {"{\"spacing_m\": [1, 2, 3]}", "spacing_m"},
        {"{\"spacing_m\": [1, \"2\"]}", "spacing_m"},
        {"{\"spacing_m\": 1e999}", "spacing_m"},
        {"{\"spacing_m\": 30, \"height_scale\": 0}", "height_scale"},
        {"{\"spacing_m\": 30, \"height_scale\": -1}", "height_scale"},
        {"{\"spacing_m\": 30, \"height_offset\": \"low\"}", "height_offset"},
        {"{\"spacing_m\": 30, \"dtype\": \"uint8\"}", "dtype"},
        {"{\"spacing_m\": 30, \"dtype\": \"float32\"}", "dtype"},
        {"{\"spacing_m\": 30, \"nodata\": []}", "nodata"},
        {"{\"spacing_m\": 30, \"endian\": \"middle\"}", "endian"},
        {"{\"spacing_m\": 30", "JSON"},
        {"[30]", "JSON"},
        {"", "JSON"},
    };
    const uint16_t samples[6] = {1, 2, 3, 4, 5, 6};
    assert_true(image_write_grey16(in_folder("b.png"), 3, 2, samples));
    for (size_t i = 0; i < sizeof BAD / sizeof *BAD; i++) {
        write_text("b.json", BAD[i].text);
        refused("b.png", "/b.", BAD[i].word);
    }
    write_file("c.raw", samples, sizeof samples);
    refused("c.raw", "c.raw", "needs the sidecar");
    write_text("c.json", "{\"spacing_m\": 30, \"width\": 3, \"height\": 2}");
    refused("c.raw", "c.raw", "dtype");
    write_text("c.json", "{\"spacing_m\": 30, \"width\": 3, \"height\": 3, \"dtype\": \"uint16\"}");
    refused("c.raw", "c.raw", "must agree");
    write_text("c.json",
               "{\"spacing_m\": 30, \"width\": 1000000000, \"height\": 1000000000, \"dtype\": \"float32\"}");
    refused("c.raw", "c.raw", "must agree");
}

static void unwritable_places(void **state)
{
    (void)state;
    int32_t samples[4] = {1, 2, 3, 4};
    struct heightfield field = {
        .name = "four", .width = 2, .height = 2, .samples = samples, .spacing_m = {1, 1}, .quantum_m = 1};
    char text[4096];
    hold_stderr();
    assert_false(heightfield_save(&field, in_folder("nowhere/out.png"), "test"));
    assert_int_equal(release_stderr(text, sizeof text), 1);
    assert_non_null(strstr(text, "nowhere/out"));
    hold_stderr();
    mkdir(in_folder("taken.png"), 0700); // a folder of that name: the sidecar must not stay behind
    assert_false(heightfield_save(&field, in_folder("taken.png"), "test"));
    assert_int_equal(release_stderr(text, sizeof text), 1);
    assert_int_equal(access(in_folder("taken.json"), F_OK), -1);
}

static void mutated_files(void **state) // whatever a file holds: a terrain, or one line
{
    (void)state;
    static const char SIDE[] =
        "{\"width\": 6, \"height\": 5, \"dtype\": \"float32\", \"spacing_m\": [3, 4.5], "
        "\"height_scale\": 0.5, \"height_offset\": -3, \"nodata\": -1, \"endian\": \"big\"}";
    uint64_t random = 5;
    int cases = test_size(1500, 20000), good = 0;
    for (int n = 0; n < cases; n++) {
        unsigned char data[6 * 5 * 4];
        char side[sizeof SIDE], text[4096];
        for (size_t i = 0; i < sizeof data; i++) data[i] = (unsigned char)test_random(&random);
        memcpy(side, SIDE, sizeof side);
        for (uint64_t k = test_random(&random) % 4; k > 0; k--)
            side[test_random(&random) % (sizeof side - 1)] =
                (char)(test_random(&random) % 2 ? test_random(&random) % 128
                                                : '0' + test_random(&random) % 10);
        size_t cut = n % 5 ? sizeof side - 1 : test_random(&random) % sizeof side;
        write_file("m.raw", data, n % 7 ? sizeof data : test_random(&random) % sizeof data);
        write_file("m.json", side, cut);
        hold_stderr();
        struct terrain *terrain = load("m.raw");
        int lines = release_stderr(text, sizeof text);
        if (!terrain && lines != 1) fail_msg("case %d: %d lines: %s", n, lines, text);
        if (terrain) {
            const struct terrain_info *info = terrain_info(terrain);
            assert_true(lines <= 1 && isfinite(info->quantum_m) && info->quantum_m > 0 &&
                        isfinite(info->offset_m));
            assert_true(isfinite(terrain_level(terrain, info->coarsest).rms_error_m));
            good++;
        }
        terrain_destroy(terrain);
    }
    FIGURE("mutated raw files: %d, of them taken: %d", cases, good);
}

// ---- the program -----------------------------------------------------------

// Runs build/terrain with stdout and stderr in files; returns its exit code.
static int run(const char *arguments, char *out, char *err, size_t size)
{
    const char *build = getenv("RELIEF_BUILD");
    char command[1024];
    snprintf(command, sizeof command, "'%s/terrain' %s >'%s' 2>'%s'", build ? build : "build", arguments,
             in_folder("out"), in_folder("err"));
    int status = system(command);
    char *texts[2] = {out, err};
    for (int i = 0; i < 2; i++) {
        FILE *file = fopen(in_folder(i ? "err" : "out"), "r");
        texts[i][fread(texts[i], 1, size - 1, file)] = 0;
        fclose(file);
    }
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

static void program_does_what_help_says(void **state)
{
    (void)state;
    static char out[20000], err[20000], arguments[600];
    const char *f = folder;
    assert_int_equal(run("--help", out, err, sizeof out), 0);
    assert_true(strstr(out, "import") && strstr(out, "generate") && !*err);
    assert_int_equal(run("--version", out, err, sizeof out), 0);
    snprintf(arguments, sizeof arguments,
             "generate %s/g.png --kind ramp --size 33x17 --spacing 10 --relief 64", f);
    assert_int_equal(run(arguments, out, err, sizeof out), 0);
    snprintf(arguments, sizeof arguments, "import %s/g.png %s/h.png", f, f);
    assert_int_equal(run(arguments, out, err, sizeof out), 0);
    snprintf(arguments, sizeof arguments, "info --json %s/h.png", f);
    assert_int_equal(run(arguments, out, err, sizeof out), 0);
    cJSON *root = cJSON_Parse(out);
    assert_non_null(root);
    static const struct {
        const char *key;
        double value;
    } NUMBERS[] = {{"width", 33}, {"height", 17}, {"side_bytes", 0},
                   {"rms_m", 0},  {"max_m", 0},   {"max_height_m", 64}};
    for (size_t i = 0; i < sizeof NUMBERS / sizeof *NUMBERS; i++)
        assert_true(cJSON_GetNumberValue(cJSON_GetObjectItem(root, NUMBERS[i].key)) == NUMBERS[i].value);
    assert_true(cJSON_GetNumberValue(cJSON_GetArrayItem(cJSON_GetObjectItem(root, "spacing_m"), 1)) == 10);
    cJSON_Delete(root);
    static const struct {
        const char *arguments, *word;
        int code;
    } BAD[] = {{"", "generate", 2},
               {"fly", "fly", 2},
               {"info", "info", 2},
               {"info a b", "b", 2},
               {"info --jsn x.png", "--jsn", 2},
               {"info nowhere.png", "nowhere.png", 1},
               {"import x.png", "import", 2},
               {"import x.png y.tif", ".png", 2},
               {"import nowhere.hgt y.png", "nowhere.hgt", 1},
               {"generate x.png --kind hole", "--kind", 2},
               {"generate x.png --size 0x0", "--size", 2},
               {"generate nowhere/x.png", "nowhere/x", 1}};
    for (size_t i = 0; i < sizeof BAD / sizeof *BAD; i++) {
        int code = run(BAD[i].arguments, out, err, sizeof out), lines = 0;
        for (const char *c = err; *c; c++) lines += *c == '\n';
        if (code != BAD[i].code || lines != 1 || !strstr(err, BAD[i].word))
            fail_msg("terrain %s: code %d, %d lines: %s", BAD[i].arguments, code, lines, err);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(png_with_sidecar),
        cmocka_unit_test(srtm_tiles),
        cmocka_unit_test(raw_files),
        cmocka_unit_test(gdal_rasters),
        cmocka_unit_test(generated_and_imported),
        cmocka_unit_test(packing_rounds_what_16_bits_do_not_hold),
        cmocka_unit_test(data_sets),
        cmocka_unit_test(bad_pngs),
        cmocka_unit_test(bad_sidecars),
        cmocka_unit_test(unwritable_places),
        cmocka_unit_test(mutated_files),
        cmocka_unit_test(program_does_what_help_says),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
