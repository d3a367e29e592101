// The report: what it says about numbers that are known, and what it makes of results that are incomplete,
// hostile or broken. The results are made here: three methods at four settings, decimated at four, brute and
// null, on curves with known answers. SPDX-License-Identifier: MIT
#include "bench/error/error.h"
#include "bench/report/parts.h"
#include "bench/report/report.h"
#include "bench/statistics.h"
#include "common/image.h"
#include "tests/folder.h"

#include <cjson/cJSON.h>
#include <ctype.h>
#include <dirent.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>

// ---- results that are known ----------------------------------------------------------------------

struct model { // error_px = error * fall^k and ms = time * rise^k at setting k, coarse to fine
    const char *name, *knob;
    double values[4], error, fall, time, rise, triangles;
    int count;
};

static const struct model models[] = {
    {"null", NULL, {0}, NAN, 1, 0.31, 1, 0, 1},
    {"brute", NULL, {0}, 7.4e-5, 1, 61.2, 1, 1884000, 1},
    {"decimated", "step", {16, 8, 4, 2}, 21, 0.4, 2.9, 2.1, 7400, 4},
    {"clipmap", "n", {31, 63, 127, 255}, 7.9, 0.42, 4.6, 1.52, 9100, 4},
    {"geomipmap", "tau", {8, 4, 2, 1}, 5.2, 0.47, 3.1, 1.48, 12400, 4},
    {"pgm", "columns", {64, 128, 256, 512}, 14, 0.46, 4.1, 1.9, 8200, 4},
};
enum { MODELS = 6, FRAMES = 48, WIDTH = 160, HEIGHT = 120 };

static void add_times(cJSON *run, const char *key, double ms)
{
    cJSON *times = cJSON_AddObjectToObject(run, key);
    cJSON_AddNumberToObject(times, "median", ms);
    cJSON_AddNumberToObject(times, "p95", ms * 1.21);
    cJSON_AddNumberToObject(times, "p99", ms * 1.34);
    cJSON_AddNumberToObject(times, "min", ms * 0.8);
    cJSON_AddNumberToObject(times, "max", ms * 1.35);
    cJSON_AddItemToObject(times, "ci95", cJSON_CreateDoubleArray((double[]){ms * 0.98, ms * 1.02}, 2));
}

static void add_pair(cJSON *run, const char *key, double mean)
{
    cJSON *pair = cJSON_AddObjectToObject(run, key);
    cJSON_AddNumberToObject(pair, "mean", mean);
    cJSON_AddNumberToObject(pair, "max", mean * 1.3);
}

static void add_error(cJSON *run, const char *key, double p999)
{
    static const char *const names[] = {"mean", "rms", "p50", "p99", "p999", "max"};
    static const double shares[] = {0.05, 0.12, 0.02, 0.6, 1, 3.1};
    cJSON *error = cJSON_AddObjectToObject(run, key);
    for (int i = 0; i < 6; i++) {
        if (isnan(p999))
            cJSON_AddNullToObject(error, names[i]);
        else
            cJSON_AddNumberToObject(error, names[i], p999 * shares[i]);
    }
    if (isnan(p999))
        cJSON_AddNullToObject(error, "share_over_1px");
    else
        cJSON_AddNumberToObject(error, "share_over_1px", p999 > 1 ? 0.001 * p999 : 0);
    cJSON_AddNumberToObject(error, "samples", isnan(p999) ? 0 : 11059200);
}

static void add_coverage(cJSON *run, const char *key, double total)
{
    cJSON *coverage = cJSON_AddObjectToObject(run, key);
    cJSON_AddNumberToObject(coverage, "total", total);
    cJSON_AddNumberToObject(coverage, "worst_frame", total / 9);
    cJSON_AddNumberToObject(coverage, "share", total / 1.1e7);
}

static void add_pictures(cJSON *run, const char *slug)
{
    static const char *const moments[] = {"start", "middle", "worst"};
    cJSON *pictures = cJSON_AddArrayToObject(run, "pictures");
    for (int m = 0; m < 3; m++) {
        char path[128];
        cJSON *picture = cJSON_CreateObject();
        cJSON_AddItemToArray(pictures, picture);
        cJSON_AddStringToObject(picture, "moment", moments[m]);
        cJSON_AddNumberToObject(picture, "frame", m * 17);
        snprintf(path, sizeof path, "pictures/%s_%s.png", slug, moments[m]);
        cJSON_AddStringToObject(picture, "picture", path);
        snprintf(path, sizeof path, "pictures/%s_%s_error.png", slug, moments[m]);
        cJSON_AddStringToObject(picture, "error", path);
        cJSON_AddNumberToObject(picture, "error_px_p999", 0.7 + 0.2 * m);
    }
}

