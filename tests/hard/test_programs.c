// The programs as a user meets them: what bad input says, that runs repeat, that the measures hold on whole
// flights. Needs the programs in $RELIEF_BUILD (tests/run sets it) and a GL that works without a display.
// SPDX-License-Identifier: MIT
#define _GNU_SOURCE
#include "common/image.h"
#include "common/report.h"
#include "tests/folder.h"

#include <cjson/cJSON.h>
#include <signal.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

// ---- running a program -----------------------------------------------------

static char error_text[8192]; // what the last program wrote to stderr

static char *read_file(const char *path)
{
    FILE *file = fopen(path, "rb");
    if (!file) return NULL;
    size_t size = 0, got;
    char *text = NULL;
    do {
        text = realloc(text, size + 65537);
        got = fread(text + size, 1, 65536, file);
        size += got;
    } while (got > 0);
    text[size] = 0;
    fclose(file);
    return text;
}

// Runs `$RELIEF_BUILD/<command>` in the test's folder; %s in the command stands for that folder.
static int run(const char *format, ...)
{
    char arguments[2048], command[4096], path[512];
    const char *build = getenv("RELIEF_BUILD");
    va_list list;
    va_start(list, format);
    vsnprintf(arguments, sizeof arguments, format, list);
    va_end(list);
    snprintf(command, sizeof command, "env -u DISPLAY -u WAYLAND_DISPLAY %s/%s >%s/out.txt 2>%s/err.txt",
             build ? build : "build", arguments, folder, folder);
    int status = system(command);
    snprintf(path, sizeof path, "%s/err.txt", folder);
    char *text = read_file(path);
    snprintf(error_text, sizeof error_text, "%s", text ? text : "");
    free(text);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

static cJSON *read_results(const char *name)
{
    char path[512];
    snprintf(path, sizeof path, "%s/%s/results.json", folder, name);
    char *text = read_file(path);
    assert_non_null(text);
    assert_null(strstr(text, "nan"));
    assert_null(strstr(text, "inf"));
    cJSON *root = cJSON_ParseWithOpts(text, NULL, true);
    free(text);
    assert_non_null(root);
    return root;
}

static double number(const cJSON *object, const char *key, const char *inner)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, key);
    if (inner) item = cJSON_GetObjectItemCaseSensitive(item, inner);
    return cJSON_IsNumber(item) ? item->valuedouble : (double)NAN;
}

// ---- fixtures --------------------------------------------------------------

enum { SIDE = 129 };

static void write_terrain(const char *name, double (*height)(int i, int j), double scale, double offset)
{
    static uint16_t samples[SIDE * SIDE];
    char path[512], sidecar[512];
    for (int j = 0; j < SIDE; j++)
        for (int i = 0; i < SIDE; i++)
            samples[j * SIDE + i] = (uint16_t)lround((height(i, j) - offset) / scale);
    snprintf(path, sizeof path, "%s/%s.png", folder, name);
    assert_true(image_write_grey16(path, SIDE, SIDE, samples));
    snprintf(path, sizeof path, "%s.json", name);
    snprintf(sidecar, sizeof sidecar,
             "{\"file\": \"%s.png\", \"width\": %d, \"height\": %d, \"height_scale\": %.17g, "
             "\"height_offset\": %.17g, "
             "\"nodata\": null, \"spacing_m\": [20, 25]}",
             name, SIDE, SIDE, scale, offset);
    write_text(path, sidecar);
}

static double flat_0(int i, int j)
{
    (void)i, (void)j;
    return 0;
}

static double flat_1000(int i, int j)
{
    (void)i, (void)j;
    return 1000;
}

static double flat_8848(int i, int j)
{
    (void)i, (void)j;
    return 8848.86;
}

static double hills(int i, int j)
{
    return 300 + 180 * sin(i * 0.11) * cos(j * 0.07) + 40 * sin(i * 0.41 + j * 0.3) +
           9 * sin(i * 1.7) * sin(j * 1.3);
}

