// Files that were spoilt in every way a seeded generator thinks of, their checksums set right: read or
// refused in one line, never a crash, a hang or a read beyond their bytes (under sanitizers: `make check`).
// The same function runs under libFuzzer in `make soak`, which starts from what RELIEF_CORPUS=FOLDER makes
// this program write. SPDX-License-Identifier: MIT
#define _GNU_SOURCE // memfd_create
#include "tests/folder.h"
#include "tests/fuzz/fuzz_relief.h"

#include "common/terrain/relief/relief_file.h"
#include "common/terrain/relief/relief_pack.h"

#include <string.h>
#include <sys/mman.h>
#include <time.h>

struct seed_file {
    uint8_t *data;
    size_t size, sections; // where base, index and side begin
};

static const struct {
    enum layout layout;
    int width, height;
    double error_m, radius_m;
} SEEDS[] = {{LAYOUT_WAVELET, 41, 70, 4, 0}, {LAYOUT_BOUNDED, 70, 41, 2, 0},
             {LAYOUT_BOUNDED, 33, 18, 0, 0}, {LAYOUT_WAVELET, 5, 7, 1, 0},
             {LAYOUT_PYRAMID, 37, 21, 2, 0}, {LAYOUT_MARS, 41, 30, 0, 0},
             {LAYOUT_RAW, 19, 11, 0, 0},     {LAYOUT_PYRAMID, 384, 65, 90, 1e6},
             {LAYOUT_RAW, 32, 9, 0, 1e6},    {LAYOUT_WAVELET, 10, 9, 30, 1e6}};
enum { SEED_COUNT = sizeof SEEDS / sizeof *SEEDS };

static struct seed_file make_seed(int n)
{
    struct relief_pack_options options = {
        .layout = SEEDS[n].layout, .rms_m = SEEDS[n].error_m, .max_m = SEEDS[n].error_m};
    struct relief_header header;
    uint64_t dice = (uint64_t)n;
    int width = SEEDS[n].width, height = SEEDS[n].height;
    struct heightfield field = {.name = "seed",
                                .width = width,
                                .height = height,
                                .spacing_m = {30, 30},
                                .quantum_m = 0.1,
                                .radius_m = SEEDS[n].radius_m,
                                .samples = malloc((size_t)(width * height) * sizeof(int32_t))};
    for (int i = 0; i < width * height; i++)
        field.samples[i] = (int32_t)(900 * sin(i % width * 0.11) * cos(i / width * 0.07)) +
                           (int32_t)(test_random(&dice) % 60);
    assert_true(relief_pack(&field, &options, in_folder("seed.relief"), &header));
    heightfield_finish(&field);
    struct seed_file seed;
    FILE *file = fopen(in_folder("seed.relief"), "rb");
    assert_non_null(file);
    fseek(file, 0, SEEK_END);
    seed.size = (size_t)ftell(file);
    rewind(file);
    seed.data = malloc(seed.size);
    assert_int_equal(fread(seed.data, 1, seed.size, file), seed.size);
    fclose(file);
    seed.sections = RELIEF_HEADER + (size_t)header.payload_bytes;
    return seed;
}

static void write_corpus(const char *corpus, const struct seed_file *seeds)
{
    for (int n = 0; n < SEED_COUNT; n++) {
        char path[1200];
        snprintf(path, sizeof path, "%s/%d.relief", corpus, n);
        FILE *file = fopen(path, "wb");
        assert_non_null(file);
        assert_int_equal(fwrite(seeds[n].data, 1, seeds[n].size, file), seeds[n].size);
        assert_int_equal(fclose(file), 0);
    }
}

static size_t spoil(const struct seed_file *seed, uint8_t *data, uint64_t *dice)
{
    size_t size = seed->size;
    memcpy(data, seed->data, size);
    for (int times = 1 + (int)(test_random(dice) % 4); times > 0; times--) {
        size_t place = test_random(dice) % 3, from = place == 1 ? seed->sections : 0;
        size_t at = from + test_random(dice) % (place == 0 ? RELIEF_HEADER : size - from);
        switch (test_random(dice) % 4) {
        case 0:
            data[at] ^= (uint8_t)(1 << test_random(dice) % 8);
            break;
        case 1:
            data[at] = (uint8_t)(0u - (test_random(dice) & 1)); // 0 or 255
            break;
        default:
            data[at] = (uint8_t)test_random(dice);
        }
    }
    if (test_random(dice) % 16 == 0) size = test_random(dice) % size;
    return size;
}

static double seconds_now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
}

// Lines in a file that stderr is led to, which is emptied for what comes next.
static int lines_told(int file)
{
    char told[4096];
    fflush(stderr);
    ssize_t size = pread(file, told, sizeof told, 0);
    int lines = 0;
    for (ssize_t i = 0; i < size; i++) lines += told[i] == '\n';
    bool good = lseek(file, 0, SEEK_SET) == 0 && ftruncate(file, 0) == 0 && size < (ssize_t)sizeof told;
    return good ? lines : -1;
}

static void test_spoilt_files_do_no_harm(void **state)
{
    (void)state;
    struct seed_file seeds[SEED_COUNT];
    for (int n = 0; n < SEED_COUNT; n++) seeds[n] = make_seed(n);
    if (getenv("RELIEF_CORPUS")) write_corpus(getenv("RELIEF_CORPUS"), seeds);
    uint8_t *data = malloc(1 << 20);
    uint64_t dice = 1;
    int opened = 0, harmed = 0, wrong = 0, count = test_size(20000, 1000000);
    double worst_s = 0;
    fflush(stderr);
    int kept = dup(2), file = memfd_create("stderr", MFD_CLOEXEC);
    dup2(file, 2);
    for (int n = 0; n < SEED_COUNT; n++) // the seeds themselves are whole
        assert_int_equal(fuzz_relief(seeds[n].data, seeds[n].size), 1);
    for (int i = 0; i < count; i++) {
        size_t size = spoil(&seeds[test_random(&dice) % SEED_COUNT], data, &dice);
        double start = seconds_now();
        int good = fuzz_relief(data, size), lines = lines_told(file);
        worst_s = fmax(worst_s, seconds_now() - start);
        opened += good;
        harmed += good && lines == 1; // a tile was, which is told once
        wrong += good ? lines != 0 && lines != 1 : lines != 1;
    }
    dup2(kept, 2);
    close(kept);
    close(file);
    FIGURE("%d spoilt files: %d were opened, %d of them with a harmed tile, the slowest took %.1f ms", count,
           opened, harmed, worst_s * 1e3);
    assert_int_equal(wrong, 0);                         // a refusal is one line
    assert_true(opened > count / 20 && opened < count); // it gets behind the header, and there is harm
    assert_true(worst_s < 5);                           // a hang
    for (int n = 0; n < SEED_COUNT; n++) free(seeds[n].data);
    free(data);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_spoilt_files_do_no_harm)};
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