static cJSON *make_run(const struct model *model, int k)
{
    char id[64], slug[64], path[96];
    double ms = model->time * pow(model->rise, k), error = model->error * pow(model->fall, k);
    cJSON *run = cJSON_CreateObject();
    if (model->knob)
        snprintf(id, sizeof id, "%s %s=%g", model->name, model->knob, model->values[k]);
    else
        snprintf(id, sizeof id, "%s", model->name);
    snprintf(slug, sizeof slug, "%s_%d", model->name, k);
    snprintf(path, sizeof path, "frames/%s.csv", slug);
    cJSON_AddStringToObject(run, "id", id);
    cJSON_AddStringToObject(run, "label", id);
    cJSON_AddStringToObject(run, "renderer", model->name);
    cJSON *setting = cJSON_AddObjectToObject(run, "setting");
    if (model->knob) cJSON_AddNumberToObject(setting, model->knob, model->values[k]);
    cJSON_AddNumberToObject(run, "frames", FRAMES);
    cJSON_AddBoolToObject(run, "uncertain", false);
    add_times(run, "frame_ms", ms);
    add_times(run, "update_ms", ms * 0.1);
    add_times(run, "draw_ms", ms * 0.9);
    add_times(run, "wall_ms", ms * 1.04);
    add_times(run, "worker_ms", 0.02);
    cJSON_AddNullToObject(run, "gpu_ms");
    cJSON_AddNullToObject(run, "throughput_ms");
    if (model->triangles > 0) {
        cJSON *roofline = cJSON_AddObjectToObject(run, "roofline_ms");
        cJSON_AddNumberToObject(roofline, "median", ms * 0.7);
        cJSON_AddNumberToObject(run, "steadiness", 1.07 + 0.03 * k);
    } else {
        cJSON_AddNullToObject(run, "roofline_ms");
        cJSON_AddNullToObject(run, "steadiness");
    }
    cJSON_AddNumberToObject(run, "fps", 1000 / ms);
    add_pair(run, "triangles", model->triangles * pow(3.4, k) * 1.6);
    add_pair(run, "visible_triangles", model->triangles * pow(3.4, k));
    add_pair(run, "draw_calls", 12 + k);
    add_pair(run, "upload_bytes", 40960 * (k + 1));
    cJSON_AddNumberToObject(run, "resident_bytes", 3.2e6 * (k + 1));
    add_error(run, "error_px", error);
    add_error(run, "plane_px", error * 0.4);
    bool claims = strcmp(model->name, "clipmap") == 0 || strcmp(model->name, "geomipmap") == 0;
    if (claims)
        cJSON_AddNumberToObject(run, "claimed_px", error * 4);
    else
        cJSON_AddNullToObject(run, "claimed_px");
    if (claims)
        cJSON_AddNumberToObject(run, "claim_broken_frames", 0);
    else
        cJSON_AddNullToObject(run, "claim_broken_frames");
    cJSON *tightness = cJSON_AddObjectToObject(run, "tightness");
    if (claims) {
        cJSON_AddNumberToObject(tightness, "mean", 1.5 + k);
        cJSON_AddNumberToObject(tightness, "min", 1.25 + k);
    } else {
        cJSON_AddNullToObject(tightness, "mean");
        cJSON_AddNullToObject(tightness, "min");
    }
    add_coverage(run, "holes", 0);
    add_coverage(run, "misses", isnan(error) ? 0 : 100 * error);
    add_coverage(run, "spills", isnan(error) ? 0 : 80 * error);
    cJSON *temporal = cJSON_AddObjectToObject(run, "temporal_px");
    cJSON_AddNumberToObject(temporal, "p999", 0.11 * (k + 1));
    cJSON_AddNumberToObject(temporal, "max", 0.43 * (k + 1));
    cJSON_AddStringToObject(run, "frames_csv", path);
    if (model->triangles > 0 && k == (model->count > 1 ? 2 : 0))
        add_pictures(run, slug);
    else
        cJSON_AddArrayToObject(run, "pictures");
    cJSON *counters = cJSON_AddObjectToObject(run, "counters");
    if (claims) cJSON_AddNumberToObject(counters, "levels", 8 - k);
    if (claims) cJSON_AddNumberToObject(counters, "samples_updated", 4096.25 + k);
    cJSON *reasons = cJSON_AddObjectToObject(run, "reasons");
    cJSON_AddStringToObject(reasons, "gpu_ms", "a software rasteriser's timer queries mean nothing");
    cJSON_AddStringToObject(reasons, "throughput_ms", "measured on a GPU only");
    if (!claims) cJSON_AddStringToObject(reasons, "claimed_px", "this method claims no bound");
    if (isnan(error)) cJSON_AddStringToObject(reasons, "error_px", "no pixel to measure");
    if (isnan(error)) cJSON_AddStringToObject(reasons, "roofline_ms", "no triangles are drawn");
    return run;
}

static void add_facts(cJSON *root)
{
    cJSON *group;
    cJSON_AddStringToObject(root, "created", "2026-11-22T12:00:00Z");
    cJSON_AddStringToObject(root, "command", "build/bench run --out reports/default");
    group = cJSON_AddObjectToObject(root, "machine");
    cJSON_AddStringToObject(group, "cpu", "A Processor of Note at 2.40 GHz");
    cJSON_AddNumberToObject(group, "cores", 2);
    cJSON_AddStringToObject(group, "memory_gib", "7.8");
    cJSON_AddStringToObject(group, "system", "Linux 6.1.0 x86_64");
    group = cJSON_AddObjectToObject(root, "build");
    cJSON_AddStringToObject(group, "version", "0.1.0");
    cJSON_AddStringToObject(group, "commit", "0123abc");
    cJSON_AddStringToObject(group, "compiler", "gcc 12.2.0");
    cJSON_AddStringToObject(group, "flags", "-O2 -g -ffp-contract=off");
    group = cJSON_AddObjectToObject(root, "gl");
    cJSON_AddStringToObject(group, "backend", "egl");
    cJSON_AddStringToObject(group, "vendor", "Mesa");
    cJSON_AddStringToObject(group, "renderer", "llvmpipe (LLVM 15.0.6, 256 bits)");
    cJSON_AddStringToObject(group, "version", "4.5 (Core Profile) Mesa 22.3.6");
    cJSON_AddBoolToObject(group, "software", true);
    cJSON_AddBoolToObject(group, "reversed_depth", true);
    group = cJSON_AddObjectToObject(root, "scene");
    cJSON_AddStringToObject(group, "name", "default");
    cJSON_AddStringToObject(group, "terrain", "jacksboro.png");
    cJSON_AddNumberToObject(group, "samples", 8.9e6);
    cJSON_AddItemToObject(group, "spacing_m", cJSON_CreateDoubleArray((double[]){28.9, 30.9}, 2));
    cJSON_AddNumberToObject(group, "width", WIDTH);
    cJSON_AddNumberToObject(group, "height", HEIGHT);
    cJSON_AddNumberToObject(group, "fov_vertical_deg", 45);
    cJSON_AddStringToObject(group, "sha256", "c0ffee");
    cJSON_AddStringToObject(cJSON_AddObjectToObject(group, "effects"), "shading", "common");
    group = cJSON_AddObjectToObject(root, "path");
    cJSON_AddStringToObject(group, "name", "default");
    cJSON_AddNumberToObject(group, "frames", FRAMES);
    cJSON_AddNumberToObject(group, "step_m", 0.0333);
    group = cJSON_AddObjectToObject(root, "method");
    cJSON_AddNumberToObject(group, "repeats", 5);
    cJSON_AddStringToObject(group, "warmup", "the whole path once, untimed, by every setting");
    cJSON_AddNumberToObject(group, "seed", 1);
    cJSON_AddStringToObject(group, "sweep", "quick");
    cJSON_AddStringToObject(group, "times", "cpu");
    group = cJSON_AddObjectToObject(root, "agreement");
    cJSON_AddNumberToObject(group, "plane_px_p999", 8.1e-5);
    cJSON_AddNumberToObject(group, "coverage_mismatch_max", 1);
    cJSON_AddNumberToObject(group, "order_mismatch_max", 0);
    cJSON_AddNumberToObject(group, "pixels", 307200);
}

