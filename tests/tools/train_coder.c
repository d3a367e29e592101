// Trains the tile coder's tables: packs the maps given at many rates, counts what the coder sees, and prints
// common/terrain/relief/coder_tables.c.  Choices made while packing hang on the tables, so `make tables`
// starts from those that are printed when no map is given, and runs it again with what came out: the same
// every time. SPDX-License-Identifier: MIT
#include "common/report.h"
#include "common/terrain/relief/relief_format.h"
#include "common/terrain/relief/relief_pack.h"

#include <stdio.h>
#include <stdlib.h>

static bool count(const char *path, enum layout layout, double error_m, struct coder_counts *counts)
{
    struct heightfield field;
    struct relief_header header;
    struct relief_pack_options options = {
        .layout = layout, .rms_m = error_m, .max_m = error_m, .threads = 1, .counts = counts};
    bool good = heightfield_load(&field, path) && relief_pack(&field, &options, NULL, &header);
    heightfield_finish(&field);
    return good;
}

// Frequencies of a context: at least 1 each, 2^CODER_BITS together.  Contexts that were hardly seen lean on
// `likely`.
static void normalise(const uint64_t seen[CODER_TOKENS], const double likely[CODER_TOKENS],
                      double share[CODER_TOKENS], int frequency[CODER_TOKENS])
{
    const double whole = 1 << CODER_BITS, belief = 50;
    double total = belief;
    int sum = 0, most = 0;
    for (int t = 0; t < CODER_TOKENS; t++) total += (double)seen[t];
    for (int t = 0; t < CODER_TOKENS; t++) {
        share[t] = ((double)seen[t] + belief * likely[t]) / total;
        frequency[t] = (int)(share[t] * (whole - CODER_TOKENS)) + 1;
        sum += frequency[t];
        if (frequency[t] > frequency[most]) most = t;
    }
    frequency[most] += (1 << CODER_BITS) - sum;
}

static void print_tables(const struct coder_counts *counts)
{
    printf("// Made by `make tables`; do not edit.  SPDX-License-Identifier: MIT\n"
           "#include \"common/terrain/relief/coder.h\"\n\n// clang-format off\nconst struct coder_tables "
           "CODER_TABLES = {{\n");
    uint8_t words[2 * CODER_SETS * CODER_CONTEXTS * CODER_TOKENS], *word = words; // little-endian
    for (int set = 0; set < CODER_SETS; set++) {
        double share[CODER_TOKENS];
        for (int t = 0; t < CODER_TOKENS; t++) share[t] = 1.0 / CODER_TOKENS;
        printf("{ // set %d\n", set);
        for (int c = 0; c < CODER_CONTEXTS; c++) {
            int frequency[CODER_TOKENS], start = 0;
            normalise(counts->of[set][c], share, share, frequency);
            printf("{");
            for (int t = 0; t < CODER_TOKENS; start += frequency[t++]) {
                printf("%d%s", start, t + 1 < CODER_TOKENS ? "," : "");
                *word++ = (uint8_t)start, *word++ = (uint8_t)(start >> 8);
            }
            printf("},\n");
        }
        printf("},\n");
    }
    printf("}};\nconst uint32_t CODER_TABLES_CRC = 0x%08x;\n", relief_crc(words, sizeof words));
}

// Geometric distributions: a mean of 0.05 in the first context, 1.3 times more from context to context.
static void guess(struct coder_counts *counts)
{
    const int first[CODER_TOKENS + 1] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 24, 32, 48, 64, 128, 4096};
    for (int set = 0; set < CODER_SETS; set++) {
        double mean = 0.05;
        for (int c = 0; c < CODER_CONTEXTS; c++, mean *= 1.3) {
            double ratio = mean / (1 + mean), left = 1e6; // as many magnitudes are at least n
            for (int n = 0, token = 0; n < first[CODER_TOKENS]; n++, left *= ratio) {
                if (n == first[token + 1]) token++;
                counts->of[set][c][token] += (uint64_t)(left * (1 - ratio));
            }
        }
    }
}

int main(int argc, char **argv)
{
    static const double RMS_M[] = {0.25, 0.5, 1, 2, 4, 8, 16}, MAX_M[] = {0, 0.5, 1, 2, 4, 8, 16, 32};
    struct coder_counts *counts = calloc(1, sizeof *counts);
    if (!counts) return fail("train_coder: out of memory"), EXIT_WORLD;
    if (argc < 2) guess(counts);
    for (int i = 1; i < argc; i++) {
        for (size_t k = 0; k < sizeof RMS_M / sizeof *RMS_M; k++)
            if (!count(argv[i], LAYOUT_WAVELET, RMS_M[k], counts))
                note("%s is left out at that rate", argv[i]);
        for (size_t k = 0; k < sizeof MAX_M / sizeof *MAX_M; k++)
            for (enum layout layout = LAYOUT_BOUNDED; layout <= LAYOUT_PYRAMID; layout++)
                if (!count(argv[i], layout, MAX_M[k], counts)) return free(counts), EXIT_WORLD;
    }
    print_tables(counts);
    free(counts);
    return EXIT_GOOD;
}
