// Compressed terrain: what is decoded is what was promised, from any window, and a harmed file is one line on
// stderr. SPDX-License-Identifier: MIT
#define _GNU_SOURCE // memfd_create
#include "tests/field.h"
#include "tests/folder.h"

#include "common/terrain/relief/layout.h"
#include "common/terrain/relief/relief_file.h"
#include "common/terrain/relief/relief_pack.h"
#include "common/terrain/terrain.h"
#include "common/terrain/upsample.h"

#include <fcntl.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>

static const int SIZES[][2] = {{1, 1},    {1, 2},    {2, 1},    {3, 3},    {1, 50},  {77, 1},
                               {8, 8},    {9, 8},    {9, 9},    {2, 65},   {63, 64}, {65, 64},
                               {129, 66}, {31, 130}, {675, 18}, {200, 257}};
enum { SIZE_COUNT = sizeof SIZES / sizeof *SIZES };

// ---- maps with known trouble -----------------------------------------------

enum shape { HILLS, NOISE, CLIFF, FLAT, EXTREME, SHAPES };

static int32_t height_of(enum shape shape, int x, int y, uint64_t *seed)
{
    switch (shape) {
    case HILLS:
        return (int32_t)(3000 + 900 * sin(x * 0.11) * cos(y * 0.07) + 200 * sin(x * 0.9 + y * 0.7)) +
               (int32_t)(test_random(seed) % 9);
    case NOISE:
        return (int32_t)(test_random(seed) % 4000);
    case CLIFF:
        return x * 3 > y * 2 + 20 ? 65535 : 0;
    case FLAT:
        return -117;
    default:
        return test_random(seed) & 1 ? QUANTA_LIMIT : -QUANTA_LIMIT;
    }
}

static struct heightfield make(enum shape shape, int width, int height, uint64_t seed)
{
    struct heightfield field = test_field("made", width, height);
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) field.samples[y * width + x] = height_of(shape, x, y, &seed);
    return field;
}

static struct relief_header pack(struct heightfield *field, enum layout layout, double error_m,
                                 const char *name)
{
    struct relief_pack_options options = {.layout = layout, .rms_m = error_m, .max_m = error_m};
    struct relief_header header;
    assert_true(relief_pack(field, &options, in_folder(name), &header));
    return header;
}

static int32_t *read_level(const struct relief *relief, int level)
{
    const int64_t *size = relief_grid(relief)->size[level];
    int32_t *samples = malloc((size_t)(size[0] * size[1]) * sizeof *samples);
    assert_true(relief_window(relief, level, 0, 0, size[0], size[1], samples));
    return samples;
}

// ---- the tile coder --------------------------------------------------------

struct tile_case {
    struct coder_tile tile;
    coder_band k[CODER_BANDS];
    uint16_t activity[CODER_BANDS][CODER_TILE * CODER_TILE];
};

static void random_tile(struct tile_case *c, uint64_t *seed)
{
    int bits = (int)(test_random(seed) % 27), width = 1 + (int)(test_random(seed) % CODER_TILE);
    int height = 1 + (int)(test_random(seed) % CODER_TILE), rare = 1 + (int)(test_random(seed) % 40);
    memset(c->k, 0, sizeof c->k);
    c->tile = (struct coder_tile){.first_band = (int)(test_random(seed) % 2),
                                  .bands = CODER_BANDS,
                                  .siblings = test_random(seed) & 1,
                                  .activity = (const uint16_t(*)[CODER_TILE * CODER_TILE]) c->activity};
    for (int b = 0; b < CODER_BANDS; b++) {
        c->tile.width[b] = width - (int)(test_random(seed) % 2), c->tile.height[b] = height;
        c->tile.set[b] = (int)(test_random(seed) % 8);
        for (int i = 0; i < CODER_TILE * CODER_TILE; i++) {
            c->activity[b][i] = (uint16_t)(test_random(seed) >> (48 + test_random(seed) % 16));
            if (i % CODER_TILE >= c->tile.width[b] || i / CODER_TILE >= height || b < c->tile.first_band)
                continue;
            if (test_random(seed) % (uint64_t)rare) continue;
            int32_t magnitude = (int32_t)(test_random(seed) & (((uint64_t)1 << bits) - 1));
            c->k[b][i] = test_random(seed) & 1 ? -magnitude : magnitude;
        }
    }
}

