// SPDX-License-Identifier: MIT
#include "common/terrain/relief/coder.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#ifdef __SSE2__
#include <emmintrin.h>
#endif

enum {
    SUMS = 512, // context sums below this have a context each; larger ones lose low bits
    ESCAPE = CODER_TOKENS - 1,
    STATE_LOW = 1 << 16,
    OWN_STATES = 8,   // in a tile's first byte: each band has a state of its own
    BRIEF_STATE = 16, // there: the one state has three bytes
    MARGIN = 2,       // magnitudes west and north of a band that contexts read: zeros
    STRIDE = CODER_TILE + 2 * MARGIN,
};

// ---- tokens ----------------------------------------------------------------

static const uint8_t TOKEN_BITS[CODER_TOKENS] = {0, 0, 0, 0, 0, 0, 0, 0, 2, 2, 3, 3, 4, 4, 6, 0};
static const uint8_t TOKEN_FIRST[CODER_TOKENS] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 24, 32, 48, 64, 128};

static inline int log2_floor(uint32_t value) // of a positive value
{
    return 31 - __builtin_clz(value);
}

static inline int token_of(uint32_t magnitude)
{
    if (magnitude < 8) return (int)magnitude;
    if (magnitude >= 128) return ESCAPE;
    if (magnitude >= 64) return ESCAPE - 1;
    int octave = log2_floor(magnitude);
    return 2 + 2 * octave + (int)(magnitude >> (octave - 1) & 1);
}

// Contexts of sums: 0 to 5 by themselves, then 2.6 an octave: thresholds 6 * 2^(n / 2.6), rounded up.
static const uint16_t CONTEXT_FIRST[CODER_CONTEXTS] = {
    0, 1, 2, 3, 4, 5, 6, 8, 11, 14, 18, 23, 30, 39, 51, 66, 87, 113, 148, 192, 251, 328, 428, SUMS};

static inline int context_of(uint32_t sum) // sum < SUMS
{
    if (sum < 6) return (int)sum;
    int octave = log2_floor(sum), context = 6 + (octave - 2) * 13 / 5;
    if (context > CODER_CONTEXTS - 2) context = CODER_CONTEXTS - 2;
    while (sum < CONTEXT_FIRST[context]) context--;
    while (sum >= CONTEXT_FIRST[context + 1]) context++;
    return context;
}

struct contexts {
    uint8_t of[SUMS];
};

static int shifted(int context, int shift)
{
    context += shift;
    return context < 0 ? 0 : context > CODER_CONTEXTS - 1 ? CODER_CONTEXTS - 1 : context;
}

static void contexts_init(struct contexts *contexts, int shift)
{
    for (int context = 0; context + 1 < CODER_CONTEXTS; context++) {
        int from = CONTEXT_FIRST[context], to = CONTEXT_FIRST[context + 1];
        memset(contexts->of + from, shifted(context, shift), (size_t)(to - from));
    }
}

// Low bits that a magnitude loses in a neighbourhood of this sum.
static inline int raw_shift(uint32_t sum)
{
    return sum < SUMS ? 0 : log2_floor(sum) - 8;
}

// ---- magnitudes and their neighbours ---------------------------------------

struct plane { // magnitudes of one band with zeros around
    uint32_t of[(CODER_TILE + MARGIN) * STRIDE];
    uint32_t row[CODER_TILE]; // what the rows before and the coarser level give, of the row at hand
};

static inline uint32_t *plane_row(struct plane *plane, int y)
{
    return plane->of + (y + MARGIN) * STRIDE + MARGIN;
}

static void plane_start_row(struct plane *restrict plane, const uint16_t *restrict activity, int y)
{
    const uint32_t *north = plane_row(plane, y - 1), *north2 = plane_row(plane, y - 2);
    for (int x = 0; x < CODER_TILE; x++)
        plane->row[x] = 6 * north[x] + 3 * (north[x - 1] + north[x + 1]) + 2 * north2[x] + activity[x];
}

static inline uint32_t with_siblings(struct plane *planes, uint32_t sum, int band, int x, int y)
{
    if (band == 2) return sum + 4 * plane_row(&planes[1], y)[x];
    if (band == 3) return sum / 2 + 6 * plane_row(&planes[1], y)[x] + 8 * plane_row(&planes[2], y)[x];
    return sum;
}

