// SPDX-License-Identifier: MIT
#include "common/terrain/relief/relief_format.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

static const uint8_t MAGIC[8] = {0x89, 'r', 'e', 'l', 'i', 'e', 'f', '\n'};

uint32_t relief_crc(const uint8_t *data, size_t size)
{
    return (uint32_t)crc32_z(0, data, size);
}

// ---- the header ------------------------------------------------------------

static void put_u64(uint8_t *to, uint64_t value, int bytes)
{
    for (int i = 0; i < bytes; i++) to[i] = (uint8_t)(value >> 8 * i);
}

static uint64_t get_u64(const uint8_t *from, int bytes)
{
    uint64_t value = 0;
    for (int i = 0; i < bytes; i++) value |= (uint64_t)from[i] << 8 * i;
    return value;
}

static void put_double(uint8_t *to, double value)
{
    uint64_t word;
    memcpy(&word, &value, sizeof word);
    put_u64(to, word, 8);
}

static double get_double(const uint8_t *from)
{
    uint64_t word = get_u64(from, 8);
    double value;
    memcpy(&value, &word, sizeof value);
    return value;
}

// Layouts that know no tables serve with any.
static uint32_t tables_crc(enum layout layout)
{
    return layout == LAYOUT_MARS || layout == LAYOUT_RAW ? 0 : CODER_TABLES_CRC;
}

void relief_header_write(const struct relief_header *h, uint8_t b[RELIEF_HEADER])
{
    memset(b, 0, RELIEF_HEADER);
    memcpy(b, MAGIC, sizeof MAGIC);
    put_u64(b + 8, RELIEF_VERSION_NUMBER, 4);
    put_u64(b + 12, (uint64_t)h->layout, 4);
    put_u64(b + 16, (uint64_t)h->size[0], 8);
    put_u64(b + 24, (uint64_t)h->size[1], 8);
    const double numbers[6] = {h->spacing_m[0], h->spacing_m[1], h->quantum_m,
                               h->offset_m,     h->rms_m,        h->max_m};
    for (int i = 0; i < 6; i++) put_double(b + 32 + 8 * i, numbers[i]);
    put_u64(b + 80, (uint64_t)h->fraction_bits, 4);
    put_u64(b + 84, (uint32_t)h->min_q, 4);
    put_u64(b + 88, (uint32_t)h->max_q, 4);
    const uint64_t counts[5] = {h->voids_filled, h->payload_bytes, h->base_bytes, h->index_bytes,
                                h->side_bytes};
    for (int i = 0; i < 5; i++) put_u64(b + 96 + 8 * i, counts[i], 8);
    put_u64(b + 136, h->base_crc, 4);
    put_u64(b + 140, h->index_crc, 4);
    put_u64(b + 144, h->side_crc, 4);
    memcpy(b + 152, h->name, sizeof h->name - 1);
    put_double(b + 216, h->radius_m);
    put_u64(b + 224, (uint32_t)h->margin, 4);
    put_u64(b + 228, (uint32_t)h->coarsest, 4);
    put_u64(b + 232, tables_crc(h->layout), 4);
    put_u64(b + RELIEF_HEADER - 4, relief_crc(b, RELIEF_HEADER - 4), 4);
}

static bool numbers_are_good(const struct relief_header *h)
{
    for (int axis = 0; axis < 2; axis++)
        if (!(h->spacing_m[axis] > 0) || !isfinite(h->spacing_m[axis])) return false;
    return h->quantum_m > 0 && isfinite(h->quantum_m) && isfinite(h->offset_m) && h->rms_m >= 0 &&
           isfinite(h->rms_m) && h->max_m >= 0 && isfinite(h->max_m);
}

struct relief_planet relief_planet(const struct relief_header *h)
{
    int64_t columns = h->size[0] - 2 * (int64_t)h->margin, rows = h->size[1] - 2 * (int64_t)h->margin;
    return (struct relief_planet){sphere_grid(-columns / 2, columns, rows), h->margin, h->coarsest};
}

struct relief_planet relief_planet_plan(int64_t columns, int64_t rows, int reach)
{
    enum { LEAST = 32, ROWS = 4 }; // margins in a turn, and from pole to pole: a map is not margin mostly
    struct relief_planet planet = {sphere_grid(-columns / 2, columns, rows), 0, 0};
    struct sphere_grid at = planet.grid;
    while (sphere_has_coarser(&at) && at.columns > 2 * LAYOUT_BASE &&
           ((int64_t)reach << (planet.coarsest + 1)) * LEAST <= columns &&
           ((int64_t)reach << (planet.coarsest + 1)) * ROWS <= rows)
        at = sphere_level(&planet.grid, ++planet.coarsest);
    planet.margin = planet.coarsest > 0 ? (int64_t)reach << planet.coarsest : 0;
    return planet;
}

// Of a planet: that its levels are whole ones.
static bool planet_is_good(const struct relief_header *h)
{
    if (h->radius_m == 0) return h->margin == 0 && h->coarsest == 0;
    if (!(h->radius_m > 0) || !isfinite(h->radius_m) || h->margin < 0 || h->coarsest < 0) return false;
    struct relief_planet planet = relief_planet(h);
    if (planet.grid.columns < 4 || planet.grid.columns % 2 || h->size[1] % 2 == 0 || planet.grid.pole < 1 ||
        h->coarsest >= LAYOUT_LEVELS || planet.margin > planet.grid.pole ||
        planet.margin % ((int64_t)1 << h->coarsest))
        return false;
    for (int l = 0; l < h->coarsest; l++) {
        struct sphere_grid at = sphere_level(&planet.grid, l);
        if (!sphere_has_coarser(&at) || at.columns <= 2 * LAYOUT_BASE) return false;
    }
    return true;
}