static void test_coder_gives_back_what_it_took(void **state)
{
    (void)state;
    static struct tile_case c;
    static coder_band decoded[CODER_BANDS];
    uint64_t seed = 1;
    uint8_t bytes[CODER_MAX_BYTES];
    for (int i = 0; i < test_size(1000, 100000); i++) {
        random_tile(&c, &seed);
        size_t size = coder_encode(&c.tile, (const coder_band *)c.k, bytes, NULL);
        assert_true(size <= CODER_MAX_BYTES);
        memset(decoded, 0, sizeof decoded);
        assert_true(coder_decode(&c.tile, bytes, size, decoded));
        assert_memory_equal(decoded, c.k, sizeof decoded);
        if (size == 0) continue;
        size_t cut = test_random(&seed) % size; // a shorter tile is another tile, and no crash
        if (cut && coder_decode(&c.tile, bytes, cut, decoded))
            assert_memory_not_equal(decoded, c.k, sizeof decoded);
    }
}

static void test_coder_survives_any_bytes(void **state)
{
    (void)state;
    static struct tile_case c;
    static coder_band decoded[CODER_BANDS];
    uint64_t seed = 2;
    for (int i = 0; i < test_size(2000, 1000000); i++) {
        random_tile(&c, &seed);
        size_t size = 1 + test_random(&seed) % 300;
        uint8_t *bytes = malloc(size); // of its own, so that a sanitizer sees a read beyond it
        for (size_t b = 0; b < size; b++) bytes[b] = (uint8_t)test_random(&seed);
        bytes[0] &= 15;
        if (size > 4) bytes[3] |= 1; // a first state that passes
        coder_decode(&c.tile, bytes, size, decoded);
        free(bytes);
    }
}

// ---- lifting ---------------------------------------------------------------

static void test_lifting_is_reversible(void **state)
{
    (void)state;
    uint64_t seed = 3;
    for (int n = 0; n < SIZE_COUNT; n++) {
        struct grid grid = {.count = 2, .size = {{SIZES[n][0], SIZES[n][1]}}};
        int64_t count = grid.size[0][0] * grid.size[0][1];
        for (int axis = 0; axis < 2; axis++) grid.size[1][axis] = (grid.size[0][axis] + 1) / 2;
        int32_t *samples = malloc((size_t)count * sizeof *samples),
                *back = malloc((size_t)count * sizeof *back);
        for (int64_t i = 0; i < count; i++)
            samples[i] = (int32_t)(test_random(&seed) % (1 << 23)) - (1 << 22);
        struct patch bands[CODER_BANDS];
        for (int b = 0; b < CODER_BANDS; b++) {
            int64_t band_size = grid_band_size(&grid, 0, b, 0) * grid_band_size(&grid, 0, b, 1);
            bands[b].samples = malloc((size_t)(band_size + 1) * sizeof(int32_t));
        }
        const struct patch whole = {{0, 0, grid.size[0][0], grid.size[0][1]}, samples};
        assert_true(layout_wavelet_forward(&whole, bands));
        const struct patch wanted = {{0, 0, grid.size[0][0], grid.size[0][1]}, back};
        assert_true(layout_wavelet_inverse(&grid, 0, bands, &wanted));
        assert_memory_equal(samples, back, (size_t)count * sizeof *samples);
        for (int b = 0; b < CODER_BANDS; b++) free(bands[b].samples);
        free(samples);
        free(back);
    }
}

