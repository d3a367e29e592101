// SPDX-License-Identifier: MIT
#include "common/terrain/relief/relief_file.h"

#include "common/integer.h"
#include "common/report.h"
#include "common/terrain/upsample.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { TILES_A_MARK = 64 };
_Static_assert(CODER_MAX_BYTES <= UINT16_MAX, "the bytes of a tile are kept in 16 bits");

// Index and side section as they are kept: 11 bytes a tile, and 8 for TILES_A_MARK.
struct tile_table {
    uint16_t *bytes;
    uint64_t *mark; // where every TILES_A_MARK-th tile begins in the payload
    uint32_t *crc;
    uint16_t (*extrema)[2]; // (q - low) >> shift, the lowest downwards, the highest upwards
    uint8_t *error_code;
    int32_t low;
    int shift; // 0 where heights span 65,535 quanta at most
};

struct relief {
    char path[1024];
    int file;
    struct relief_header header;
    struct grid grid;
    int32_t step[LAYOUT_LEVELS][CODER_BANDS]; // of the base: [count - 1][0]
    int32_t base[LAYOUT_BASE * LAYOUT_BASE];  // internal units
    int32_t poles[LAYOUT_LEVELS][2];          // of a planet
    double rms_q[LAYOUT_LEVELS];
    struct tile_table tiles;
    atomic_bool told; // that a tile is harmed: once is enough, whatever number of threads meet it
};

// ---- opening ---------------------------------------------------------------

static bool read_at(int file, void *to, size_t size, uint64_t offset)
{
    for (size_t got = 0; got < size;) {
        ssize_t n = pread(file, (char *)to + got, size - got, (off_t)(offset + got));
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) return false;
        got += (size_t)n;
    }
    return true;
}

static bool read_header(struct relief *r)
{
    uint8_t bytes[RELIEF_HEADER];
    struct stat status;
    if (fstat(r->file, &status) != 0 || !S_ISREG(status.st_mode))
        return fail("%s: is not a file; a .relief file is expected", r->path);
    if (!read_at(r->file, bytes, sizeof bytes, 0))
        return fail("%s: ends within its header; a .relief file is expected", r->path);
    const char *wrong = relief_header_read(&r->header, bytes);
    if (wrong) return fail("%s: %s", r->path, wrong);
    const struct relief_header *h = &r->header;
    uint64_t size = (uint64_t)status.st_size, left = size - RELIEF_HEADER;
    const uint64_t parts[4] = {h->payload_bytes, h->base_bytes, h->index_bytes, h->side_bytes};
    for (int i = 0; i < 4; i++) {
        if (parts[i] > left)
            return fail("%s: holds %llu bytes, fewer than its header says; it is cut short", r->path,
                        (unsigned long long)size);
        left -= parts[i];
    }
    return left == 0 || fail("%s: has bytes behind its end; a whole .relief file is expected", r->path);
}

// Reads a section and checks it; NULL after one line on stderr.
static uint8_t *read_section(const struct relief *r, const char *name, uint64_t offset, uint64_t size,
                             uint32_t crc)
{
    uint8_t *data = malloc((size_t)size + 1);
    if (!data)
        fail("%s: its %s of %llu bytes does not fit in memory", r->path, name, (unsigned long long)size);
    else if (!read_at(r->file, data, (size_t)size, offset))
        fail("%s: its %s cannot be read", r->path, name);
    else if (relief_crc(data, (size_t)size) != crc)
        fail("%s: its %s does not match its checksum; the file is harmed", r->path, name);
    else
        return data;
    free(data);
    return NULL;
}

