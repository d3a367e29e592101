// Terrain read on demand: the same samples as the file's, whatever the window, the ceiling and the threads;
// what a reader is given follows from frame numbers alone.  SPDX-License-Identifier: MIT
#include "tests/field.h"
#include "tests/folder.h"

#include "bench/error/truth.h"
#include "common/parallel.h"
#include "common/terrain/paged.h"
#include "common/terrain/pyramid.h"
#include "common/terrain/reader.h"
#include "common/terrain/relief/relief_file.h"
#include "common/terrain/relief/relief_pack.h"
#include "common/terrain/synthesis.h"
#include "common/terrain/upsample.h"

#include <fcntl.h>
#include <stdatomic.h>
#include <string.h>

static const int SIZES[][2] = {{1, 1},   {1, 2},   {2, 2},    {3, 3},     {1, 50},   {77, 1},   {9, 8},
                               {2, 65},  {64, 64}, {65, 65},  {128, 129}, {129, 66}, {675, 18}, {200, 257},
                               {256, 2}, {66, 66}, {130, 64}, {385, 390}, {130, 130}};
enum { SIZE_COUNT = sizeof SIZES / sizeof *SIZES, BLOCK = PAGED_BLOCK };
#define ONE_BLOCK ((uint64_t)1) // the least ceiling: one block is kept

static void pack(int width, int height, enum layout layout, uint64_t seed, const char *name)
{
    struct heightfield field = test_field("made", width, height);
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++)
            field.samples[y * width + x] =
                (int32_t)(3000 + 900 * sin(x * 0.11) * cos(y * 0.07) + 200 * sin(x * 0.9 + y * 0.7)) +
                (int32_t)(test_random(&seed) % 9);
    struct relief_pack_options options = {.layout = layout, .rms_m = 1, .max_m = 1};
    struct relief_header header;
    assert_true(relief_pack(&field, &options, in_folder(name), &header));
    heightfield_finish(&field);
}

static struct terrain *load(const char *name, struct terrain_options options)
{
    struct terrain *terrain = terrain_load(in_folder(name), &options);
    assert_non_null(terrain);
    return terrain;
}

static int64_t clamp(int64_t value, int64_t low, int64_t high)
{
    return value < low ? low : value > high ? high : value;
}

static int32_t limit(int64_t q)
{
    return (int32_t)clamp(q, -QUANTA_LIMIT, QUANTA_LIMIT);
}

// ---- samples ---------------------------------------------------------------

struct level { // a level of the file, and the column and row that continue it
    int64_t size[2];
    int32_t *samples;
};

static struct level whole_level(const struct relief *relief, int level)
{
    const struct grid *grid = relief_grid(relief);
    int64_t stored[2] = {grid->size[level][0], grid->size[level][1]};
    struct level all;
    for (int k = 0; k < 2; k++) {
        int64_t cells = grid->size[0][k] - 1, cell = (int64_t)1 << level;
        all.size[k] = (cells + cell - 1) / cell + 1; // covers the map, rounded outward
        assert_true(all.size[k] == stored[k] || all.size[k] == stored[k] + 1);
    }
    int32_t *file = malloc((size_t)(stored[0] * stored[1]) * sizeof *file);
    assert_true(relief_window(relief, level, 0, 0, stored[0], stored[1], file));
    all.samples = calloc((size_t)(all.size[0] * all.size[1]), sizeof *all.samples);
    for (int64_t y = 0; y < all.size[1]; y++)
        for (int64_t x = 0; x < all.size[0]; x++) {
            int32_t *out = all.samples + y * all.size[0] + x, *row = all.samples + y * all.size[0];
            if (y >= stored[1])
                *out = stored[1] > 1 ? limit(2 * (int64_t)out[-all.size[0]] - out[-2 * all.size[0]])
                                     : out[-all.size[0]];
            else if (x >= stored[0])
                *out = stored[0] > 1 ? limit(2 * (int64_t)row[x - 1] - row[x - 2]) : row[x - 1];
            else
                *out = file[y * stored[0] + x];
        }
    free(file);
    return all;
}

static void check_window(const struct terrain *terrain, int level, const struct level *all, uint64_t *seed)
{
    int width = 1 + (int)(test_random(seed) % 150), height = 1 + (int)(test_random(seed) % 150);
    int64_t x0 = (int64_t)(test_random(seed) % (uint64_t)(all->size[0] + 60)) - 30;
    int64_t y0 = (int64_t)(test_random(seed) % (uint64_t)(all->size[1] + 60)) - 30;
    int32_t *out = malloc((size_t)(width * height) * sizeof *out), low, high;
    assert_true(terrain_window(terrain, level, x0, y0, width, height, out, TERRAIN_WAIT));
    terrain_bounds(terrain, level, x0, y0, x0 + width - 1, y0 + height - 1, &low, &high);
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            int32_t q = all->samples[clamp(y0 + y, 0, all->size[1] - 1) * all->size[0] +
                                     clamp(x0 + x, 0, all->size[0] - 1)];
            assert_int_equal(out[y * width + x], q);
            assert_in_range(q - (int64_t)low, 0, high - (int64_t)low);
        }
    free(out);
}