// The sum over one axis of what a unit adds: a low coefficient at level 1 gives (1, 9/16, -1/16 ...), a
// detail the row of the inverse update.  Squares by hand: 1 + 2 (81 + 1)/256 for the low one.
static void test_norms_are_those_of_the_filters(void **state)
{
    (void)state;
    double low = 1 + 2 * (81.0 + 1) / 256;
    assert_true(fabs(layout_wavelet_norm(0, 0) - low) < 1e-12); // sqrt(low) along each axis
    double high = 0, update[4] = {-1 / 32.0, 9 / 32.0, 9 / 32.0, -1 / 32.0}, even[20] = {0}, odd[20] = {0};
    odd[10] = 1;
    for (int i = 2; i < 18; i++)
        for (int k = 0; k < 4; k++) even[i] -= update[k] * odd[i - 2 + k];
    for (int i = 2; i < 17; i++) {
        double detail = odd[i] + (9 * (even[i] + even[i + 1]) - even[i - 1] - even[i + 2]) / 16;
        high += even[i] * even[i] + detail * detail;
    }
    assert_true(fabs(layout_wavelet_norm(0, BAND_HL) - sqrt(low * high)) < 1e-12);
    assert_true(fabs(layout_wavelet_norm(0, BAND_HH) - high) < 1e-12);
}

// ---- promises --------------------------------------------------------------

static void test_lossless_is_exact(void **state)
{
    (void)state;
    for (int n = 0; n < SIZE_COUNT; n++)
        for (enum shape shape = 0; shape < SHAPES; shape++) {
            struct heightfield field = make(shape, SIZES[n][0], SIZES[n][1], (uint64_t)n), back = {0};
            struct relief_header header = pack(&field, LAYOUT_BOUNDED, 0, "lossless.relief");
            assert_true(header.rms_m == 0 && header.max_m == 0);
            assert_true(heightfield_load(&back, in_folder("lossless.relief")));
            assert_int_equal(back.width, field.width);
            assert_int_equal(back.height, field.height);
            assert_true(back.quantum_m == field.quantum_m && back.offset_m == field.offset_m);
            assert_true(back.spacing_m[0] == field.spacing_m[0] && back.spacing_m[1] == field.spacing_m[1]);
            assert_memory_equal(back.samples, field.samples,
                                (size_t)(field.width * field.height) * sizeof *field.samples);
            assert_int_not_equal(access(in_folder("lossless.relief.part"), F_OK), 0);
            heightfield_finish(&field);
            heightfield_finish(&back);
        }
}

// The largest difference of any sample of any level from the source's sample at the same place.
static int32_t worst_of_levels(const struct heightfield *field, const char *name)
{
    struct relief *relief = relief_open(in_folder(name));
    assert_non_null(relief);
    const struct grid *grid = relief_grid(relief);
    int32_t worst = 0;
    for (int l = 0; l < grid->count; l++) {
        int32_t *samples = read_level(relief, l);
        for (int64_t y = 0; y < grid->size[l][1]; y++)
            for (int64_t x = 0; x < grid->size[l][0]; x++) {
                int32_t off = abs(samples[y * grid->size[l][0] + x] -
                                  field->samples[(y << l) * field->width + (x << l)]);
                worst = off > worst ? off : worst;
            }
        free(samples);
    }
    relief_close(relief);
    return worst;
}

static void test_bounded_keeps_its_bound_on_every_level(void **state)
{
    (void)state;
    static const double MAX_M[] = {0.05, 0.1, 0.31, 1.5, 40, 7000};
    for (int n = 0; n < SIZE_COUNT; n++)
        for (enum shape shape = 0; shape < EXTREME; shape++)
            for (size_t m = 0; m < sizeof MAX_M / sizeof *MAX_M; m++) {
                struct heightfield field = make(shape, SIZES[n][0], SIZES[n][1], (uint64_t)n);
                struct relief_header header = pack(&field, LAYOUT_BOUNDED, MAX_M[m], "bounded.relief");
                int32_t worst = worst_of_levels(&field, "bounded.relief");
                assert_true(worst * field.quantum_m <= MAX_M[m] * (1 + 1e-12));
                assert_true(header.max_m <= MAX_M[m] * (1 + 1e-12));
                heightfield_finish(&field);
            }
}

