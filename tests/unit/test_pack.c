// Packing by regions: the same bytes for any region and any number of threads, the samples that the whole map
// gives, and after any interruption the file of a pack that was not interrupted.  SPDX-License-Identifier:
// MIT
#include "tests/field.h"
#include "tests/folder.h"

#include "common/image.h"
#include "common/terrain/relief/relief_file.h"
#include "common/terrain/relief/relief_pack.h"
#include "common/terrain/upsample.h"

#include <fcntl.h>
#include <png.h>
#include <signal.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>

enum { LITTLE_MEMORY = 1 << 20 }; // so that maps of a few hundred samples a side are packed by regions

static const struct relief_pack_options BOUNDED = {
    .layout = LAYOUT_BOUNDED, .max_m = 1, .memory_bytes = LITTLE_MEMORY};
static const struct relief_pack_options WAVELET = {
    .layout = LAYOUT_WAVELET, .rms_m = 1, .memory_bytes = LITTLE_MEMORY};

static struct heightfield hills(int width, int height, uint64_t seed)
{
    struct heightfield field = test_field("hills", width, height);
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++)
            field.samples[y * width + x] =
                (int32_t)(3000 + 2000 * sin(x * 0.011) * cos(y * 0.007) + 300 * sin(x * 0.09 + y * 0.07)) +
                (int32_t)(test_random(&seed) % 30);
    return field;
}

static void assert_same_files(const char *a, const char *b)
{
    size_t sizes[2];
    uint8_t *files[2] = {file_of(a, &sizes[0]), file_of(b, &sizes[1])};
    assert_int_equal(sizes[0], sizes[1]);
    assert_memory_equal(files[0], files[1], sizes[0]);
    free(files[0]);
    free(files[1]);
}

static bool exists(const char *name)
{
    return access(in_folder(name), F_OK) == 0;
}

static struct relief_header pack(struct heightfield *field, struct relief_pack_options options,
                                 const char *name)
{
    struct relief_header header;
    assert_true(relief_pack(field, &options, in_folder(name), &header));
    return header;
}

// ---- by regions and whole --------------------------------------------------

static const int SIZES[][2] = {{300, 433}, {1025, 513}, {257, 1100}, {700, 700}, {1500, 70}, {63, 2100}};

static void test_regions_give_what_the_whole_gives(void **state)
{
    (void)state;
    for (size_t n = 0; n < sizeof SIZES / sizeof *SIZES; n++) {
        struct heightfield field = hills(SIZES[n][0], SIZES[n][1], n);
        struct relief_pack_options whole = BOUNDED;
        whole.memory_bytes = 0;
        pack(&field, whole, "whole.relief");
        pack(&field, BOUNDED, "regions.relief");
        struct relief *a = relief_open(in_folder("whole.relief")),
                      *b = relief_open(in_folder("regions.relief"));
        const struct relief_header *ha = relief_header(a), *hb = relief_header(b);
        assert_int_equal(ha->payload_bytes, hb->payload_bytes);
        assert_int_equal(ha->base_crc, hb->base_crc);
        assert_int_equal(ha->index_crc, hb->index_crc);
        assert_true(ha->rms_m == hb->rms_m && ha->max_m == hb->max_m);
        assert_true(ha->min_q == hb->min_q && ha->max_q == hb->max_q);
        const struct grid *grid = relief_grid(a);
        for (int l = 1; l < grid->count; l++) // sums of integers
            assert_true(relief_level_rms(a, l) > 0 && relief_level_rms(a, l) == relief_level_rms(b, l));
        for (int64_t i = 0; i < grid->tile_count; i++) {
            const struct relief_tile_side sa = relief_side(a, i), sb = relief_side(b, i);
            assert_int_equal(sa.bytes, sb.bytes);
            assert_int_equal(sa.crc, sb.crc);
            assert_int_equal(sa.min_q, sb.min_q);
            assert_int_equal(sa.max_q, sb.max_q);
            if (i >= grid->first_tile[2]) // levels of the first stage: exact
                assert_int_equal(sa.error_code, sb.error_code);
            else // a bound, and no loose one: two surfaces' differences, each of them needed
                assert_true(sb.error_code >= sa.error_code &&
                            relief_error_of(sb.error_code) <= 2 * relief_error_of(sa.error_code) + 64);
        }
        relief_close(a);
        relief_close(b);
        heightfield_finish(&field);
    }
}