static inline uint32_t plane_sum(struct plane *planes, const struct coder_tile *tile, int band, int x, int y)
{
    const uint32_t *row = plane_row(&planes[band], y) + x;
    uint32_t sum = planes[band].row[x] + 8 * row[-1] + 2 * row[-2];
    return tile->siblings ? with_siblings(planes, sum, band, x, y) : sum;
}

static void planes_start(struct plane *planes, const struct coder_tile *tile)
{
    memset(planes + tile->first_band, 0, (size_t)(tile->bands - tile->first_band) * sizeof *planes);
}

static int tile_columns(const struct coder_tile *tile)
{
    int most = 0;
    for (int b = tile->first_band; b < tile->bands; b++) most = tile->width[b] > most ? tile->width[b] : most;
    return most;
}

static int tile_rows(const struct coder_tile *tile)
{
    int most = 0;
    for (int b = tile->first_band; b < tile->bands; b++)
        most = tile->height[b] > most ? tile->height[b] : most;
    return most;
}

// ---- what a coefficient costs, in 1/256 bit --------------------------------

static inline int frequency(int set, int context, int token)
{
    const uint16_t *start = CODER_TABLES.start[set][context];
    return (token == ESCAPE ? 1 << CODER_BITS : start[token + 1]) - start[token];
}

// -256 log2(frequency / 2^14), from a table of 256 steps of the mantissa made at compile time by a square:
// the encoder's choices must not hang on a mathematics library.
static inline uint32_t bits_256(int frequency)
{
    int octave = log2_floor((uint32_t)frequency);
    uint32_t fraction = ((uint32_t)frequency << (16 - octave)) & 0xffff; // log2(1 + f) ~ f + 0.345 f (1 - f)
    uint32_t bent = fraction + (uint32_t)((uint64_t)22600 * fraction / 65536 * (65536 - fraction) / 65536);
    return (uint32_t)(CODER_BITS - octave) * 256 - bent / 256;
}

static inline uint32_t escape_bits(uint32_t above) // Elias gamma of above + 1
{
    return (uint32_t)(2 * log2_floor(above + 1) + 1);
}

static inline uint32_t cost_256(int set, int context, uint32_t magnitude, int raw)
{
    uint32_t high = magnitude >> raw;
    int token = token_of(high);
    uint32_t bits = (uint32_t)raw + TOKEN_BITS[token] + (magnitude > 0);
    if (token == ESCAPE) bits += escape_bits(high - 128);
    return bits * 256 + bits_256(frequency(set, context, token));
}

static inline int64_t lambda_at(const struct coder_rate *rate, int x, int y)
{
    uint32_t scattered = (uint32_t)(y * CODER_TILE + x) * 2654435761u >> 16; // Knuth's multiplicative hash
    return rate->lambda_65536 + (rate->uneven ? (int64_t)rate->lambda_65536 * scattered >> 16 : 0);
}

void coder_quantise(const struct coder_tile *tile, const struct coder_rate *rate, coder_band *k)
{
    struct plane planes[CODER_BANDS];
    planes_start(planes, tile);
    int columns = tile_columns(tile), rows = tile_rows(tile);
    for (int y = 0; y < rows; y++) {
        for (int b = tile->first_band; b < tile->bands; b++)
            plane_start_row(&planes[b], tile->activity[b] + y * CODER_TILE, y);
        for (int x = 0; x < columns; x++)
            for (int b = tile->first_band; b < tile->bands; b++) {
                if (x >= tile->width[b] || y >= tile->height[b]) continue;
                int32_t value = rate->values[b][y * CODER_TILE + x], step = rate->step[b];
                int64_t size = llabs((int64_t)value);
                uint32_t nearest = (uint32_t)((size + step / 2) / step), best = 0;
                if (nearest >= CODER_LIMIT) nearest = CODER_LIMIT - 1;
                if (nearest > 0) {
                    uint32_t sum = plane_sum(planes, tile, b, x, y);
                    int raw = raw_shift(sum), context = context_of(sum < SUMS ? sum : SUMS - 1);
                    int64_t least = INT64_MAX;
                    for (uint32_t c = nearest;; c--) {
                        int64_t off = size - (int64_t)c * step; // in 1/64 step, squared
                        int64_t far = off * 64 / step;
                        int64_t cost = far * far * 4096 +
                                       lambda_at(rate, x, y) * cost_256(tile->set[b], context, c, raw);
                        if (cost < least) least = cost, best = c;
                        if (c == 0 || (c + 1 == nearest && !rate->uneven)) break;
                        if (c + 1 == nearest) c = 1; // zero next
                    }
                }
                plane_row(&planes[b], y)[x] = best;
                k[b][y * CODER_TILE + x] = value < 0 ? -(int32_t)best : (int32_t)best;
            }
    }
}