static void test_levels_are_those_of_the_file(void **state)
{
    (void)state;
    uint64_t seed = 1;
    for (int n = 0; n < SIZE_COUNT; n++)
        for (enum layout layout = LAYOUT_WAVELET; layout <= LAYOUT_BOUNDED; layout++) {
            pack(SIZES[n][0], SIZES[n][1], layout, seed, "levels.relief");
            struct relief *relief = relief_open(in_folder("levels.relief"));
            struct terrain *usual = load("levels.relief", (struct terrain_options){0});
            struct terrain *small = load("levels.relief", (struct terrain_options){.cache_bytes = ONE_BLOCK});
            assert_int_equal(terrain_info(usual)->coarsest, relief_grid(relief)->count - 1);
            for (int l = 0; l < relief_grid(relief)->count; l++) {
                struct level all = whole_level(relief, l);
                struct terrain_level level = terrain_level(usual, l);
                assert_true(level.extent.x0 == 0 && level.extent.y0 == 0);
                assert_true(level.extent.x1 == all.size[0] && level.extent.y1 == all.size[1]);
                size_t stride;
                assert_null(terrain_samples(usual, l, &stride));
                for (int k = 0; k < test_size(12, 200); k++) {
                    check_window(usual, l, &all, &seed);
                    if (k < 4) check_window(small, l, &all, &seed);
                }
                for (int64_t i = 0; i < all.size[0] * all.size[1]; i++)
                    assert_in_range(all.samples[i] - (int64_t)level.min_q, 0,
                                    level.max_q - (int64_t)level.min_q);
                free(all.samples);
            }
            terrain_destroy(usual);
            terrain_destroy(small);
            relief_close(relief);
        }
}

// What goes on beyond the last stored samples counts only where it is meant: else a tile is bounded as its
// file tells, the last ones, too.
static void test_bounds_end_with_the_stored_samples(void **state)
{
    (void)state;
    int continued = 0;
    for (int n = 0; n < SIZE_COUNT; n++) {
        pack(SIZES[n][0], SIZES[n][1], LAYOUT_WAVELET, 2, "bounds.relief");
        struct relief *relief = relief_open(in_folder("bounds.relief"));
        struct terrain *terrain = load("bounds.relief", (struct terrain_options){0});
        const struct grid *grid = relief_grid(relief);
        for (int l = 0; l < grid->count - 1; l++)
            for (int64_t t = 0; t < grid->tiles[l][0] * grid->tiles[l][1]; t++) {
                int64_t x = t % grid->tiles[l][0] * LAYOUT_SAMPLES,
                        y = t / grid->tiles[l][0] * LAYOUT_SAMPLES;
                int64_t x1 = clamp(x + LAYOUT_SAMPLES - 1, 0, grid->size[l][0] - 1),
                        y1 = clamp(y + LAYOUT_SAMPLES - 1, 0, grid->size[l][1] - 1);
                int32_t low, high, tile_low, tile_high;
                relief_bounds(relief, grid->first_tile[l] + t, &tile_low, &tile_high);
                terrain_bounds(terrain, l, x, y, x1, y1, &low, &high);
                assert_true(low == tile_low && high == tile_high);
                continued += terrain_level(terrain, l).extent.x1 > x1 + 1 && x1 + 1 == grid->size[l][0];
            }
        terrain_destroy(terrain);
        relief_close(relief);
    }
    assert_true(continued > 0);
}

// Where the last tile of a level has a single sample, the corner beyond it follows from three other tiles:
// here from a peak in the one across.
static void test_corners_are_bounded_by_all_they_follow_from(void **state)
{
    (void)state;
    enum { SIDE = 130, PEAK = 126, CORNER = 65 };
    struct heightfield field = test_field("peak", SIDE, SIDE);
    for (int k = 0; k < SIDE * SIDE; k++) field.samples[k] = k == PEAK * SIDE + PEAK ? 1000 : 0;
    struct relief_pack_options options = {.layout = LAYOUT_BOUNDED};
    struct relief_header header;
    assert_true(relief_pack(&field, &options, in_folder("peak.relief"), &header));
    heightfield_finish(&field);
    struct terrain *terrain = load("peak.relief", (struct terrain_options){0});
    int32_t corner, low, high;
    terrain_window(terrain, 1, CORNER, CORNER, 1, 1, &corner, TERRAIN_WAIT);
    assert_true(abs(corner) >= 1000);
    terrain_bounds(terrain, 1, CORNER, CORNER, CORNER, CORNER, &low, &high);
    assert_true(low <= corner && corner <= high);
    struct terrain_level level = terrain_level(terrain, 1);
    assert_true(level.min_q <= corner && corner <= level.max_q);
    terrain_destroy(terrain);
}

