// SPDX-License-Identifier: MIT
#include "common/terrain/relief_pack.h"

#include "common/parallel.h"
#include "common/report.h"
#include "common/terrain/upsample.h"
#include "common/terrain/voids.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum {
    ROWS_A_BLOCK = 128,
    LAMBDA_65536 = 26 << 8, // 0.1 step^2 a bit (Sullivan & Wiegand 1998: rate against distortion)
    MOST_LAMBDA = 1 << 26,
};

struct packed_tile {
    uint8_t *data;
    uint32_t bytes;
    int32_t min_q, max_q;
    uint32_t error_q;
};

struct pack {
    const struct heightfield *field;
    const struct relief_pack_options *options;
    struct grid grid;
    enum layout layout;
    int fraction_bits;
    int32_t lambda_65536;
    bool uneven; // coder.h
    int32_t step[LAYOUT_LEVELS][CODER_BANDS];
    int32_t *levels[LAYOUT_LEVELS]; // as decoded, internal units, at the end quanta
    struct patch details[LAYOUT_LEVELS]
                        [CODER_BANDS]; // wavelet: coefficients; [0]: the coarser level, filtered
    struct patch decoded[CODER_BANDS]; // of the level at hand
    struct packed_tile *tiles;
    bool write; // else only what would be decoded is wanted
    bool failed;
    int level; // at hand
};

static int64_t samples_of(const struct grid *grid, int level)
{
    return grid->size[level][0] * grid->size[level][1];
}

static int64_t smaller(int64_t a, int64_t b)
{
    return a < b ? a : b;
}

// ---- making and unmaking ---------------------------------------------------

static bool allocate_bands(const struct grid *grid, int level, int first, struct patch bands[CODER_BANDS])
{
    for (int b = first; b < CODER_BANDS; b++) {
        int64_t width = grid_band_size(grid, level, b, 0), height = grid_band_size(grid, level, b, 1);
        bands[b].rect = (struct rect){0, 0, width, height};
        free(bands[b].samples);
        bands[b].samples = malloc((size_t)(width * height + 1) * sizeof(int32_t));
        if (!bands[b].samples) return false;
    }
    return true;
}

static bool allocate(struct pack *p)
{
    int top = p->grid.count - 1;
    p->tiles = calloc((size_t)p->grid.tile_count + 1, sizeof *p->tiles);
    if (!p->tiles) return false;
    for (int l = 0; l <= top; l++) {
        p->levels[l] = malloc((size_t)samples_of(&p->grid, l) * sizeof *p->levels[l]);
        if (!p->levels[l]) return false;
        if (p->layout == LAYOUT_WAVELET && l < top && !allocate_bands(&p->grid, l, 0, p->details[l]))
            return false;
    }
    return p->layout != LAYOUT_WAVELET || top == 0 || allocate_bands(&p->grid, 0, BAND_HL, p->decoded);
}

static void finish(struct pack *p)
{
    for (int64_t i = 0; p->tiles && i < p->grid.tile_count; i++) free(p->tiles[i].data);
    free(p->tiles);
    for (int l = 0; l < LAYOUT_LEVELS; l++) {
        free(p->levels[l]);
        for (int b = 0; b < CODER_BANDS; b++) free(p->details[l][b].samples);
    }
    for (int b = BAND_HL; b < CODER_BANDS; b++) free(p->decoded[b].samples);
}

// ---- one tile --------------------------------------------------------------

static void keep_tile(struct pack *p, int64_t number, const struct coder_tile *tile, const coder_band *k)
{
    uint8_t data[CODER_MAX_BYTES];
    struct packed_tile *to = &p->tiles[number];
    to->bytes = (uint32_t)coder_encode(tile, k, data, p->options->counts);
    to->data = malloc(to->bytes + 1);
    if (to->data)
        memcpy(to->data, data, to->bytes);
    else
        p->failed = true;
}