static bool parse_base(struct relief *r, const uint8_t *data)
{
    struct relief_reader reader = {data, data + r->header.base_bytes, false};
    int top = r->grid.count - 1;
    for (int l = 0; l <= top; l++)
        for (int b = l == top ? 0 : BAND_HL; b < (l == top ? 1 : CODER_BANDS); b++) {
            uint64_t step = relief_get_varint(&reader);
            if (step < 1 || step >= 1 << 28) return false;
            r->step[l][b] = (int32_t)step;
            if (r->header.layout == LAYOUT_BOUNDED && !(step & 1)) return false;
        }
    int64_t count = r->grid.size[top][0] * r->grid.size[top][1], k = 0;
    for (int64_t i = 0; i < count; i++) {
        k = (int64_t)((uint64_t)k + (uint64_t)relief_get_difference(&reader));
        r->base[i] = (int32_t)((uint32_t)k * (uint32_t)r->step[top][0]);
    }
    int64_t pole = 0;
    for (int i = 0; r->header.radius_m > 0 && i < 2 * (r->header.coarsest + 1); i++) {
        pole = (int64_t)((uint64_t)pole + (uint64_t)relief_get_difference(&reader));
        if (pole < -QUANTA_LIMIT || pole > QUANTA_LIMIT) return false;
        r->poles[i / 2][i % 2] = (int32_t)pole;
    }
    return !reader.bad && reader.at == reader.end;
}

static bool parse_index(struct relief *r, const uint8_t *data)
{
    struct relief_reader reader = {data, data + r->header.index_bytes, false};
    uint64_t offset = 0;
    for (int64_t i = 0; i < r->grid.tile_count; i++) {
        uint64_t bytes = relief_get_varint(&reader);
        if (bytes > CODER_MAX_BYTES) return false;
        if (i % TILES_A_MARK == 0) r->tiles.mark[i / TILES_A_MARK] = offset;
        r->tiles.bytes[i] = (uint16_t)bytes;
        offset += bytes;
    }
    return !reader.bad && reader.at == reader.end && offset == r->header.payload_bytes;
}

// The side section tile by tile; false where it makes no sense.
static bool next_side(const struct relief *r, struct relief_reader *reader, int64_t number, int64_t *low,
                      struct relief_tile_side *tile)
{
    tile->crc = r->tiles.bytes[number] ? relief_get_u32(reader) : 0;
    *low = (int64_t)((uint64_t)*low + (uint64_t)relief_get_difference(reader));
    uint64_t span = relief_get_varint(reader);
    if (*low < -QUANTA_LIMIT || *low > QUANTA_LIMIT || span > 2 * QUANTA_LIMIT || reader->at >= reader->end)
        return false;
    tile->min_q = (int32_t)*low;
    tile->max_q = (int32_t)(*low + (int64_t)span);
    tile->error_code = *reader->at++;
    return true;
}

static bool parse_level_errors(struct relief *r, struct relief_reader *reader)
{
    bool known = reader->at < reader->end;
    for (int l = 1; l < r->grid.count; l++) {
        r->rms_q[l] = known ? relief_get_double(reader) : -1;
        if (known && (!(r->rms_q[l] >= 0) || !isfinite(r->rms_q[l]))) return false;
    }
    return !reader->bad && reader->at == reader->end;
}

static bool parse_side(struct relief *r, const uint8_t *data)
{
    struct relief_reader reader = {data, data + r->header.side_bytes, false};
    struct relief_tile_side tile;
    struct tile_table *table = &r->tiles;
    int64_t low = 0;
    int32_t least = INT32_MAX, most = INT32_MIN;
    for (int64_t i = 0; i < r->grid.tile_count; i++) {
        if (!next_side(r, &reader, i, &low, &tile)) return false;
        least = tile.min_q < least ? tile.min_q : least;
        most = tile.max_q > most ? tile.max_q : most;
    }
    if (reader.bad || !parse_level_errors(r, &reader)) return false;
    table->low = least;
    while (r->grid.tile_count && (most - least + (1 << table->shift) - 1) >> table->shift > UINT16_MAX)
        table->shift++;
    reader.at = data;
    low = 0;
    for (int64_t i = 0; i < r->grid.tile_count; i++) {
        if (!next_side(r, &reader, i, &low, &tile)) return false;
        table->crc[i] = tile.crc;
        table->extrema[i][0] = (uint16_t)((tile.min_q - least) >> table->shift);
        table->extrema[i][1] = (uint16_t)((tile.max_q - least + (1 << table->shift) - 1) >> table->shift);
        table->error_code[i] = tile.error_code;
    }
    return true;
}