// ---- what a level differs from the finest ----------------------------------

static double surface(const struct level *all, double x, double y)
{
    int64_t i = clamp((int64_t)floor(x), 0, all->size[0] > 1 ? all->size[0] - 2 : 0);
    int64_t j = clamp((int64_t)floor(y), 0, all->size[1] > 1 ? all->size[1] - 2 : 0);
    int64_t east = all->size[0] > 1, north = all->size[1] > 1 ? all->size[0] : 0;
    double u = x - (double)i, v = y - (double)j;
    const int32_t *sw = all->samples + j * all->size[0] + i;
    return u >= v ? sw[0] + u * (sw[east] - sw[0]) + v * (sw[north + east] - sw[east])
                  : sw[0] + v * (sw[north] - sw[0]) + u * (sw[north + east] - sw[north]);
}

static void test_errors_are_not_exceeded(void **state)
{
    (void)state;
    double least = 1e9, most = 0;
    for (int n = 0; n < SIZE_COUNT; n++)
        for (enum layout layout = LAYOUT_WAVELET; layout <= LAYOUT_BOUNDED; layout++) {
            pack(SIZES[n][0], SIZES[n][1], layout, 3, "errors.relief");
            struct relief *relief = relief_open(in_folder("errors.relief"));
            struct terrain *terrain = load("errors.relief", (struct terrain_options){0});
            struct level fine = whole_level(relief, 0);
            for (int l = 0; l <= terrain_info(terrain)->coarsest; l++) {
                struct level all = whole_level(relief, l);
                double squares = 0, quantum_m = terrain_info(terrain)->quantum_m;
                struct terrain_level level = terrain_level(terrain, l);
                for (int64_t y = 0; y < fine.size[1]; y++)
                    for (int64_t x = 0; x < fine.size[0]; x++) {
                        double at[2] = {ldexp((double)x, -l), ldexp((double)y, -l)};
                        double d = fabs(surface(&all, at[0], at[1]) - fine.samples[y * fine.size[0] + x]);
                        int64_t i = (int64_t)at[0], j = (int64_t)at[1];
                        // One that stands on a line between tiles belongs to both.
                        assert_true(d * quantum_m <= terrain_error(terrain, l, i, j, i + 1, j + 1) + 1e-9);
                        assert_true(d * quantum_m <= level.max_error_m + 1e-9);
                        squares += d * d;
                    }
                double rms_m = sqrt(squares / (double)(fine.size[0] * fine.size[1])) * quantum_m;
                assert_false(level.rms_estimated);
                if (rms_m > 0.1) {
                    least = fmin(least, level.rms_error_m / rms_m);
                    most = fmax(most, level.rms_error_m / rms_m);
                }
                free(all.samples);
            }
            free(fine.samples);
            terrain_destroy(terrain);
            relief_close(relief);
        }
    // Every map here is small enough for the windows to cover all of it.
    assert_true(fabs(least - 1) < 1e-9 && fabs(most - 1) < 1e-9);
}

// Made-up levels of a large map are not gone through when it is opened: what is told of them is estimated,
// and says so.
static void test_estimates_are_told(void **state)
{
    (void)state;
    pack(600, 500, LAYOUT_WAVELET, 3, "estimates.relief");
    for (int finer = 0; finer <= 2; finer += 2) {
        struct terrain *terrain =
            load("estimates.relief", (struct terrain_options){.synthesize_levels = finer});
        const struct terrain_info *info = terrain_info(terrain);
        for (int l = info->finest; l <= info->coarsest; l++) {
            struct terrain_level level = terrain_level(terrain, l);
            assert_true(level.rms_estimated == (finer > 0 && l > info->finest));
            assert_true(level.max_estimated == (finer > 0 && l > info->finest));
        }
        terrain_destroy(terrain);
    }
}