static void wavelet_tile(struct pack *p, struct layout_tile *tile, int64_t tx, int64_t ty, coder_band *k)
{
    static const coder_band NONE;
    coder_band values[CODER_BANDS];
    int64_t x0 = tx * CODER_TILE, y0 = ty * CODER_TILE;
    const struct coder_tile *coder = &tile->coder;
    memcpy(values[0], NONE, sizeof NONE);
    for (int b = BAND_HL; b <= BAND_HH; b++)
        for (int y = 0; y < coder->height[b]; y++)
            memcpy(values[b] + y * CODER_TILE, patch_at(&p->details[p->level][b], x0, y0 + y),
                   (size_t)coder->width[b] * sizeof(int32_t));
    struct coder_rate rate = {(const coder_band *)values, p->step[p->level], p->lambda_65536, p->uneven};
    coder_quantise(coder, &rate, k);
    for (int b = BAND_HL; b <= BAND_HH; b++)
        for (int y = 0; y < coder->height[b]; y++)
            for (int x = 0; x < coder->width[b]; x++)
                *patch_at(&p->decoded[b], x0 + x, y0 + y) = k[b][y * CODER_TILE + x] * p->step[p->level][b];
}

static void bounded_tile(struct pack *p, struct layout_tile *tile, int64_t tx, int64_t ty, coder_band *k)
{
    enum { S = LAYOUT_SAMPLES };
    int32_t wanted[S * S] = {0}, samples[S * S];
    const int64_t *size = p->grid.size[p->level];
    int64_t x0 = tx * S, y0 = ty * S, columns = smaller(S, size[0] - x0), rows = smaller(S, size[1] - y0);
    for (int64_t y = 0; y < rows; y++) {
        const int32_t *source = p->field->samples + ((y0 + y) << p->level) * p->field->width;
        for (int64_t x = 0; x < columns; x++) wanted[y * S + x] = source[(x0 + x) << p->level];
    }
    layout_bounded_tile(tile, p->step[p->level][BAND_HL], wanted, k, samples);
    for (int64_t y = 0; y < rows; y++)
        memcpy(p->levels[p->level] + (y0 + y) * size[0] + x0, samples + y * S,
               (size_t)columns * sizeof *samples);
}

static void pack_tile_row(int block, void *user)
{
    struct pack *p = user;
    struct layout_tile tile;
    coder_band k[CODER_BANDS];
    const int64_t *coarse_size = p->grid.size[p->level + 1];
    const struct patch coarse = {{0, 0, coarse_size[0], coarse_size[1]}, p->levels[p->level + 1]};
    for (int64_t tx = 0; tx < p->grid.tiles[p->level][0]; tx++) {
        layout_tile_init(&tile, p->layout, &p->grid, p->level, tx, block, &coarse, p->step[p->level]);
        memset(k, 0, sizeof k);
        if (p->layout == LAYOUT_WAVELET)
            wavelet_tile(p, &tile, tx, block, k);
        else
            bounded_tile(p, &tile, tx, block, k);
        if (p->write)
            keep_tile(p, p->grid.first_tile[p->level] + block * p->grid.tiles[p->level][0] + tx, &tile.coder,
                      (const coder_band *)k);
    }
}

// ---- all levels, from the coarsest, as a decoder will see them -------------

static void inverse_rows(int block, void *user)
{
    struct pack *p = user;
    int64_t width = p->grid.size[p->level][0], y = (int64_t)block * ROWS_A_BLOCK;
    int64_t end = smaller(y + ROWS_A_BLOCK, p->grid.size[p->level][1]);
    const struct patch wanted = {{0, y, width, end}, p->levels[p->level] + y * width};
    struct patch bands[CODER_BANDS];
    memcpy(bands, p->decoded, sizeof bands);
    const int64_t *coarse_size = p->grid.size[p->level + 1];
    bands[0] = (struct patch){{0, 0, coarse_size[0], coarse_size[1]}, p->levels[p->level + 1]};
    if (!layout_wavelet_inverse(&p->grid, p->level, bands, &wanted)) p->failed = true;
}

static int32_t rounded_quotient(int32_t value, int32_t step)
{
    return value >= 0 ? (value + step / 2) / step : -((step / 2 - value) / step);
}

static void pack_base(struct pack *p)
{
    int top = p->grid.count - 1;
    const int64_t *size = p->grid.size[top];
    for (int64_t y = 0; y < size[1]; y++)
        for (int64_t x = 0; x < size[0]; x++) {
            int64_t at = y * size[0] + x;
            int32_t value =
                p->layout == LAYOUT_WAVELET && top > 0
                    ? p->details[top - 1][0].samples[at]
                    : p->field->samples[(y << top) * p->field->width + (x << top)] * (1 << p->fraction_bits);
            p->levels[top][at] = rounded_quotient(value, p->step[top][0]) * p->step[top][0];
        }
}