static int set_up(void **state)
{
    if (folder_create(state) != 0) return -1;
    write_terrain("flat0", flat_0, 0.1, 0);
    write_terrain("flat1000", flat_1000, 0.1, 0);
    write_terrain("flat8848", flat_8848, 0.01, 8500);
    write_terrain("hills", hills, 0.1, 0);
    return 0;
}

// ---- bad input -------------------------------------------------------------

static void assert_one_line(int code, int expected_code, const char *expected_text)
{
    size_t lines = 0;
    for (const char *c = error_text; *c; c++) lines += *c == '\n';
    if (code != expected_code || lines != 1 || !strstr(error_text, expected_text))
        print_error("exit %d (expected %d), %zu lines: %s", code, expected_code, lines, error_text);
    assert_int_equal(code, expected_code);
    assert_int_equal(lines, 1);
    assert_non_null(strstr(error_text, expected_text));
    char path[512];
    snprintf(path, sizeof path, "%s/bad/results.json", folder);
    assert_int_equal(access(path, F_OK), -1);
}

static void test_bad_input_is_one_line(void **state)
{
    (void)state;
    char path[512];
    const char *f = folder;
    write_text("short.png", "\x89PNG\r\n\x1a\n");
    write_text("short.json",
               "{\"width\": 4, \"height\": 4, \"height_scale\": 1, \"height_offset\": 0, \"spacing_m\": 1}");
    snprintf(path, sizeof path, "cp %s/hills.png %s/wrong.png", f, f);
    assert_int_equal(system(path), 0);
    write_text(
        "wrong.json",
        "{\"width\": 128, \"height\": 129, \"height_scale\": 0.1, \"height_offset\": 0, \"spacing_m\": 20}");
    write_text("unknown.json", "{\"name\": \"x\", \"terrain\": \"hills.png\", \"fog\": true}");
    write_text("nokeys.json", "{\"name\": \"x\", \"terrain\": \"hills.png\", \"path\": {\"keys\": []}}");
    write_text("broken.json", "{\"name\": ");
    write_text("noterrain.json", "{\"name\": \"x\", \"terrain\": \"nowhere.png\"}");
    write_text("afile", "");
    assert_one_line(run("bench run --terrain %s/missing.png --out %s/bad", f, f), EXIT_WORLD, "missing.png");
    assert_one_line(run("bench run --terrain %s/short.png --out %s/bad", f, f), EXIT_WORLD, "short.png");
    assert_one_line(run("bench run --terrain %s/wrong.png --out %s/bad", f, f), EXIT_WORLD, "wrong.");
    assert_one_line(run("bench run --scene %s/unknown.json --out %s/bad", f, f), EXIT_WORLD, "fog");
    assert_one_line(run("bench run --scene %s/nokeys.json --out %s/bad", f, f), EXIT_WORLD, "nokeys.json");
    assert_one_line(run("bench run --scene %s/broken.json --out %s/bad", f, f), EXIT_WORLD, "broken.json");
    assert_one_line(run("bench run --scene %s/noterrain.json --out %s/bad", f, f), EXIT_WORLD, "nowhere.png");
    assert_one_line(run("bench run --scene %s/absent.json --out %s/bad", f, f), EXIT_WORLD, "absent.json");
    assert_one_line(run("bench run --terrain %s/hills.png --size 0x0 --out %s/bad", f, f), EXIT_COMMAND_LINE,
                    "--size");
    assert_one_line(run("bench run --terrain %s/hills.png --out %s/afile/x", f, f), EXIT_WORLD, "afile");
    assert_one_line(run("bench run --terrain %s/hills.png --out /proc/relief", f), EXIT_WORLD,
                    "/proc/relief");
    assert_one_line(run("bench run --renderers roam --out %s/bad", f), EXIT_COMMAND_LINE, "roam");
    assert_one_line(run("bench run --renderers clipmap:n=few --out %s/bad", f), EXIT_COMMAND_LINE, "few");
    assert_one_line(run("bench papers --only clipmap-1,clipmap-9"), EXIT_COMMAND_LINE, "clipmap-9");
    assert_one_line(run("bench papers --repeats 0"), EXIT_COMMAND_LINE, "--repeats");
    assert_one_line(run("bench papers --out /proc/relief"), EXIT_WORLD, "/proc/relief");
    assert_one_line(run("bench run --sweep slow --out %s/bad", f), EXIT_COMMAND_LINE, "--sweep");
    assert_one_line(run("bench run --frames 0 --out %s/bad", f), EXIT_COMMAND_LINE, "--frames");
    static const char *const pack[][2] = {{"", "--rms"},
                                          {"--rms 1 --lossless", "--lossless"},
                                          {"--rms 0", "--rms 0"},
                                          {"--rms 1 --codec bounded", "bounded"},
                                          {"--codec raw --max 1", "raw"},
                                          {"--max 1 --scaled", "--scaled"}};
    for (size_t i = 0; i < sizeof pack / sizeof *pack; i++)
        assert_one_line(run("terrain pack %s/hills.png %s/bad.relief %s", f, f, pack[i][0]),
                        EXIT_COMMAND_LINE, pack[i][1]);
    assert_one_line(run("bench soar"), EXIT_COMMAND_LINE, "soar");
    assert_one_line(run("bench fly --frames 0"), EXIT_COMMAND_LINE, "--frames");
    assert_one_line(run("bench fly --renderers roam"), EXIT_COMMAND_LINE, "roam");
    assert_one_line(run("bench fly --terrain %s/missing.png", f), EXIT_WORLD, "missing.png");
    assert_one_line(run("bench run --terrain %s/hills.png --backend glfw --out %s/bad", f, f), EXIT_WORLD,
                    "glfw");
    assert_one_line(run("clipmap --headless --terrain %s/missing.png", f), EXIT_WORLD, "missing.png");
    assert_one_line(run("pgm --rows many"), EXIT_COMMAND_LINE, "many");
    assert_one_line(run("terrain info %s/short.png", f), EXIT_WORLD, "short.png");
    assert_one_line(run("bench report %s/nothing", f), EXIT_WORLD, "nothing");
}