// Version 2 of the format ends before the rms of levels, which is then found when the file is opened: on a
// map this small from all of it.
static void test_levels_of_older_files_are_measured(void **state)
{
    (void)state;
    static uint8_t data[1 << 20];
    struct relief_header h;
    pack(385, 390, LAYOUT_WAVELET, 4, "newer.relief");
    FILE *file = fopen(in_folder("newer.relief"), "rb");
    assert_non_null(file);
    size_t size = fread(data, 1, sizeof data, file);
    fclose(file);
    assert_null(relief_header_read(&h, data));
    struct relief *relief = relief_open(in_folder("newer.relief"));
    size_t cut = 8 * (size_t)(relief_grid(relief)->count - 1);
    relief_close(relief);
    h.side_bytes -= cut, size -= cut;
    h.side_crc = relief_crc(data + size - h.side_bytes, (size_t)h.side_bytes);
    relief_header_write(&h, data);
    data[8] = 2;
    uint32_t crc = relief_crc(data, RELIEF_HEADER - 4);
    for (int i = 0; i < 4; i++) data[RELIEF_HEADER - 4 + i] = (uint8_t)(crc >> 8 * i);
    file = fopen(in_folder("older.relief"), "wb");
    assert_int_equal(fwrite(data, 1, size, file), size);
    fclose(file);
    relief = relief_open(in_folder("older.relief"));
    assert_non_null(relief);
    assert_true(relief_level_rms(relief, 1) < 0);
    relief_close(relief);
    struct terrain *newer = load("newer.relief", (struct terrain_options){0});
    struct terrain *older = load("older.relief", (struct terrain_options){0});
    for (int l = 1; l <= terrain_info(newer)->coarsest; l++) {
        double rms_m = terrain_level(newer, l).rms_error_m;
        assert_true(rms_m > 0 && fabs(terrain_level(older, l).rms_error_m - rms_m) <= 1e-9 * rms_m);
    }
    terrain_destroy(newer);
    terrain_destroy(older);
}

// ---- synthesised levels ----------------------------------------------------

static void test_detail_depends_on_its_place_alone(void **state)
{
    (void)state;
    pack(201, 150, LAYOUT_WAVELET, 5, "detail.relief");
    for (enum terrain_noise noise = TERRAIN_NOISE_HASH; noise <= TERRAIN_NOISE_TABLE; noise++) {
        struct terrain_options options = {.synthesize_levels = 3, .seed = 9, .noise = noise};
        struct terrain *usual = load("detail.relief", options);
        options.cache_bytes = ONE_BLOCK;
        struct terrain *small = load("detail.relief", options);
        struct synthesis_table table;
        synthesis_fill_table(&table, options.seed);
        uint64_t seed = 11;
        for (int l = -1; l >= -3; l--) {
            struct terrain_level level = terrain_level(usual, l), coarser = terrain_level(usual, l + 1);
            assert_true(level.noise_q > 0 && terrain_level(small, l).noise_q == level.noise_q);
            assert_int_equal(level.extent.x1, 2 * coarser.extent.x1 - 1);
            for (int n = 0; n < test_size(6, 60); n++) {
                int width = 1 + (int)(test_random(&seed) % 200), height = 1 + (int)(test_random(&seed) % 200);
                // Away from the border, where samples of the coarser level are continued.
                int64_t x0 = 4 + (int64_t)(test_random(&seed) % (uint64_t)(level.extent.x1 - width - 8));
                int64_t y0 = 4 + (int64_t)(test_random(&seed) % (uint64_t)(level.extent.y1 - height - 8));
                int columns = upsample_coarse_size(x0, width), rows = upsample_coarse_size(y0, height);
                int32_t *fine = malloc((size_t)(width * height) * sizeof *fine);
                int32_t *again = malloc((size_t)(width * height) * sizeof *again);
                int32_t *coarse = malloc((size_t)(columns * rows) * sizeof *coarse), low, high;
                terrain_window(usual, l, x0, y0, width, height, fine, TERRAIN_WAIT);
                if (n < 2) {
                    terrain_window(small, l, x0, y0, width, height, again, TERRAIN_WAIT);
                    assert_memory_equal(fine, again, (size_t)(width * height) * sizeof *fine);
                }
                terrain_window(usual, l + 1, (x0 >> 1) - 1, (y0 >> 1) - 1, columns, rows, coarse,
                               TERRAIN_WAIT);
                upsample(coarse, x0, y0, width, height, again);
                for (int y = 0; y < height; y++)
                    noise == TERRAIN_NOISE_HASH ? synthesis_add_row(again + y * width, width, x0, y0 + y, l,
                                                                    options.seed, level.noise_q)
                                                : synthesis_add_table_row(again + y * width, width, x0,
                                                                          y0 + y, &table, level.noise_q);
                assert_memory_equal(fine, again, (size_t)(width * height) * sizeof *fine);
                terrain_bounds(usual, l, x0, y0, x0 + width - 1, y0 + height - 1, &low, &high);
                for (int i = 0; i < width * height; i++) assert_true(fine[i] >= low && fine[i] <= high);
                free(fine);
                free(again);
                free(coarse);
            }
        }
        terrain_destroy(usual);
        terrain_destroy(small);
    }
}