static void add_rows(cJSON *root, const char *table, const char *key, const double *at, int count)
{
    cJSON *rows = cJSON_AddArrayToObject(root, table);
    for (int r = 0; r < count; r++) {
        cJSON *row = cJSON_CreateObject();
        cJSON_AddItemToArray(rows, row);
        cJSON_AddNumberToObject(row, key, at[r]);
        for (int m = 2; m < MODELS; m++) {
            double errors[4], times[4];
            for (int k = 0; k < 4; k++) {
                errors[k] = models[m].error * pow(models[m].fall, k);
                times[k] = models[m].time * pow(models[m].rise, k);
            }
            double value =
                key[3] == 'p' ? curve_at(errors, times, 4, at[r]) : curve_at(times, errors, 4, at[r]);
            cJSON_AddItemToObject(row, models[m].name,
                                  isnan(value) ? cJSON_CreateNull() : cJSON_CreateNumber(value));
        }
    }
}

static cJSON *make_results(void)
{
    cJSON *root = cJSON_CreateObject();
    cJSON_AddNumberToObject(root, "schema", 1);
    cJSON_AddBoolToObject(root, "complete", true);
    add_facts(root);
    cJSON *runs = cJSON_AddArrayToObject(root, "runs"), *frontier = cJSON_AddArrayToObject(root, "frontier");
    cJSON *sweeps = cJSON_AddArrayToObject(root, "sweeps");
    for (int m = 0; m < MODELS; m++) {
        cJSON *points = cJSON_CreateArray();
        for (int k = 0; k < models[m].count; k++) {
            cJSON *run = make_run(&models[m], k), *point = cJSON_CreateObject();
            cJSON_AddItemToArray(runs, run);
            cJSON_AddItemToArray(points, point);
            cJSON_AddStringToObject(point, "setting", cJSON_GetObjectItem(run, "id")->valuestring);
        }
        if (models[m].count == 1) {
            cJSON_Delete(points);
            continue;
        }
        cJSON *curve = cJSON_CreateObject(), *sweep = cJSON_CreateObject();
        cJSON_AddItemToArray(frontier, curve);
        cJSON_AddStringToObject(curve, "renderer", models[m].name);
        cJSON_AddItemToObject(curve, "points", points);
        cJSON_AddItemToArray(sweeps, sweep);
        cJSON_AddStringToObject(sweep, "renderer", models[m].name);
        cJSON_AddStringToObject(sweep, "knob", models[m].knob);
        cJSON_AddNumberToObject(sweep, "rank_correlation", -1);
    }
    add_rows(root, "equal_error", "at_px", (double[]){0.5, 1, 2, 4}, 4);
    add_rows(root, "equal_time", "at_ms", (double[]){5, 10, 20}, 3);
    return root;
}

// ---- the folder ----------------------------------------------------------------------------------

static void write_results(const cJSON *root)
{
    char *content = cJSON_Print(root);
    write_text("results.json", content);
    free(content);
}

// Of renderer m at setting k: nothing moves in frame 7.
static double moved_px(int m, int k, int frame)
{
    return frame == 7 ? 0 : 1e-3 * (m + 1) * (k + 1) * (1 + 0.5 * sin(frame));
}

static void write_frames(void)
{
    for (int m = 0; m < MODELS; m++)
        for (int k = 0; k < models[m].count; k++) {
            char name[96];
            snprintf(name, sizeof name, "frames/%s_%d.csv", models[m].name, k);
            FILE *file = fopen(in_folder(name), "wb");
            assert_non_null(file);
            fprintf(file, "frame,frame_ms,update_ms,error_px_mean,error_px_p999,temporal_px_p999\n");
            for (int frame = 0; frame < FRAMES; frame++) {
                double wave = 1 + 0.15 * sin(frame * 0.31 + m) + 0.05 * sin(frame * 2.3 + k);
                double error = models[m].error * pow(models[m].fall, k) * wave;
                fprintf(file, "%d,%.6g,,", frame, models[m].time * pow(models[m].rise, k) * wave);
                if (isnan(error))
                    fprintf(file, ",,\n");
                else if (frame == 0)
                    fprintf(file, "%.6g,%.6g,\n", error * 0.05, error);
                else
                    fprintf(file, "%.6g,%.6g,%.6g\n", error * 0.05, error, moved_px(m, k, frame));
            }
            fclose(file);
        }
}

static void write_pictures(void)
{
    static uint8_t picture[WIDTH * HEIGHT * 3], error[WIDTH * HEIGHT * 3];
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++) {
            uint8_t *p = picture + 3 * (y * WIDTH + x), *e = error + 3 * (y * WIDTH + x);
            bool sky = y > 70 + 12 * sin(x * 0.06) + 5 * sin(x * 0.21);
            for (int c = 0; c < 3; c++) {
                p[c] = (uint8_t)(sky ? 150 + 30 * c : 60 + y + 20 * sin((x + y) * 0.15) + 12 * c);
                e[c] = 176;
            }
            if (!sky) frame_error_colour(pow(10, -2 + 2.6 * y / HEIGHT + 0.4 * sin(x * 0.3)), e);
        }
    for (int m = 1; m < MODELS; m++)
        for (int moment = 0; moment < 3; moment++) {
            static const char *const moments[] = {"start", "middle", "worst"};
            char name[96];
            int k = models[m].count > 1 ? 2 : 0;
            snprintf(name, sizeof name, "pictures/%s_%d_%s.png", models[m].name, k, moments[moment]);
            assert_true(image_write_png(in_folder(name), WIDTH, HEIGHT, 3, picture));
            snprintf(name, sizeof name, "pictures/%s_%d_%s_error.png", models[m].name, k, moments[moment]);
            assert_true(image_write_png(in_folder(name), WIDTH, HEIGHT, 3, error));
        }
}