// ---- encoding --------------------------------------------------------------

struct symbol {
    uint16_t start, frequency;
    uint8_t band;
};

struct bit_writer {
    uint8_t *bytes;
    size_t size;
    uint64_t held;
    int count;
};

static void put_bits(struct bit_writer *w, uint32_t value, int bits) // bits <= 32
{
    w->held |= (uint64_t)value << w->count;
    for (w->count += bits; w->count >= 8; w->count -= 8, w->held >>= 8)
        w->bytes[w->size++] = (uint8_t)w->held;
}

static void put_magnitude_bits(struct bit_writer *w, uint32_t magnitude, int raw, int token)
{
    uint32_t high = magnitude >> raw;
    if (token == ESCAPE) {
        uint32_t above = high - 128 + 1;
        int octave = log2_floor(above);
        put_bits(w, (uint32_t)1 << octave, octave + 1);
        put_bits(w, above & (((uint32_t)1 << octave) - 1), octave);
    } else if (TOKEN_BITS[token])
        put_bits(w, high - TOKEN_FIRST[token], TOKEN_BITS[token]);
    if (raw) put_bits(w, magnitude & (((uint32_t)1 << raw) - 1), raw);
}

// Sums of all coefficients in coding order; returns their number.  `costs` gets what each shift would cost.
struct visit {
    uint32_t sum, magnitude;
    uint8_t band;
};

static int visit_all(const struct coder_tile *tile, const coder_band *k, struct visit *visits)
{
    struct plane planes[CODER_BANDS];
    planes_start(planes, tile);
    int columns = tile_columns(tile), rows = tile_rows(tile), count = 0;
    for (int y = 0; y < rows; y++) {
        for (int b = tile->first_band; b < tile->bands; b++)
            plane_start_row(&planes[b], tile->activity[b] + y * CODER_TILE, y);
        for (int x = 0; x < columns; x++)
            for (int b = tile->first_band; b < tile->bands; b++) {
                if (x >= tile->width[b] || y >= tile->height[b]) continue;
                int32_t value = k[b][y * CODER_TILE + x];
                uint32_t magnitude = (uint32_t)abs(value);
                visits[count++] = (struct visit){plane_sum(planes, tile, b, x, y), magnitude, (uint8_t)b};
                plane_row(&planes[b], y)[x] = magnitude;
            }
    }
    return count;
}

static int best_shift(const struct coder_tile *tile, const struct visit *visits, int count)
{
    uint64_t costs[CODER_SHIFTS] = {0};
    for (int i = 0; i < count; i++) {
        const struct visit *v = &visits[i];
        int raw = raw_shift(v->sum), token = token_of(v->magnitude >> raw);
        int context = context_of(v->sum < SUMS ? v->sum : SUMS - 1);
        for (int s = 0; s < CODER_SHIFTS; s++)
            costs[s] +=
                bits_256(frequency(tile->set[v->band], shifted(context, s - CODER_SHIFTS / 2), token));
    }
    int best = CODER_SHIFTS / 2;
    for (int s = 0; s < CODER_SHIFTS; s++)
        if (costs[s] < costs[best]) best = s;
    return best;
}

// Signs, band by band.  The first ones stand in the states that the encoder begins with: bits that would be
// lost.
struct signs {
    uint16_t words[CODER_BANDS * CODER_TILE * CODER_TILE / 16 + CODER_BANDS];
    int count;
};

static void collect_signs(const struct coder_tile *tile, const coder_band *k, struct signs *signs)
{
    memset(signs, 0, sizeof *signs);
    for (int b = tile->first_band; b < tile->bands; b++)
        for (int y = 0; y < tile->height[b]; y++)
            for (int x = 0; x < tile->width[b]; x++) {
                int32_t value = k[b][y * CODER_TILE + x];
                if (value < 0) signs->words[signs->count / 16] |= (uint16_t)(1 << signs->count % 16);
                signs->count += value != 0;
            }
}

