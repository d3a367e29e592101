// SPDX-License-Identifier: MIT
#include "common/terrain/relief/relief_format.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const uint8_t MAGIC[8] = {0x89, 'r', 'e', 'l', 'i', 'e', 'f', '\n'};

uint32_t relief_crc(const uint8_t *data, size_t size)
{
    static const uint32_t BYTES[256] = {
        0x00000000, 0x77073096, 0xee0e612c, 0x990951ba, 0x076dc419, 0x706af48f, 0xe963a535, 0x9e6495a3,
        0x0edb8832, 0x79dcb8a4, 0xe0d5e91e, 0x97d2d988, 0x09b64c2b, 0x7eb17cbd, 0xe7b82d07, 0x90bf1d91,
        0x1db71064, 0x6ab020f2, 0xf3b97148, 0x84be41de, 0x1adad47d, 0x6ddde4eb, 0xf4d4b551, 0x83d385c7,
        0x136c9856, 0x646ba8c0, 0xfd62f97a, 0x8a65c9ec, 0x14015c4f, 0x63066cd9, 0xfa0f3d63, 0x8d080df5,
        0x3b6e20c8, 0x4c69105e, 0xd56041e4, 0xa2677172, 0x3c03e4d1, 0x4b04d447, 0xd20d85fd, 0xa50ab56b,
        0x35b5a8fa, 0x42b2986c, 0xdbbbc9d6, 0xacbcf940, 0x32d86ce3, 0x45df5c75, 0xdcd60dcf, 0xabd13d59,
        0x26d930ac, 0x51de003a, 0xc8d75180, 0xbfd06116, 0x21b4f4b5, 0x56b3c423, 0xcfba9599, 0xb8bda50f,
        0x2802b89e, 0x5f058808, 0xc60cd9b2, 0xb10be924, 0x2f6f7c87, 0x58684c11, 0xc1611dab, 0xb6662d3d,
        0x76dc4190, 0x01db7106, 0x98d220bc, 0xefd5102a, 0x71b18589, 0x06b6b51f, 0x9fbfe4a5, 0xe8b8d433,
        0x7807c9a2, 0x0f00f934, 0x9609a88e, 0xe10e9818, 0x7f6a0dbb, 0x086d3d2d, 0x91646c97, 0xe6635c01,
        0x6b6b51f4, 0x1c6c6162, 0x856530d8, 0xf262004e, 0x6c0695ed, 0x1b01a57b, 0x8208f4c1, 0xf50fc457,
        0x65b0d9c6, 0x12b7e950, 0x8bbeb8ea, 0xfcb9887c, 0x62dd1ddf, 0x15da2d49, 0x8cd37cf3, 0xfbd44c65,
        0x4db26158, 0x3ab551ce, 0xa3bc0074, 0xd4bb30e2, 0x4adfa541, 0x3dd895d7, 0xa4d1c46d, 0xd3d6f4fb,
        0x4369e96a, 0x346ed9fc, 0xad678846, 0xda60b8d0, 0x44042d73, 0x33031de5, 0xaa0a4c5f, 0xdd0d7cc9,
        0x5005713c, 0x270241aa, 0xbe0b1010, 0xc90c2086, 0x5768b525, 0x206f85b3, 0xb966d409, 0xce61e49f,
        0x5edef90e, 0x29d9c998, 0xb0d09822, 0xc7d7a8b4, 0x59b33d17, 0x2eb40d81, 0xb7bd5c3b, 0xc0ba6cad,
        0xedb88320, 0x9abfb3b6, 0x03b6e20c, 0x74b1d29a, 0xead54739, 0x9dd277af, 0x04db2615, 0x73dc1683,
        0xe3630b12, 0x94643b84, 0x0d6d6a3e, 0x7a6a5aa8, 0xe40ecf0b, 0x9309ff9d, 0x0a00ae27, 0x7d079eb1,
        0xf00f9344, 0x8708a3d2, 0x1e01f268, 0x6906c2fe, 0xf762575d, 0x806567cb, 0x196c3671, 0x6e6b06e7,
        0xfed41b76, 0x89d32be0, 0x10da7a5a, 0x67dd4acc, 0xf9b9df6f, 0x8ebeeff9, 0x17b7be43, 0x60b08ed5,
        0xd6d6a3e8, 0xa1d1937e, 0x38d8c2c4, 0x4fdff252, 0xd1bb67f1, 0xa6bc5767, 0x3fb506dd, 0x48b2364b,
        0xd80d2bda, 0xaf0a1b4c, 0x36034af6, 0x41047a60, 0xdf60efc3, 0xa867df55, 0x316e8eef, 0x4669be79,
        0xcb61b38c, 0xbc66831a, 0x256fd2a0, 0x5268e236, 0xcc0c7795, 0xbb0b4703, 0x220216b9, 0x5505262f,
        0xc5ba3bbe, 0xb2bd0b28, 0x2bb45a92, 0x5cb36a04, 0xc2d7ffa7, 0xb5d0cf31, 0x2cd99e8b, 0x5bdeae1d,
        0x9b64c2b0, 0xec63f226, 0x756aa39c, 0x026d930a, 0x9c0906a9, 0xeb0e363f, 0x72076785, 0x05005713,
        0x95bf4a82, 0xe2b87a14, 0x7bb12bae, 0x0cb61b38, 0x92d28e9b, 0xe5d5be0d, 0x7cdcefb7, 0x0bdbdf21,
        0x86d3d2d4, 0xf1d4e242, 0x68ddb3f8, 0x1fda836e, 0x81be16cd, 0xf6b9265b, 0x6fb077e1, 0x18b74777,
        0x88085ae6, 0xff0f6a70, 0x66063bca, 0x11010b5c, 0x8f659eff, 0xf862ae69, 0x616bffd3, 0x166ccf45,
        0xa00ae278, 0xd70dd2ee, 0x4e048354, 0x3903b3c2, 0xa7672661, 0xd06016f7, 0x4969474d, 0x3e6e77db,
        0xaed16a4a, 0xd9d65adc, 0x40df0b66, 0x37d83bf0, 0xa9bcae53, 0xdebb9ec5, 0x47b2cf7f, 0x30b5ffe9,
        0xbdbdf21c, 0xcabac28a, 0x53b39330, 0x24b4a3a6, 0xbad03605, 0xcdd70693, 0x54de5729, 0x23d967bf,
        0xb3667a2e, 0xc4614ab8, 0x5d681b02, 0x2a6f2b94, 0xb40bbe37, 0xc30c8ea1, 0x5a05df1b, 0x2d02ef8d};
    uint32_t crc = ~0u;
    for (size_t i = 0; i < size; i++) crc = crc >> 8 ^ BYTES[(crc ^ data[i]) & 255];
    return ~crc;
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
    if (get_u64(b + 8, 4) != RELIEF_VERSION_NUMBER) return "is of another version; version 2 is accepted";
    if (get_u64(b + RELIEF_HEADER - 4, 4) != relief_crc(b, RELIEF_HEADER - 4))
        return "has a header that does not match its checksum";
    if (get_u64(b + 12, 4) >= LAYOUTS) return "is of a codec that is not known";
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