// ---- whole runs ------------------------------------------------------------

static const cJSON *find_run(const cJSON *results, const char *id)
{
    const cJSON *r;
    cJSON_ArrayForEach(r, cJSON_GetObjectItemCaseSensitive(results, "runs"))
    {
        if (strcmp(cJSON_GetObjectItemCaseSensitive(r, "id")->valuestring, id) == 0) return r;
    }
    return NULL;
}

static void assert_same(const cJSON *a, const cJSON *b, const char *key)
{
    const cJSON *x = cJSON_GetObjectItemCaseSensitive(a, key), *y = cJSON_GetObjectItemCaseSensitive(b, key);
    if (!cJSON_Compare(x, y, true)) print_error("%s differs\n", key);
    assert_true(cJSON_Compare(x, y, true));
}

// Two runs of the same command: the same errors, triangles and pictures, whatever the number of threads.
static void test_runs_repeat_bit_for_bit(void **state)
{
    (void)state;
    static const char *const same[] = {"error_px",     "plane_px",        "triangles", "visible_triangles",
                                       "draw_calls",   "holes",           "misses",    "spills",
                                       "upload_bytes", "pictures_sha256", "counters",  "temporal_px",
                                       "claimed_px",   "resident_bytes"};
    const char *f = folder, *command =
                                "bench run --terrain %s/hills.png --frames 6 --repeats 1 --size 320x240 "
                                "--threads %d --out %s/%s";
    assert_int_equal(run(command, f, 1, f, "one"), EXIT_GOOD);
    assert_int_equal(run(command, f, 3, f, "two"), EXIT_GOOD);
    cJSON *one = read_results("one"), *two = read_results("two");
    const cJSON *a;
    int count = 0;
    cJSON_ArrayForEach(a, cJSON_GetObjectItemCaseSensitive(one, "runs"))
    {
        const cJSON *b = find_run(two, cJSON_GetObjectItemCaseSensitive(a, "id")->valuestring);
        assert_non_null(b);
        for (size_t k = 0; k < sizeof same / sizeof *same; k++) assert_same(a, b, same[k]);
        count++;
    }
    assert_true(count >= 15);
    FIGURE("repeat: %d runs with 1 and 3 threads gave the same numbers and pictures", count);
    cJSON_Delete(one);
    cJSON_Delete(two);
}