static double rms_of(const struct heightfield *a, const struct heightfield *b)
{
    double squares = 0;
    for (int64_t i = 0; i < a->width * a->height; i++) {
        double off = (a->samples[i] - b->samples[i]) * a->quantum_m;
        squares += off * off;
    }
    return sqrt(squares / (double)(a->width * a->height));
}

static void test_wavelet_reaches_its_rms(void **state)
{
    (void)state;
    static const double RMS_M[] = {0.5, 1, 2, 5, 15};
    for (enum shape shape = HILLS; shape <= NOISE; shape++)
        for (size_t m = 0; m < sizeof RMS_M / sizeof *RMS_M; m++) {
            struct heightfield field = make(shape, 300, 217, 5), back = {0};
            struct relief_header header = pack(&field, LAYOUT_WAVELET, RMS_M[m], "wavelet.relief");
            assert_true(heightfield_load(&back, in_folder("wavelet.relief")));
            double rms_m = rms_of(&field, &back);
            assert_true(fabs(rms_m - header.rms_m) < 1e-9);
            assert_true(rms_m >= 0.98 * RMS_M[m] && rms_m <= 1.001 * RMS_M[m]);
            heightfield_finish(&field);
            heightfield_finish(&back);
        }
}

// Swell without noise: a few coefficients carry everything.  Slower swell would stand in the coarsest level
// alone.
static void test_wavelet_reaches_its_rms_on_smooth_maps(void **state)
{
    (void)state;
    uint64_t seed = 7;
    struct heightfield field = make(FLAT, 300, 217, 5);
    for (int n = 0; n < test_size(40, 1000); n++) {
        double fx = test_uniform(&seed, 0.04, 0.3), fy = test_uniform(&seed, 0, 0.3);
        double swell_q = exp2(test_uniform(&seed, 5, 13));
        double aim_m = fmax(0.3, field.quantum_m * swell_q * exp2(test_uniform(&seed, -8, -2)));
        for (int i = 0; i < 300 * 217; i++)
            field.samples[i] = (int32_t)lrint(swell_q * sin(i % 300 * fx) * cos(i / 300 * fy));
        struct relief_pack_options options = {.layout = LAYOUT_WAVELET, .rms_m = aim_m};
        struct relief_header h;
        assert_true(relief_pack(&field, &options, NULL, &h));
        assert_true(h.rms_m >= 0.98 * aim_m && h.rms_m <= 1.001 * aim_m);
    }
    heightfield_finish(&field);
}

static void test_wavelet_takes_every_size(void **state)
{
    (void)state;
    for (int n = 0; n < SIZE_COUNT; n++)
        for (enum shape shape = 0; shape < SHAPES; shape++) {
            struct heightfield field = make(shape, SIZES[n][0], SIZES[n][1], (uint64_t)n), back = {0};
            struct relief_header header = pack(&field, LAYOUT_WAVELET, 3, "wavelet.relief");
            assert_true(heightfield_load(&back, in_folder("wavelet.relief")));
            assert_true(rms_of(&field, &back) <= 3.003 && fabs(rms_of(&field, &back) - header.rms_m) < 1e-9);
            heightfield_finish(&field);
            heightfield_finish(&back);
        }
}

