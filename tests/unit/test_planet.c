// Whole planets as .relief files: their levels are those that terrain/sphere makes in memory, over the seam
// and over the poles, in whatever regions they are packed; and files that are not this program's are refused.
// SPDX-License-Identifier: MIT
#include "tests/folder.h"

#include "common/terrain/reader.h"
#include "common/terrain/relief/relief_file.h"
#include "common/terrain/relief/relief_pack.h"
#include "common/terrain/sphere.h"
#include "common/terrain/terrain.h"
#include "common/terrain/upsample.h"

#include <string.h>

#define RADIUS_M 3396190.0
enum { LITTLE_MEMORY = 1 << 20, MOST = 1600 * 801 };

// Hills that go on over the seam, but for noise, and over the poles; the first columns are `turned` east.
static struct heightfield planet(int columns, int rows, int turned)
{
    struct heightfield field = {.name = "planet",
                                .width = columns,
                                .height = rows,
                                .spacing_m = {2 * M_PI * RADIUS_M / columns, 2 * M_PI * RADIUS_M / columns},
                                .quantum_m = 1,
                                .offset_m = -50,
                                .radius_m = RADIUS_M,
                                .samples = malloc((size_t)columns * (size_t)rows * sizeof(int32_t))};
    for (int y = 0; y < rows; y++)
        for (int x = 0; x < columns; x++) {
            int at = (x + turned) % columns;
            uint64_t seed = (uint64_t)y * 100000 + (uint64_t)at;
            double longitude = 2 * M_PI * at / columns, latitude = M_PI * y / (rows - 1) - M_PI / 2;
            double hills =
                2000 * sin(3 * longitude) * cos(latitude) + 900 * sin(40 * longitude + 30 * latitude);
            field.samples[(int64_t)y * columns + x] = (int32_t)hills + (int32_t)(test_random(&seed) % 300);
        }
    return field;
}

static struct terrain *in_memory(const struct heightfield *field, enum terrain_filter filter)
{
    const struct terrain_options options = {
        .filter = filter, .radius_m = field->radius_m, .pixel_centred = field->pixel_centred};
    const struct terrain_grid grid = {.name = field->name,
                                      .samples = field->samples,
                                      .width = field->width,
                                      .height = field->height,
                                      .first = {-field->width / 2, 0},
                                      .spacing_m = {field->spacing_m[0], field->spacing_m[1]},
                                      .quantum_m = field->quantum_m,
                                      .offset_m = field->offset_m};
    struct terrain *terrain = terrain_from_grid(&grid, &options);
    assert_non_null(terrain);
    return terrain;
}

static struct relief *pack(struct heightfield *field, struct relief_pack_options options)
{
    struct relief_header header;
    assert_true(relief_pack(field, &options, in_folder("planet.relief"), &header));
    struct relief *relief = relief_open(in_folder("planet.relief"));
    assert_non_null(relief);
    return relief;
}

// All samples of a level, by the planet's own indices.
static struct sphere_grid read_level(const struct relief *relief, int level, int32_t *samples)
{
    struct relief_planet planet = relief_planet(relief_header(relief));
    struct sphere_grid grid = sphere_level(&planet.grid, level);
    int64_t margin = planet.margin >> level;
    assert_true(relief_window(relief, level, margin, margin, grid.columns, 2 * grid.pole + 1, samples));
    return grid;
}

struct difference {
    int32_t most;
    double rms;
};

static struct difference differ(const int32_t *a, const int32_t *b, int64_t count)
{
    struct difference d = {0};
    for (int64_t i = 0; i < count; i++) {
        int32_t off = abs(a[i] - b[i]);
        d.most = off > d.most ? off : d.most;
        d.rms += (double)off * off;
    }
    d.rms = sqrt(d.rms / (double)count);
    return d;
}

// ---- levels ----------------------------------------------------------------

static const int SIZES[][2] = {{768, 385}, {512, 129}, {384, 17}, {36, 19}, {4, 3}, {1440, 721}, {1600, 801}};