static double brute_error(const char *name, const char *key)
{
    cJSON *results = read_results(name);
    double error =
        number(cJSON_GetArrayItem(cJSON_GetObjectItemCaseSensitive(results, "runs"), 0), "error_px", key);
    cJSON_Delete(results);
    return error;
}

static bool page_says(const char *name, const char *words)
{
    char command[1400];
    snprintf(command, sizeof command, "grep -q '%s' %s/%s/index.html", words, folder, name);
    return system(command) == 0;
}

// Every sample of a packed terrain drawn: no error against itself; against its source, what the coder did.
// What a map of 2 m rms error does to a picture is not 0, and the source itself against the source is.
static void test_errors_against_the_source(void **state)
{
    (void)state;
    const char *f = folder, *command = "bench run --terrain %s/%s --renderers brute --frames 2 --repeats 1 "
                                       "--size 160x120 --out %s/%s %s%s%s";
    assert_int_equal(run("terrain pack %s/hills.png %s/hills.relief --rms 2", f, f), EXIT_GOOD);
    assert_int_equal(run(command, f, "hills.relief", f, "itself", "", "", ""), EXIT_GOOD);
    assert_int_equal(run(command, f, "hills.relief", f, "source", "--truth ", f, "/hills.png"), EXIT_GOOD);
    assert_int_equal(run(command, f, "hills.png", f, "same", "--truth ", f, "/hills.png"), EXIT_GOOD);
    assert_true(brute_error("itself", "max") <= 1e-3 && brute_error("same", "max") <= 1e-3);
    assert_true(brute_error("source", "p50") > 1e-3);
    FIGURE("--truth: brute's mean error %.1e px against itself, %.3f px against the source of rms 2 m",
           brute_error("itself", "mean"), brute_error("source", "mean"));
    cJSON *itself = read_results("itself"), *same = read_results("same");
    double rms_m = number(cJSON_GetObjectItemCaseSensitive(itself, "scene"), "packed", "rms_m");
    assert_true(rms_m >= 0.98 * 2 && rms_m <= 1.001 * 2);
    assert_null(cJSON_GetObjectItemCaseSensitive(cJSON_GetObjectItemCaseSensitive(same, "scene"), "packed"));
    cJSON_Delete(itself);
    cJSON_Delete(same);
    assert_true(page_says("itself", "levels of detail alone; <code>--truth") &&
                page_says("source", "<b>hills</b>: compression and levels of detail together") &&
                !page_says("same", "was packed"));
    assert_one_line(run("bench run --terrain %s/hills.relief --truth %s/nowhere.png", f, f), EXIT_WORLD,
                    "nowhere.png");
}

// E3: on flat ground at 0, 1000 and 8848.86 m every renderer is exact: error_px max at most 1e-3.
static void test_flat_ground_has_no_error(void **state)
{
    (void)state;
    static const char *const names[] = {"flat0", "flat1000", "flat8848"};
    for (int n = 0; n < 3; n++) {
        assert_int_equal(
            run("bench run --terrain %s/%s.png --frames %d --repeats 1 --size 320x240 --out %s/%s", folder,
                names[n], test_size(4, 48), folder, names[n]),
            EXIT_GOOD);
        cJSON *results = read_results(names[n]);
        const cJSON *r;
        cJSON_ArrayForEach(r, cJSON_GetObjectItemCaseSensitive(results, "runs"))
        {
            const char *id = cJSON_GetObjectItemCaseSensitive(r, "id")->valuestring;
            if (strcmp(id, "null") == 0) continue;
            double most = number(r, "error_px", "max");
            if (!(most <= 1e-3)) print_error("%s on %s: error_px max %g\n", id, names[n], most);
            assert_true(most <= 1e-3);
            assert_true(number(r, "holes", "total") == 0);
        }
        cJSON_Delete(results);
    }
}