// The decoder reaches the state that the encoder measured: bit for bit, though each region was coded alone.
static void test_wavelet_by_regions_decodes_to_what_was_measured(void **state)
{
    (void)state;
    for (size_t n = 0; n < sizeof SIZES / sizeof *SIZES; n++) {
        struct heightfield field = hills(SIZES[n][0], SIZES[n][1], n), back;
        struct relief_header header = pack(&field, WAVELET, "regions.relief");
        assert_true(heightfield_load(&back, in_folder("regions.relief")));
        double squares = 0, most = 0;
        for (int64_t i = 0; i < field.width * field.height; i++) {
            double off = fabs((double)(field.samples[i] - back.samples[i]) * field.quantum_m);
            squares += off * off;
            most = fmax(most, off);
        }
        double rms_m = sqrt(squares / (double)(field.width * field.height));
        assert_true(fabs(rms_m - header.rms_m) < 1e-9 && fabs(most - header.max_m) < 1e-9);
        assert_true(rms_m >= 0.98 && rms_m <= 1.001);
        heightfield_finish(&field);
        heightfield_finish(&back);
    }
}

static void test_threads_and_regions_do_not_show(void **state)
{
    (void)state;
    static const int REGIONS[] = {256, 512, 1024, 2048};
    const struct relief_pack_options *const all[2] = {&BOUNDED, &WAVELET};
    for (int layout = 0; layout < 2; layout++) {
        struct heightfield field = hills(test_size(700, 1100), test_size(560, 900), 5);
        pack(&field, *all[layout], "one.relief");
        for (int i = 0; i < 4; i++) {
            struct relief_pack_options options = *all[layout];
            options.threads = 1 + 2 * i;
            options.region = REGIONS[i];
            pack(&field, options, "other.relief");
            assert_same_files("one.relief", "other.relief");
        }
        heightfield_finish(&field);
    }
}

// ---- sources ---------------------------------------------------------------

enum { MAP_SIDE = 640, ROOMY_MEMORY = 1 << 30 };