// The largest difference of any level from the one in memory.
static int32_t check_levels(const int size[2], struct relief_pack_options options, enum terrain_filter filter)
{
    static int32_t got[MOST], wanted[MOST];
    struct heightfield field = planet(size[0], size[1], 0);
    struct terrain *terrain = in_memory(&field, filter);
    struct relief *relief = pack(&field, options);
    const struct relief_header *header = relief_header(relief);
    assert_true(header->radius_m == RADIUS_M);
    assert_true(header->coarsest <= terrain_info(terrain)->coarsest);
    assert_true(size[0] < 768 || header->coarsest >= 2);
    int32_t most = 0;
    for (int l = 0; l <= header->coarsest; l++) {
        struct sphere_grid grid = read_level(relief, l, got);
        struct terrain_extent extent = terrain_level(terrain, l).extent, own = sphere_extent(&grid);
        assert_memory_equal(&extent, &own, sizeof own);
        int64_t width = own.x1 - own.x0, height = own.y1 - own.y0;
        terrain_window(terrain, l, own.x0, own.y0, (int)width, (int)height, wanted, TERRAIN_WAIT);
        struct difference d = differ(got, wanted, width * height);
        most = d.most > most ? d.most : most;
        for (int64_t x = 0; x < width; x++) { // a pole is one height, and in memory's level the same
            assert_int_equal(got[x], wanted[0]);
            assert_int_equal(got[(height - 1) * width + x], wanted[(height - 1) * width]);
        }
        if (l == 0) assert_true(fabs(d.rms - header->rms_m) < 1e-9 && d.most == header->max_m);
        if (l == 0 || most > 0) continue;
        double rms_m = terrain_level(terrain, l).rms_error_m; // its sum of squares is rounded
        assert_true(fabs(relief_level_rms(relief, l) * field.quantum_m - rms_m) <= 1e-9 * rms_m);
    }
    relief_close(relief);
    terrain_destroy(terrain);
    heightfield_finish(&field);
    return most;
}

static void test_levels_are_those_of_memory(void **state)
{
    (void)state;
    for (int n = 0; n < test_size(5, 7); n++)
        for (int little = 0; little < 2; little++) { // by regions, too
            struct relief_pack_options o = {.memory_bytes = little ? LITTLE_MEMORY : 0};
            o.layout = LAYOUT_RAW;
            assert_int_equal(check_levels(SIZES[n], o, TERRAIN_FILTER_DECIMATE), 0);
            o.layout = LAYOUT_BOUNDED;
            assert_int_equal(check_levels(SIZES[n], o, TERRAIN_FILTER_DECIMATE), 0);
            o.layout = LAYOUT_PYRAMID; // lossless: its levels are the filtered ones, bit for bit
            assert_int_equal(check_levels(SIZES[n], o, TERRAIN_FILTER_OPTIMAL), 0);
            o.max_m = 5;
            assert_in_range(check_levels(SIZES[n], o, TERRAIN_FILTER_OPTIMAL), 1, 5);
            o.layout = LAYOUT_BOUNDED;
            assert_in_range(check_levels(SIZES[n], o, TERRAIN_FILTER_DECIMATE), 1, 5);
        }
}

// A seam is nothing: a planet that was turned by whole samples of its coarsest level packs to the same
// levels, turned, as near as its coefficients' steps allow.  One sample of noise at the seam would be 300
// quanta.
static void test_wavelet_has_no_seam(void **state)
{
    (void)state;
    enum { COLUMNS = 800, ROWS = 401, TURNED = 208 };
    static int32_t levels[2][MOST], turned[MOST];
    for (int little = 0; little < 2; little++) {
        struct relief *reliefs[2];
        for (int k = 0; k < 2; k++) {
            struct heightfield field = planet(COLUMNS, ROWS, k * TURNED);
            reliefs[k] =
                pack(&field, (struct relief_pack_options){.layout = LAYOUT_WAVELET,
                                                          .rms_m = 0.5,
                                                          .memory_bytes = little ? LITTLE_MEMORY : 0});
            const struct relief_header *header = relief_header(reliefs[k]);
            assert_true(header->rms_m >= 0.49 && header->rms_m <= 0.5005 && header->coarsest >= 2);
            heightfield_finish(&field);
        }
        for (int l = 0; l <= relief_header(reliefs[0])->coarsest; l++) {
            struct sphere_grid grid = read_level(reliefs[0], l, levels[0]);
            read_level(reliefs[1], l, levels[1]);
            int64_t rows = 2 * grid.pole + 1;
            const struct sphere_grid from = {0, grid.columns, grid.pole};
            sphere_window(&from, levels[0], TURNED >> l, -grid.pole, (int)grid.columns, (int)rows, turned);
            struct difference d = differ(levels[1], turned, grid.columns * rows);
            // Both are coded to 0.5 at level 0, and coarser levels nearer still.
            assert_true(d.rms <= sqrt(2) * 0.5 && d.most <= 8);
        }
        for (int k = 0; k < 2; k++) relief_close(reliefs[k]);
    }
}