static void test_threads_do_not_show(void **state)
{
    (void)state;
    for (enum layout layout = LAYOUT_WAVELET; layout < LAYOUTS; layout++) {
        uint8_t *files[2];
        long sizes[2];
        for (int i = 0; i < 2; i++) {
            struct heightfield field = make(HILLS, 300, 433, 9);
            struct relief_pack_options options = {
                .layout = layout, .rms_m = 1, .max_m = 1, .threads = i ? 5 : 1};
            struct relief_header header;
            assert_true(relief_pack(&field, &options, in_folder("threads.relief"), &header));
            heightfield_finish(&field);
            FILE *file = fopen(in_folder("threads.relief"), "rb");
            fseek(file, 0, SEEK_END);
            sizes[i] = ftell(file);
            rewind(file);
            files[i] = malloc((size_t)sizes[i]);
            assert_int_equal(fread(files[i], 1, (size_t)sizes[i], file), sizes[i]);
            fclose(file);
        }
        assert_int_equal(sizes[0], sizes[1]);
        assert_memory_equal(files[0], files[1], (size_t)sizes[0]);
        free(files[0]);
        free(files[1]);
    }
}

// ---- windows and the side section ------------------------------------------

static void test_any_window_is_that_of_the_whole(void **state)
{
    (void)state;
    uint64_t seed = 11;
    for (int n = 0; n < SIZE_COUNT; n++)
        for (enum layout layout = LAYOUT_WAVELET; layout < LAYOUTS; layout++) {
            struct heightfield field = make(HILLS, SIZES[n][0], SIZES[n][1], 4);
            pack(&field, layout, 1, "window.relief");
            struct relief *relief = relief_open(in_folder("window.relief"));
            const struct grid *grid = relief_grid(relief);
            for (int l = 0; l < grid->count; l++) {
                int32_t *whole = read_level(relief, l);
                for (int i = 0; i < test_size(12, 300); i++) {
                    const int64_t *size = grid->size[l];
                    int64_t x0 = (int64_t)(test_random(&seed) % (uint64_t)size[0]);
                    int64_t y0 = (int64_t)(test_random(&seed) % (uint64_t)size[1]);
                    int64_t width = 1 + (int64_t)(test_random(&seed) % (uint64_t)(size[0] - x0));
                    int64_t height = 1 + (int64_t)(test_random(&seed) % (uint64_t)(size[1] - y0));
                    int32_t *window = malloc((size_t)(width * height) * sizeof *window);
                    assert_true(relief_window(relief, l, x0, y0, width, height, window));
                    for (int64_t y = 0; y < height; y++)
                        assert_memory_equal(window + y * width, whole + (y0 + y) * size[0] + x0,
                                            (size_t)width * sizeof *window);
                    free(window);
                }
                free(whole);
            }
            relief_close(relief);
            heightfield_finish(&field);
        }
}

// |surface of a level - level 0| over one tile, in quanta, in double.
static double surface_error(const int32_t *fine, int64_t fine_width, int64_t fine_height,
                            const int32_t *coarse, const int64_t size[2], int level, int64_t tx, int64_t ty)
{
    double worst = 0, cell = ldexp(1, level);
    for (int64_t y = (ty * LAYOUT_SAMPLES) << level;
         y < fine_height && y < (((ty + 1) * LAYOUT_SAMPLES) << level); y++)
        for (int64_t x = (tx * LAYOUT_SAMPLES) << level;
             x < fine_width && x < (((tx + 1) * LAYOUT_SAMPLES) << level); x++) {
            int64_t i = x >> level, j = y >> level;
            if (i + 1 >= size[0] || j + 1 >= size[1]) continue; // beyond the level's last cell: continued
            double u = (double)x / cell - (double)i, v = (double)y / cell - (double)j;
            const int32_t *c = coarse + j * size[0] + i;
            double height = u < v ? c[0] + v * (c[size[0]] - c[0]) + u * (c[size[0] + 1] - c[size[0]])
                                  : c[0] + u * (c[1] - c[0]) + v * (c[size[0] + 1] - c[1]);
            worst = fmax(worst, fabs(height - fine[y * fine_width + x]));
        }
    return worst;
}

