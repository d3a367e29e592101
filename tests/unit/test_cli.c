// Command lines: what is taken, and that what is not costs one line that names the option and what is
// accepted.
// SPDX-License-Identifier: MIT
#include "common/cli.h"

#include "tests/test.h"

#include <string.h>

static struct {
    bool help;
    const char *backend, *out;
    int frames, size[2];
    double tau;
} given;

static const struct cli_option options[] = {
    {"help", NULL, "this list", CLI_FLAG, &given.help, 0, 0, NULL},
    {"backend", "NAME", "which context", CLI_TEXT, &given.backend, 0, 0, "auto|glfw|egl|osmesa"},
    {"out", "DIR", "where results go", CLI_TEXT, &given.out, 0, 0, NULL},
    {"frames", "N", "frames to fly", CLI_INT, &given.frames, 1, 100000, NULL},
    {"size", "WxH", "window", CLI_SIZE, given.size, 1, 16384, NULL},
    {"tau", "PX", "tolerance", CLI_NUMBER, &given.tau, 0, 64, NULL},
    {NULL, NULL, NULL, CLI_FLAG, NULL, 0, 0, NULL},
};

// Parses a line of words, split at blanks; what it says on stderr lands in said[].
static bool parse(const char *line, const char **words, int *count, char said[1024])
{
    static char copy[512];
    char *argv[32] = {"program"};
    int argc = 1;
    snprintf(copy, sizeof copy, "%s", line);
    for (char *word = strtok(copy, " "); word; word = strtok(NULL, " ")) argv[argc++] = word;
    memset(&given, 0, sizeof given);
    fflush(stderr);
    int saved = dup(2);
    FILE *file = tmpfile();
    dup2(fileno(file), 2);
    bool good = cli_parse(argc, argv, options, words, count);
    fflush(stderr);
    dup2(saved, 2);
    close(saved);
    rewind(file);
    size_t got = fread(said, 1, 1023, file);
    said[got] = '\0';
    fclose(file);
    return good;
}

static void takes_both_forms(void **state)
{
    (void)state;
    const char *words[4];
    char said[1024];
    int count = 4;
    assert_true(
        parse("run --frames 12 --size=320x200 --backend egl a --tau=-0 --help b", words, &count, said));
    assert_string_equal(said, "");
    assert_int_equal(count, 3);
    assert_string_equal(words[0], "run");
    assert_string_equal(words[2], "b");
    assert_true(given.help && given.frames == 12 && given.size[0] == 320 && given.size[1] == 200);
    assert_string_equal(given.backend, "egl");
    count = 4;
    assert_true(parse("--out=a=b --tau 1e-3 -- --frames -", words, &count, said));
    assert_string_equal(given.out, "a=b");
    assert_true(given.tau == 1e-3);
    assert_int_equal(count, 2);
    assert_string_equal(words[0], "--frames");
    count = 0;
    assert_true(parse("--frames 1 --frames 2", words, &count, said));
    assert_int_equal(given.frames, 2);
}

static void refuses_in_one_line(void **state)
{
    (void)state;
    const struct {
        const char *line, *names, *accepted;
    } cases[] = {
        {"--size 0x0", "--size: 0x0 is not a size", "accepted is WIDTHxHEIGHT, each 1..16384"},
        {"--size 640", "--size: 640", "WIDTHxHEIGHT"},
        {"--size 640x480x2", "--size", "WIDTHxHEIGHT"},
        {"--size 640x-480", "--size", "WIDTHxHEIGHT"},
        {"--size 640x16385", "--size", "1..16384"},
        {"--size x", "--size", "WIDTHxHEIGHT"},
        {"--size 99999999999999999999x1", "--size", "WIDTHxHEIGHT"},
        {"--size=", "--size", "WIDTHxHEIGHT"},
        {"--size", "--size", "WIDTHxHEIGHT"},
        {"--frames 0", "--frames: 0", "1..100000"},
        {"--frames 1.5", "--frames: 1.5", "whole number"},
        {"--frames 12abc", "--frames: 12abc", "whole number"},
        {"--frames 99999999999999999999", "--frames", "1..100000"},
        {"--frames --tau 1", "--frames", "its value is missing"},
        {"--tau nan", "--tau: nan", "a number 0..64"},
        {"--tau inf", "--tau: inf", "a number 0..64"},
        {"--tau 65", "--tau: 65", "0..64"},
        {"--backend vulkan", "--backend: vulkan", "auto|glfw|egl|osmesa"},
        {"--backend auto|glfw", "--backend", "auto|glfw|egl|osmesa"},
        {"--backend=", "--backend", "auto|glfw|egl|osmesa"},
        {"--help=yes", "--help", "no value"},
        {"--frame 3", "--frame: no such option", "--help"},
        {"--frames2=3", "--frames2: no such option", "--help"},
        {"-x", "-x: no such option", "--help"},
        {"a b c", "c", "--help"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const char *words[2];
        char said[1024];
        int count = 2;
        assert_false(parse(cases[i].line, words, &count, said));
        if (!strstr(said, cases[i].names) || !strstr(said, cases[i].accepted))
            fail_msg("%s: %s", cases[i].line, said);
        assert_true(strchr(said, '\n') == said + strlen(said) - 1);
    }
    FIGURE("command lines: %zu bad ones, one line each", sizeof cases / sizeof cases[0]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(takes_both_forms),
        cmocka_unit_test(refuses_in_one_line),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