static void test_regions_and_threads_do_not_show(void **state)
{
    (void)state;
    for (enum layout layout = LAYOUT_WAVELET; layout <= LAYOUT_PYRAMID; layout++) {
        struct heightfield field = planet(960, 481, 0);
        struct relief_header first = {0};
        for (int i = 0; i < 3; i++) {
            struct relief_pack_options o = {.layout = layout,
                                            .rms_m = 4,
                                            .max_m = 4,
                                            .memory_bytes = LITTLE_MEMORY,
                                            .threads = 1 + i,
                                            .region = 256 << i};
            struct relief *relief = pack(&field, o);
            const struct relief_header *header = relief_header(relief);
            if (i == 0) first = *header;
            assert_int_equal(header->side_crc, first.side_crc);
            assert_int_equal(header->index_crc, first.index_crc);
            assert_int_equal(header->base_crc, first.base_crc);
            relief_close(relief);
        }
        heightfield_finish(&field);
    }
}

// Bounds of tiles hold for what is read, poles included.
static void test_tiles_bound_their_samples(void **state)
{
    (void)state;
    static int32_t got[MOST];
    enum { S = LAYOUT_SAMPLES };
    for (enum layout layout = LAYOUT_WAVELET; layout < LAYOUTS; layout++) {
        struct heightfield field = planet(768, 385, 0);
        struct relief *relief =
            pack(&field, (struct relief_pack_options){.layout = layout, .rms_m = 20, .max_m = 40});
        const struct grid *grid = relief_grid(relief);
        for (int l = 0; l <= relief_header(relief)->coarsest; l++) {
            int64_t width = grid->size[l][0], height = grid->size[l][1];
            assert_true(relief_window(relief, l, 0, 0, width, height, got));
            for (int64_t y = 0; y < height; y++)
                for (int64_t x = 0; x < width; x++) {
                    struct relief_tile_side side =
                        relief_side(relief, grid->first_tile[l] + y / S * grid->tiles[l][0] + x / S);
                    assert_in_range(got[y * width + x] + 100000, side.min_q + 100000, side.max_q + 100000);
                }
        }
        relief_close(relief);
        heightfield_finish(&field);
    }
}

// ---- files -----------------------------------------------------------------

// Cells become samples on the lines between them, as in memory.
static void test_pixel_centred_planets_are_packed_as_their_grid(void **state)
{
    (void)state;
    static int32_t wanted[MOST];
    struct heightfield field = planet(360, 180, 0), back;
    field.pixel_centred = true;
    struct terrain *terrain = in_memory(&field, TERRAIN_FILTER_DECIMATE);
    relief_close(pack(&field, (struct relief_pack_options){.layout = LAYOUT_BOUNDED}));
    assert_true(heightfield_load(&back, in_folder("planet.relief")));
    assert_true(back.radius_m == RADIUS_M && !back.pixel_centred);
    assert_int_equal(back.width, 360);
    assert_int_equal(back.height, 181);
    terrain_window(terrain, 0, -180, -90, 360, 181, wanted, TERRAIN_WAIT);
    assert_memory_equal(back.samples, wanted, 360 * 181 * sizeof *wanted);
    struct terrain *opened = terrain_load(in_folder("planet.relief"), NULL);
    assert_non_null(opened);
    assert_int_equal(terrain_info(opened)->datum, TERRAIN_SPHERE);
    assert_true(terrain_info(opened)->wraps_x && terrain_info(opened)->radius_m == RADIUS_M);
    static int32_t over[70 * 40], under[70 * 40]; // over the seam and the pole
    terrain_window(opened, 0, 150, 70, 70, 40, over, TERRAIN_WAIT);
    terrain_window(terrain, 0, 150, 70, 70, 40, under, TERRAIN_WAIT);
    assert_memory_equal(over, under, sizeof over);
    terrain_destroy(opened);
    terrain_destroy(terrain);
    heightfield_finish(&back);
    heightfield_finish(&field);
}