static void test_side_section_holds(void **state)
{
    (void)state;
    for (int n = 0; n < SIZE_COUNT; n++)
        for (enum layout layout = LAYOUT_WAVELET; layout < LAYOUTS; layout++) {
            struct heightfield field = make(HILLS, SIZES[n][0], SIZES[n][1], 6);
            pack(&field, layout, 2, "side.relief");
            struct relief *relief = relief_open(in_folder("side.relief"));
            const struct grid *grid = relief_grid(relief);
            int32_t *fine = read_level(relief, 0);
            for (int l = 0; l < grid->count - 1; l++) {
                int32_t *samples = read_level(relief, l);
                const int64_t *size = grid->size[l];
                for (int64_t t = 0; t < grid->tiles[l][0] * grid->tiles[l][1]; t++) {
                    int64_t tx = t % grid->tiles[l][0], ty = t / grid->tiles[l][0];
                    struct relief_tile_side side = relief_side(relief, grid->first_tile[l] + t);
                    int32_t low = INT32_MAX, high = INT32_MIN;
                    for (int64_t y = ty * LAYOUT_SAMPLES; y <= (ty + 1) * LAYOUT_SAMPLES && y < size[1]; y++)
                        for (int64_t x = tx * LAYOUT_SAMPLES; x <= (tx + 1) * LAYOUT_SAMPLES && x < size[0];
                             x++) {
                            int32_t q = samples[y * size[0] + x];
                            low = q < low ? q : low;
                            high = q > high ? q : high;
                        }
                    assert_int_equal(side.min_q, low);
                    assert_int_equal(side.max_q, high);
                    double error =
                        surface_error(fine, grid->size[0][0], grid->size[0][1], samples, size, l, tx, ty);
                    assert_true(relief_error_of(side.error_code) >= error);
                }
                free(samples);
            }
            free(fine);
            relief_close(relief);
            heightfield_finish(&field);
        }
}

static void test_error_bytes_round_up(void **state)
{
    (void)state;
    for (uint32_t error = 0; error < 100000; error++) {
        uint32_t back = relief_error_of(relief_error_code(error));
        assert_true(back >= error && (double)back <= 1.125 * error); // 3 bits of mantissa
    }
    assert_int_equal(relief_error_of(relief_error_code(UINT32_MAX)), UINT32_MAX);
}

static void test_terrain_flies_it(void **state)
{
    (void)state;
    struct heightfield field = make(HILLS, 131, 90, 8);
    pack(&field, LAYOUT_WAVELET, 1, "flown.relief");
    struct relief *relief = relief_open(in_folder("flown.relief"));
    struct terrain *terrain = terrain_load(in_folder("flown.relief"), NULL);
    assert_non_null(terrain);
    int32_t *decoded = read_level(relief, 0), *window = malloc(131 * 90 * sizeof *window);
    assert_true(terrain_window(terrain, 0, 0, 0, 131, 90, window, TERRAIN_WAIT));
    assert_memory_equal(decoded, window, 131 * 90 * sizeof *window);
    assert_true(terrain_info(terrain)->quantum_m == field.quantum_m);
    free(window);
    free(decoded);
    terrain_destroy(terrain);
    relief_close(relief);
    heightfield_finish(&field);
}

// ---- harm ------------------------------------------------------------------

// Files in memory, written again for each case: on a disk, truncating and rewriting one waits for the disk.
struct harm {
    int file, lines; // what is loaded, by the name harmed.relief in the folder; what stderr is told
};

static struct harm harm_begin(void)
{
    char path[64];
    struct harm harm = {memfd_create("harmed", MFD_CLOEXEC), memfd_create("stderr", MFD_CLOEXEC)};
    assert_true(harm.file >= 0 && harm.lines >= 0);
    snprintf(path, sizeof path, "/proc/self/fd/%d", harm.file);
    assert_int_equal(symlink(path, in_folder("harmed.relief")), 0);
    return harm;
}

static void harm_end(const struct harm *harm)
{
    assert_int_equal(unlink(in_folder("harmed.relief")), 0);
    close(harm->file);
    close(harm->lines);
}