static bool pack_levels(struct pack *p, bool write)
{
    p->write = write;
    pack_base(p);
    for (p->level = p->grid.count - 2; p->level >= 0; p->level--) {
        for (int b = BAND_HL; b < CODER_BANDS && p->layout == LAYOUT_WAVELET; b++)
            p->decoded[b].rect = p->details[p->level][b].rect;
        parallel_blocks((int)p->grid.tiles[p->level][1], p->options->threads, pack_tile_row, p);
        int64_t rows = p->grid.size[p->level][1];
        if (p->layout == LAYOUT_WAVELET)
            parallel_blocks((int)((rows + ROWS_A_BLOCK - 1) / ROWS_A_BLOCK), p->options->threads,
                            inverse_rows, p);
    }
    return !p->failed;
}

// ---- errors ----------------------------------------------------------------

static int32_t quanta(const struct pack *p, int32_t value)
{
    int32_t round = p->fraction_bits ? 1 << (p->fraction_bits - 1) : 0,
            q = (value + round) >> p->fraction_bits;
    return q > QUANTA_LIMIT ? QUANTA_LIMIT : q < -QUANTA_LIMIT ? -QUANTA_LIMIT : q;
}

static void measure(const struct pack *p, struct relief_header *h)
{
    int64_t count = samples_of(&p->grid, 0), most = 0;
    double squares = 0;
    for (int64_t i = 0; i < count; i++) {
        int64_t d = llabs((int64_t)quanta(p, p->levels[0][i]) - p->field->samples[i]);
        squares += (double)(d * d);
        most = d > most ? d : most;
    }
    h->rms_m = sqrt(squares / (double)count) * h->quantum_m;
    h->max_m = (double)most * h->quantum_m;
}

// ---- steps -----------------------------------------------------------------

static void set_bounded_steps(struct pack *p, double quantum_m)
{
    double most = floor(p->options->max_m / quantum_m * (1 + 1e-12));
    int32_t step = 2 * (int32_t)(most < QUANTA_LIMIT ? most : QUANTA_LIMIT) + 1;
    for (int l = 0; l < p->grid.count; l++)
        for (int b = 0; b < CODER_BANDS; b++) p->step[l][b] = step;
}

// Equal slopes of error against rate: a band's step is inverse to what its coefficients add to level 0.
static void set_wavelet_steps(struct pack *p, double step)
{
    const double least = step / 64; // a floor of step / 16 costs 2 % at low rates
    int top = p->grid.count - 1;
    for (int l = 0; l <= top; l++)
        for (int b = 0; b < CODER_BANDS; b++) {
            double norm = b == 0 ? layout_wavelet_norm(l > 0 ? l - 1 : 0, 0) : layout_wavelet_norm(l, b);
            double own = rint(fmax(step / norm, least));
            p->step[l][b] = own < 1 ? 1 : own < 1 << 27 ? (int32_t)own : 1 << 27;
        }
}

static bool forward(struct pack *p)
{
    int64_t count = samples_of(&p->grid, 0);
    for (int64_t i = 0; i < count; i++) p->levels[0][i] = p->field->samples[i] * (1 << p->fraction_bits);
    for (int l = 0; l < p->grid.count - 1; l++)
        if (!layout_wavelet_forward(&p->grid, l, l == 0 ? p->levels[0] : p->details[l - 1][0].samples,
                                    p->details[l]))
            return false;
    return true;
}

static bool try_steps(struct pack *p, struct relief_header *h, double step, int32_t lambda_65536)
{
    set_wavelet_steps(p, step);
    p->lambda_65536 = lambda_65536;
    if (!pack_levels(p, false)) return false;
    measure(p, h);
    return true;
}