// On disk and in memory a planet is the same: any window of any level, over seam and poles, and bounds hold
// it.
static void test_planets_are_read_on_demand(void **state)
{
    enum { COLUMNS = 1440, ROWS = 721, SIDE = 90 };
    (void)state;
    struct heightfield field = planet(COLUMNS, ROWS, 0);
    struct terrain *memory = in_memory(&field, TERRAIN_FILTER_DECIMATE);
    relief_close(pack(&field, (struct relief_pack_options){.layout = LAYOUT_BOUNDED}));
    const struct terrain_options options = {.cache_bytes = 1 << 20, .frame_samples = 4 * 128 * 128};
    struct terrain *disk = terrain_load(in_folder("planet.relief"), &options);
    assert_non_null(disk);
    assert_null(terrain_extrema(disk));
    const struct terrain_info *info = terrain_info(disk);
    assert_true(info->coarsest > 0 && info->coarsest <= terrain_info(memory)->coarsest);
    struct terrain_reader *reader = terrain_reader_create(disk, false);
    static int32_t wanted[SIDE * SIDE], read[SIDE * SIDE];
    uint64_t seed = 7, late = 0;
    int frame = 0, windows = test_size(300, 20000);
    for (int k = 0; k < windows; k++) {
        int level = (int)(test_random(&seed) % (uint64_t)(info->coarsest + 1));
        int width = 1 + (int)(test_random(&seed) % SIDE), height = 1 + (int)(test_random(&seed) % SIDE);
        int64_t x0 = (int64_t)test_uniform(&seed, -2000, 2000) >> level,
                y0 = (int64_t)test_uniform(&seed, -1200, 1200) >> level;
        int32_t low, high;
        struct terrain_level one = terrain_level(disk, level), other = terrain_level(memory, level);
        assert_memory_equal(&one.extent, &other.extent, sizeof one.extent);
        assert_true(one.spacing_m[0] == other.spacing_m[0] && one.spacing_m[1] == other.spacing_m[1]);
        terrain_window(memory, level, x0, y0, width, height, wanted, TERRAIN_WAIT);
        const double place[2] = {(double)x0 * one.spacing_m[0], (double)y0 * one.spacing_m[1]};
        for (;; late++) { // the reader has all of it, in the end
            terrain_reader_begin_frame(reader, frame++, place);
            if (terrain_reader_window(reader, level, x0, y0, width, height, read)) break;
            assert_true(late < 100 * (uint64_t)windows);
        }
        assert_memory_equal(read, wanted, (size_t)(width * height) * sizeof *read);
        terrain_bounds(disk, level, x0, y0, x0 + width - 1, y0 + height - 1, &low, &high);
        for (int i = 0; i < width * height; i++) assert_true(wanted[i] >= low && wanted[i] <= high);
    }
    FIGURE("planet on disk: %d windows as in memory, %lu frames late", windows, late);
    assert_true(late > 0);
    terrain_reader_destroy(reader);
    terrain_destroy(disk);
    terrain_destroy(memory);
    heightfield_finish(&field);
}

// Samples take 4 bytes and nodes over 8 x 8 of them another 1/6, in all levels 4/3 of that.
static void test_planets_in_memory_take_little_beside_their_samples(void **state)
{
    (void)state;
    struct heightfield field = planet(1440, 721, 0);
    struct terrain *terrain = in_memory(&field, TERRAIN_FILTER_LINEAR);
    double bytes_a_sample = (double)terrain_resident_bytes(terrain) / (1440 * 721);
    FIGURE("planet in memory: %.2f bytes a sample", bytes_a_sample);
    assert_true(bytes_a_sample > 4 && bytes_a_sample < 6);
    terrain_destroy(terrain);
    heightfield_finish(&field);
}