// Loads these bytes with stderr held; returns the number of lines, or -1 when they loaded.
static int lines_of_refusal(const struct harm *harm, const uint8_t *data, size_t size)
{
    struct heightfield field;
    assert_int_equal(pwrite(harm->file, data, size, 0), size);
    assert_int_equal(ftruncate(harm->file, (off_t)size), 0);
    assert_int_equal(ftruncate(harm->lines, 0), 0);
    lseek(harm->lines, 0, SEEK_SET);
    fflush(stderr);
    int kept = dup(2);
    dup2(harm->lines, 2);
    bool loaded = heightfield_load(&field, in_folder("harmed.relief"));
    fflush(stderr);
    dup2(kept, 2);
    close(kept);
    char told[4096];
    ssize_t size_told = pread(harm->lines, told, sizeof told, 0);
    assert_in_range(size_told, 0, (ssize_t)sizeof told - 1);
    int lines = 0;
    for (ssize_t i = 0; i < size_told; i++) lines += told[i] == '\n';
    if (!loaded) return lines;
    heightfield_finish(&field);
    return -1;
}

static void test_harmed_files_are_refused(void **state)
{
    (void)state;
    struct harm harm = harm_begin();
    for (enum layout layout = LAYOUT_WAVELET; layout < LAYOUTS; layout++) {
        struct heightfield field = make(HILLS, 70, 41, 10);
        pack(&field, layout, 4, "whole.relief");
        heightfield_finish(&field);
        size_t size;
        uint8_t *data = file_of("whole.relief", &size);
        size_t step = (size_t)test_size(7, 1);
        for (size_t cut = 0; cut < size; cut += step) { // truncated
            assert_int_equal(lines_of_refusal(&harm, data, cut), 1);
        }
        for (size_t at = 0; at < size; at += step) // one bit flipped anywhere
            for (int bit = 0; bit < 8; bit += test_size(5, 1)) {
                data[at] ^= (uint8_t)(1 << bit);
                assert_int_equal(lines_of_refusal(&harm, data, size), 1);
                data[at] ^= (uint8_t)(1 << bit);
            }
        free(data);
    }
    harm_end(&harm);
}

// ---- figures ---------------------------------------------------------------

// Bits a sample of header, tiles, base and index; checks side section and errors.
static double bits_of(const char *file, enum layout layout, double error_m)
{
    char path[1024];
    struct heightfield field;
    if (!test_data(file, path)) return -1;
    assert_true(heightfield_load(&field, path));
    field.radius_m = 0; // the raster, as other coders see it
    struct relief_header h = pack(&field, layout, error_m, "figure.relief");
    struct heightfield back;
    assert_true(heightfield_load(&back, in_folder("figure.relief")));
    double samples = (double)field.width * (double)field.height, rms_m = rms_of(&field, &back);
    double bits = 8 * (double)(RELIEF_HEADER + h.payload_bytes + h.base_bytes + h.index_bytes) / samples;
    double side = 8 * (double)h.side_bytes / samples;
    FIGURE("%s %s %g m: %.4f bits a sample, side %.4f, rms %.4f m, max %.2f m", file,
           layout == LAYOUT_WAVELET ? "rms" : "max", error_m, bits, side, h.rms_m, h.max_m);
    assert_true(side <= 0.03);
    assert_true(fabs(rms_m - h.rms_m) < 1e-9);
    if (layout == LAYOUT_WAVELET)
        assert_true(rms_m >= 0.98 * error_m && rms_m <= 1.001 * error_m);
    else
        assert_true(h.max_m <= error_m * (1 + 1e-12));
    heightfield_finish(&field);
    heightfield_finish(&back);
    return bits;
}