// 16-bit grey, big-endian rows from the north.
static void write_png(const char *name, const uint8_t *rows, int height, int interlace)
{
    FILE *file = fopen(in_folder(name), "wb");
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
    png_infop info = png_create_info_struct(png);
    assert_true(file && info && !setjmp(png_jmpbuf(png)));
    png_init_io(png, file);
    png_set_IHDR(png, info, MAP_SIDE, (png_uint_32)height, 16, PNG_COLOR_TYPE_GRAY, interlace,
                 PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_write_info(png, info);
    for (int pass = png_set_interlace_handling(png); pass > 0; pass--)
        for (int y = 0; y < height; y++) png_write_row(png, rows + 2 * MAP_SIDE * y);
    png_write_end(png, NULL);
    png_destroy_write_struct(&png, &info);
    fclose(file);
}

// Opened with little memory and with a lot; both pack to the same file.  Returns whether the first was read
// by windows.
static bool little_memory_gives_the_same(const char *name)
{
    const size_t memory[2] = {LITTLE_MEMORY, ROOMY_MEMORY};
    const char *const packed[2] = {"little.relief", "roomy.relief"};
    struct relief_source sources[2];
    struct relief_header header;
    for (int i = 0; i < 2; i++) {
        assert_true(relief_source_open(&sources[i], in_folder(name), memory[i], NULL));
        assert_true(relief_pack_source(&sources[i], &BOUNDED, in_folder(packed[i]), &header));
    }
    assert_same_files(packed[0], packed[1]);
    assert_true(sources[0].identity == sources[1].identity);
    assert_int_equal(sources[0].magnitude_q, sources[1].magnitude_q);
    assert_int_equal(sources[0].voids_filled, sources[1].voids_filled);
    bool by_windows = sources[0].window != sources[1].window;
    for (int i = 0; i < 2; i++) relief_source_finish(&sources[i]);
    return by_windows;
}

#define SIDECAR                                                                                              \
    "\"width\": 640, \"height\": 610, \"dtype\": \"int16\", \"spacing_m\": [30, 40], "                       \
    "\"height_scale\": 0.1, \"height_offset\": 7, \"nodata\": 32000}"

static void test_large_files_are_not_held(void **state)
{
    (void)state;
    enum { W = MAP_SIDE, H = MAP_SIDE, PART = 2 * W * 610 };
    static uint8_t rows[W * H * 2], swapped[PART];
    struct heightfield field = hills(W, H, 4);
    for (int i = 0; i < W * H; i++) { // files begin in the north
        int32_t q = field.samples[(H - 1 - i / W) * W + i % W] - 3000;
        rows[2 * i] = (uint8_t)(q >> 8);
        rows[2 * i + 1] = (uint8_t)q;
    }
    heightfield_finish(&field);
    for (int i = 0; i < PART; i++) swapped[i] = rows[i ^ 1];
    write_png("bare.png", rows, H, PNG_INTERLACE_NONE);
    assert_true(little_memory_gives_the_same("bare.png")); // no sidecar: unsigned
    write_text("map.json", "{" SIDECAR);
    write_text("big.json", "{\"endian\": \"big\", " SIDECAR);
    write_png("map.png", rows, 610, PNG_INTERLACE_NONE);
    write_file("map.raw", swapped, PART);
    write_file("big.raw", rows, PART);
    write_file("N47W122.hgt", rows, sizeof rows);
    assert_true(little_memory_gives_the_same("map.png"));
    assert_true(little_memory_gives_the_same("map.raw"));
    assert_true(little_memory_gives_the_same("big.raw"));
    assert_true(little_memory_gives_the_same("N47W122.hgt"));
    write_png("map.png", rows, 610, PNG_INTERLACE_ADAM7);
    assert_false(little_memory_gives_the_same("map.png"));
    rows[4000] = 32000 >> 8, rows[4001] = 32000 & 255; // a void
    write_png("map.png", rows, 610, PNG_INTERLACE_NONE);
    assert_false(little_memory_gives_the_same("map.png"));
    write_file("big.raw", rows, PART);
    struct relief_source source; // one line each: voids, and the sidecar says another height
    assert_false(relief_source_open(&source, in_folder("big.raw"), LITTLE_MEMORY, NULL));
    assert_true(relief_source_open(&source, in_folder("big.raw"), ROOMY_MEMORY, NULL));
    assert_int_equal(source.voids_filled, 1);
    relief_source_finish(&source);
    write_png("map.png", rows, 609, PNG_INTERLACE_NONE);
    assert_false(relief_source_open(&source, in_folder("map.png"), LITTLE_MEMORY, NULL));
    assert_int_equal(truncate(in_folder("bare.png"), 200000), 0);
    assert_false(relief_source_open(&source, in_folder("bare.png"), LITTLE_MEMORY, NULL));
}

static void write_world(int width, int height)
{
    char text[256];
    snprintf(text, sizeof text,
             "{\"generate\": \"amplify\", \"source\": \"jacksboro\", \"levels\": 3, \"width\": %d, "
             "\"height\": %d, \"spacing_m\": 30, \"height_scale\": 4, \"seed\": 7}",
             width, height);
    write_text("world.json", text);
}

static void test_a_made_world_is_the_same_from_any_window(void **state)
{
    (void)state;
    struct relief_source source;
    write_world(1100, 900);
    assert_true(relief_source_open(&source, in_folder("world.json"), 0, NULL));
    assert_int_equal(source.size[0], 1100);
    struct patch whole = {{0, 0, 1100, 900}, malloc(1100 * 900 * sizeof(int32_t))};
    assert_true(source.window(&source, &whole));
    uint64_t seed = 1;
    for (int i = 0; i < test_size(100, 5000); i++) {
        int64_t x0 = (int64_t)(test_random(&seed) % 1100), y0 = (int64_t)(test_random(&seed) % 900);
        int64_t x1 = x0 + 1 + (int64_t)(test_random(&seed) % (uint64_t)(1100 - x0));
        int64_t y1 = y0 + 1 + (int64_t)(test_random(&seed) % (uint64_t)(900 - y0));
        if (y1 > y0 + 200) y1 = y0 + 200;
        struct patch part = {{x0, y0, x1, y1}, malloc((size_t)((x1 - x0) * (y1 - y0)) * sizeof(int32_t))};
        assert_true(source.window(&source, &part));
        for (int64_t y = y0; y < y1; y++)
            assert_memory_equal(patch_at(&part, x0, y), patch_at(&whole, x0, y),
                                (size_t)(x1 - x0) * sizeof(int32_t));
        free(part.samples);
    }
    // Noise of every level: the finest residuals of U have the spread that the spec's source leads to, not 0.
    double squares = 0;
    for (int64_t x = 3; x < 1096; x += 2) {
        const int32_t *at = patch_at(&whole, x, 500);
        double off = at[0] - (9.0 * (at[-1] + at[1]) - at[-3] - at[3]) / 16;
        squares += off * off;
    }
    assert_true(squares > 0);
    free(whole.samples);
    relief_source_finish(&source);
}

static void test_specs_that_do_not_serve_are_one_line(void **state)
{
    (void)state;
    static const char *const BAD[] = {
        "",
        "[]",
        "{}",
        "{\"generate\": \"amplify\"}",
        "{\"generate\": \"amplify\", \"width\": 10, \"height\": 10, \"colour\": 1}",
        "{\"generate\": \"amplify\", \"width\": 10.5, \"height\": 10}",
        "{\"generate\": \"amplify\", \"width\": 10, \"height\": -1}",
        "{\"generate\": \"amplify\", \"width\": 10, \"height\": 10, \"levels\": 99}",
        "{\"generate\": \"amplify\", \"width\": 10, \"height\": 10, \"quantum_m\": 1e-6}",
        "{\"generate\": \"amplify\", \"width\": 10, \"height\": 10, \"source\": \"no such file.png\"}",
        "{\"generate\": \"moon\", \"width\": 10, \"height\": 10}",
        "{\"generate\": \"fractal\", \"width\": 10, \"height\": 10, \"levels\": 2}",
        "{\"generate\": \"fractal\", \"width\": 100000, \"height\": 10}"};
    for (size_t i = 0; i < sizeof BAD / sizeof *BAD; i++) {
        struct relief_source source;
        write_text("bad.json", BAD[i]);
        assert_false(relief_source_open(&source, in_folder("bad.json"), 0, NULL));
    }
}

// ---- interruptions ---------------------------------------------------------

// Packs the world in a child; returns its exit code, or -1 when it was killed after `after_us`.
static int pack_in_child(const char *name, const struct relief_pack_options *options, int64_t after_us)
{
    pid_t child = fork();
    if (child == 0) {
        struct relief_source source;
        struct relief_header header;
        bool good = relief_source_open(&source, in_folder("world.json"), 0, NULL) &&
                    relief_pack_source(&source, options, in_folder(name), &header);
        _exit(good ? 0 : 1);
    }
    if (after_us >= 0) {
        struct timespec pause = {after_us / 1000000, after_us % 1000000 * 1000};
        nanosleep(&pause, NULL);
        kill(child, SIGKILL);
    }
    int status = 0;
    waitpid(child, &status, 0);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

static double seconds_now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
}

static void test_killed_at_any_moment_it_goes_on(void **state)
{
    (void)state;
    const struct relief_pack_options *const all[2] = {&BOUNDED, &WAVELET};
    uint64_t seed = 20;
    int kills = 0, resumed = 0;
    write_world(test_size(800, 1100), test_size(640, 900));
    for (int layout = 0; layout < 2; layout++) {
        struct relief_pack_options options = *all[layout];
        options.region = 256;
        options.threads = 2;
        double start = seconds_now();
        assert_int_equal(pack_in_child("unbroken.relief", &options, -1), 0);
        double whole_s = seconds_now() - start;
        for (int round = 0; round < test_size(1, 60); round++) {
            unlink(in_folder("killed.relief"));
            int tries = 0;
            for (;; tries++) { // a kill in each stretch of the work, so that all of it is hit in turn
                int64_t after_us = (int64_t)(test_uniform(&seed, 0.02, 0.5) * 1e6 * whole_s);
                int code = pack_in_child("killed.relief", &options, tries < 8 ? after_us : -1);
                if (code == 0) break;
                assert_int_equal(code, -1);
                if (exists("killed.relief")) // not there until it is whole: killed on its way out
                    assert_same_files("unbroken.relief", "killed.relief");
                kills++;
            }
            resumed += tries > 0;
            assert_same_files("unbroken.relief", "killed.relief");
            assert_false(exists("killed.relief.part"));
        }
    }
    assert_true(kills > 0 && resumed > 0);
    FIGURE("%d kills, %d packs taken up again: the same bytes", kills, resumed);
}

// A source that raises the flag when its `left`-th window is asked for.
struct counting {
    struct relief_source source;
    int left;
    volatile sig_atomic_t raised;
};

static bool counted_window(const struct relief_source *source, const struct patch *to)
{
    struct counting *c = source->data;
    if (--c->left == 0) c->raised = 1;
    return c->source.window(&c->source, to);
}

// Opens c->source; what is returned counts its windows, and `options` look at the flag.  One thread, small
// regions.
static struct relief_source counting_open(struct counting *c, const char *name, size_t memory_bytes,
                                          struct relief_pack_options *options)
{
    assert_true(relief_source_open(&c->source, in_folder(name), memory_bytes, NULL));
    struct relief_source source = c->source;
    source.window = counted_window;
    source.data = c;
    options->threads = 1;
    options->region = 256;
    options->interrupted = &c->raised;
    return source;
}

static void test_interrupted_restarted_and_begun_otherwise(void **state)
{
    (void)state;
    struct counting c = {.left = 0};
    struct relief_header header;
    struct relief_pack_options options = BOUNDED, other = BOUNDED;
    other.max_m = 2;
    write_world(test_size(800, 1100), test_size(640, 900));
    struct relief_source source = counting_open(&c, "world.json", 0, &options);
    assert_true(relief_pack_source(&source, &options, in_folder("plain.relief"), &header));
    int windows = -c.left, breaks = 0;
    for (c.left = 1; !exists("later.relief"); c.left = windows / 7) {
        c.raised = 0;
        bool good = relief_pack_source(&source, &options, in_folder("later.relief"), &header);
        assert_true(good || c.raised);
        assert_true(good == exists("later.relief"));
        if (!good && breaks++ > 1) { // begun, so other options do not serve
            assert_true(exists("later.relief.part"));
            assert_false(relief_pack_source(&source, &other, in_folder("later.relief"), &header));
        }
    }
    assert_true(breaks >= 6); // each went on from where the one before was: no more windows than in one go
    assert_true(breaks <= 9);
    assert_same_files("plain.relief", "later.relief");
    c.left = windows / 2, c.raised = 0;
    assert_false(relief_pack_source(&source, &options, in_folder("again.relief"), &header));
    other.restart = true;
    assert_true(relief_pack_source(&source, &other, in_folder("again.relief"), &header));
    assert_false(exists("again.relief.part"));
    assert_true(relief_pack_source(&source, &other, in_folder("otherwise.relief"), &header));
    assert_same_files("again.relief", "otherwise.relief");
    relief_source_finish(&c.source);
}

// The samples of a PNG are written out anew for each run, and a run with more memory may take over.
static void test_an_interrupted_png_goes_on(void **state)
{
    (void)state;
    static const size_t MEMORY[3] = {LITTLE_MEMORY, LITTLE_MEMORY, ROOMY_MEMORY};
    static uint8_t rows[MAP_SIDE * MAP_SIDE * 2];
    uint64_t seed = 6;
    for (int i = 0; i < MAP_SIDE * MAP_SIDE; i++) rows[2 * i + 1] = (uint8_t)(test_random(&seed) % 50);
    write_png("again.png", rows, MAP_SIDE, PNG_INTERLACE_NONE);
    struct relief_pack_options options = BOUNDED;
    int windows = 0;
    for (int run = -1; run < 3; run++) { // the first in one go, the last goes on to the end
        struct counting c = {.left = run < 0 || run == 2 ? 0 : windows / 3};
        struct relief_header header;
        struct relief_source source = counting_open(&c, "again.png", MEMORY[run < 0 ? 0 : run], &options);
        bool good = relief_pack_source(&source, &options, in_folder(run < 0 ? "onego.relief" : "bits.relief"),
                                       &header);
        assert_true(good == (run < 0 || run == 2));
        if (run < 0) windows = -c.left;
        if (run == 2) assert_true(-c.left < windows);
        relief_source_finish(&c.source);
    }
    assert_same_files("onego.relief", "bits.relief");
}

// What is told of progress grows to 100 % and no further, also when a pack is taken up again.
static void test_progress_ends_at_100(void **state)
{
    (void)state;
    struct counting c = {.left = 60};
    struct relief_header header;
    struct relief_pack_options options = WAVELET;
    options.progress = true;
    write_world(test_size(800, 1100), test_size(640, 900));
    struct relief_source source = counting_open(&c, "world.json", 0, &options);
    fflush(stderr);
    int kept = dup(2), file = open(in_folder("progress"), O_RDWR | O_CREAT | O_TRUNC, 0600);
    dup2(file, 2);
    bool broken = !relief_pack_source(&source, &options, in_folder("told.relief"), &header);
    fputs("\n", stderr);
    c.raised = 0;
    bool good = relief_pack_source(&source, &options, in_folder("told.relief"), &header);
    fflush(stderr);
    dup2(kept, 2);
    close(kept);
    close(file);
    assert_true(broken && good);
    size_t size;
    char *told = (char *)file_of("progress", &size);
    told[size] = 0;
    int lines = 0;
    double before = 0, percent = 0;
    for (char *at = told; (at = strchr(at, '%')); at++) {
        char *number = at - 1;
        while (number > told && strchr(" 0123456789.", number[-1])) number--;
        percent = atof(number);
        if (lines++ && memchr(told, '\n', (size_t)(at - told)) == NULL) assert_true(percent >= before);
        assert_true(percent >= 0 && percent <= 100);
        before = percent;
    }
    assert_true(lines >= 5 && percent == 100);
    assert_null(strchr(told, '-'));
    free(told);
    relief_source_finish(&c.source);
}

static void test_a_full_disk_is_one_line_and_loses_nothing(void **state)
{
    (void)state;
    struct relief_source source;
    struct relief_header header;
    struct rlimit before, little;
    write_world(test_size(800, 1100), test_size(640, 900));
    assert_true(relief_source_open(&source, in_folder("world.json"), 0, NULL));
    assert_true(relief_pack_source(&source, &BOUNDED, in_folder("plain.relief"), &header));
    signal(SIGXFSZ, SIG_IGN); // a write beyond the limit fails instead
    getrlimit(RLIMIT_FSIZE, &before);
    struct stat whole;
    assert_int_equal(stat(in_folder("plain.relief"), &whole), 0);
    for (int part = 1; part < 10; part++) {
        little = (struct rlimit){(rlim_t)whole.st_size * (rlim_t)part / 10, before.rlim_max};
        setrlimit(RLIMIT_FSIZE, &little);
        assert_false(relief_pack_source(&source, &BOUNDED, in_folder("full.relief"), &header));
        setrlimit(RLIMIT_FSIZE, &before);
        assert_false(exists("full.relief"));
    }
    assert_true(relief_pack_source(&source, &BOUNDED, in_folder("full.relief"), &header));
    assert_same_files("plain.relief", "full.relief");
    relief_source_finish(&source);
}

static void test_harmed_journals_are_not_believed(void **state)
{
    (void)state;
    write_world(test_size(800, 1100), test_size(640, 900));
    assert_int_equal(pack_in_child("plain.relief", &BOUNDED, -1), 0);
    uint64_t seed = 4;
    for (int i = 0; i < test_size(6, 100); i++) {
        pack_in_child("harmed.relief", &BOUNDED, 200000 + (int64_t)(test_random(&seed) % 200000));
        if (exists("harmed.relief.part/journal")) {
            size_t size;
            uint8_t *journal = file_of("harmed.relief.part/journal", &size);
            size_t keep = size ? test_random(&seed) % size : 0; // torn in the middle of a record
            if (i % 2 && size) journal[test_random(&seed) % size] ^= 1, keep = size;
            write_file("harmed.relief.part/journal", journal, keep);
            free(journal);
        }
        int code = pack_in_child("harmed.relief", &BOUNDED, -1);
        assert_int_equal(code, 0);
        assert_same_files("plain.relief", "harmed.relief");
        unlink(in_folder("harmed.relief"));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_regions_give_what_the_whole_gives),
        cmocka_unit_test(test_wavelet_by_regions_decodes_to_what_was_measured),
        cmocka_unit_test(test_threads_and_regions_do_not_show),
        cmocka_unit_test(test_large_files_are_not_held),
        cmocka_unit_test(test_a_made_world_is_the_same_from_any_window),
        cmocka_unit_test(test_specs_that_do_not_serve_are_one_line),
        cmocka_unit_test(test_killed_at_any_moment_it_goes_on),
        cmocka_unit_test(test_interrupted_restarted_and_begun_otherwise),
        cmocka_unit_test(test_an_interrupted_png_goes_on),
        cmocka_unit_test(test_progress_ends_at_100),
        cmocka_unit_test(test_a_full_disk_is_one_line_and_loses_nothing),
        cmocka_unit_test(test_harmed_journals_are_not_believed),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
