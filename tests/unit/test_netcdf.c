// Maps in NetCDF's classic format: turned so that they begin at 180 W and in the south, harmed ones refused,
// and the Earth of Debian's ferret-datasets the same as the one that scenes fly. SPDX-License-Identifier: MIT
#include "common/terrain/heightfield_netcdf.h"
#include "tests/test.h"

#include <string.h>

enum { COLUMNS = 8, ROWS = 5, MOST = 4096 };

struct bytes {
    unsigned char data[MOST];
    size_t size;
};

static void put_word(struct bytes *b, uint64_t word, int size)
{
    for (int k = size - 1; k >= 0; k--) b->data[b->size++] = (unsigned char)(word >> 8 * k);
}

static void put_name(struct bytes *b, const char *name)
{
    put_word(b, strlen(name), 4);
    for (size_t k = 0; k < (strlen(name) + 3) / 4 * 4; k++)
        b->data[b->size++] = k < strlen(name) ? (unsigned char)name[k] : 0;
}

static void put_double(struct bytes *b, double value)
{
    uint64_t word;
    memcpy(&word, &value, sizeof word);
    put_word(b, word, 8);
}

static void put_variable(struct bytes *b, const char *name, int first, int count, int type, int fill,
                         uint64_t begin)
{
    put_name(b, name);
    put_word(b, (uint64_t)count, 4);
    for (int k = 0; k < count; k++) put_word(b, (uint64_t)(first + k), 4);
    put_word(b, fill ? 12 : 0, 4), put_word(b, fill ? 1 : 0, 4);
    if (fill) {
        put_name(b, "_FillValue");
        put_word(b, 3, 4), put_word(b, 1, 4), put_word(b, (uint16_t)fill, 2), put_word(b, 0, 2);
    }
    put_word(b, (uint64_t)type, 4), put_word(b, 0, 4), put_word(b, begin, 4);
}

static int height_at(int column, int row) // from 0 E and the south pole
{
    return row == 3 && column == 6 ? -9999 : 100 * row - 37 * column;
}

// A planet whose rows go south, whose columns begin at 0 E.
static void build(struct bytes *b, bool voids)
{
    static const uint64_t BEGINS[3] = {512, 768, 1024};
    *b = (struct bytes){.size = 0};
    put_word(b, 0x43444601, 4), put_word(b, 0, 4);
    put_word(b, 10, 4), put_word(b, 2, 4);
    put_name(b, "lat"), put_word(b, ROWS, 4), put_name(b, "longitude"), put_word(b, COLUMNS, 4);
    put_word(b, 12, 4), put_word(b, 1, 4);
    put_name(b, "history"), put_word(b, 2, 4), put_name(b, "by hand");
    put_word(b, 11, 4), put_word(b, 3, 4);
    put_variable(b, "lat", 0, 1, 6, 0, BEGINS[0]);
    put_variable(b, "longitude", 1, 1, 6, 0, BEGINS[1]);
    put_variable(b, "relief", 0, 2, 3, voids ? -5000 : 0, BEGINS[2]);
    assert_true(b->size < BEGINS[0]);
    b->size = BEGINS[0];
    for (int j = 0; j < ROWS; j++) put_double(b, 90 - 45 * j);
    b->size = BEGINS[1];
    for (int i = 0; i < COLUMNS; i++) put_double(b, 45 * i);
    b->size = BEGINS[2];
    for (int j = 0; j < ROWS; j++)
        for (int i = 0; i < COLUMNS; i++)
            put_word(b, (uint16_t)(voids && i == 2 && j == 1 ? -5000 : height_at(i, ROWS - 1 - j)), 2);
}

static void a_planet_begins_in_the_south_west(void **state)
{
    (void)state;
    struct bytes b;
    for (int voids = 0; voids < 2; voids++) {
        struct heightfield field = {.name = "planet"};
        build(&b, voids);
        assert_true(heightfield_load_netcdf(&field, "planet.nc", b.data, b.size));
        assert_int_equal(field.width, COLUMNS);
        assert_int_equal(field.height, ROWS);
        assert_true(field.radius_m == HEIGHTFIELD_EARTH_RADIUS_M);
        for (int j = 0; j < ROWS; j++)
            for (int i = 0; i < COLUMNS; i++) {
                int from = (i + COLUMNS / 2) % COLUMNS; // 180 W is column 4 from 0 E
                int32_t q = field.samples[j * COLUMNS + i];
                // Where a fill value is given -9999 is a depth, else a void.
                bool void_here = voids ? from == 2 && j == ROWS - 2 : height_at(from, j) == -9999;
                assert_true((q == HEIGHTFIELD_VOID) == void_here);
                if (!void_here) assert_true(field.offset_m + field.quantum_m * q == height_at(from, j));
            }
        heightfield_finish(&field);
    }
}

static void harmed_files_are_refused(void **state)
{
    (void)state;
    struct bytes b;
    build(&b, true);
    size_t size = b.size;
    int refused = 0, flipped = test_size(2000, 200000);
    uint64_t seed = 5;
    freopen("/dev/null", "w", stderr); // a line each
    for (size_t cut = 0; cut < size; cut += cut < 512 ? 1 : 37) {
        struct heightfield field = {.name = "cut"};
        unsigned char *exact = malloc(cut + 1); // so that sanitizers see a byte too far
        memcpy(exact, b.data, cut);
        assert_false(heightfield_load_netcdf(&field, "cut.nc", exact, cut));
        heightfield_finish(&field);
        free(exact);
    }
    for (int k = 0; k < flipped; k++) {
        struct heightfield field = {.name = "flipped"};
        build(&b, true);
        for (int f = 0; f < 3; f++) b.data[test_random(&seed) % 512] = (unsigned char)test_random(&seed);
        refused += !heightfield_load_netcdf(&field, "flipped.nc", b.data, size);
        heightfield_finish(&field);
    }
    FIGURE("NetCDF: %d of %d headers with three bytes changed are refused, none does harm", refused, flipped);
    assert_true(refused > 0);
}

static void the_packaged_earth_is_the_one_that_scenes_fly(void **state)
{
    (void)state;
    static const char PACKAGED[] = "/usr/share/ferret-vis/data/etopo5.cdf";
    char path[1024];
    if (access(PACKAGED, R_OK) != 0) {
        printf("skipped: %s is not there (Debian's ferret-datasets; make data)\n", PACKAGED);
        return;
    }
    if (!test_data("earth_etopo5_4320x2161.png", path)) return;
    struct heightfield packaged, flown;
    assert_true(heightfield_load(&packaged, PACKAGED));
    assert_true(heightfield_load(&flown, path));
    assert_int_equal(packaged.width, flown.width);
    assert_int_equal(packaged.height, flown.height);
    size_t different = 0;
    for (int64_t k = 0; k < flown.width * flown.height; k++)
        different += packaged.offset_m + packaged.quantum_m * packaged.samples[k] !=
                     flown.offset_m + flown.quantum_m * flown.samples[k];
    FIGURE("ETOPO5 of ferret-datasets: %zu of %lld samples differ from the map that scenes fly", different,
           (long long)(flown.width * flown.height));
    assert_int_equal(different, 0);
    heightfield_finish(&packaged);
    heightfield_finish(&flown);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_planet_begins_in_the_south_west),
        cmocka_unit_test(the_packaged_earth_is_the_one_that_scenes_fly),
        cmocka_unit_test(harmed_files_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