static bool allocate_tiles(struct relief *r)
{
    size_t count = (size_t)r->grid.tile_count + 1;
    struct tile_table *table = &r->tiles;
    table->bytes = malloc(count * sizeof *table->bytes);
    table->mark = malloc((count / TILES_A_MARK + 1) * sizeof *table->mark);
    table->crc = malloc(count * sizeof *table->crc);
    table->extrema = malloc(count * sizeof *table->extrema);
    table->error_code = malloc(count);
    return (table->bytes && table->mark && table->crc && table->extrema && table->error_code) ||
           fail("%s: its index does not fit in memory", r->path);
}

static bool read_sections(struct relief *r)
{
    const struct relief_header *h = &r->header;
    uint64_t base = RELIEF_HEADER + h->payload_bytes, index = base + h->base_bytes,
             side = index + h->index_bytes;
    grid_init(&r->grid, h->size[0], h->size[1]);
    if (h->index_bytes <
        (uint64_t)r->grid.tile_count) // a byte a tile at least: memory follows the file's size
        return fail("%s: its index has fewer tiles than %lld x %lld samples need; the file is harmed",
                    r->path, (long long)h->size[0], (long long)h->size[1]);
    if (!allocate_tiles(r)) return false;
    const struct {
        const char *name;
        uint64_t offset, size;
        uint32_t crc;
        bool (*parse)(struct relief *r, const uint8_t *data);
    } SECTIONS[] = {{"base", base, h->base_bytes, h->base_crc, parse_base},
                    {"index", index, h->index_bytes, h->index_crc, parse_index},
                    {"side section", side, h->side_bytes, h->side_crc, parse_side}};
    for (int i = 0; i < 3; i++) {
        uint8_t *data =
            read_section(r, SECTIONS[i].name, SECTIONS[i].offset, SECTIONS[i].size, SECTIONS[i].crc);
        if (!data) return false;
        bool good = SECTIONS[i].parse(r, data);
        free(data);
        if (!good) return fail("%s: its %s makes no sense; the file is harmed", r->path, SECTIONS[i].name);
    }
    return true;
}

struct relief *relief_open(const char *path)
{
    struct relief *r = calloc(1, sizeof *r);
    if (!r) {
        fail("%s: out of memory", path);
        return NULL;
    }
    strncpy(r->path, path, sizeof r->path - 1);
    r->file = open(path, O_RDONLY | O_CLOEXEC);
    if (r->file < 0) fail("%s: %s; a .relief file is expected", path, strerror(errno));
    if (r->file >= 0 && read_header(r) && read_sections(r)) return r;
    relief_close(r);
    return NULL;
}

void relief_close(struct relief *relief)
{
    if (!relief) return;
    if (relief->file >= 0) close(relief->file);
    free(relief->tiles.bytes);
    free(relief->tiles.mark);
    free(relief->tiles.crc);
    free(relief->tiles.extrema);
    free(relief->tiles.error_code);
    free(relief);
}

const struct relief_header *relief_header(const struct relief *relief)
{
    return &relief->header;
}

const struct grid *relief_grid(const struct relief *relief)
{
    return &relief->grid;
}

uint64_t relief_sample_bytes(const struct relief *relief)
{
    const struct relief_header *h = &relief->header;
    return RELIEF_HEADER + h->payload_bytes + h->base_bytes + h->index_bytes;
}