const char *relief_header_read(struct relief_header *h, const uint8_t b[RELIEF_HEADER])
{
    const int64_t most = (int64_t)1 << 32; // samples along an axis
    memset(h, 0, sizeof *h);
    if (memcmp(b, MAGIC, sizeof MAGIC) != 0) return "does not begin as a .relief file does";
    uint64_t version = get_u64(b + 8, 4);
    if (version != 2 && version != RELIEF_VERSION_NUMBER)
        return "is of another version; versions 2 and 3 are accepted";
    if (get_u64(b + RELIEF_HEADER - 4, 4) != relief_crc(b, RELIEF_HEADER - 4))
        return "has a header that does not match its checksum";
    if (get_u64(b + 12, 4) >= LAYOUTS) return "is of a codec that is not known";
    h->version = (int)version;
    h->layout = (enum layout)get_u64(b + 12, 4);
    if (get_u64(b + 232, 4) != tables_crc(h->layout))
        return "was coded with other tables than this program has; pack it again";
    for (int axis = 0; axis < 2; axis++) {
        h->size[axis] = (int64_t)get_u64(b + 16 + 8 * axis, 8);
        h->spacing_m[axis] = get_double(b + 32 + 8 * axis);
        if (h->size[axis] < 1 || h->size[axis] > most) return "claims a size that no map has";
    }
    h->quantum_m = get_double(b + 48), h->offset_m = get_double(b + 56);
    h->rms_m = get_double(b + 64), h->max_m = get_double(b + 72);
    if (!numbers_are_good(h)) return "claims a spacing, a scale or an error that no map has";
    uint64_t fraction_bits = get_u64(b + 80, 4);
    if (fraction_bits > RELIEF_FRACTION_BITS) return "claims more fraction bits than there are";
    h->fraction_bits = (int)fraction_bits;
    h->min_q = (int32_t)get_u64(b + 84, 4), h->max_q = (int32_t)get_u64(b + 88, 4);
    h->voids_filled = get_u64(b + 96, 8), h->payload_bytes = get_u64(b + 104, 8);
    h->base_bytes = get_u64(b + 112, 8), h->index_bytes = get_u64(b + 120, 8),
    h->side_bytes = get_u64(b + 128, 8);
    h->base_crc = (uint32_t)get_u64(b + 136, 4), h->index_crc = (uint32_t)get_u64(b + 140, 4);
    h->side_crc = (uint32_t)get_u64(b + 144, 4);
    memcpy(h->name, b + 152, sizeof h->name - 1);
    for (char *c = h->name; *c; c++)
        if ((unsigned char)*c < 32) *c = '?';
    h->radius_m = get_double(b + 216);
    h->margin = (int32_t)get_u64(b + 224, 4), h->coarsest = (int32_t)get_u64(b + 228, 4);
    if (!planet_is_good(h)) return "claims a planet that cannot be";
    return NULL;
}

// ---- varints ---------------------------------------------------------------

void relief_put(struct relief_bytes *bytes, const void *data, size_t size)
{
    if (size == 0) return;
    if (bytes->size + size > bytes->room) {
        size_t room = (bytes->size + size) * 2 + 64;
        uint8_t *grown = bytes->full ? NULL : realloc(bytes->data, room);
        if (!grown) {
            bytes->full = true;
            return;
        }
        bytes->data = grown;
        bytes->room = room;
    }
    memcpy(bytes->data + bytes->size, data, size);
    bytes->size += size;
}

void relief_put_varint(struct relief_bytes *bytes, uint64_t value)
{
    uint8_t coded[10];
    size_t size = 0;
    for (; value >= 128; value >>= 7) coded[size++] = (uint8_t)(value | 128);
    coded[size++] = (uint8_t)value;
    relief_put(bytes, coded, size);
}

void relief_put_difference(struct relief_bytes *bytes, int64_t difference)
{
    relief_put_varint(bytes, (uint64_t)difference << 1 ^ (difference < 0 ? UINT64_MAX : 0));
}

void relief_put_double(struct relief_bytes *bytes, double value)
{
    uint8_t coded[8];
    put_double(coded, value);
    relief_put(bytes, coded, sizeof coded);
}

uint64_t relief_get_varint(struct relief_reader *reader)
{
    uint64_t value = 0;
    for (int shift = 0; shift < 64 && reader->at < reader->end; shift += 7) {
        uint8_t byte = *reader->at++;
        value |= (uint64_t)(byte & 127) << shift;
        if (byte < 128) return value;
    }
    reader->bad = true;
    return 0;
}

int64_t relief_get_difference(struct relief_reader *reader)
{
    uint64_t coded = relief_get_varint(reader);
    return (int64_t)(coded >> 1 ^ (0 - (coded & 1)));
}

uint32_t relief_get_u32(struct relief_reader *reader)
{
    if (reader->end - reader->at < 4) {
        reader->bad = true;
        return 0;
    }
    reader->at += 4;
    return (uint32_t)get_u64(reader->at - 4, 4);
}

double relief_get_double(struct relief_reader *reader)
{
    if (reader->end - reader->at < 8) {
        reader->bad = true;
        return 0;
    }
    reader->at += 8;
    return get_double(reader->at - 8);
}

// ---- errors as bytes -------------------------------------------------------

uint32_t relief_error_of(uint8_t code)
{
    if (code < 16) return code;
    int octave = (code - 8) / 8;
    uint64_t value = (uint64_t)(8 + code % 8) << octave;
    return value < UINT32_MAX ? (uint32_t)value : UINT32_MAX;
}

uint8_t relief_error_code(uint32_t error_q)
{
    int code = 0;
    while (code < 255 && relief_error_of((uint8_t)code) < error_q) code++;
    return (uint8_t)code;
}
