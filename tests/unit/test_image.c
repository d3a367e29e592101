// PNG files: round trips, whole or absent, one line when they cannot be read or written.
// SPDX-License-Identifier: MIT
#include "tests/folder.h"

#include "common/image.h"

#include <dirent.h>
#include <png.h>
#include <string.h>
#include <sys/stat.h>

static int files(void)
{
    int count = 0;
    DIR *directory = opendir(folder);
    for (struct dirent *entry; (entry = readdir(directory));) count += entry->d_name[0] != '.';
    closedir(directory);
    return count;
}

static void grey16_round_trips(void **state)
{
    (void)state;
    static const int SIZES[][2] = {{1, 1}, {1, 17}, {17, 1}, {675, 18}, {256, 256}};
    uint64_t random = 1;
    for (size_t s = 0; s < sizeof SIZES / sizeof *SIZES; s++) {
        int width = SIZES[s][0], height = SIZES[s][1], read_width, read_height;
        uint16_t *samples = malloc((size_t)(width * height) * sizeof *samples), *back;
        for (int i = 0; i < width * height; i++) samples[i] = (uint16_t)test_random(&random);
        assert_true(image_write_grey16(in_folder("grey.png"), width, height, samples));
        assert_true(image_read_grey16(in_folder("grey.png"), NULL, 0, &read_width, &read_height, &back));
        assert_true(read_width == width && read_height == height);
        assert_memory_equal(samples, back, (size_t)(width * height) * sizeof *samples);
        free(back);
        FILE *file = fopen(in_folder("grey.png"), "rb"); // and from memory
        static unsigned char data[1 << 18];
        size_t size = fread(data, 1, sizeof data, file);
        fclose(file);
        assert_true(image_read_grey16("memory", data, size, &read_width, &read_height, &back));
        assert_memory_equal(samples, back, (size_t)(width * height) * sizeof *samples);
        free(back);
        assert_false(image_read_grey16("memory", data, size - 1, &read_width, &read_height, &back));
        assert_false(image_read_grey16("memory", data, 3, &read_width, &read_height, &back));
        free(samples);
    }
    assert_int_equal(files(), 1); // no temporary file stays behind
}

static void pictures_stand_upright(void **state)
{
    (void)state;
    for (int channels = 3; channels <= 4; channels++) {
        uint8_t pixels[3 * 2 * 4];
        for (int i = 0; i < 3 * 2 * channels; i++) pixels[i] = (uint8_t)(i * 7 + 1);
        assert_true(image_write_png(in_folder("colour.png"), 3, 2, channels, pixels));
        png_image image = {.version = PNG_IMAGE_VERSION};
        assert_true(png_image_begin_read_from_file(&image, in_folder("colour.png")));
        assert_true(image.width == 3 && image.height == 2);
        assert_int_equal(image.format, channels == 3 ? PNG_FORMAT_RGB : PNG_FORMAT_RGBA);
        uint8_t back[3 * 2 * 4];
        assert_true(png_image_finish_read(&image, NULL, back, 0, NULL));
        size_t row = (size_t)(3 * channels); // the file's first row is the top one, which was given last
        assert_memory_equal(back, pixels + row, row);
        assert_memory_equal(back + row, pixels, row);
    }
}

static void failures_leave_nothing(void **state)
{
    (void)state;
    int before = files(), width, height;
    uint16_t sample = 1, *back;
    uint8_t pixel[3] = {0};
    assert_false(image_write_grey16(in_folder("nowhere/x.png"), 1, 1, &sample));
    assert_false(image_write_png(in_folder("nowhere/x.png"), 1, 1, 3, pixel));
    assert_false(image_write_png(in_folder("none.png"), 0, 1, 3, pixel));
    assert_int_equal(mkdir(in_folder("folder.png"), 0700), 0);
    assert_false(image_write_grey16(in_folder("folder.png"), 1, 1, &sample)); // a folder of that name
    assert_int_equal(files(), before + 1);
    assert_false(image_read_grey16(in_folder("missing.png"), NULL, 0, &width, &height, &back));
    assert_false(image_read_grey16(in_folder("folder.png"), NULL, 0, &width, &height, &back));
}

static void any_picture_is_read_as_rgba(void **state)
{
    (void)state;
    enum { W = 13, H = 7 };
    uint64_t random = 4;
    uint8_t pixels[W * H * 4], *back;
    uint16_t grey[W * H];
    int width, height;
    for (int i = 0; i < W * H * 4; i++) pixels[i] = (uint8_t)test_random(&random);
    for (int channels = 3; channels <= 4; channels++) {
        assert_true(image_write_png(in_folder("any.png"), W, H, channels, pixels));
        assert_true(image_read_rgba8(in_folder("any.png"), &width, &height, &back));
        assert_true(width == W && height == H);
        for (int i = 0; i < W * H; i++) { // written from the bottom row, read from the top one
            const uint8_t *written = pixels + ((H - 1 - i / W) * W + i % W) * channels;
            assert_memory_equal(back + 4 * i, written, 3);
            assert_int_equal(back[4 * i + 3], channels == 4 ? written[3] : 255);
        }
        free(back);
    }
    for (int i = 0; i < W * H; i++) grey[i] = (uint16_t)test_random(&random);
    assert_true(image_write_grey16(in_folder("any.png"), W, H, grey));
    assert_true(image_read_rgba8(in_folder("any.png"), &width, &height, &back));
    for (int i = 0; i < W * H; i++) {
        assert_true(fabs(back[4 * i] - grey[i] / 257.0) <= 0.5 + 1e-6);
        assert_true(back[4 * i] == back[4 * i + 1] && back[4 * i] == back[4 * i + 2] &&
                    back[4 * i + 3] == 255);
    }
    free(back);
    assert_int_equal(truncate(in_folder("any.png"), 60), 0);
    assert_false(image_read_rgba8(in_folder("any.png"), &width, &height, &back));
    assert_int_equal(unlink(in_folder("any.png")), 0);
    assert_false(image_read_rgba8(in_folder("any.png"), &width, &height, &back));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(grey16_round_trips),
        cmocka_unit_test(any_picture_is_read_as_rgba),
        cmocka_unit_test(pictures_stand_upright),
        cmocka_unit_test(failures_leave_nothing),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