// On smooth maps a few coefficients carry everything, and the error jumps when one of them changes.  Finer
// steps have smaller jumps: with them the error is brought up again by making rate dearer.
static bool trim(struct pack *p, struct relief_header *h, double step)
{
    enum { FINER = 20, TRIES = 14 };
    const double aim = p->options->rms_m;
    double best = step, best_rms_m = 0;
    int32_t best_lambda = 0; // exact
    p->uneven = true;
    for (int finer = 0; finer < FINER; finer++, step *= 0.9) {
        double low = LAMBDA_65536 / 8, high = MOST_LAMBDA;
        for (int i = 0; i < TRIES; i++) {
            int32_t lambda = (int32_t)sqrt(low * high);
            if (!try_steps(p, h, step, lambda)) return false;
            if (h->rms_m <= aim && h->rms_m > best_rms_m)
                best = step, best_lambda = lambda, best_rms_m = h->rms_m;
            if (best_rms_m >= 0.985 * aim) return true;
            *(h->rms_m <= aim ? &low : &high) = lambda;
        }
    }
    set_wavelet_steps(p, best);
    p->lambda_65536 = best_lambda;
    return true;
}

// Finds the largest steps that reach the rms: the error grows with the step, nearly in proportion.
static bool search_steps(struct pack *p, struct relief_header *h)
{
    enum { TRIES = 16 };
    const double aim = p->options->rms_m, unit = ldexp(h->quantum_m, -p->fraction_bits);
    double low = 0, high = INFINITY, step = aim / unit * 3.2, best = 0, best_rms_m = 0;
    for (int i = 0; i < TRIES; i++) {
        if (!try_steps(p, h, step, LAMBDA_65536)) return false;
        if (h->rms_m <= aim && (best == 0 || h->rms_m > best_rms_m)) best = step, best_rms_m = h->rms_m;
        *(h->rms_m <= aim ? &low : &high) = step;
        if (h->rms_m <= aim && h->rms_m >= 0.9985 * aim) return true;
        double guess = h->rms_m > 0 ? step * pow(0.9993 * aim / h->rms_m, 1.15) : 4 * step;
        bool inside = guess > low && guess < high && (i < 5 || i % 2);
        step = inside ? guess : isinf(high) ? 2 * step : low > 0 ? sqrt(low * high) : high / 2;
        if (step < 1 && best == 0) step = 1;
    }
    if (best == 0)
        return fail("%s: an rms error of %g m is finer than the map's own steps; --lossless is smaller",
                    p->field->name, aim);
    if (best_rms_m < 0.99 * aim) return trim(p, h, best);
    set_wavelet_steps(p, best);
    return true;
}

// ---- side section ----------------------------------------------------------

// A sample of a level; one beyond the last column or row continues the line through the last two, as what
// reads the file does.
static int64_t continued(const struct pack *p, int level, int64_t x, int64_t y)
{
    const int64_t *size = p->grid.size[level];
    if (x >= size[0] && size[0] == 1) x = 0;
    if (y >= size[1] && size[1] == 1) y = 0;
    if (y >= size[1]) return 2 * continued(p, level, x, size[1] - 1) - continued(p, level, x, size[1] - 2);
    if (x >= size[0]) return 2 * continued(p, level, size[0] - 1, y) - continued(p, level, size[0] - 2, y);
    return p->levels[level][y * size[0] + x];
}

// Largest |surface of this level - level 0| over the cells of one tile, rounded up; integers throughout.
static uint32_t surface_error(const struct pack *p, int level, int64_t x0, int64_t y0, int64_t x1, int64_t y1)
{
    const int64_t *size = p->grid.size[level], *fine = p->grid.size[0];
    int64_t cell = (int64_t)1 << level, most = 0;
    for (int64_t j = y0; j < smaller(y1, size[1]); j++)
        for (int64_t i = x0; i < smaller(x1, size[0]); i++) {
            int64_t sw = continued(p, level, i, j), se = continued(p, level, i + 1, j);
            int64_t nw = continued(p, level, i, j + 1), ne = continued(p, level, i + 1, j + 1);
            for (int64_t y = j << level; y <= smaller((j + 1) << level, fine[1] - 1); y++)
                for (int64_t x = i << level; x <= smaller((i + 1) << level, fine[0] - 1); x++) {
                    int64_t u = x - (i << level), v = y - (j << level);
                    int64_t height = u < v ? sw * cell + v * (nw - sw) + u * (ne - nw)
                                           : sw * cell + u * (se - sw) + v * (ne - se);
                    int64_t off = llabs(height - (int64_t)p->levels[0][y * fine[0] + x] * cell);
                    most = off > most ? off : most;
                }
        }
    int64_t error = (most + cell - 1) >> level;
    return error < UINT32_MAX ? (uint32_t)error : UINT32_MAX;
}