// rms of what U of the coarser level leaves of the finer one, without 4 samples next to the border, in
// `parts` of a quantum: U rounds.
static double residual_rms(const struct level *fine, const struct level *coarse, int parts)
{
    enum { FROM = 4 };
    int side = (int)fine->size[0] - 2 * FROM, under = upsample_coarse_size(FROM, side);
    int32_t *window = malloc((size_t)(under * under) * sizeof *window);
    int32_t *predicted = malloc((size_t)(side * side) * sizeof *predicted);
    for (int k = 0; k < under * under; k++)
        window[k] =
            parts * coarse->samples[(FROM / 2 - 1 + k / under) * coarse->size[0] + FROM / 2 - 1 + k % under];
    upsample(window, FROM, FROM, side, side, predicted);
    double squares = 0;
    for (int k = 0; k < side * side; k++) {
        double d = parts * fine->samples[(FROM + k / side) * fine->size[0] + FROM + k % side] - predicted[k];
        squares += d * d;
    }
    free(window);
    free(predicted);
    return sqrt(squares / side / side);
}

// On a map this small, from all of it.
static void test_noise_goes_on_from_the_levels_of_the_file(void **state)
{
    (void)state;
    enum { SIDE = 257, FITTED = 4 }; // 257, 129, 65, 33: the levels that are large enough
    for (enum layout layout = LAYOUT_WAVELET; layout <= LAYOUT_BOUNDED; layout++) {
        pack(SIDE, SIDE, layout, 8, "noise.relief");
        struct relief *relief = relief_open(in_folder("noise.relief"));
        struct terrain *terrain = load("noise.relief", (struct terrain_options){.synthesize_levels = 2});
        int parts = (int)(relief_header(relief)->quantum_m / terrain_info(terrain)->quantum_m);
        double rms_q[FITTED], noise_log2, noise_slope;
        struct level fine = whole_level(relief, 0);
        for (int l = 0; l < FITTED; l++) {
            struct level coarse = whole_level(relief, l + 1);
            rms_q[l] = residual_rms(&fine, &coarse, parts);
            free(fine.samples);
            fine = coarse;
        }
        free(fine.samples);
        pyramid_fit_noise(rms_q, FITTED, &noise_log2, &noise_slope);
        for (int l = -1; l >= -2; l--) {
            double noise_q = exp2(noise_log2 + noise_slope * l);
            assert_true(fabs(terrain_level(terrain, l).noise_q - noise_q) <= 1e-9 * noise_q);
        }
        terrain_destroy(terrain);
        relief_close(relief);
    }
}

// A file that tells the errors of its levels opens without a look at its finest one.
static void test_opening_keeps_no_fine_blocks(void **state)
{
    (void)state;
    pack(600, 500, LAYOUT_WAVELET, 3, "opened.relief");
    struct paged *paged = paged_open(in_folder("opened.relief"), &(struct terrain_options){0});
    assert_non_null(paged);
    int held = 0;
    for (int64_t y = 0; y * BLOCK < 500; y++)
        for (int64_t x = 0; x * BLOCK < 600; x++) held += paged_holds(paged, (struct slot_key){x, y, 0});
    assert_int_equal(held, 0);
    paged_close(paged);
}

// ---- the ray caster --------------------------------------------------------

// The same samples in memory.
static struct terrain *in_memory(const struct terrain *paged)
{
    const struct terrain_info *info = terrain_info(paged);
    struct terrain_level level = terrain_level(paged, info->finest);
    int64_t width = level.extent.x1, height = level.extent.y1;
    int32_t *samples = malloc((size_t)(width * height) * sizeof *samples);
    terrain_window(paged, info->finest, 0, 0, (int)width, (int)height, samples, TERRAIN_WAIT);
    struct terrain *terrain =
        terrain_from_grid(&(struct terrain_grid){.name = "in memory",
                                                 .samples = samples,
                                                 .width = width,
                                                 .height = height,
                                                 .spacing_m = {level.spacing_m[0], level.spacing_m[1]},
                                                 .quantum_m = info->quantum_m,
                                                 .offset_m = info->offset_m},
                          NULL);
    free(samples);
    assert_non_null(terrain);
    return terrain;
}