// default_path: there the shares of misses and spills are bounded and decimated, too, leaves no hole;
// elsewhere they are printed.
static void check_flight(const char *name, bool default_path)
{
    cJSON *results = read_results(name);
    const cJSON *agreement = cJSON_GetObjectItemCaseSensitive(results, "agreement"), *r;
    double plane = number(agreement, "plane_px_p999", NULL),
           coverage = number(agreement, "coverage_mismatch_max", NULL),
           order = number(agreement, "order_mismatch_max", NULL);
    FIGURE("%s: brute against the ray caster: plane_px p99.9 %.2g (at most 1.6e-4), coverage %g, order %g "
           "(at most 4)",
           name, plane, coverage, order);
    assert_true(plane <= 1.6e-4);
    assert_true(coverage <= 4 && order <= 4);
    cJSON_ArrayForEach(r, cJSON_GetObjectItemCaseSensitive(results, "runs"))
    {
        const char *id = cJSON_GetObjectItemCaseSensitive(r, "id")->valuestring;
        // null draws nothing; decimated is a closed mesh, but nothing bounds how far below a skyline it
        // stays, and more than 8 px is a hole by definition: 96 frames of the default path show one pixel at
        // step 6 and three at step 5.
        if (strcmp(id, "null") == 0 || strncmp(id, "decimated", 9) == 0) continue;
        if (number(r, "holes", "total") != 0) print_error("%s: %s has holes\n", name, id);
        assert_true(number(r, "holes", "total") == 0);
        assert_true(cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(r, "triangles_confirmed")));
    }
    static const struct {
        const char *renderer;
        double share;
    } bounds[] = {{"clipmap", 0.0005}, {"geomipmap", 0.0005}, {"pgm", 0.005}}; // design.md, coverage
    for (int b = 0; b < 3; b++) {
        const cJSON *best = NULL; // sweeps run coarse to fine
        cJSON_ArrayForEach(r, cJSON_GetObjectItemCaseSensitive(results, "runs"))
        {
            if (strcmp(cJSON_GetObjectItemCaseSensitive(r, "renderer")->valuestring, bounds[b].renderer) == 0)
                best = r;
        }
        assert_non_null(best);
        double misses = number(best, "misses", "share"), spills = number(best, "spills", "share");
        FIGURE("%s: %s misses %.4f %%, spills %.4f %% (at most %.2f %% each)", name,
               cJSON_GetObjectItemCaseSensitive(best, "id")->valuestring, 100 * misses, 100 * spills,
               100 * bounds[b].share);
        assert_true(!default_path || (misses <= bounds[b].share && spills <= bounds[b].share));
    }
    cJSON_ArrayForEach(r, cJSON_GetObjectItemCaseSensitive(results, "sweeps"))
    {
        double rho = number(r, "rank_correlation", NULL);
        const char *renderer = cJSON_GetObjectItemCaseSensitive(r, "renderer")->valuestring;
        FIGURE("%s: %s: rank correlation of error with visible triangles %.2f (at most -0.9)", name, renderer,
               rho);
        assert_true(rho <= -0.9);
    }
    cJSON_Delete(results);
}