struct relief_tile_side relief_side(const struct relief *relief, int64_t number)
{
    const struct tile_table *table = &relief->tiles;
    struct relief_tile_side side = {.offset = table->mark[number / TILES_A_MARK],
                                    .bytes = table->bytes[number],
                                    .crc = table->crc[number],
                                    .min_q = table->low + (table->extrema[number][0] << table->shift),
                                    .max_q = table->low + (table->extrema[number][1] << table->shift),
                                    .error_code = table->error_code[number]};
    for (int64_t i = number - number % TILES_A_MARK; i < number; i++) side.offset += table->bytes[i];
    return side;
}

void relief_bounds(const struct relief *relief, int64_t number, int32_t *min_q, int32_t *max_q)
{
    const struct tile_table *table = &relief->tiles;
    *min_q = table->low + (table->extrema[number][0] << table->shift);
    *max_q = table->low + (table->extrema[number][1] << table->shift);
}

uint32_t relief_tile_error(const struct relief *relief, int64_t number)
{
    return relief_error_of(relief->tiles.error_code[number]);
}

double relief_level_rms(const struct relief *relief, int level)
{
    return relief->rms_q[level];
}

size_t relief_resident_bytes(const struct relief *relief)
{
    size_t tiles = (size_t)relief->grid.tile_count;
    const struct tile_table *t = &relief->tiles;
    return sizeof *relief + tiles * (sizeof *t->bytes + sizeof *t->crc + sizeof *t->extrema + 1) +
           tiles / TILES_A_MARK * sizeof *t->mark;
}

// ---- decoding --------------------------------------------------------------

static int64_t tiles_of(int64_t end) // tiles that indices below `end` reach
{
    return (end + CODER_TILE - 1) / CODER_TILE;
}

// Tiles that a rectangle of samples needs.
static struct rect tile_rect(const struct relief *r, int level, const struct rect *wanted)
{
    struct rect t;
    if (r->header.layout == LAYOUT_WAVELET) {
        struct rect low = layout_wavelet_band_rect(&r->grid, level, wanted, 0);
        struct rect high = layout_wavelet_band_rect(&r->grid, level, wanted, BAND_HH);
        t = rect_hull(&low, &high);
    } else
        t = (struct rect){wanted->x0 / 2, wanted->y0 / 2, (wanted->x1 + 1) / 2, (wanted->y1 + 1) / 2};
    return (struct rect){t.x0 / CODER_TILE, t.y0 / CODER_TILE, tiles_of(t.x1), tiles_of(t.y1)};
}

struct rect relief_coarse_rect(const struct relief *r, int level, const struct rect *wanted)
{
    struct rect t = tile_rect(r, level, wanted);
    return layout_coarse_rect(&r->grid, level, t.x0, t.y0, t.x1, t.y1);
}

// Says it once.
static bool harmed(const struct relief *r, int level, int64_t tx, int64_t ty, const char *what)
{
    if (!atomic_exchange(&((struct relief *)r)->told, true))
        fail("%s: tile (%lld, %lld) of level %d %s", r->path, (long long)tx, (long long)ty, level, what);
    return false;
}

// Coefficients of a tile.
static bool read_tile(const struct relief *r, int level, int64_t tx, int64_t ty, const struct patch *coarse,
                      struct layout_tile *tile, coder_band *k)
{
    uint8_t data[CODER_MAX_BYTES];
    struct relief_tile_side side =
        relief_side(r, r->grid.first_tile[level] + ty * r->grid.tiles[level][0] + tx);
    layout_tile_init(tile, r->header.layout, &r->grid, level, tx, ty, coarse, r->step[level]);
    if (!read_at(r->file, data, side.bytes, RELIEF_HEADER + side.offset))
        return harmed(r, level, tx, ty, "cannot be read; the file is cut short or cannot be reached");
    if ((side.bytes && relief_crc(data, side.bytes) != side.crc) ||
        !layout_tile_decode(r->header.layout, tile, data, side.bytes, k))
        return harmed(r, level, tx, ty, "is harmed");
    return true;
}