static void compare_pictures(const struct terrain *paged, const struct terrain *kept, uint64_t *seed)
{
    enum { WIDTH = 80, HEIGHT = 60 };
    const double *outline = terrain_info(kept)->outline_m;
    struct truth_surface *surfaces[2] = {truth_surface_create(paged), truth_surface_create(kept)};
    struct truth pictures[2];
    for (int k = 0; k < 2; k++) assert_true(truth_init(&pictures[k], WIDTH, HEIGHT));
    for (int n = 0; n < test_size(5, 200); n++) {
        double at[2], ground_q;
        for (int k = 0; k < 2; k++) // a place that the lattices of both hold exactly
            at[k] = floor(test_uniform(seed, outline[k], outline[k + 2]) * 64) / 64;
        assert_true(terrain_truth_at(paged, at[0], at[1], &ground_q, NULL));
        double kept_q;
        assert_true(terrain_truth_at(kept, at[0], at[1], &kept_q, NULL) && kept_q == ground_q);
        double ground_m = 7 + terrain_info(paged)->quantum_m * ground_q;
        struct camera camera = {.eye_m = {at[0], at[1], ground_m + test_uniform(seed, 1, 400)},
                                .yaw = test_uniform(seed, 0, 6.3),
                                .pitch = test_uniform(seed, -1.2, 0.1),
                                .fov_vertical = 1};
        struct view views[2];
        view_init(&views[0], paged, &camera, WIDTH, HEIGHT, 0.5);
        view_init(&views[1], kept, &camera, WIDTH, HEIGHT, 0.5);
        truth_cast(&pictures[0], surfaces[0], &views[0], 2);
        truth_cast(&pictures[1], surfaces[1], &views[1], 1);
        assert_int_equal(pictures[0].ground, pictures[1].ground);
        // Bounds of synthesised levels are loose: a ray may enter the layer of ground elsewhere, and its hit
        // be rounded otherwise.
        double most = terrain_info(paged)->finest < 0 ? 1e-13 : 0;
        for (int i = 0; i < WIDTH * HEIGHT; i++) {
            const struct truth_pixel *a = &pictures[0].pixels[i], *b = &pictures[1].pixels[i];
            assert_true(fabs(a->depth - b->depth) <= most * b->depth);
            if (most == 0) assert_memory_equal(a, b, sizeof *a);
        }
    }
    for (int k = 0; k < 2; k++) {
        truth_finish(&pictures[k]);
        truth_surface_destroy(surfaces[k]);
    }
}

static void test_rays_meet_the_same_ground(void **state)
{
    (void)state;
    uint64_t seed = 13;
    static const struct terrain_options OPTIONS[] = {{0},
                                                     {.cache_bytes = ONE_BLOCK},
                                                     {.cache_bytes = 1 << 20, .refine_bits = 1},
                                                     {.synthesize_levels = 1}};
    for (int n = 0; n < SIZE_COUNT; n++) {
        if (SIZES[n][0] < 2 || SIZES[n][1] < 2) continue;
        pack(SIZES[n][0], SIZES[n][1], n % 2 ? LAYOUT_WAVELET : LAYOUT_BOUNDED, 6, "rays.relief");
        // The least ceiling decodes a page from the coarsest level up, again and again: small maps alone.
        struct terrain *paged = load("rays.relief", OPTIONS[n % 4 == 1 && SIZES[n][0] > 100 ? 0 : n % 4]);
        struct terrain *kept = in_memory(paged);
        compare_pictures(paged, kept, &seed);
        terrain_destroy(paged);
        terrain_destroy(kept);
    }
}

// ---- the reader ------------------------------------------------------------

enum { FLIGHT = 60, WINDOWS_A_FRAME = 5 };

// Flies over the map and notes which windows were there; what is there is what the file holds.
static void fly(const struct terrain *terrain, const struct level *levels, bool realtime,
                char there[FLIGHT][WINDOWS_A_FRAME], struct terrain_reader_counters *sum)
{
    struct terrain_reader *reader = terrain_reader_create(terrain, realtime);
    int32_t out[100 * 70];
    memset(sum, 0, sizeof *sum);
    for (int frame = 0; frame < FLIGHT; frame++) {
        double place_m[2] = {30.0 * 5 * frame, 40.0 * 6 * frame};
        terrain_reader_begin_frame(reader, frame, place_m);
        for (int n = 0; n < WINDOWS_A_FRAME; n++) {
            int l = WINDOWS_A_FRAME - 1 - n;
            int64_t x0 = (5 * frame >> l) - 20, y0 = (6 * frame >> l) - 10;
            memset(out, 0x55, sizeof out);
            there[frame][n] = terrain_reader_window(reader, l, x0, y0, 100, 70, out);
            for (int i = 0; i < 100 * 70; i++) {
                int64_t x = clamp(x0 + i % 100, 0, levels[l].size[0] - 1);
                int64_t y = clamp(y0 + i / 100, 0, levels[l].size[1] - 1);
                assert_int_equal(out[i],
                                 there[frame][n] ? levels[l].samples[y * levels[l].size[0] + x] : 0x55555555);
            }
        }
        struct terrain_reader_counters c = terrain_reader_counters(reader);
        assert_int_equal(c.asked, WINDOWS_A_FRAME);
        sum->missed += c.missed;
        sum->arrived += c.arrived;
        sum->evicted += c.evicted;
    }
    terrain_reader_destroy(reader);
}