// Two tables that need few frames: text, JSON and page are whole, and what is printed stands beside what is
// measured.
static void test_papers(void **state)
{
    (void)state;
    char path[512];
    assert_int_equal(
        run("bench papers --only clipmap-1,clipmap-2 --repeats 1 --size 160x120 --out %s/papers", folder),
        EXIT_GOOD);
    snprintf(path, sizeof path, "%s/out.txt", folder);
    char *text = read_file(path);
    assert_non_null(strstr(text, "Losasso & Hoppe 2004, Table 1"));
    free(text);
    snprintf(path, sizeof path, "%s/papers/papers.json", folder);
    text = read_file(path);
    assert_non_null(text);
    cJSON *root = cJSON_ParseWithOpts(text, NULL, true);
    free(text);
    assert_non_null(root);
    const cJSON *tables = cJSON_GetObjectItemCaseSensitive(root, "tables");
    assert_int_equal(cJSON_GetArraySize(tables), 2);
    const cJSON *rows = cJSON_GetObjectItemCaseSensitive(cJSON_GetArrayItem(tables, 0), "rows"), *row;
    double sum = 0, total = NAN;
    cJSON_ArrayForEach(row, rows)
    {
        const char *label = cJSON_GetObjectItemCaseSensitive(row, "label")->valuestring;
        const cJSON *values = cJSON_GetObjectItemCaseSensitive(row, "values");
        if (strcmp(label, "total, with synthesis") == 0)
            total = cJSON_GetArrayItem(values, 2)->valuedouble;
        else if (cJSON_IsNumber(cJSON_GetArrayItem(values, 2)))
            sum += cJSON_GetArrayItem(values, 2)->valuedouble;
    }
    assert_true(total == 100);
    assert_true(fabs(sum - 100) < 25); // medians of steps need not add up to the median of their sum
    cJSON_Delete(root);
    snprintf(path, sizeof path, "%s/papers/papers.html", folder);
    text = read_file(path);
    assert_non_null(text);
    assert_null(strstr(text, "<script"));
    assert_non_null(strstr(text, "</html>"));
    free(text);
}

// The default flight: agreement with the ray caster, no holes for any renderer and setting, coverage, rank
// correlation.
static void test_default_flight(void **state)
{
    (void)state;
    assert_int_equal(run("bench run --frames %d --repeats 1 --out %s/default", test_size(6, 96), folder),
                     EXIT_GOOD);
    check_flight("default", true);
}

static void test_puget_flights(void **state)
{
    (void)state;
    static const char *const scenes[][2] = {{"puget", "puget_1k_160m.png"},
                                            {"cascades", "puget_cascades_72m_2049x2817.png"}};
    for (int s = 0; s < 2; s++) {
        char path[1024];
        if (!test_data(scenes[s][1], path)) continue;
        if (s == 1 && !getenv("RELIEF_SOAK")) continue; // the larger one only at full size
        assert_int_equal(run("bench run --scene bench/scenes/%s.json --frames %d --repeats 1 --out %s/%s",
                             scenes[s][0], test_size(6, 96), folder, scenes[s][0]),
                         EXIT_GOOD);
        check_flight(scenes[s][0], false);
    }
}

// E10: the same pictures and numbers from programs built with -O0, -O2 and -O3.  Takes builds of its own.
static void test_optimisation_changes_nothing(void **state)
{
    (void)state;
    static const char *const levels[] = {"-O0", "-O3"};
    char command[2048], path[600];
    if (!getenv("RELIEF_SOAK")) {
        printf("skipped: -O0 and -O3 are built at full size only\n");
        return;
    }
    assert_int_equal(run("bench run --terrain %s/hills.png --frames 6 --repeats 1 --size 320x240 --out %s/O2",
                         folder, folder),
                     EXIT_GOOD);
    cJSON *built = read_results("O2");
    for (int l = 0; l < 2; l++) {
        snprintf(command, sizeof command,
                 "make -s BUILD=%s/%s CFLAGS=%s %s/%s/bench >%s/make.txt 2>&1 && env -u DISPLAY %s/%s/bench "
                 "run --terrain "
                 "%s/hills.png --frames 6 --repeats 1 --size 320x240 --out %s/%s/results >%s/out.txt 2>&1",
                 folder, levels[l], levels[l], folder, levels[l], folder, folder, levels[l], folder, folder,
                 levels[l], folder);
        assert_int_equal(system(command), 0);
        snprintf(path, sizeof path, "%s/results", levels[l]);
        cJSON *other = read_results(path);
        const cJSON *a;
        cJSON_ArrayForEach(a, cJSON_GetObjectItemCaseSensitive(built, "runs"))
        {
            const cJSON *b = find_run(other, cJSON_GetObjectItemCaseSensitive(a, "id")->valuestring);
            assert_non_null(b);
            assert_same(a, b, "error_px");
            assert_same(a, b, "triangles");
            assert_same(a, b, "pictures_sha256");
        }
        FIGURE("E10: %s gives the pictures and numbers of -O2", levels[l]);
        cJSON_Delete(other);
    }
    cJSON_Delete(built);
}