// Copies what of a tile's `size` x `size` values, `from` standing at (x0, y0), lies in the patch; times
// `step`.
static void copy_tile(const int32_t *from, int64_t size, int64_t x0, int64_t y0, int32_t step,
                      const struct patch *to)
{
    const struct rect *r = &to->rect;
    int64_t x_from = larger(x0, r->x0), x_to = smaller(x0 + size, r->x1);
    for (int64_t y = larger(y0, r->y0); y < smaller(y0 + size, r->y1); y++) {
        const int32_t *row = from + (y - y0) * size - x0;
        int32_t *out = to->samples + (y - r->y0) * rect_width(r) - r->x0;
        for (int64_t x = x_from; x < x_to; x++) out[x] = (int32_t)((uint32_t)row[x] * (uint32_t)step);
    }
}

static bool refine_tiles(const struct relief *r, int level, const struct patch *coarse,
                         const struct patch *wanted)
{
    struct layout_tile tile;
    coder_band k[CODER_BANDS];
    int32_t samples[LAYOUT_SAMPLES * LAYOUT_SAMPLES];
    struct rect t = tile_rect(r, level, &wanted->rect);
    for (int64_t ty = t.y0; ty < t.y1; ty++)
        for (int64_t tx = t.x0; tx < t.x1; tx++) {
            if (!read_tile(r, level, tx, ty, coarse, &tile, k)) return false;
            layout_tile_samples(r->header.layout, &tile, r->step[level][BAND_HL], k, samples);
            copy_tile(samples, LAYOUT_SAMPLES, tx * LAYOUT_SAMPLES, ty * LAYOUT_SAMPLES, 1, wanted);
        }
    return true;
}

static bool refine_wavelet(const struct relief *r, int level, const struct patch *coarse,
                           const struct patch *wanted)
{
    struct layout_tile tile;
    coder_band k[CODER_BANDS];
    struct patch bands[CODER_BANDS];
    int64_t counts[CODER_BANDS], total = 0;
    for (int b = 0; b < CODER_BANDS; b++) {
        bands[b].rect = layout_wavelet_band_rect(&r->grid, level, &wanted->rect, b);
        counts[b] = rect_width(&bands[b].rect) * rect_height(&bands[b].rect);
        total += counts[b];
    }
    int32_t *room = malloc((size_t)(total + 1) * sizeof *room);
    if (!room) return fail("%s: a window does not fit in memory", r->path);
    int32_t *next = room;
    for (int b = 0; b < CODER_BANDS; next += counts[b++]) bands[b].samples = next;
    for (int64_t y = bands[0].rect.y0; y < bands[0].rect.y1; y++)
        memcpy(patch_at(&bands[0], bands[0].rect.x0, y), patch_at(coarse, bands[0].rect.x0, y),
               (size_t)rect_width(&bands[0].rect) * sizeof *room);
    struct rect t = tile_rect(r, level, &wanted->rect);
    bool good = true;
    for (int64_t ty = t.y0; good && ty < t.y1; ty++)
        for (int64_t tx = t.x0; good && tx < t.x1; tx++) {
            good = read_tile(r, level, tx, ty, coarse, &tile, k);
            for (int b = BAND_HL; good && b <= BAND_HH; b++)
                copy_tile(k[b], CODER_TILE, tx * CODER_TILE, ty * CODER_TILE, r->step[level][b], &bands[b]);
        }
    if (good && !layout_wavelet_inverse(&r->grid, level, bands, wanted))
        good = fail("%s: a window does not fit in memory", r->path);
    free(room);
    return good;
}

bool relief_refine(const struct relief *r, int level, const struct patch *coarse, const struct patch *wanted)
{
    return r->header.layout == LAYOUT_WAVELET ? refine_wavelet(r, level, coarse, wanted)
                                              : refine_tiles(r, level, coarse, wanted);
}