// Words from symbols, in reverse, to the end of `words`; returns where they begin.
static size_t rans_encode(const struct symbol *symbols, int count, const struct signs *signs, bool own_states,
                          int first_band, uint32_t *states, uint16_t *words, size_t room)
{
    for (int s = 0; s < CODER_BANDS; s++) states[s] = STATE_LOW | signs->words[s];
    for (int i = count - 1; i >= 0; i--) {
        const struct symbol *symbol = &symbols[i];
        uint32_t *state = &states[own_states ? symbol->band - first_band : 0], x = *state;
        if (x >> (32 - CODER_BITS) >= symbol->frequency) {
            words[--room] = (uint16_t)x;
            x >>= 16;
        }
        *state = (x / symbol->frequency << CODER_BITS) + x % symbol->frequency + symbol->start;
    }
    return room;
}

size_t coder_encode(const struct coder_tile *tile, const coder_band *k, uint8_t *out,
                    struct coder_counts *counts)
{
    enum { MOST = CODER_BANDS * CODER_TILE * CODER_TILE, OWN_STATES_FROM = 300 };
    struct visit visits[MOST];
    struct symbol symbols[MOST];
    uint16_t words[MOST + 8];
    uint8_t raw_bytes[CODER_MAX_BYTES];
    int count = visit_all(tile, k, visits);
    bool any = false;
    for (int i = 0; i < count; i++) any |= visits[i].magnitude != 0;
    if (!any) return 0;
    int shift = best_shift(tile, visits, count);
    struct bit_writer writer = {.bytes = raw_bytes};
    for (int i = 0; i < count; i++) {
        const struct visit *v = &visits[i];
        int raw = raw_shift(v->sum), token = token_of(v->magnitude >> raw), set = tile->set[v->band];
        int plain = context_of(v->sum < SUMS ? v->sum : SUMS - 1);
        int context = shifted(plain, shift - CODER_SHIFTS / 2);
        symbols[i] = (struct symbol){CODER_TABLES.start[set][context][token],
                                     (uint16_t)frequency(set, context, token), v->band};
        if (counts) counts->of[set][context][token]++;
        put_magnitude_bits(&writer, v->magnitude, raw, token);
    }
    uint32_t states[CODER_BANDS];
    struct signs signs;
    size_t room = sizeof words / sizeof *words;
    collect_signs(tile, k, &signs);
    size_t from = rans_encode(symbols, count, &signs, false, tile->first_band, states, words, room);
    bool own = room - from > OWN_STATES_FROM / 2, brief = !own && states[0] < 1 << 24;
    if (own) from = rans_encode(symbols, count, &signs, true, tile->first_band, states, words, room);
    int state_count = own ? tile->bands - tile->first_band : 1;
    for (int i = 16 * state_count; i < signs.count; i++)
        put_bits(&writer, signs.words[i / 16] >> i % 16 & 1, 1);
    if (writer.count) put_bits(&writer, 0, 8 - writer.count);
    uint8_t *to = out;
    *to++ = (uint8_t)(shift + (own ? OWN_STATES : brief ? BRIEF_STATE : 0));
    for (int s = 0; s < state_count; s++)
        for (int byte = 0; byte < (brief ? 3 : 4); byte++) *to++ = (uint8_t)(states[s] >> 8 * byte);
    for (size_t i = from; i < room; i++) {
        *to++ = (uint8_t)words[i];
        *to++ = (uint8_t)(words[i] >> 8);
    }
    // cppcheck-suppress uninitvar ; the writer has filled them
    for (size_t i = writer.size; i > 0; i--) *to++ = raw_bytes[i - 1];
    return (size_t)(to - out);
}

// ---- decoding --------------------------------------------------------------

struct bit_reader { // backwards from the end
    const uint8_t *data;
    size_t at, low; // bytes low..at-1 are unread
    uint64_t held;
    int count;
    bool spent;
};

static inline void refill(struct bit_reader *r)
{
    while (r->count <= 56 && r->at > r->low) {
        r->held |= (uint64_t)r->data[--r->at] << r->count;
        r->count += 8;
    }
}

static inline uint32_t get_bits(struct bit_reader *r, int bits) // bits <= 27
{
    if (r->count < bits) refill(r);
    uint32_t value = (uint32_t)(r->held & (((uint64_t)1 << bits) - 1));
    if (r->count < bits) {
        r->spent = true; // zeros from here on
        r->count = 0;
        r->held = 0;
        return value;
    }
    r->held >>= bits;
    r->count -= bits;
    return value;
}