static void clear_folder(const char *path)
{
    DIR *directory = opendir(path);
    struct dirent *entry;
    if (!directory) return;
    while ((entry = readdir(directory))) {
        char child[2048];
        if (entry->d_name[0] == '.') continue;
        snprintf(child, sizeof child, "%s/%s", path, entry->d_name);
        if (unlink(child) != 0) {
            clear_folder(child);
            rmdir(child);
        }
    }
    closedir(directory);
}

static int setup(void **state)
{
    if (folder_create(state) != 0) return -1;
    return mkdir(in_folder("frames"), 0777) | mkdir(in_folder("pictures"), 0777);
}

static char *read_page(const char *name)
{
    FILE *file = fopen(in_folder(name), "rb");
    if (!file) return NULL;
    fseek(file, 0, SEEK_END);
    size_t size = (size_t)ftell(file);
    rewind(file);
    char *content = calloc(1, size + 1);
    assert_int_equal(fread(content, 1, size, file), size);
    fclose(file);
    return content;
}

// The page of some results: written, read back, to be freed.
static char *page_of(cJSON *root)
{
    write_results(root);
    cJSON_Delete(root);
    assert_true(report_write(folder));
    char *page = read_page("index.html");
    assert_non_null(page);
    return page;
}

// What a reader sees: the page without tags, pictures' data and style.
static char *visible_text(const char *page)
{
    char *out = calloc(1, strlen(page) + 1), *end = out;
    for (const char *c = page; *c; c++) {
        if (strncmp(c, "<style>", 7) == 0) c = strstr(c, "</style>");
        if (*c == '<')
            c = strchr(c, '>');
        else
            *end++ = *c;
    }
    return out;
}

static bool has_word(const char *text, const char *word)
{
    size_t length = strlen(word);
    for (const char *c = text; *c; c++)
        if (strncasecmp(c, word, length) == 0 && (c == text || !isalnum((unsigned char)c[-1])) &&
            !isalnum((unsigned char)c[length]))
            return true;
    return false;
}

static void assert_contains(const char *text, const char *part)
{
    if (!strstr(text, part)) fail_msg("the page does not say: %s", part);
}

static void assert_no_litter(const char *name) // no temporary file stays behind
{
    DIR *directory = opendir(in_folder(name));
    struct dirent *entry;
    if (!directory) return;
    while ((entry = readdir(directory))) assert_null(strstr(entry->d_name, ".tmp"));
    closedir(directory);
}