// A made planet: the same from any window, and it goes on over the seam as over any other column.
static void test_a_made_planet_has_no_seam(void **state)
{
    (void)state;
    char path[1024], text[1400];
    if (!test_data("earth_etopo5_4320x2161.png", path)) return;
    enum { COLUMNS = 2880, ROWS = 1441 };
    snprintf(text, sizeof text,
             "{\"generate\": \"amplify\", \"source\": \"%s\", \"levels\": 4, \"width\": %d, \"height\": %d}",
             path, COLUMNS, ROWS);
    write_text("earth.json", text);
    struct relief_source source;
    assert_true(relief_source_open(&source, in_folder("earth.json"), 0, NULL));
    assert_true(fabs(source.radius_m - 6371007) < 1);
    struct patch whole = {{0, 0, COLUMNS, ROWS}, malloc(COLUMNS * ROWS * sizeof(int32_t))};
    assert_true(source.window(&source, &whole));
    uint64_t seed = 1;
    for (int i = 0; i < test_size(60, 3000); i++) {
        int64_t x0 = (int64_t)(test_random(&seed) % COLUMNS), y0 = (int64_t)(test_random(&seed) % ROWS);
        int64_t x1 = x0 + 1 + (int64_t)(test_random(&seed) % (uint64_t)(COLUMNS - x0));
        int64_t y1 = y0 + 100 < ROWS ? y0 + 100 : ROWS;
        struct patch part = {{x0, y0, x1, y1}, malloc((size_t)((x1 - x0) * (y1 - y0)) * sizeof(int32_t))};
        assert_true(source.window(&source, &part));
        for (int64_t y = y0; y < y1; y++)
            assert_memory_equal(patch_at(&part, x0, y), patch_at(&whole, x0, y),
                                (size_t)(x1 - x0) * sizeof(int32_t));
        free(part.samples);
    }
    // Mean bend of columns about the seam against all columns: a seam would stand out by far.
    double seam = 0, all = 0;
    for (int64_t y = 1; y < ROWS - 1; y++)
        for (int64_t x = 0; x < COLUMNS; x++) {
            const int32_t *row = patch_at(&whole, 0, y);
            double bend = fabs(2.0 * row[x] - row[(x + COLUMNS - 1) % COLUMNS] - row[(x + 1) % COLUMNS]);
            all += bend;
            if (x == 0 || x == COLUMNS - 1) seam += bend;
        }
    assert_true(seam / 2 < 2 * all / COLUMNS);
    free(whole.samples);
    relief_source_finish(&source);
    snprintf(
        text, sizeof text,
        "{\"generate\": \"amplify\", \"source\": \"%s\", \"levels\": 4, \"width\": 2888, \"height\": 1441}",
        path);
    write_text("earth.json", text); // one line: no planet of 4 levels
    assert_false(relief_source_open(&source, in_folder("earth.json"), 0, NULL));
}

// ---- what is refused -------------------------------------------------------

static void spoil(size_t at, uint32_t value)
{
    uint8_t header[RELIEF_HEADER];
    FILE *file = fopen(in_folder("planet.relief"), "r+b");
    assert_non_null(file);
    assert_int_equal(fread(header, 1, sizeof header, file), sizeof header);
    for (int i = 0; i < 4; i++) header[at + (size_t)i] = (uint8_t)(value >> 8 * i);
    uint32_t crc = relief_crc(header, RELIEF_HEADER - 4);
    for (int i = 0; i < 4; i++) header[RELIEF_HEADER - 4 + i] = (uint8_t)(crc >> 8 * i);
    rewind(file);
    assert_int_equal(fwrite(header, 1, sizeof header, file), sizeof header);
    assert_int_equal(fclose(file), 0);
}

static void test_other_tables_and_versions_are_refused(void **state)
{
    (void)state;
    enum { VERSION = 8, MARGIN = 224, COARSEST = 228, TABLES = 232 };
    uint8_t words[sizeof CODER_TABLES], *word = words;
    const uint16_t *tables = &CODER_TABLES.start[0][0][0];
    for (size_t i = 0; i < sizeof CODER_TABLES / sizeof *tables; i++)
        *word++ = (uint8_t)tables[i], *word++ = (uint8_t)(tables[i] >> 8);
    assert_int_equal(relief_crc(words, sizeof words), CODER_TABLES_CRC);
    const struct {
        size_t at;
        uint32_t value;
    } BAD[] = {{VERSION, 1},    {TABLES, CODER_TABLES_CRC ^ 1},
               {MARGIN, 3},     {MARGIN, 1000},
               {MARGIN, ~0u},   {COARSEST, 30},
               {COARSEST, ~0u}, {TABLES, 0}};
    for (size_t i = 0; i < sizeof BAD / sizeof *BAD; i++) {
        struct heightfield field = planet(768, 385, 0);
        relief_close(pack(&field, (struct relief_pack_options){.layout = LAYOUT_BOUNDED, .max_m = 9}));
        spoil(BAD[i].at, BAD[i].value);
        assert_null(relief_open(in_folder("planet.relief")));
        heightfield_finish(&field);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_levels_are_those_of_memory),
        cmocka_unit_test(test_wavelet_has_no_seam),
        cmocka_unit_test(test_regions_and_threads_do_not_show),
        cmocka_unit_test(test_tiles_bound_their_samples),
        cmocka_unit_test(test_pixel_centred_planets_are_packed_as_their_grid),
        cmocka_unit_test(test_planets_are_read_on_demand),
        cmocka_unit_test(test_planets_in_memory_take_little_beside_their_samples),
        cmocka_unit_test(test_a_made_planet_has_no_seam),
        cmocka_unit_test(test_other_tables_and_versions_are_refused),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