// Ctrl-C keeps what was measured.
// Starts a run that would last for hours and returns once its first timed flight is done.
// `*progress` is what it says on stderr, to be kept open as long as it runs.
static pid_t start_long_run(const char *name, FILE **progress)
{
    char program[512], terrain[512], out[512], line[512];
    const char *build = getenv("RELIEF_BUILD");
    snprintf(program, sizeof program, "%s/bench", build ? build : "build");
    snprintf(terrain, sizeof terrain, "%s/hills.png", folder);
    snprintf(out, sizeof out, "%s/%s", folder, name);
    int ends[2];
    assert_int_equal(pipe(ends), 0);
    pid_t child = fork();
    if (child == 0) {
        unsetenv("DISPLAY");
        if (!freopen("/dev/null", "w", stdout) || dup2(ends[1], STDERR_FILENO) < 0) _exit(99);
        close(ends[0]);
        execl(program, program, "run", "--terrain", terrain, "--repeats", "1000", "--size", "64x48", "--out",
              out, "--renderers", "null,clipmap", (char *)NULL);
        _exit(99);
    }
    close(ends[1]);
    *progress = fdopen(ends[0], "r");
    assert_non_null(*progress);
    bool timed = false;
    while (!timed && fgets(line, sizeof line, *progress)) timed = strstr(line, "flight 2 of 1000");
    assert_true(timed);
    return child;
}

static void test_interrupt_keeps_results(void **state)
{
    (void)state;
    FILE *progress = NULL;
    pid_t child = start_long_run("stopped", &progress);
    kill(child, SIGINT);
    int status = 0;
    waitpid(child, &status, 0);
    fclose(progress);
    assert_true(WIFEXITED(status));
    assert_int_equal(WEXITSTATUS(status), EXIT_INTERRUPTED);
    cJSON *results = read_results("stopped");
    assert_true(cJSON_IsFalse(cJSON_GetObjectItemCaseSensitive(results, "complete")));
    assert_true(isfinite(number(find_run(results, "null"), "frame_ms", "median")));
    cJSON_Delete(results);
}

static void test_help_and_version(void **state)
{
    (void)state;
    static const char *const programs[] = {"bench", "clipmap", "geomipmap", "pgm", "terrain"};
    for (int p = 0; p < 5; p++) {
        assert_int_equal(run("%s --help", programs[p]), EXIT_GOOD);
        assert_int_equal(run("%s --version", programs[p]), EXIT_GOOD);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_help_and_version),
        cmocka_unit_test(test_bad_input_is_one_line),
        cmocka_unit_test(test_flat_ground_has_no_error),
        cmocka_unit_test(test_runs_repeat_bit_for_bit),
        cmocka_unit_test(test_optimisation_changes_nothing),
        cmocka_unit_test(test_errors_against_the_source),
        cmocka_unit_test(test_interrupt_keeps_results),
        cmocka_unit_test(test_papers),
        cmocka_unit_test(test_default_flight),
        cmocka_unit_test(test_puget_flights),
    };
    return cmocka_run_group_tests(tests, set_up, folder_remove);
}