static void test_bits_of_real_terrain(void **state)
{
    (void)state;
    bits_of("puget_1k_160m.png", LAYOUT_WAVELET, 1);
    bits_of("puget_1k_160m.png", LAYOUT_BOUNDED, 4);
    bits_of("mars_mola_4ppd_1440x720.png", LAYOUT_WAVELET, 16);
    // What the design was measured to reach with tiles of 32 coefficients.
    assert_true(bits_of("puget_cascades_72m_2049x2817.png", LAYOUT_WAVELET, 1) <= 1.76);
    assert_true(bits_of("puget_cascades_72m_2049x2817.png", LAYOUT_WAVELET, 8) <= 0.203);
    assert_true(bits_of("puget_cascades_72m_2049x2817.png", LAYOUT_BOUNDED, 4) <= 1.23);
    // JPEG-LS: 8.68 bits a sample on this map (measured with CharLS); within 5 % of it.
    assert_true(bits_of("puget_1k_160m.png", LAYOUT_BOUNDED, 0) <= 1.05 * 8.68);
}

static double cpu_ms(void)
{
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec * 1e3 + (double)t.tv_nsec * 1e-6;
}

// What a viewer asks each time it moves: 255 x 255 samples of the next level, the coarser level being there.
static void test_refining_a_window_is_quick(void **state)
{
    (void)state;
    char path[1024];
    struct heightfield field;
    if (!test_data("puget_cascades_72m_2049x2817.png", path)) return;
    for (enum layout layout = LAYOUT_WAVELET; layout <= LAYOUT_BOUNDED; layout++) {
        assert_true(heightfield_load(&field, path));
        pack(&field, layout, layout == LAYOUT_WAVELET ? 1 : 4, "refined.relief");
        heightfield_finish(&field);
        struct relief *relief = relief_open(in_folder("refined.relief"));
        const struct grid *grid = relief_grid(relief);
        struct patch coarse = {.rect = {0, 0, grid->size[1][0], grid->size[1][1]}}, wanted;
        coarse.samples = malloc((size_t)(grid->size[1][0] * grid->size[1][1]) * sizeof(int32_t));
        wanted.samples = malloc(255 * 255 * sizeof(int32_t));
        assert_true(relief_units(relief, 1, &coarse));
        uint64_t seed = 21;
        double sum = 0, worst = 0;
        int positions = test_size(100, 1000);
        for (int i = 0; i < positions; i++) {
            int64_t x0 = (int64_t)(test_random(&seed) % (uint64_t)(grid->size[0][0] - 254));
            int64_t y0 = (int64_t)(test_random(&seed) % (uint64_t)(grid->size[0][1] - 254));
            wanted.rect = (struct rect){x0, y0, x0 + 255, y0 + 255};
            double least = INFINITY;
            for (int again = 0; again < 5; again++) {
                double start = cpu_ms();
                assert_true(relief_refine(relief, 0, &coarse, &wanted));
                least = fmin(least, cpu_ms() - start);
            }
            sum += least, worst = fmax(worst, least);
        }
        FIGURE("255 x 255 samples of the next level, %s, %d places: mean %.2f ms, worst %.2f ms",
               layout == LAYOUT_WAVELET ? "rms 1 m" : "max 4 m", positions, sum / positions, worst);
        free(coarse.samples);
        free(wanted.samples);
        relief_close(relief);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_coder_gives_back_what_it_took),
        cmocka_unit_test(test_coder_survives_any_bytes),
        cmocka_unit_test(test_lifting_is_reversible),
        cmocka_unit_test(test_norms_are_those_of_the_filters),
        cmocka_unit_test(test_lossless_is_exact),
        cmocka_unit_test(test_bounded_keeps_its_bound_on_every_level),
        cmocka_unit_test(test_wavelet_reaches_its_rms),
        cmocka_unit_test(test_wavelet_reaches_its_rms_on_smooth_maps),
        cmocka_unit_test(test_wavelet_takes_every_size),
        cmocka_unit_test(test_threads_do_not_show),
        cmocka_unit_test(test_any_window_is_that_of_the_whole),
        cmocka_unit_test(test_side_section_holds),
        cmocka_unit_test(test_error_bytes_round_up),
        cmocka_unit_test(test_terrain_flies_it),
        cmocka_unit_test(test_harmed_files_are_refused),
        cmocka_unit_test(test_refining_a_window_is_quick),
        cmocka_unit_test(test_bits_of_real_terrain),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
