// A world too large for memory: the 1/64 of `make us-scale`, 27,000 x 11,700 samples made and packed within
// the default memory, and what is read back at seeded places is what was promised.  SPDX-License-Identifier:
// MIT
#include "tests/folder.h"

#include "common/terrain/relief/relief_file.h"
#include "common/terrain/relief/relief_pack.h"

#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>

static const struct relief_pack_options OPTIONS = {.layout = LAYOUT_WAVELET, .rms_m = 2};

static struct rusage pack_in_child(const char *path)
{
    struct rusage usage;
    int status = 1;
    pid_t child = fork();
    if (child == 0) {
        struct relief_source source;
        struct relief_header header;
        bool good = relief_source_open(&source, "bench/worlds/us64.json", 0, NULL) &&
                    relief_pack_source(&source, &OPTIONS, path, &header);
        _exit(!good);
    }
    assert_true(wait4(child, &status, 0, &usage) == child && WIFEXITED(status) && WEXITSTATUS(status) == 0);
    return usage;
}

static void test_a_world_packs_within_its_memory(void **state)
{
    (void)state;
    struct rusage usage = pack_in_child(in_folder("world.relief"));
    struct relief *relief = relief_open(in_folder("world.relief"));
    assert_non_null(relief);
    const struct relief_header *h = relief_header(relief);
    double samples = (double)h->size[0] * (double)h->size[1];
    double cpu_s = (double)usage.ru_utime.tv_sec + (double)usage.ru_utime.tv_usec * 1e-6 +
                   (double)usage.ru_stime.tv_sec + (double)usage.ru_stime.tv_usec * 1e-6;
    FIGURE("%.0f samples at rms %.4f m: %.4f bits a sample, side %.4f; %.1f s of CPU time, %.0f ns a sample, "
           "%.0f "
           "MiB at the peak",
           samples, h->rms_m, 8 * (double)relief_sample_bytes(relief) / samples,
           8 * (double)h->side_bytes / samples, cpu_s, cpu_s / samples * 1e9, (double)usage.ru_maxrss / 1024);
    assert_true(usage.ru_maxrss <= 512 << 10); // KiB
    assert_true(h->rms_m >= 0.98 * OPTIONS.rms_m && h->rms_m <= 1.001 * OPTIONS.rms_m);
    assert_true(8 * (double)h->side_bytes / samples <= 0.03);
    relief_close(relief);
}

// No sample is further off than the header says, and none lies beyond its tile's extrema.
static void test_places_of_it_are_as_promised(void **state)
{
    (void)state;
    enum { SIDE = 128 };
    static int32_t got[SIDE * SIDE], made[SIDE * SIDE];
    struct relief_source source;
    struct relief *relief = relief_open(in_folder("world.relief"));
    assert_non_null(relief);
    assert_true(relief_source_open(&source, "bench/worlds/us64.json", 0, NULL));
    const struct grid *grid = relief_grid(relief);
    uint64_t seed = 9;
    double squares = 0, most = 0;
    int places = test_size(150, 3000);
    for (int i = 0; i < places; i++) {
        int64_t x0 = (int64_t)(test_random(&seed) % (uint64_t)(source.size[0] - SIDE));
        int64_t y0 = (int64_t)(test_random(&seed) % (uint64_t)(source.size[1] - SIDE));
        struct patch patch = {{x0, y0, x0 + SIDE, y0 + SIDE}, made};
        assert_true(source.window(&source, &patch));
        assert_true(relief_window(relief, 0, x0, y0, SIDE, SIDE, got));
        for (int k = 0; k < SIDE * SIDE; k++) {
            double off = fabs((double)(got[k] - made[k])) * source.quantum_m;
            int64_t tile =
                (y0 + k / SIDE) / LAYOUT_SAMPLES * grid->tiles[0][0] + (x0 + k % SIDE) / LAYOUT_SAMPLES;
            int32_t low, high;
            relief_bounds(relief, grid->first_tile[0] + tile, &low, &high);
            assert_true(got[k] >= low && got[k] <= high);
            squares += off * off;
            most = fmax(most, off);
        }
    }
    double rms_m = sqrt(squares / (places * (double)(SIDE * SIDE)));
    FIGURE("%d places: rms %.3f m, max %.2f m; the header says %.3f and %.2f", places, rms_m, most,
           relief_header(relief)->rms_m, relief_header(relief)->max_m);
    assert_true(most <= relief_header(relief)->max_m * (1 + 1e-12));
    relief_source_finish(&source);
    relief_close(relief);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_world_packs_within_its_memory),
        cmocka_unit_test(test_places_of_it_are_as_promised),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