static void measure_tile_row(int block, void *user)
{
    struct pack *p = user;
    const int64_t *size = p->grid.size[p->level];
    int64_t y0 = (int64_t)block * LAYOUT_SAMPLES, y1 = smaller(y0 + LAYOUT_SAMPLES, size[1] - 1);
    for (int64_t tx = 0; tx < p->grid.tiles[p->level][0]; tx++) {
        int64_t x0 = tx * LAYOUT_SAMPLES, x1 = smaller(x0 + LAYOUT_SAMPLES, size[0] - 1);
        struct packed_tile *tile =
            &p->tiles[p->grid.first_tile[p->level] + block * p->grid.tiles[p->level][0] + tx];
        tile->min_q = INT32_MAX, tile->max_q = INT32_MIN;
        for (int64_t y = y0; y <= y1; y++)
            for (int64_t x = x0; x <= x1; x++) {
                int32_t q = p->levels[p->level][y * size[0] + x];
                tile->min_q = q < tile->min_q ? q : tile->min_q;
                tile->max_q = q > tile->max_q ? q : tile->max_q;
            }
        if (p->level > 0)
            tile->error_q = surface_error(p, p->level, x0, y0, x0 + LAYOUT_SAMPLES, y0 + LAYOUT_SAMPLES);
    }
}

static void measure_tiles(struct pack *p, struct relief_header *h)
{
    for (int l = 0; l < p->grid.count; l++)
        for (int64_t i = 0; i < samples_of(&p->grid, l); i++) p->levels[l][i] = quanta(p, p->levels[l][i]);
    for (p->level = 0; p->level < p->grid.count - 1; p->level++)
        parallel_blocks((int)p->grid.tiles[p->level][1], p->options->threads, measure_tile_row, p);
    h->min_q = INT32_MAX, h->max_q = INT32_MIN;
    for (int64_t i = 0; i < samples_of(&p->grid, 0); i++) {
        int32_t q = p->levels[0][i];
        h->min_q = q < h->min_q ? q : h->min_q;
        h->max_q = q > h->max_q ? q : h->max_q;
    }
}

// ---- writing ---------------------------------------------------------------

static void put_base(const struct pack *p, struct relief_bytes *to)
{
    int top = p->grid.count - 1;
    for (int l = 0; l < top; l++)
        for (int b = BAND_HL; b < CODER_BANDS; b++) relief_put_varint(to, (uint64_t)p->step[l][b]);
    relief_put_varint(to, (uint64_t)p->step[top][0]);
    int32_t before = 0;
    for (int64_t i = 0; i < samples_of(&p->grid, top); i++) {
        int32_t k = p->levels[top][i] / p->step[top][0]; // a multiple: pack_base
        relief_put_difference(to, (int64_t)k - before);
        before = k;
    }
}

static void put_tiles(const struct pack *p, struct relief_bytes *index, struct relief_bytes *side)
{
    int64_t low = 0;
    for (int64_t i = 0; i < p->grid.tile_count; i++) {
        const struct packed_tile *tile = &p->tiles[i];
        relief_put_varint(index, tile->bytes);
        if (tile->bytes) {
            uint32_t crc = relief_crc(tile->data, tile->bytes);
            const uint8_t bytes[4] = {(uint8_t)crc, (uint8_t)(crc >> 8), (uint8_t)(crc >> 16),
                                      (uint8_t)(crc >> 24)};
            relief_put(side, bytes, sizeof bytes);
        }
        relief_put_difference(side, tile->min_q - low);
        relief_put_varint(side, (uint64_t)((int64_t)tile->max_q - tile->min_q));
        const uint8_t code = relief_error_code(tile->error_q);
        relief_put(side, &code, 1);
        low = tile->min_q;
    }
}

static bool write_parts(FILE *file, const struct pack *p, const struct relief_header *h,
                        const struct relief_bytes parts[3])
{
    uint8_t header[RELIEF_HEADER];
    relief_header_write(h, header);
    bool good = fwrite(header, 1, sizeof header, file) == sizeof header;
    for (int64_t i = 0; good && i < p->grid.tile_count; i++)
        good = fwrite(p->tiles[i].data, 1, p->tiles[i].bytes, file) == p->tiles[i].bytes;
    for (int i = 0; good && i < 3; i++)
        good = !parts[i].size || fwrite(parts[i].data, 1, parts[i].size, file) == parts[i].size;
    return good;
}