static int run_quietly(const char *command)
{
    char line[2400];
    snprintf(line, sizeof line, "%s >/dev/null 2>&1", command);
    int status = system(line);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

// ---- tests ---------------------------------------------------------------------------------------

static void page_is_whole_and_self_contained(void **state)
{
    (void)state;
    write_frames();
    write_pictures();
    char *page = page_of(make_results()), *text = visible_text(page);
    assert_null(strstr(page, "http"));
    assert_null(strstr(page, "<script"));
    assert_null(strstr(page, "<link"));
    assert_null(strstr(page, "@import"));
    for (const char *c = page; (c = strstr(c, "src=\"")); c += 5)
        assert_memory_equal(c + 5, "data:image/png;base64,", 22);
    assert_false(has_word(text, "nan"));
    assert_false(has_word(text, "inf"));
    assert_contains(page, "</html>");
    assert_null(strstr(page, "Incomplete"));
    int pictures = 0;
    for (const char *c = page; (c = strstr(c, "<img")); c += 4) pictures++;
    assert_int_equal(pictures, 5 * 3 * 2);
    FIGURE("report: %zu bytes, %d pictures", strlen(page), pictures);
    assert_no_litter(".");
    free(text);
    free(page);
}

static void figures_are_valid_and_ids_do_not_clash(void **state)
{
    (void)state;
    static const char *const names[] = {"frontier", "path", "motion", "triangles"};
    if (run_quietly("gnuplot --version") != 0) {
        printf("skipped: gnuplot is not installed\n");
        return;
    }
    write_frames();
    char *page = page_of(make_results());
    for (int i = 0; i < 4; i++) {
        char command[1400], name[64];
        snprintf(name, sizeof name, "figures/%s.svg", names[i]);
        snprintf(command, sizeof command, "xmllint --noout %s", in_folder(name));
        int code = run_quietly(command);
        if (code == 127)
            printf("skipped: xmllint is not installed\n");
        else
            assert_int_equal(code, 0);
        snprintf(command, sizeof command, "cd %s/figures && gnuplot %s.gp | cmp - %s.svg", folder, names[i],
                 names[i]);
        assert_int_equal(run_quietly(command), 0); // the script makes the same figure again
    }
    int ids = 0;
    for (const char *c = page; (c = strpbrk(c, " ")); c++) { // every id once
        if (strncmp(c, " id=", 4) != 0) continue;
        size_t length = strcspn(c + 5, "\"'");
        for (const char *d = c + 5; (d = strstr(d, " id=")); d += 4)
            assert_false(strcspn(d + 5, "\"'") == length && memcmp(d + 5, c + 5, length) == 0);
        ids++;
    }
    assert_true(ids > 60);
    assert_no_litter("figures");
    free(page);
}

static cJSON *run_named(const cJSON *root, const char *renderer, int k)
{
    const cJSON *runs = cJSON_GetObjectItem(root, "runs");
    cJSON *run;
    cJSON_ArrayForEach(run,
                       runs) if (strcmp(cJSON_GetObjectItem(run, "renderer")->valuestring, renderer) == 0 &&
                                 k-- == 0) return run;
    return NULL;
}

// Lines join settings that differ in the quality knob alone: an empty line ends one.
static void lines_join_sweeps_alone(void **state)
{
    (void)state;
    for (int beside = 0; beside < 2; beside++) {
        cJSON *root = make_results();
        write_frames();
        if (beside) {
            cJSON *setting = cJSON_GetObjectItem(run_named(root, "clipmap", 1), "setting");
            cJSON_AddStringToObject(setting, "layout", "strips");
        }
        free(page_of(root));
        char *data = read_page("figures/frontier.dat"), points[64] = "", *line = data;
        assert_non_null(data);
        for (char *end; (end = strchr(line, '\n')); line = end + 1) // a letter a line; methods come first
            if (*line != '#' && strlen(points) < 20) strcat(points, end > line ? "p" : "-");
        assert_string_equal(points, beside ? "ppp-p--pppp--pppp--p" : "pppp--pppp--pppp--pp");
        free(data);
    }
}

// At 1 px the curves give, by log-log interpolation, clipmap 4.6 * 7.9^(ln 1.52 / -ln 0.42) = 12.5 ms and
// geomipmap 3.1 * 5.2^(ln 1.48 / -ln 0.47) = 7.3 ms: intervals of 2 % are far apart.
static void verdict_names_the_faster(void **state)
{
    (void)state;
    char *page = page_of(make_results()), *text = visible_text(page), expected[128];
    double clipmap = 4.6 * pow(7.9, log(1.52) / -log(0.42)),
           geomipmap = 3.1 * pow(5.2, log(1.48) / -log(0.47));
    snprintf(expected, sizeof expected, "geomipmap is fastest, at %.2f\u00a0ms", geomipmap);
    assert_contains(text, expected);
    snprintf(expected, sizeof expected, "clipmap takes %.2f\u00a0\u00d7 as long", clipmap / geomipmap);
    assert_contains(text, expected);
    assert_contains(text, "No holes");
    assert_contains(text, "8.10\u00d710\u207b\u2075\u00a0px");
    assert_contains(text, "software-rendered");
    assert_contains(text, "pgm claims no bound");
    snprintf(expected, sizeof expected,
             "brute, the whole mesh, costs 61.2\u00a0ms a frame, %.2f\u00a0\u00d7 geomipmap",
             61.2 / geomipmap);
    assert_contains(text, expected);
    free(text);
    free(page);
}

static void set_interval(cJSON *run, double low, double high)
{
    cJSON *times = cJSON_GetObjectItem(run, "frame_ms");
    double median = cJSON_GetObjectItem(times, "median")->valuedouble;
    cJSON_ReplaceItemInObject(times, "ci95",
                              isnan(low)
                                  ? cJSON_CreateNull()
                                  : cJSON_CreateDoubleArray((double[]){median * low, median * high}, 2));
}

static void all_intervals(cJSON *root, double low, double high)
{
    cJSON *run;
    cJSON_ArrayForEach(run, cJSON_GetObjectItem(root, "runs")) set_interval(run, low, high);
}

static void verdict_cannot_tell(void **state)
{
    (void)state;
    cJSON *root = make_results();
    all_intervals(root, 0.5, 2); // overlapping
    char *page = page_of(root), *text = visible_text(page);
    assert_contains(text, "At 1\u00a0px cannot tell geomipmap");
    assert_contains(text, "the intervals overlap");
    assert_null(strstr(text, "is fastest"));
    free(text);
    free(page);

    root = make_results();
    all_intervals(root, NAN, NAN); // fewer than 3 repeats
    page = page_of(root), text = visible_text(page);
    assert_contains(text, "cannot tell");
    assert_contains(text, "no interval");
    assert_null(strstr(text, "is fastest"));
    free(text);
    free(page);

    root = make_results(); // intervals apart, but only 4 % between the values
    all_intervals(root, 0.99, 1.01);
    cJSON *row;
    cJSON_ArrayForEach(row, cJSON_GetObjectItem(root, "equal_error"))
    {
        cJSON_ReplaceItemInObject(row, "geomipmap", cJSON_CreateNumber(10));
        cJSON_ReplaceItemInObject(row, "clipmap", cJSON_CreateNumber(10.4));
        cJSON_ReplaceItemInObject(row, "pgm", cJSON_CreateNumber(20));
    }
    page = page_of(root), text = visible_text(page);
    assert_contains(text, "less than 5\u00a0% apart");
    assert_contains(text, "pgm takes 2\u00a0\u00d7 as long");
    assert_null(strstr(text, "is fastest"));
    free(text);
    free(page);
}

// What the page says of motion, tightness and counters, and that results without them still have a page.
static void motion_tightness_and_counters_are_shown(void **state)
{
    (void)state;
    write_frames();
    char *page = page_of(make_results()), *text = visible_text(page);
    assert_contains(text, "From frame to frame the eye moves 0.0333\u00a0m");
    assert_contains(text,
                    "geomipmap keeps the error it claims in all 192 frames. Over the frames that claim is on "
                    "average 1.50 to 4.50\u00a0\u00d7 the largest error, depending on the setting.");
    assert_contains(page, "<details id=\"counters\"><summary>What the methods counted");
    assert_contains(page, "<th>levels</th><th>samples_updated</th>");
    assert_contains(page, "<td>8</td><td>4\u202f096</td>");
    assert_contains(page, ">least</small>"); // the columns of tightness
    const char *counters = strstr(page, "<details id=\"counters\"");
    assert_null(strstr(counters, "<th class=\"word\"><span class=\"who\" style=\"--c:#009E73\">pgm<"));
    free(text);
    free(page);

    // The figure's numbers are the frames': 46 of the 48 of each method, as one has none and one did not
    // move.
    char *data = read_page("figures/motion.dat");
    int rows = 0, blank = 0, m = 3;
    assert_non_null(data);
    for (char *line = strtok(data, "\n"); line; line = strtok(NULL, "\n")) {
        double frame, moved;
        if (sscanf(line, "%lf %lf", &frame, &moved) != 2) {
            blank++;
            continue;
        }
        int k = m == 4 ? 2 : m == 3 ? 2 : 3; // the settings nearest to 1 px: 1.39, 1.15 and 1.36
        assert_true(fabs(moved - moved_px(m, k, (int)frame)) <= 1e-5 * moved);
        if (++rows % (FRAMES - 2) == 0) m++;
    }
    assert_int_equal(rows, 3 * (FRAMES - 2));
    assert_int_equal(blank, 1); // the heading
    free(data);
}

static void frames_that_do_not_follow_each_other_are_said(void **state)
{
    (void)state;
    cJSON *root = make_results(), *run;
    cJSON_ArrayForEach(run, cJSON_GetObjectItem(root, "runs"))
    {
        if (strcmp(cJSON_GetObjectItem(run, "renderer")->valuestring, "pgm") != 0) continue;
        cJSON *temporal = cJSON_CreateObject();
        cJSON_AddNullToObject(temporal, "p999");
        cJSON_AddNullToObject(temporal, "max");
        cJSON_ReplaceItemInObject(run, "temporal_px", temporal);
        cJSON_AddStringToObject(cJSON_GetObjectItem(run, "reasons"), "temporal_px",
                                "its frames do not follow each other");
    }
    char *page = page_of(root), *text = visible_text(page); // and no frames/*.csv: no figure
    assert_contains(text, "Not measured: pgm columns=512, its frames do not follow each other.");
    assert_int_not_equal(access(in_folder("figures/motion.svg"), F_OK), 0);
    free(text);
    free(page);
}

static void results_without_later_fields_have_a_page(void **state)
{
    (void)state;
    cJSON *root = make_results(), *run;
    cJSON_DeleteItemFromObject(cJSON_GetObjectItem(root, "path"), "step_m");
    cJSON_ArrayForEach(run, cJSON_GetObjectItem(root, "runs"))
    {
        cJSON_DeleteItemFromObject(run, "tightness");
        cJSON_DeleteItemFromObject(run, "counters");
    }
    char *page = page_of(root), *text = visible_text(page);
    assert_contains(text, "geomipmap keeps the error it claims in all 192 frames. ");
    assert_null(strstr(text, "that claim is on average"));
    assert_null(strstr(text, "the eye moves"));
    assert_null(strstr(page, "id=\"counters\""));
    assert_null(strstr(page, "claimed over measured error"));
    assert_contains(text, "these results were written without it");
    free(text);
    free(page);
}

// A method whose flights were cut short may have had a bound to claim: the page must not say that it has
// none.
static void what_was_not_measured_claims_nothing(void **state)
{
    (void)state;
    cJSON *root = make_results(), *run;
    cJSON_ArrayForEach(run, cJSON_GetObjectItem(root, "runs"))
    {
        if (strcmp(cJSON_GetObjectItem(run, "renderer")->valuestring, "geomipmap") != 0) continue;
        cJSON_ReplaceItemInObject(run, "error_px", cJSON_CreateNull());
        cJSON_ReplaceItemInObject(run, "claimed_px", cJSON_CreateNull());
        cJSON_ReplaceItemInObject(run, "tightness", cJSON_CreateNull());
        cJSON_ReplaceItemInObject(run, "counters", cJSON_CreateNull());
    }
    char *page = page_of(root), *text = visible_text(page);
    assert_null(strstr(text, "geomipmap claims no bound"));
    assert_contains(text, "geomipmap was not measured. ");
    assert_contains(text, "pgm claims no bound");
    free(text);
    free(page);
}

static void holes_and_broken_promises_are_said(void **state)
{
    (void)state;
    cJSON *root = make_results();
    cJSON_SetNumberValue(
        cJSON_GetObjectItem(cJSON_GetObjectItem(run_named(root, "clipmap", 1), "holes"), "total"), 13);
    cJSON_SetNumberValue(cJSON_GetObjectItem(run_named(root, "geomipmap", 0), "claim_broken_frames"), 3);
    cJSON_SetNumberValue(
        cJSON_GetObjectItem(cJSON_GetObjectItem(run_named(root, "clipmap", 3), "misses"), "share"), 0.01);
    cJSON_SetNumberValue(cJSON_GetObjectItem(cJSON_GetObjectItem(root, "agreement"), "order_mismatch_max"),
                         9);
    char *page = page_of(root), *text = visible_text(page);
    assert_null(strstr(text, "No holes"));
    assert_contains(text, "clipmap n=63 13");
    assert_contains(text, "geomipmap breaks the error it claims in 3 of 192");
    assert_contains(text, "beyond the bound of 0.05");
    assert_contains(text, "beyond the bounds of 1.6");
    free(text);
    free(page);
}

static void remove_renderer(cJSON *root, const char *name)
{
    static const char *const lists[] = {"runs", "frontier", "sweeps"};
    for (int i = 0; i < 3; i++) {
        cJSON *list = cJSON_GetObjectItem(root, lists[i]);
        for (int k = cJSON_GetArraySize(list) - 1; k >= 0; k--)
            if (strcmp(cJSON_GetObjectItem(cJSON_GetArrayItem(list, k), "renderer")->valuestring, name) == 0)
                cJSON_DeleteItemFromArray(list, k);
    }
}

static void no_number_is_no_number(void **state)
{
    (void)state;
    cJSON *root = make_results(), *run;
    remove_renderer(root, "null"); // the only right use of the word
    cJSON_ArrayForEach(run, cJSON_GetObjectItem(root, "runs"))
    {
        static const char *const keys[] = {"frames",
                                           "frame_ms",
                                           "update_ms",
                                           "draw_ms",
                                           "wall_ms",
                                           "worker_ms",
                                           "roofline_ms",
                                           "steadiness",
                                           "fps",
                                           "triangles",
                                           "visible_triangles",
                                           "draw_calls",
                                           "upload_bytes",
                                           "resident_bytes",
                                           "error_px",
                                           "plane_px",
                                           "holes",
                                           "misses",
                                           "spills",
                                           "temporal_px",
                                           "tightness",
                                           "counters"};
        for (size_t i = 0; i < sizeof keys / sizeof keys[0]; i++)
            cJSON_ReplaceItemInObject(run, keys[i], cJSON_CreateNull());
    }
    cJSON_ReplaceItemInObject(root, "agreement", cJSON_CreateNull());
    cJSON_ReplaceItemInObject(root, "frontier", cJSON_CreateArray());
    cJSON_ReplaceItemInObject(root, "equal_error", cJSON_CreateArray());
    cJSON_ReplaceItemInObject(root, "equal_time", cJSON_CreateArray());
    char *page = page_of(root), *text = visible_text(page);
    static const char *const forbidden[] = {"null", "nan", "inf", "-nan", "0.00", "undefined"};
    for (size_t i = 0; i < sizeof forbidden / sizeof forbidden[0]; i++)
        if (has_word(text, forbidden[i])) fail_msg("the page says %s", forbidden[i]);
    assert_contains(text, "no reason was recorded");
    assert_contains(text, "a software rasteriser&#39;s timer queries mean nothing");
    assert_contains(text, "cannot tell");
    assert_contains(text, "Holes were not measured");
    free(text);
    free(page);
}

// Sends stderr elsewhere and gives back what silence_end needs.
static int silence_begin(FILE *elsewhere)
{
    fflush(stderr);
    int kept = dup(2);
    assert_true(kept >= 0 && dup2(fileno(elsewhere), 2) == 2);
    return kept;
}

static void silence_end(int kept)
{
    fflush(stderr);
    dup2(kept, 2);
    close(kept);
}

static void survives(const cJSON *root, bool expected, int *documents)
{
    write_results(root);
    assert_int_equal(report_write(folder), expected);
    ++*documents;
}

// Each field of an object left out, then of another kind; the object is as before afterwards, but for its
// order.
static void try_fields(const cJSON *root, cJSON *object, int *documents)
{
    for (int k = cJSON_GetArraySize(object); k > 0; k--) {
        cJSON *kept = cJSON_DetachItemFromArray(object, 0), *other = cJSON_CreateString("other");
        bool schema = object == root && strcmp(kept->string, "schema") == 0;
        survives(root, !schema, documents);
        cJSON_AddItemToObject(object, kept->string, other);
        survives(root, !schema, documents);
        cJSON_Delete(cJSON_DetachItemViaPointer(object, other));
        cJSON_AddItemToObject(object, kept->string, kept);
    }
}

static void survives_missing_fields(void **state)
{
    (void)state;
    cJSON *root = make_results(), *item, *child;
    char path[4096];
    int documents = 0;
    FILE *elsewhere = tmpfile();
    snprintf(path, sizeof path, "%s", getenv("PATH"));
    setenv("PATH", folder, 1); // without figures: drawing them hundreds of times tells nothing more
    int kept = silence_begin(elsewhere);
    try_fields(root, root, &documents);
    cJSON_ArrayForEach(item, root)
    {
        if (cJSON_IsObject(item)) try_fields(root, item, &documents);
        if (!cJSON_IsArray(item)) continue;
        int last = cJSON_GetArraySize(item) - 1, first = test_size(last, 0); // everyday: the last; full: each
        for (int k = first; k <= last; k++) {
            try_fields(root, cJSON_GetArrayItem(item, k), &documents);
            cJSON_ArrayForEach(child, cJSON_GetArrayItem(item, k)) if (cJSON_IsObject(child))
                try_fields(root, child, &documents);
        }
    }
    silence_end(kept);
    fclose(elsewhere);
    setenv("PATH", path, 1);
    FIGURE("report: %d documents with a field missing or of another kind", documents);
    cJSON_Delete(root);
}

static void incomplete_single_and_empty(void **state)
{
    (void)state;
    cJSON *root = make_results();
    cJSON_ReplaceItemInObject(root, "complete", cJSON_CreateFalse());
    char *page = page_of(root);
    assert_contains(page, "Incomplete");
    free(page);
    static const char *const others[] = {"null", "brute", "decimated", "geomipmap", "pgm"};
    root = make_results();
    for (int i = 0; i < 5; i++) remove_renderer(root, others[i]);
    page = page_of(root);
    char *text = visible_text(page);
    assert_contains(text, "clipmap is the only method that gets there");
    free(text);
    free(page);
    root = make_results();
    for (int i = 0; i < 5; i++) remove_renderer(root, others[i]);
    for (int k = 0; k < 3; k++) cJSON_DeleteItemFromArray(cJSON_GetObjectItem(root, "runs"), 0);
    cJSON_ReplaceItemInObject(root, "equal_error", cJSON_CreateArray());
    page = page_of(root);
    assert_contains(page, "clipmap n=255");
    free(page);
    page = page_of(cJSON_Parse("{\"schema\": 1, \"complete\": false, \"runs\": []}"));
    assert_contains(page, "No run was measured");
    free(page);
}

static void nothing_from_the_files_becomes_markup(void **state)
{
    (void)state;
    static const char hostile[] = "<b id='x'>\"&'\\ `id` \x01 \xff\xfe </title><script>alert(1)</script>";
    cJSON *root = make_results(), *run;
    remove_renderer(root, "geomipmap");
    cJSON_ArrayForEach(run, cJSON_GetObjectItem(root, "runs"))
    {
        if (strcmp(cJSON_GetObjectItem(run, "renderer")->valuestring, "pgm") == 0)
            cJSON_ReplaceItemInObject(run, "renderer", cJSON_CreateString(hostile));
        cJSON_ReplaceItemInObject(run, "id", cJSON_CreateString(hostile));
        cJSON_AddStringToObject(cJSON_GetObjectItem(run, "reasons"), "worker_ms", hostile);
        cJSON_ReplaceItemInObject(run, "worker_ms", cJSON_CreateNull());
    }
    static const char *const groups[] = {"machine", "build", "gl", "scene", "path", "method"};
    for (int i = 0; i < 6; i++) {
        cJSON *group = cJSON_GetObjectItem(root, groups[i]);
        for (int k = 0; k < cJSON_GetArraySize(group); k++) {
            cJSON *item = cJSON_GetArrayItem(group, k);
            if (cJSON_IsString(item)) cJSON_SetValuestring(item, hostile);
        }
    }
    cJSON_DeleteItemFromObject(root, "command");
    cJSON_AddStringToObject(root, "command", hostile);
    cJSON_DeleteItemFromObject(root, "frontier");
    char *page = page_of(root);
    assert_null(strstr(page, "<script"));
    assert_null(strstr(page, "<b id"));
    assert_null(strchr(page, '\x01'));
    assert_null(strchr(page, '\xff'));
    char command[1400];
    snprintf(command, sizeof command, "xmllint --noout %s", in_folder("figures/frontier.svg"));
    if (run_quietly("gnuplot --version") == 0 && run_quietly("xmllint --version") == 0)
        assert_int_equal(run_quietly(command), 0);
    free(page);
}

static void files_outside_the_folder_are_not_read(void **state)
{
    (void)state;
    static const char *const names[] = {"/etc/hostname", "../test.png", "frames/../../x.csv"};
    for (int i = 0; i < 3; i++) {
        cJSON *root = make_results(), *run;
        cJSON_ArrayForEach(run, cJSON_GetObjectItem(root, "runs"))
        {
            cJSON_ReplaceItemInObject(run, "frames_csv", cJSON_CreateString(names[i]));
            cJSON *picture = cJSON_GetArrayItem(cJSON_GetObjectItem(run, "pictures"), 0);
            if (picture) cJSON_ReplaceItemInObject(picture, "picture", cJSON_CreateString(names[i]));
        }
        char *page = page_of(root);
        assert_contains(page, "No picture: as drawn");
        assert_contains(page, "No figure: the numbers it needs were not measured");
        free(page);
    }
}

static void page_without_gnuplot(void **state)
{
    (void)state;
    char path[4096];
    snprintf(path, sizeof path, "%s", getenv("PATH"));
    setenv("PATH", folder, 1);
    char *page = page_of(make_results());
    setenv("PATH", path, 1);
    assert_contains(page, "This figure needs gnuplot");
    assert_null(strstr(page, "<svg"));
    assert_int_equal(access(in_folder("figures/frontier.gp"), R_OK), 0);
    assert_int_not_equal(access(in_folder("figures/frontier.svg"), R_OK), 0);
    assert_no_litter("figures");
    free(page);
}

// Lines that report_write(path) leaves on stderr; it must refuse.
static int lines_of_refusal(const char *path)
{
    FILE *lines = tmpfile();
    int kept = silence_begin(lines);
    bool good = report_write(path);
    silence_end(kept);
    assert_false(good);
    rewind(lines);
    int count = 0;
    for (int c; (c = fgetc(lines)) != EOF;) count += c == '\n';
    fclose(lines);
    return count;
}

static void broken_input_is_one_line_and_no_page(void **state)
{
    (void)state;
    static const char *const broken[] = {"",
                                         "{",
                                         "[]",
                                         "{}",
                                         "{\"schema\": 2}",
                                         "{\"schema\": 1} trailing",
                                         "{\"schema\": null}",
                                         "nonsense",
                                         "{\"schema\": 1, \"runs\": [}"};
    clear_folder(folder);
    assert_int_equal(lines_of_refusal(folder), 1); // no results.json
    assert_int_equal(lines_of_refusal(in_folder("nowhere")), 1);
    for (size_t i = 0; i < sizeof broken / sizeof broken[0]; i++) {
        write_text("results.json", broken[i]);
        assert_int_equal(lines_of_refusal(folder), 1);
        assert_int_not_equal(access(in_folder("index.html"), F_OK), 0);
        assert_int_not_equal(access(in_folder("figures"), F_OK), 0);
    }
    write_text("figures", "a file where the folder belongs");
    cJSON *root = make_results();
    write_results(root);
    cJSON_Delete(root);
    assert_int_equal(lines_of_refusal(folder), 1);
    assert_int_not_equal(access(in_folder("index.html"), F_OK), 0);
    unlink(in_folder("figures"));
    assert_int_equal(mkdir(in_folder("index.html"), 0777), 0); // the page cannot take its place
    assert_int_equal(lines_of_refusal(folder), 1);
    assert_no_litter(".");
}

// Counts are told digit by digit, those that nobody reads so by three digits and a power of ten.
static void counts_of_any_size_are_told(void **state)
{
    (void)state;
    char text[NUMBER_TEXT];
    assert_string_equal(count_text(1234567, text), "1\u202f234\u202f567");
    assert_string_equal(count_text(2504824997806080.0, text), "2.50\u00d710\u00b9\u2075");
    assert_string_equal(number_text(2504824997806080.0, text), "2.50\u00d710\u00b9\u2075");
    assert_string_equal(count_text(999900000000000.0, text), "999\u202f900\u202f000\u202f000\u202f000");
    assert_string_equal(count_text(HUGE_VAL, text), "\u2013");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
#define CASE(name) cmocka_unit_test_setup_teardown(name, setup, folder_remove)
        CASE(page_is_whole_and_self_contained),
        CASE(figures_are_valid_and_ids_do_not_clash),
        CASE(lines_join_sweeps_alone),
        CASE(verdict_names_the_faster),
        CASE(verdict_cannot_tell),
        CASE(motion_tightness_and_counters_are_shown),
        CASE(frames_that_do_not_follow_each_other_are_said),
        CASE(results_without_later_fields_have_a_page),
        CASE(what_was_not_measured_claims_nothing),
        CASE(holes_and_broken_promises_are_said),
        CASE(no_number_is_no_number),
        cmocka_unit_test(counts_of_any_size_are_told),
        CASE(survives_missing_fields),
        CASE(incomplete_single_and_empty),
        CASE(nothing_from_the_files_becomes_markup),
        CASE(files_outside_the_folder_are_not_read),
        CASE(page_without_gnuplot),
        CASE(broken_input_is_one_line_and_no_page),
    };
    return cmocka_run_group_tests_name("report", tests, NULL, NULL);
}
