// The tile coder beside other people's on whole maps, at equal errors: the bars that it is held to.
// SPDX-License-Identifier: MIT
#include "bench/papers/papers.h"
#include "common/report.h"
#include "common/terrain/relief/peer_coders.h"
#include "common/terrain/relief/relief_pack.h"
#include "common/terrain/voids.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { BAR, OWN, RMS, MAX, PEERS, COLUMNS = PAPERS_COLUMNS };

enum bar { BAR_BITS, BAR_OPENJPEG, BAR_JPEG_LS };

static const struct comparison {
    const char *file, *name;
    double rms_m, max_m; // both 0: lossless
    enum bar bar;
    double bits; // of BAR_BITS
} COMPARISONS[] = {{"puget_cascades_72m_2049x2817.png", "Cascades", 1, 0, BAR_BITS, 1.76},
                   {"puget_cascades_72m_2049x2817.png", "Cascades", 8, 0, BAR_BITS, .203},
                   {"puget_cascades_72m_2049x2817.png", "Cascades", 0, 4, BAR_BITS, 1.23},
                   {"puget_srtm3_strip_3601x1201.png", "Puget strip", 1, 0, BAR_OPENJPEG, 0},
                   {"puget_srtm3_strip_3601x1201.png", "Puget strip", 2, 0, BAR_OPENJPEG, 0},
                   {"puget_srtm3_strip_3601x1201.png", "Puget strip", 8, 0, BAR_OPENJPEG, 0},
                   {"mars_mola_4ppd_1440x720.png", "Mars", 8, 0, BAR_OPENJPEG, 0},
                   {"mars_mola_4ppd_1440x720.png", "Mars", 16, 0, BAR_OPENJPEG, 0},
                   {"mars_mola_4ppd_1440x720.png", "Mars", 64, 0, BAR_OPENJPEG, 0},
                   {"puget_srtm3_strip_3601x1201.png", "Puget strip", 0, 0, BAR_JPEG_LS, 0},
                   {"puget_1k_160m.png", "Puget 160 m", 0, 0, BAR_JPEG_LS, 0},
                   {"puget_cascades_72m_2049x2817.png", "Cascades", 0, 0, BAR_JPEG_LS, 0}};
enum { COMPARISON_COUNT = sizeof COMPARISONS / sizeof *COMPARISONS };

static bool run_own(struct heightfield *field, const struct comparison *c, double values[COLUMNS])
{
    const struct relief_pack_options options = {
        .layout = c->rms_m > 0 ? LAYOUT_WAVELET : LAYOUT_BOUNDED, .rms_m = c->rms_m, .max_m = c->max_m};
    struct relief_header h;
    if (!relief_pack(field, &options, NULL, &h)) return false;
    double bytes = (double)(RELIEF_HEADER + h.payload_bytes + h.base_bytes + h.index_bytes);
    values[OWN] = 8 * bytes / ((double)field->width * (double)field->height);
    values[RMS] = h.rms_m, values[MAX] = h.max_m;
    return true;
}

static void run_peers(const struct heightfield *field, const struct comparison *c, double values[COLUMNS])
{
    const struct coder_aim aim = {c->rms_m, c->max_m};
    double samples = (double)field->width * (double)field->height;
    values[BAR] = c->bar == BAR_BITS ? c->bits : (double)NAN;
    for (int i = 0; i < peer_coder_count() && PEERS + i < COLUMNS; i++) {
        const struct coder_run run = peer_coder_run(i, field, &aim);
        if (run.reason) continue;
        values[PEERS + i] = 8 * run.bytes / samples;
        if (c->bar == BAR_OPENJPEG && strncmp(run.coder, "OpenJPEG", 8) == 0) values[BAR] = values[PEERS + i];
        if (c->bar == BAR_JPEG_LS && strncmp(run.coder, "CharLS", 6) == 0)
            values[BAR] = 1.05 * values[PEERS + i];
    }
}

static bool compare(struct papers_table *table, const struct comparison *c, const char *path)
{
    struct heightfield field;
    if (!heightfield_load(&field, path)) return false;
    field.radius_m = 0; // the raster, as the others see it
    bool good = voids_fill(field.samples, field.width, field.height) || fail("%s: out of memory", path);
    double *values = c->rms_m > 0   ? papers_row(table, "%s, rms %g m", c->name, c->rms_m)
                     : c->max_m > 0 ? papers_row(table, "%s, max %g m", c->name, c->max_m)
                                    : papers_row(table, "%s, lossless", c->name);
    good = good && run_own(&field, c, values);
    if (good) run_peers(&field, c, values);
    heightfield_finish(&field);
    return good;
}

bool papers_coders(struct papers *papers, struct papers_table *table)
{
    char path[1024];
    (void)papers;
    snprintf(table->title, sizeof table->title, "Bits a sample at equal error, beside other coders");
    snprintf(table->row_name, sizeof table->row_name, "terrain, aim");
    static const char *const OURS[PEERS] = {"at most", "relief", "relief rms", "relief max"};
    for (int k = 0; k < PEERS; k++) papers_column(table, OURS[k], k < RMS ? "bits" : "m", false);
    for (int i = 0; i < peer_coder_count() && PEERS + i < COLUMNS; i++) {
        char name[32];
        snprintf(name, sizeof name, "%.*s", (int)strcspn(peer_coder_name(i), " "), peer_coder_name(i));
        papers_column(table, name, "bits", false);
    }
    for (int i = 0; i < COMPARISON_COUNT; i++) {
        if (!papers_data(table, COMPARISONS[i].file, path)) return true;
        if (!compare(table, &COMPARISONS[i], path)) return false;
    }
    papers_note(table,
                "At most: what is asked of ours.  Of the Cascades figures in bits, of the strip and Mars "
                "what OpenJPEG needs at the same rms error, without loss 1.05 times what JPEG-LS "
                "(CharLS) needs.  Ours counts header, tiles, base and index; tiles of 64 x 64 samples "
                "decode alone, the others' files only whole.  Each of the others is run at the coarsest "
                "setting that keeps the error.  Tables of ours were trained on three other maps.");
    return true;
}
