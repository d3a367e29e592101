// `terrain compare`: two maps against each other, or one map through every coder there is.
// SPDX-License-Identifier: MIT
#include "common/cli.h"
#include "common/report.h"
#include "common/terrain/heightfield.h"
#include "common/terrain/relief/peer_coders.h"
#include "common/terrain/relief/relief_file.h"
#include "common/terrain/relief/relief_pack.h"
#include "common/terrain/relief/relief_program.h"
#include "common/terrain/relief/relief_source.h"
#include "common/terrain/voids.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static double file_bytes(const char *path)
{
    struct stat status;
    return stat(path, &status) == 0 ? (double)status.st_size : 0;
}

// ---- two maps --------------------------------------------------------------

struct difference {
    double rms_m, max_m, mean_m;
    int64_t compared, voids; // samples that both have; that one lacks
};

static struct difference difference_of(const struct heightfield *a, const struct heightfield *b)
{
    struct difference d = {0};
    double squares = 0, sum = 0;
    for (int64_t i = 0; i < a->width * a->height; i++) {
        bool known = a->samples[i] != HEIGHTFIELD_VOID && b->samples[i] != HEIGHTFIELD_VOID;
        d.compared += known;
        d.voids += !known;
        if (!known) continue;
        double off =
            (b->quantum_m * b->samples[i] + b->offset_m) - (a->quantum_m * a->samples[i] + a->offset_m);
        squares += off * off;
        sum += off;
        d.max_m = fabs(off) > d.max_m ? fabs(off) : d.max_m;
    }
    if (d.compared) d.rms_m = sqrt(squares / (double)d.compared), d.mean_m = sum / (double)d.compared;
    return d;
}

static void print_difference(const struct difference *d, const char *const names[2], const double seconds[2],
                             double samples, bool json)
{
    double bytes[2] = {file_bytes(names[0]), file_bytes(names[1])};
    if (!json) {
        printf("rms %.4g m, max %.4g m, mean %.3g m over %lld samples; %lld void in one of them\n", d->rms_m,
               d->max_m, d->mean_m, (long long)d->compared, (long long)d->voids);
        for (int i = 0; i < 2; i++)
            printf("%s: %.0f bytes, %.4f bits a sample, read in %.3f s of CPU time\n", names[i], bytes[i],
                   8 * bytes[i] / samples, seconds[i]);
        return;
    }
    cJSON *root = cJSON_CreateObject(), *files = cJSON_CreateArray();
    cJSON_AddNumberToObject(root, "rms_m", d->rms_m);
    cJSON_AddNumberToObject(root, "max_m", d->max_m);
    cJSON_AddNumberToObject(root, "mean_m", d->mean_m);
    cJSON_AddNumberToObject(root, "compared", (double)d->compared);
    cJSON_AddNumberToObject(root, "voids", (double)d->voids);
    cJSON_AddItemToObject(root, "files", files);
    for (int i = 0; i < 2; i++) {
        cJSON *item = cJSON_CreateObject();
        cJSON_AddItemToArray(files, item);
        cJSON_AddStringToObject(item, "file", names[i]);
        cJSON_AddNumberToObject(item, "bytes", bytes[i]);
        cJSON_AddNumberToObject(item, "bits_per_sample", 8 * bytes[i] / samples);
        cJSON_AddNumberToObject(item, "read_cpu_s", seconds[i]);
    }
    char *text = cJSON_Print(root);
    if (text) puts(text);
    cJSON_free(text);
    cJSON_Delete(root);
}

static int compare_maps(const char *const words[2], bool json)
{
    struct heightfield fields[2] = {0};
    double seconds[2] = {0, 0};
    bool good = true;
    for (int i = 0; good && i < 2; i++) {
        double start = coder_cpu_seconds();
        good = heightfield_load(&fields[i], words[i]);
        seconds[i] = coder_cpu_seconds() - start;
        good = good && (!fields[i].pixel_centred || relief_source_lines(&fields[i]));
    }
    if (good && (fields[0].width != fields[1].width || fields[0].height != fields[1].height))
        good = fail("%s: %lld x %lld samples, but %s has %lld x %lld; equal sizes are expected", words[1],
                    (long long)fields[1].width, (long long)fields[1].height, words[0],
                    (long long)fields[0].width, (long long)fields[0].height);
    if (good) {
        struct difference d = difference_of(&fields[0], &fields[1]);
        print_difference(&d, words, seconds, (double)fields[0].width * (double)fields[0].height, json);
    }
    for (int i = 0; i < 2; i++) heightfield_finish(&fields[i]);
    return good ? EXIT_GOOD : EXIT_WORLD;
}

// ---- one map through every coder -------------------------------------------

// Packs to a file of its own, reads it back whole and removes it.
static struct coder_run run_layout(enum layout layout, const char *name, struct heightfield *field,
                                   const struct coder_aim *aim)
{
    struct coder_run run = {.coder = name, .reason = "it failed; see above"};
    struct relief_pack_options options = {.layout = layout, .rms_m = aim->rms_m, .max_m = aim->max_m};
    struct relief_header header;
    struct heightfield back = {0};
    char folder[] = "/tmp/relief-XXXXXX", path[64];
    if (!mkdtemp(folder)) {
        run.reason = "/tmp cannot be written";
        return run;
    }
    snprintf(path, sizeof path, "%s/map.relief", folder);
    bool search = aim->rms_m > 0 && (layout == LAYOUT_BOUNDED || layout == LAYOUT_PYRAMID);
    bool good = !search || relief_pack_max_for_rms(field, &options, aim->rms_m);
    double start = coder_cpu_seconds();
    good = good && relief_pack(field, &options, path, &header);
    double middle = coder_cpu_seconds();
    good = good && relief_load(&back, path);
    run.encode_s = middle - start;
    run.decode_s = coder_cpu_seconds() - middle;
    if (good) {
        run.reason = NULL;
        run.bytes = (double)(RELIEF_HEADER + header.payload_bytes + header.base_bytes + header.index_bytes);
        coder_errors(field, &back, &run.rms_m, &run.max_m);
    }
    free(back.samples);
    unlink(path);
    rmdir(folder);
    return run;
}