static void test_arrivals_follow_from_frames_alone(void **state)
{
    (void)state;
    pack(385, 390, LAYOUT_WAVELET, 8, "flight.relief");
    struct relief *relief = relief_open(in_folder("flight.relief"));
    struct level levels[WINDOWS_A_FRAME];
    for (int l = 0; l < WINDOWS_A_FRAME; l++) levels[l] = whole_level(relief, l);
    const uint64_t ceilings[] = {ONE_BLOCK, 12 * BLOCK * BLOCK * 4, 1 << 23};
    for (int c = 0; c < 3; c++) {
        char first[FLIGHT][WINDOWS_A_FRAME], there[FLIGHT][WINDOWS_A_FRAME];
        struct terrain_reader_counters sums[2], live;
        for (int workers = 1; workers <= 4; workers++) {
            struct terrain *terrain =
                load("flight.relief", (struct terrain_options){.cache_bytes = ceilings[c],
                                                               .workers = workers,
                                                               .frame_samples = 2 * BLOCK * BLOCK});
            fly(terrain, levels, workers < 3, there, &live); // what was read before does not show either
            fly(terrain, levels, false, workers == 1 ? first : there, &sums[workers > 1]);
            if (workers > 1) {
                assert_memory_equal(first, there, sizeof first);
                assert_memory_equal(&sums[0], &sums[1], sizeof sums[0]);
            }
            terrain_destroy(terrain);
        }
        FIGURE("ceiling %.2f MiB: %llu of %d windows late, %llu blocks arrived, %llu evicted",
               (double)ceilings[c] / (1 << 20), (unsigned long long)sums[0].missed, FLIGHT * WINDOWS_A_FRAME,
               (unsigned long long)sums[0].arrived, (unsigned long long)sums[0].evicted);
    }
    for (int l = 0; l < WINDOWS_A_FRAME; l++) free(levels[l].samples);
    relief_close(relief);
}

static void test_what_is_asked_for_arrives_after_the_latency(void **state)
{
    (void)state;
    pack(385, 390, LAYOUT_BOUNDED, 8, "latency.relief");
    for (int latency = 1; latency <= 4; latency++) {
        struct terrain *terrain =
            load("latency.relief",
                 (struct terrain_options){.latency_frames = latency, .frame_samples = BLOCK * BLOCK});
        struct terrain_reader *reader = terrain_reader_create(terrain, false);
        const double here[2] = {0, 0};
        // Four blocks, one a frame: the last is sent for in the fourth frame.
        for (int frame = 0; frame < 4 + latency; frame++) {
            terrain_reader_begin_frame(reader, frame, here);
            bool there = terrain_reader_window(reader, 0, BLOCK - 1, BLOCK - 1, 2, 2, NULL);
            assert_int_equal(there, frame == 3 + latency);
            assert_int_equal(terrain_reader_idle(reader), there);
        }
        // A skipped frame is a frame: what it would have brought is there.
        terrain_reader_begin_frame(reader, 20, here);
        assert_false(terrain_reader_window(reader, 0, 300, 300, 1, 1, NULL));
        terrain_reader_begin_frame(reader, 20 + latency, here);
        assert_true(terrain_reader_window(reader, 0, 300, 300, 1, 1, NULL));
        terrain_reader_destroy(reader);
        terrain_destroy(terrain);
    }
}

// Windows that need all that is kept, wanted in turns, still arrive.
static void test_rivals_all_arrive(void **state)
{
    (void)state;
    pack(600, 600, LAYOUT_BOUNDED, 9, "rivals.relief");
    for (int kept = 1; kept <= 8; kept++) {
        struct terrain *terrain = load(
            "rivals.relief", (struct terrain_options){.cache_bytes = (uint64_t)kept * 2 * BLOCK * BLOCK * 4});
        struct terrain_reader *reader = terrain_reader_create(terrain, false);
        bool done[6] = {0};
        int count = 0, frame = 0;
        for (; frame < 400 && count < 6; frame++) {
            terrain_reader_begin_frame(reader, frame, (const double[2]){0, 0});
            for (int n = 0; n < 6; n++)
                if (!done[n] && terrain_reader_window(reader, 0, 60 * n, 70 * n, BLOCK + 2, BLOCK + 2, NULL))
                    done[n] = true, count++;
        }
        assert_int_equal(count, 6);
        terrain_reader_destroy(reader);
        terrain_destroy(terrain);
    }
}

// A window that needs all that is kept arrives though others, which are there or arrive meanwhile, are asked
// for after it in every frame.
static void test_the_first_goes_before_what_is_there(void **state)
{
    (void)state;
    enum { KEPT = 9, OTHERS = 4, FRAMES = 60 };
    pack(600, 600, LAYOUT_BOUNDED, 9, "first.relief");
    for (int others = 1; others <= OTHERS; others++) {
        struct terrain *terrain =
            load("first.relief",
                 (struct terrain_options){.cache_bytes = (uint64_t)(KEPT + 7) * BLOCK * BLOCK * 4});
        struct terrain_reader *reader = terrain_reader_create(terrain, false);
        int frame = 0, first = 0;
        bool there = false;
        for (; !there && frame < 2 * FRAMES; frame++) {
            terrain_reader_begin_frame(reader, frame, (const double[2]){0, 0});
            if (frame >= FRAMES) there = terrain_reader_window(reader, 0, 0, 0, 3 * BLOCK, 3 * BLOCK, NULL);
            for (int n = 0; n < others; n++)
                first += terrain_reader_window(reader, 0, 4 * BLOCK, n * BLOCK, 8, 8, NULL);
        }
        assert_true(first > 0 && there);
        // Two blocks a frame, each two frames later: nine of them need seven frames, and the others once
        // more.
        assert_true(frame <= FRAMES + 20);
        terrain_reader_destroy(reader);
        terrain_destroy(terrain);
    }
}