static uint32_t get_escape(struct bit_reader *r)
{
    int octave = 0;
    while (octave < 26 && !get_bits(r, 1)) {
        octave++;
        if (r->spent) return 128;
    }
    return 128 + ((uint32_t)1 << octave) - 1 + (octave ? get_bits(r, octave) : 0);
}

struct decoder {
    struct bit_reader bits;
    size_t word_at, word_end; // in bytes
    uint32_t states[CODER_BANDS];
    struct contexts contexts;
};

// Number of the tokens 1..15 that begin at or before `slot`.  All are compared at once: where many tokens are
// likely, a loop would be mispredicted each time.
static inline int tokens_before(const uint16_t *start, uint32_t slot)
{
#ifdef __SSE2__
    const __m128i all = _mm_set1_epi16((int16_t)slot), *eight = (const __m128i *)start; // values below 2^14
    __m128i low = _mm_cmpgt_epi16(_mm_loadu_si128(eight), all);
    __m128i high = _mm_cmpgt_epi16(_mm_loadu_si128(eight + 1), all);
    return __builtin_ctz((unsigned)_mm_movemask_epi8(_mm_packs_epi16(low, high)) | 1 << CODER_TOKENS) - 1;
#else
    int token = 0;
    while (token < ESCAPE && start[token + 1] <= slot) token++;
    return token;
#endif
}

static inline __attribute__((always_inline)) int get_token(struct decoder *d, uint32_t *state,
                                                           const uint16_t *start)
{
    uint32_t x = *state, slot = x & ((1 << CODER_BITS) - 1);
    int token = slot < start[1] ? 0 : tokens_before(start, slot);
    uint32_t end = token == ESCAPE ? 1 << CODER_BITS : start[token + 1];
    x = (end - start[token]) * (x >> CODER_BITS) + slot - start[token];
    if (x < STATE_LOW) {
        const uint8_t *word = d->bits.data + d->word_at;
        bool more = d->word_at + 2 <= d->word_end;
        x = x << 16 | (more ? (uint32_t)(word[0] | word[1] << 8) : 0);
        d->bits.spent |= !more;
        d->word_at += 2 * more;
    }
    *state = x;
    return token;
}

// A magnitude from its token and raw bits.
static uint32_t get_raw(struct decoder *d, int token, int raw)
{
    uint32_t magnitude = TOKEN_FIRST[token];
    if (token == ESCAPE)
        magnitude = get_escape(&d->bits);
    else if (TOKEN_BITS[token])
        magnitude += get_bits(&d->bits, TOKEN_BITS[token]);
    if (raw) magnitude = magnitude << raw | get_bits(&d->bits, raw);
    if (magnitude < CODER_LIMIT) return magnitude;
    d->bits.spent = true;
    return 0;
}

static inline __attribute__((always_inline)) uint32_t get_magnitude(struct decoder *d, uint32_t *state,
                                                                    int set, uint32_t sum)
{
    bool plain = sum < SUMS;
    int context = d->contexts.of[plain ? sum : SUMS - 1];
    int token = get_token(d, state, CODER_TABLES.start[set][context]);
    return plain && token < 8 ? (uint32_t)token : get_raw(d, token, raw_shift(sum));
}

static int state_count(const struct coder_tile *tile, int head)
{
    return head & OWN_STATES ? tile->bands - tile->first_band : 1;
}

static bool decoder_init(struct decoder *d, const struct coder_tile *tile, const uint8_t *data, size_t size)
{
    int head = data[0], states = state_count(tile, head), bytes = head & BRIEF_STATE ? 3 : 4;
    size_t words = 1 + (size_t)bytes * (size_t)states;
    if ((head & 7) >= CODER_SHIFTS || head >= BRIEF_STATE + OWN_STATES || size < words) return false;
    contexts_init(&d->contexts, (head & 7) - CODER_SHIFTS / 2);
    for (int s = 0; s < states; s++) {
        d->states[s] = 0;
        for (int byte = 0; byte < bytes; byte++)
            d->states[s] |= (uint32_t)data[1 + bytes * s + byte] << 8 * byte;
        if (d->states[s] < STATE_LOW) return false;
    }
    d->bits = (struct bit_reader){.data = data, .at = size, .low = words};
    d->word_at = words;
    d->word_end = size;
    return true;
}