static const struct {
    enum layout layout;
    const char *name;
} OWN[] = {{LAYOUT_WAVELET, "relief wavelet"},
           {LAYOUT_BOUNDED, "relief bounded"},
           {LAYOUT_PYRAMID, "relief pyramid"},
           {LAYOUT_MARS, "relief mars (whatever the aim)"},
           {LAYOUT_RAW, "relief raw"}};

static double mb_a_second(double samples, double seconds)
{
    return seconds > 0 ? 2 * samples / 1e6 / seconds : 0;
}

static void print_run(const struct coder_run *run, double samples, cJSON *list)
{
    if (!list && run->reason)
        printf("%-36s not measured: %s\n", run->coder, run->reason);
    else if (!list)
        printf("%-36s %11.0f %8.4f %9.4g %9.4g %8.1f %8.1f\n", run->coder, run->bytes,
               8 * run->bytes / samples, run->rms_m, run->max_m, mb_a_second(samples, run->encode_s),
               mb_a_second(samples, run->decode_s));
    if (!list) return;
    cJSON *item = cJSON_CreateObject();
    cJSON_AddItemToArray(list, item);
    cJSON_AddStringToObject(item, "coder", run->coder);
    if (run->reason) {
        cJSON_AddStringToObject(item, "reason", run->reason);
        return;
    }
    cJSON_AddNumberToObject(item, "bytes", run->bytes);
    cJSON_AddNumberToObject(item, "bits_per_sample", 8 * run->bytes / samples);
    cJSON_AddNumberToObject(item, "rms_m", run->rms_m);
    cJSON_AddNumberToObject(item, "max_m", run->max_m);
    cJSON_AddNumberToObject(item, "encode_mb_s", mb_a_second(samples, run->encode_s));
    cJSON_AddNumberToObject(item, "decode_mb_s", mb_a_second(samples, run->decode_s));
}

static void run_coders(struct heightfield *field, const struct coder_aim *aim, cJSON *list)
{
    double samples = (double)field->width * (double)field->height;
    if (!list)
        printf("%-36s %11s %8s %9s %9s %8s %8s\n", "coder", "bytes", "bits", "rms, m", "max, m", "enc MB/s",
               "dec MB/s");
    for (size_t i = 0; i < sizeof OWN / sizeof *OWN; i++) {
        enum layout layout = OWN[i].layout;
        if (layout == LAYOUT_WAVELET && !(aim->rms_m > 0)) continue; // it knows no largest error
        struct coder_run run = run_layout(layout, OWN[i].name, field, aim);
        print_run(&run, samples, list);
    }
    for (int i = 0; i < peer_coder_count(); i++) {
        struct coder_run run = peer_coder_run(i, field, aim);
        print_run(&run, samples, list);
    }
}

static int compare_coders(const char *path, const struct coder_aim *aim, bool json)
{
    struct heightfield field;
    if (!heightfield_load(&field, path)) return EXIT_WORLD;
    field.radius_m = 0; // the raster, as the others see it
    bool good = voids_count(field.samples, (size_t)(field.width * field.height)) == 0 ||
                voids_fill(field.samples, field.width, field.height) ||
                fail("%s: its voids cannot be filled; at least one height is expected", path);
    cJSON *list = json ? cJSON_CreateArray() : NULL;
    if (good) run_coders(&field, aim, list);
    if (good && !json)
        printf("Rates: 16-bit samples in MB a second of CPU time, whole map; of wavelet the search for its "
               "steps is part of encoding, of the others one encoding at the setting found.  The side "
               "section of "
               "relief (extrema, errors, checksums) is not counted.\n");
    char *text = json ? cJSON_Print(list) : NULL;
    if (text) puts(text);
    cJSON_free(text);
    cJSON_Delete(list);
    heightfield_finish(&field);
    return good ? EXIT_GOOD : EXIT_WORLD;
}

// ---- the command -----------------------------------------------------------

int relief_compare_main(int argc, char **argv)
{
    const char *words[2] = {NULL, NULL};
    bool json = false, lossless = false;
    double rms_m = -1, max_m = -1;
    int count = 2;
    const struct cli_option options[] = {
        {"rms", "M", "one map: through every coder at this rms error, metres", CLI_NUMBER, &rms_m, 0, 1e6,
         NULL},
        {"max", "M", "one map: at this largest error, metres", CLI_NUMBER, &max_m, 0, 1e6, NULL},
        {"lossless", NULL, "one map: without error", CLI_FLAG, &lossless, 0, 0, NULL},
        {"json", NULL, "print JSON", CLI_FLAG, &json, 0, 0, NULL},
        {NULL, NULL, NULL, CLI_FLAG, NULL, 0, 0, NULL},
    };
    if (!cli_parse(argc, argv, options, words, &count)) return EXIT_COMMAND_LINE;
    int said = (rms_m >= 0) + (max_m >= 0) + lossless;
    if ((count != 2 || said != 0) && (count != 1 || said != 1))
        return fail("compare: two elevation files, or one and an aim (--rms M, --max M or --lossless) are "
                    "expected"),
               EXIT_COMMAND_LINE;
    if (count == 2) return compare_maps(words, json);
    const struct coder_aim aim = {rms_m > 0 ? rms_m : 0, max_m > 0 ? max_m : 0};
    return compare_coders(words[0], &aim, json);
}
