// Terrain beside the coders of others, at equal error, in one run.  SPDX-License-Identifier: MIT
#include "tests/folder.h"

#include "common/terrain/relief/peer_coders.h"
#include "common/terrain/relief/relief_file.h"
#include "common/terrain/relief/relief_pack.h"

#include <string.h>

static double relief_bytes_of(struct heightfield *field, const struct coder_aim *aim)
{
    struct relief_pack_options options = {
        .layout = aim->rms_m > 0 ? LAYOUT_WAVELET : LAYOUT_BOUNDED, .rms_m = aim->rms_m, .max_m = aim->max_m};
    struct relief_header h;
    assert_true(relief_pack(field, &options, NULL, &h));
    return (double)(RELIEF_HEADER + h.payload_bytes + h.base_bytes + h.index_bytes);
}

// Relief's bytes over those of the coder whose name begins with `peer`, at one aim; 0 when it is not there.
// The other coders are run at the full size alone.
static double ratio_to(const char *peer, const char *map, double rms_m, double max_m)
{
    char path[1024];
    struct heightfield field;
    double ratio = 0;
    if (!test_data(map, path)) return 0;
    assert_true(heightfield_load(&field, path));
    field.radius_m = 0; // the raster, as other coders see it
    const struct coder_aim aim = {rms_m, max_m};
    double own = relief_bytes_of(&field, &aim), samples = (double)(field.width * field.height);
    printf("figure: %s, %s %g m, bits a sample: relief %.4f", map, rms_m > 0 ? "rms" : "max",
           fmax(rms_m, max_m), 8 * own / samples);
    for (int i = 0; i < peer_coder_count(); i++) {
        bool asked = strncmp(peer_coder_name(i), peer, strlen(peer)) == 0;
        if (!asked && !test_size(0, 1)) continue;
        struct coder_run run = peer_coder_run(i, &field, &aim);
        if (run.reason) {
            printf("\nskipped: %s: %s", run.coder, run.reason);
            continue;
        }
        assert_true(rms_m > 0 ? run.rms_m <= rms_m * (1 + 1e-9) : run.max_m <= max_m * (1 + 1e-9));
        printf("; %s %.4f", run.coder, 8 * run.bytes / samples);
        if (asked) ratio = own / run.bytes;
    }
    printf("\n");
    heightfield_finish(&field);
    return ratio;
}

static void test_no_more_than_jpeg_2000_at_equal_rms(void **state)
{
    (void)state;
    static const struct {
        const char *map;
        double rms_m;
    } CASES[] = {{"mars_mola_4ppd_1440x720.png", 16},    {"puget_srtm3_strip_3601x1201.png", 2},
                 {"puget_srtm3_strip_3601x1201.png", 1}, {"puget_srtm3_strip_3601x1201.png", 8},
                 {"mars_mola_4ppd_1440x720.png", 8},     {"mars_mola_4ppd_1440x720.png", 64}};
    for (int i = 0; i < test_size(2, 6); i++)
        assert_true(ratio_to("OpenJPEG", CASES[i].map, CASES[i].rms_m, 0) <= 1);
}

static void test_lossless_within_5_percent_of_jpeg_ls(void **state)
{
    (void)state;
    assert_true(ratio_to("CharLS", "puget_1k_160m.png", 0, 0) <= 1.05);
    if (test_size(0, 1)) {
        assert_true(ratio_to("CharLS", "puget_srtm3_strip_3601x1201.png", 0, 0) <= 1.05);
        assert_true(ratio_to("CharLS", "puget_cascades_72m_2049x2817.png", 0, 0) <= 1.05);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_no_more_than_jpeg_2000_at_equal_rms),
        cmocka_unit_test(test_lossless_within_5_percent_of_jpeg_ls),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