// A row of magnitudes takes its signs from the lowest bits of `held`; returns how many were taken.  No branch
// hangs on a coefficient: half of them would be mispredicted.
static inline int sign_row(int32_t *row, int width, uint64_t *held)
{
    uint64_t left = *held;
    int taken = 0;
    for (int x = 0; x < width; x++) {
        int32_t magnitude = row[x], any = magnitude != 0;
        int32_t negative = -(int32_t)((int32_t)left & any);
        row[x] = (magnitude ^ negative) - negative;
        left = any ? left >> 1 : left;
        taken += any;
    }
    *held = left;
    return taken;
}

// Gives the magnitudes of a tile their signs; false when the states do not end where an encoder begins.
static bool get_signs(struct decoder *d, const struct coder_tile *tile, int states, coder_band *k)
{
    uint64_t in_states = 0;
    int stated = 16 * states;
    for (int s = 0; s < states; s++) {
        if (d->states[s] >> 16 != 1) return false;
        in_states |= (uint64_t)(d->states[s] & 0xffff) << 16 * s;
    }
    for (int b = tile->first_band; b < tile->bands; b++)
        for (int y = 0; y < tile->height[b]; y++) {
            int32_t *row = k[b] + y * CODER_TILE;
            int width = tile->width[b], x = 0;
            for (; x < width && stated > 0; x++) // at most the first signs of a tile
                if (row[x]) stated -= sign_row(row + x, 1, &in_states);
            if (x == width) continue;
            refill(&d->bits); // 57 bits, or all there are with zeros behind
            d->bits.count -= sign_row(row + x, width - x, &d->bits.held);
            if (d->bits.count >= 0) continue;
            d->bits.spent = true;
            d->bits.count = 0;
        }
    return in_states == 0;
}

// Magnitudes of all bands, in lockstep, so that the states' latencies overlap.  What hangs from one
// coefficient to the next (states, the two magnitudes to the west) is kept in variables.
static inline __attribute__((always_inline)) void
get_magnitudes(struct decoder *d, const struct coder_tile *tile, coder_band *k, bool siblings, bool own)
{
    struct plane planes[CODER_BANDS];
    planes_start(planes, tile);
    int columns = tile_columns(tile), rows = tile_rows(tile), first = tile->first_band;
    uint32_t states[CODER_BANDS] = {d->states[0]};
    for (int b = first; own && b < tile->bands; b++) states[b] = d->states[b - first];
    for (int y = 0; y < rows && !d->bits.spent; y++) {
        int width[CODER_BANDS] = {0}; // a tile may have fewer bands
        uint32_t west[CODER_BANDS] = {0}, west2[CODER_BANDS] = {0};
        for (int b = first; b < tile->bands; b++) {
            width[b] = y < tile->height[b] ? tile->width[b] : 0;
            plane_start_row(&planes[b], tile->activity[b] + y * CODER_TILE, y);
        }
        for (int x = 0; x < columns; x++)
#pragma GCC unroll 4
            for (int b = 0; b < CODER_BANDS; b++) {
                if (x >= width[b]) continue;
                uint32_t sum = planes[b].row[x] + 2 * west2[b] + 8 * west[b];
                if (siblings) sum = with_siblings(planes, sum, b, x, y);
                uint32_t magnitude = get_magnitude(d, &states[own ? b : 0], tile->set[b], sum);
                west2[b] = west[b];
                west[b] = magnitude;
                plane_row(&planes[b], y)[x] = magnitude;
                k[b][y * CODER_TILE + x] = (int32_t)magnitude;
            }
    }
    if (!own) d->states[0] = states[0];
    for (int b = first; own && b < tile->bands; b++) d->states[b - first] = states[b];
}

bool coder_decode(const struct coder_tile *tile, const uint8_t *data, size_t size, coder_band *k)
{
    for (int b = tile->first_band; b < tile->bands; b++) memset(k[b], 0, sizeof k[b]);
    if (size == 0) return true;
    struct decoder d;
    if (!decoder_init(&d, tile, data, size)) return false;
    bool own = data[0] & OWN_STATES;
    if (tile->siblings && own)
        get_magnitudes(&d, tile, k, true, true);
    else if (tile->siblings)
        get_magnitudes(&d, tile, k, true, false);
    else if (own)
        get_magnitudes(&d, tile, k, false, true);
    else
        get_magnitudes(&d, tile, k, false, false);
    // No byte may have been read twice, and none left.
    return get_signs(&d, tile, state_count(tile, data[0]), k) && !d.bits.spent &&
           d.bits.at + (size_t)(d.bits.count / 8) == d.word_at;
}