// ---- ceiling and harm ------------------------------------------------------

static void read_some(int block, void *user)
{
    const struct terrain *terrain = user;
    uint64_t seed = (uint64_t)block;
    int32_t *out = malloc(200 * 200 * sizeof *out);
    struct terrain_page page = {0};
    for (int n = 0; n < 40; n++) {
        terrain_window(terrain, (int)(test_random(&seed) % 3), (int64_t)(test_random(&seed) % 600) - 50,
                       (int64_t)(test_random(&seed) % 600) - 50, 200, 200, out,
                       n % 4 ? TERRAIN_WAIT : TERRAIN_TRY);
        terrain_page(terrain, (int)(test_random(&seed) % 3), (int64_t)(test_random(&seed) % 9),
                     (int64_t)(test_random(&seed) % 9), &page);
    }
    terrain_page_release(terrain, &page);
    free(out);
}

static void test_the_ceiling_holds(void **state)
{
    (void)state;
    pack(600, 600, LAYOUT_WAVELET, 10, "ceiling.relief");
    for (int mib = 0; mib <= 4; mib++) {
        struct terrain_options options = {.cache_bytes = mib ? (uint64_t)mib << 20 : ONE_BLOCK, .workers = 2};
        struct terrain *terrain = load("ceiling.relief", options);
        struct relief *relief = relief_open(in_folder("ceiling.relief"));
        parallel_blocks(6, 3, read_some, terrain);
        size_t tiles = (size_t)relief_grid(relief)->tile_count;
        // Beside the ceiling: about 14 bytes a tile, the book-keeping of the cache, descriptions of levels.
        size_t most =
            (options.cache_bytes > 1 ? (size_t)options.cache_bytes : (size_t)(BLOCK * BLOCK * 4 + 40000)) +
            20 * tiles + (size_t)(mib + 1) * 40 * 200 + 300000;
        assert_true(terrain_resident_bytes(terrain) <= most);
        relief_close(relief);
        terrain_destroy(terrain);
    }
}

static void test_harm_is_told_once(void **state)
{
    (void)state;
    pack(385, 390, LAYOUT_WAVELET, 12, "harmed.relief");
    struct terrain *terrain = load("harmed.relief", (struct terrain_options){.cache_bytes = ONE_BLOCK});
    assert_false(terrain_failed(terrain));
    // The file loses its tiles while it is flown.
    int told[2], keep = dup(STDERR_FILENO);
    char text[4096];
    assert_int_equal(truncate(in_folder("harmed.relief"), RELIEF_HEADER + 40), 0);
    assert_int_equal(pipe(told), 0);
    dup2(told[1], STDERR_FILENO);
    parallel_blocks(6, 3, read_some, terrain);
    dup2(keep, STDERR_FILENO);
    close(told[1]);
    ssize_t size = read(told[0], text, sizeof text - 1);
    close(told[0]);
    close(keep);
    assert_true(size > 0);
    text[size] = '\0';
    assert_true(terrain_failed(terrain));
    assert_ptr_equal(strchr(text, '\n'), text + size - 1); // one line
    assert_non_null(strstr(text, "harmed.relief: tile ("));
    int32_t q = 1;
    assert_true(terrain_window(terrain, 0, 5, 5, 1, 1, &q, TERRAIN_WAIT));
    assert_int_equal(q, 0);
    terrain_destroy(terrain);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_levels_are_those_of_the_file),
        cmocka_unit_test(test_bounds_end_with_the_stored_samples),
        cmocka_unit_test(test_corners_are_bounded_by_all_they_follow_from),
        cmocka_unit_test(test_errors_are_not_exceeded),
        cmocka_unit_test(test_estimates_are_told),
        cmocka_unit_test(test_levels_of_older_files_are_measured),
        cmocka_unit_test(test_detail_depends_on_its_place_alone),
        cmocka_unit_test(test_noise_goes_on_from_the_levels_of_the_file),
        cmocka_unit_test(test_opening_keeps_no_fine_blocks),
        cmocka_unit_test(test_rays_meet_the_same_ground),
        cmocka_unit_test(test_arrivals_follow_from_frames_alone),
        cmocka_unit_test(test_what_is_asked_for_arrives_after_the_latency),
        cmocka_unit_test(test_rivals_all_arrive),
        cmocka_unit_test(test_the_first_goes_before_what_is_there),
        cmocka_unit_test(test_the_ceiling_holds),
        cmocka_unit_test(test_harm_is_told_once),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