bool relief_units(const struct relief *r, int level, const struct patch *wanted)
{
    int top = r->grid.count - 1;
    if (level == top) {
        const struct patch base = {{0, 0, r->grid.size[top][0], r->grid.size[top][1]}, (int32_t *)r->base};
        for (int64_t y = wanted->rect.y0; y < wanted->rect.y1; y++)
            memcpy(patch_at(wanted, wanted->rect.x0, y), patch_at(&base, wanted->rect.x0, y),
                   (size_t)rect_width(&wanted->rect) * sizeof(int32_t));
        return true;
    }
    struct patch coarse = {.rect = relief_coarse_rect(r, level, &wanted->rect)};
    coarse.samples = malloc((size_t)(rect_width(&coarse.rect) * rect_height(&coarse.rect)) * sizeof(int32_t));
    if (!coarse.samples) return fail("%s: a window does not fit in memory", r->path);
    bool good = relief_units(r, level + 1, &coarse) && relief_refine(r, level, &coarse, wanted);
    free(coarse.samples);
    return good;
}

void relief_quanta(const struct relief *r, int32_t *samples, int64_t count)
{
    int bits = r->header.fraction_bits;
    int32_t round = bits ? 1 << (bits - 1) : 0;
    for (int64_t i = 0; i < count; i++) {
        int32_t q = (int32_t)((uint32_t)samples[i] + (uint32_t)round) >> bits;
        samples[i] = q > QUANTA_LIMIT ? QUANTA_LIMIT : q < -QUANTA_LIMIT ? -QUANTA_LIMIT : q;
    }
}

bool relief_window(const struct relief *r, int level, int64_t x0, int64_t y0, int64_t width, int64_t height,
                   int32_t *out)
{
    const struct patch wanted = {{x0, y0, x0 + width, y0 + height}, out};
    if (!relief_units(r, level, &wanted)) return false;
    relief_quanta(r, out, width * height);
    relief_level_poles(r, level, &wanted);
    return true;
}

// ---- planets ---------------------------------------------------------------

const int32_t *relief_poles(const struct relief *relief, int level)
{
    return relief->poles[level];
}

void relief_level_poles(const struct relief *r, int level, const struct patch *samples)
{
    if (!(r->header.radius_m > 0) || level > r->header.coarsest) return;
    int64_t margin = r->header.margin >> level;
    const int64_t rows[2] = {margin, r->grid.size[level][1] - 1 - margin};
    for (int end = 0; end < 2; end++) {
        if (rows[end] < samples->rect.y0 || rows[end] >= samples->rect.y1) continue;
        int32_t *row = patch_at(samples, samples->rect.x0, rows[end]);
        for (int64_t x = 0; x < rect_width(&samples->rect); x++) row[x] = r->poles[level][end];
    }
}

// ---- the whole map ---------------------------------------------------------

bool relief_load(struct heightfield *field, const char *path)
{
    const int64_t most = (int64_t)1 << 31;
    struct relief *r = relief_open(path);
    if (!r) return false;
    const struct relief_header *h = &r->header;
    int64_t margin = h->margin;
    field->width = h->size[0] - 2 * margin;
    field->height = h->size[1] - 2 * margin;
    field->radius_m = h->radius_m;
    memcpy(field->spacing_m, h->spacing_m, sizeof field->spacing_m);
    field->quantum_m = h->quantum_m;
    field->offset_m = h->offset_m;
    bool good = true;
    if (field->width > most / field->height)
        good = fail("%s: %lld x %lld samples are more than memory serves; at most %lld are accepted", path,
                    (long long)field->width, (long long)field->height, (long long)most);
    if (good) field->samples = malloc((size_t)(field->width * field->height) * sizeof *field->samples);
    if (good && !field->samples) good = fail("%s: does not fit in memory", path);
    good = good && relief_window(r, 0, margin, margin, field->width, field->height, field->samples);
    relief_close(r);
    return good;
}