static bool write_file(const struct pack *p, const struct relief_header *h,
                       const struct relief_bytes parts[3], const char *path)
{
    char part[4160];
    if (strlen(path) >= 4096) return fail("%s: the name is too long", path);
    snprintf(part, sizeof part, "%s.part", path);
    FILE *file = fopen(part, "wb");
    if (!file) return fail("%s: cannot be written (%s)", part, strerror(errno));
    bool good = write_parts(file, p, h, parts);
    if (good) good = fflush(file) == 0 && fsync(fileno(file)) == 0;
    int error = errno;
    if (fclose(file) != 0 && good) good = false, error = errno;
    if (good && rename(part, path) != 0) good = false, error = errno;
    if (good) return true;
    unlink(part);
    return fail("%s: cannot be written (%s)", path, strerror(error));
}

static bool assemble(struct pack *p, struct relief_header *h, const char *path)
{
    struct relief_bytes parts[3] = {0}; // base, index, side
    put_base(p, &parts[0]);
    measure_tiles(p, h);
    put_tiles(p, &parts[1], &parts[2]);
    h->payload_bytes = 0;
    for (int64_t i = 0; i < p->grid.tile_count; i++) h->payload_bytes += p->tiles[i].bytes;
    h->base_bytes = parts[0].size, h->index_bytes = parts[1].size, h->side_bytes = parts[2].size;
    bool good = !parts[0].full && !parts[1].full && !parts[2].full;
    if (!good) fail("%s: out of memory", p->field->name);
    if (good) {
        h->base_crc = relief_crc(parts[0].data, parts[0].size);
        h->index_crc = relief_crc(parts[1].data, parts[1].size);
        h->side_crc = relief_crc(parts[2].data, parts[2].size);
        good = !path || write_file(p, h, parts, path);
    }
    for (int i = 0; i < 3; i++) free(parts[i].data);
    return good;
}

// ---- packing ---------------------------------------------------------------

static bool prepare_field(struct heightfield *field, struct relief_header *h, int32_t *magnitude)
{
    size_t count = (size_t)field->width * (size_t)field->height;
    h->voids_filled = voids_count(field->samples, count);
    if (h->voids_filled == count)
        return fail("%s: every sample is void; at least one height is expected", field->name);
    if (h->voids_filled && !voids_fill(field->samples, field->width, field->height))
        return fail("%s: out of memory", field->name);
    *magnitude = 0;
    for (size_t i = 0; i < count; i++)
        if (abs(field->samples[i]) > *magnitude) *magnitude = abs(field->samples[i]);
    return *magnitude <= QUANTA_LIMIT ||
           fail("%s: a height of %d quanta; at most %d are accepted", field->name, *magnitude, QUANTA_LIMIT);
}

static void describe(const struct pack *p, struct relief_header *h)
{
    const struct heightfield *field = p->field;
    h->layout = p->layout;
    h->size[0] = field->width, h->size[1] = field->height;
    h->spacing_m[0] = field->spacing_m[0], h->spacing_m[1] = field->spacing_m[1];
    h->quantum_m = field->quantum_m, h->offset_m = field->offset_m;
    h->fraction_bits = p->fraction_bits;
    memcpy(h->name, field->name, sizeof h->name);
}

bool relief_pack(struct heightfield *field, const struct relief_pack_options *options, const char *path,
                 struct relief_header *header)
{
    struct pack p = {.field = field, .options = options, .layout = options->layout};
    int32_t magnitude = 0;
    memset(header, 0, sizeof *header);
    if (!prepare_field(field, header, &magnitude)) return false;
    if (p.layout == LAYOUT_WAVELET) // sums of U stay in 32 bits
        while (p.fraction_bits < RELIEF_FRACTION_BITS && magnitude <= 1 << (23 - p.fraction_bits))
            p.fraction_bits++;
    grid_init(&p.grid, field->width, field->height);
    describe(&p, header);
    bool good = allocate(&p);
    if (!good) fail("%s: does not fit in memory", field->name);
    if (good && p.layout == LAYOUT_WAVELET)
        good = forward(&p) && search_steps(&p, header);
    else if (good)
        set_bounded_steps(&p, field->quantum_m);
    good = good && pack_levels(&p, true);
    if (good) {
        measure(&p, header);
        good = assemble(&p, header, path);
    }
    finish(&p);
    return good;
}
