// SPDX-License-Identifier: MIT
#include "common/terrain/relief/layout.h"

#include "common/integer.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

// ---- the levels ------------------------------------------------------------

void grid_init(struct grid *grid, int64_t width, int64_t height)
{
    memset(grid, 0, sizeof *grid);
    grid->size[0][0] = width, grid->size[0][1] = height;
    int last = 0;
    for (; grid->size[last][0] > LAYOUT_BASE || grid->size[last][1] > LAYOUT_BASE; last++)
        for (int axis = 0; axis < 2; axis++) {
            grid->size[last + 1][axis] = (grid->size[last][axis] + 1) / 2;
            grid->tiles[last][axis] = (grid->size[last + 1][axis] + CODER_TILE - 1) / CODER_TILE;
        }
    grid->count = last + 1;
    for (int l = last - 1; l >= 0; l--) {
        grid->first_tile[l] = grid->tile_count;
        grid->tile_count += grid->tiles[l][0] * grid->tiles[l][1];
    }
}

struct rect layout_half_rect(const struct rect *fine, int band)
{
    int64_t right = band & 1 ? 0 : 1, up = band >> 1 ? 0 : 1;
    return (struct rect){fine->x0 / 2, fine->y0 / 2, (fine->x1 + right) / 2, (fine->y1 + up) / 2};
}

int64_t grid_band_size(const struct grid *grid, int level, int band, int axis)
{
    bool high = axis == 0 ? band & 1 : band >> 1;
    return (grid->size[level][axis] + !high) / 2;
}

// ---- sums that wrap --------------------------------------------------------

static inline int32_t add(int32_t a, int32_t b)
{
    return (int32_t)((uint32_t)a + (uint32_t)b);
}
static inline int32_t subtract(int32_t a, int32_t b)
{
    return (int32_t)((uint32_t)a - (uint32_t)b);
}
static inline int32_t times(int32_t a, int32_t b)
{
    return (int32_t)((uint32_t)a * (uint32_t)b);
}
static inline int32_t four_point(int32_t a, int32_t b, int32_t c,
                                 int32_t d) // 16 times the value between b and c
{
    return (int32_t)(9 * ((uint32_t)b + (uint32_t)c) - (uint32_t)a - (uint32_t)d);
}
static inline int32_t predict(int32_t a, int32_t b, int32_t c, int32_t d)
{
    return add(four_point(a, b, c, d), 8) >> 4;
}
static inline int32_t update(int32_t a, int32_t b, int32_t c, int32_t d)
{
    return add(four_point(a, b, c, d), 16) >> 5;
}

// ---- one tile --------------------------------------------------------------

struct rect layout_coarse_rect(const struct grid *grid, int level, int64_t tx0, int64_t ty0, int64_t tx1,
                               int64_t ty1)
{
    const int64_t *size = grid->size[level + 1];
    return (struct rect){larger(tx0 * CODER_TILE - 1, 0), larger(ty0 * CODER_TILE - 1, 0),
                         smaller(tx1 * CODER_TILE + 2, size[0]), smaller(ty1 * CODER_TILE + 2, size[1])};
}

// Continues a line of values beyond its first and last known ones by straight lines; far ones repeat.
static void continue_line(int32_t *line, int stride, int from, int to, int count)
{
    bool flat = to - from < 2;
    for (int i = from - 1; i >= 0; i--)
        line[i * stride] =
            flat ? line[from * stride] : subtract(times(2, line[(i + 1) * stride]), line[(i + 2) * stride]);
    for (int i = to; i < count; i++)
        line[i * stride] = flat || i > to + 1
                               ? line[(i - 1) * stride]
                               : subtract(times(2, line[(i - 1) * stride]), line[(i - 2) * stride]);
}

static void gather_coarse(struct layout_tile *tile, const struct grid *grid, int level, int64_t tx,
                          int64_t ty, const struct patch *coarse)
{
    const int64_t *size = grid->size[level + 1];
    int64_t x0 = tx * CODER_TILE - 1, y0 = ty * CODER_TILE - 1;
    int from_x = x0 < 0, to_x = (int)smaller(TILE_COARSE, size[0] - x0);
    int from_y = y0 < 0, to_y = (int)smaller(TILE_COARSE, size[1] - y0);
    for (int y = from_y; y < to_y; y++) {
        memcpy(&tile->coarse[y][from_x], patch_at(coarse, x0 + from_x, y0 + y),
               (size_t)(to_x - from_x) * sizeof(int32_t));
        if (from_x > 0 || to_x < TILE_COARSE) continue_line(tile->coarse[y], 1, from_x, to_x, TILE_COARSE);
    }
    if (from_y > 0 || to_y < TILE_COARSE)
        for (int x = 0; x < TILE_COARSE; x++)
            continue_line(&tile->coarse[0][x], TILE_COARSE, from_y, to_y, TILE_COARSE);
}

// How much the coarser level bends between four samples: what U misses there is of that order.
static inline uint32_t bend(const int32_t *at, int stride)
{
    int32_t d = add(subtract(subtract(at[0], at[stride]), at[2 * stride]), at[3 * stride]);
    return d < 0 ? 0u - (uint32_t)d : (uint32_t)d;
}

struct activity_scale { // activity = min(bend >> down, 65535) * factor >> 14
    int down;
    uint32_t factor;
};

static struct activity_scale activity_scale(int32_t step)
{
    enum { PER_STEP_16 = 16 };
    struct activity_scale scale = {0, 0};
    while (step >> scale.down >= 256) scale.down++;
    scale.factor = ((uint32_t)PER_STEP_16 << 10) / (uint32_t)(step >> scale.down);
    return scale;
}

static inline uint16_t scaled(uint32_t bend, struct activity_scale scale)
{
    uint32_t down = bend >> scale.down, limited = down < 65535 ? down : 65535;
    uint32_t activity = limited * scale.factor >> 14;
    return (uint16_t)(activity < 65535 ? activity : 65535);
}

static void measure_activity(struct layout_tile *tile, const int32_t step[CODER_BANDS])
{
    struct activity_scale hl = activity_scale(step[BAND_HL]), lh = activity_scale(step[BAND_LH]),
                          hh = activity_scale(step[BAND_HH]);
    for (int y = 0; y < CODER_TILE; y++)
        for (int x = 0; x < CODER_TILE; x++) {
            uint32_t along_x = bend(&tile->coarse[y + 1][x], 1),
                     along_y = bend(&tile->coarse[y][x + 1], TILE_COARSE);
            int at = y * CODER_TILE + x;
            tile->activity[BAND_HL][at] = scaled(along_x + along_y / 4, hl);
            tile->activity[BAND_LH][at] = scaled(along_y + along_x / 4, lh);
            tile->activity[BAND_HH][at] = scaled(along_x / 2 + along_y / 2, hh);
        }
}

void layout_tile_init(struct layout_tile *tile, enum layout layout, const struct grid *grid, int level,
                      int64_t tx, int64_t ty, const struct patch *coarse, const int32_t step[CODER_BANDS])
{
    struct coder_tile *coder = &tile->coder;
    bool all = layout >= LAYOUT_PYRAMID; // (even, even) samples too
    *coder = (struct coder_tile){.first_band = all ? 0 : BAND_HL,
                                 .bands = CODER_BANDS,
                                 .siblings = layout == LAYOUT_BOUNDED,
                                 .activity = (const uint16_t(*)[CODER_TILE * CODER_TILE]) tile->activity};
    for (int band = coder->first_band; band <= BAND_HH; band++) {
        int64_t width = grid_band_size(grid, level, band, 0) - tx * CODER_TILE;
        int64_t height = grid_band_size(grid, level, band, 1) - ty * CODER_TILE;
        bool none = width <= 0 || height <= 0;
        coder->width[band] = none ? 0 : (int)smaller(width, CODER_TILE);
        coder->height[band] = none ? 0 : (int)smaller(height, CODER_TILE);
        coder->set[band] = all ? 8 +
                                     (band == 0         ? 0
                                      : band == BAND_HH ? 4
                                                        : 2) +
                                     (level == 0)
                               : (layout == LAYOUT_BOUNDED) * 4 + (band == BAND_HH) * 2 + (level == 0);
    }
    gather_coarse(tile, grid, level, tx, ty, coarse);
    measure_activity(tile, step);
    if (all) memcpy(tile->activity[0], tile->activity[BAND_HH], sizeof tile->activity[0]);
}

// ---- bounded ---------------------------------------------------------------

static inline int32_t nearest_multiple(int32_t value, int32_t step) // step is odd
{
    int32_t half = step / 2;
    return value >= 0 ? (value + half) / step : -((half - value) / step);
}

// Coefficient that brings `predicted` to within step / 2 of `wanted`, if there is one, and the sample.
static inline int32_t settle(int32_t predicted, const int32_t *wanted, int32_t step, int32_t *k)
{
    if (wanted) *k = nearest_multiple(subtract(*wanted, predicted), step);
    return add(predicted, times(*k, step));
}

int32_t layout_settle(int32_t predicted, const int32_t *wanted, int32_t step, int32_t *k)
{
    return settle(predicted, wanted, step, k);
}

void layout_bounded_tile(const struct layout_tile *tile, int32_t step, const int32_t *wanted, coder_band *k,
                         int32_t *samples)
{
    enum { N = CODER_TILE, S = LAYOUT_SAMPLES, M = TILE_COARSE };
    int32_t hl[M][N], lh[N][M]; // hl[y + 1][x], lh[y][x + 1]
    const struct coder_tile *coder = &tile->coder;
    for (int y = 0; y < M; y++)
        for (int x = 0; x < N; x++) {
            const int32_t *c = &tile->coarse[y][x];
            hl[y][x] = predict(c[0], c[1], c[2], c[3]);
        }
    for (int y = 0; y < N; y++)
        for (int x = 0; x < M; x++) {
            const int32_t *c = &tile->coarse[y][x];
            lh[y][x] = predict(c[0], c[M], c[2 * M], c[3 * M]);
        }
    for (int y = 0; y < coder->height[BAND_HL]; y++)
        for (int x = 0; x < coder->width[BAND_HL]; x++)
            hl[y + 1][x] = settle(hl[y + 1][x], wanted ? &wanted[2 * y * S + 2 * x + 1] : NULL, step,
                                  &k[BAND_HL][y * N + x]);
    for (int y = 0; y < coder->height[BAND_LH]; y++)
        for (int x = 0; x < coder->width[BAND_LH]; x++)
            lh[y][x + 1] = settle(lh[y][x + 1], wanted ? &wanted[(2 * y + 1) * S + 2 * x] : NULL, step,
                                  &k[BAND_LH][y * N + x]);
    for (int y = 0; y < N; y++)
        for (int x = 0; x < N; x++) {
            samples[2 * y * S + 2 * x] = tile->coarse[y + 1][x + 1];
            samples[2 * y * S + 2 * x + 1] = hl[y + 1][x];
            samples[(2 * y + 1) * S + 2 * x] = lh[y][x + 1];
        }
    for (int y = 0; y < coder->height[BAND_HH]; y++)
        for (int x = 0; x < coder->width[BAND_HH]; x++) {
            int32_t along_x = four_point(lh[y][x], lh[y][x + 1], lh[y][x + 2], lh[y][x + 3]);
            int32_t along_y = four_point(hl[y][x], hl[y + 1][x], hl[y + 2][x], hl[y + 3][x]);
            int32_t predicted = add(add(along_x, along_y), 16) >> 5;
            int at = (2 * y + 1) * S + 2 * x + 1;
            samples[at] = settle(predicted, wanted ? &wanted[at] : NULL, step, &k[BAND_HH][y * N + x]);
        }
}

// ---- wavelet: along one axis -----------------------------------------------

struct span { // of indices along one axis
    int64_t from, to;
};

struct axis { // what inverse lifting of samples reads, along one axis
    struct span samples, low, high;
    int64_t low_size, high_size;
};

static struct axis axis_of(int64_t size, int64_t from, int64_t to)
{
    struct axis a = {.samples = {from, to}, .low_size = (size + 1) / 2, .high_size = size / 2};
    a.low = (struct span){larger((from >> 1) - 1, 0), smaller(((to - 1) >> 1) + 3, a.low_size)};
    // The line is continued from its last two even samples.
    a.low.from = larger(smaller(a.low.from, a.low_size - 2), 0);
    a.high = (struct span){larger(a.low.from - 2, 0), smaller(a.low.to + 1, a.high_size)};
    if (a.high.from > a.high.to) a.high.from = a.high.to;
    return a;
}

enum { PAD = 3 }; // values before and after a line that lifting reads

// Even samples continued beyond the ends by straight lines; `even` points at index 0.
static void continue_even(int32_t *even, struct span known, int64_t size, int64_t stride)
{
    int64_t step = size > 1 ? stride : 0;
    if (known.from == 0) even[-stride] = subtract(times(2, even[0]), even[step]);
    if (known.to == size)
        for (int64_t i = size; i < size + 2; i++)
            even[i * stride] =
                size > 1 ? subtract(times(2, even[(i - 1) * stride]), even[(i - 2) * stride]) : even[0];
}

// One line of samples from its low and high halves.  `room` holds at least both spans and 4 PAD more.
static void inverse_line(const struct axis *a, const int32_t *low, const int32_t *high, int32_t *room,
                         int32_t *out)
{
    int64_t lows = a->low.to - a->low.from, highs = a->high.to - a->high.from;
    int32_t *padded = room + PAD, *even = padded + (a->low.to - a->high.from) + 3 * PAD;
    memset(room, 0, (size_t)(a->low.to - a->high.from + 3 * PAD) * sizeof *room);
    memcpy(padded, high, (size_t)highs * sizeof *high);
    const int32_t *d = padded + (a->low.from - a->high.from);
    for (int64_t i = 0; i < lows; i++) even[i] = subtract(low[i], update(d[i - 2], d[i - 1], d[i], d[i + 1]));
    int32_t *at_zero = even - a->low.from;
    continue_even(at_zero, a->low, a->low_size, 1);
    const int32_t *high_zero = padded - a->high.from;
    int64_t x = a->samples.from;
    if (x & 1 && x < a->samples.to) {
        const int32_t *e = at_zero + (x >> 1);
        *out++ = add(high_zero[x >> 1], predict(e[-1], e[0], e[1], e[2]));
        x++;
    }
    int64_t pairs = (a->samples.to - x) / 2;
    const int32_t *e = at_zero + (x >> 1), *h = high_zero + (x >> 1);
    for (int64_t i = 0; i < pairs; i++) {
        out[2 * i] = e[i];
        out[2 * i + 1] = add(h[i], predict(e[i - 1], e[i], e[i + 1], e[i + 2]));
    }
    if (x + 2 * pairs < a->samples.to) out[2 * pairs] = e[pairs];
}

// Columns of samples, `count` side by side, from their low and high halves (patches that start at column x0).
static void inverse_columns(const struct axis *a, const struct patch *low, const struct patch *high,
                            int64_t x0, int64_t count, int32_t *room, int32_t *out)
{
    int32_t *even = room + PAD * count, *at_zero = even - a->low.from * count;
    int32_t *zeros = even + (a->low.to - a->low.from + PAD) * count;
    memset(zeros, 0, (size_t)count * sizeof *zeros);
    for (int64_t j = a->low.from; j < a->low.to; j++) {
        const int32_t *d[4], *s = patch_at(low, x0, j);
        for (int k = 0; k < 4; k++) {
            int64_t row = j - 2 + k;
            d[k] = row >= a->high.from && row < a->high.to ? patch_at(high, x0, row) : zeros;
        }
        int32_t *to = at_zero + j * count;
        for (int64_t i = 0; i < count; i++)
            to[i] = subtract(s[i], update(d[0][i], d[1][i], d[2][i], d[3][i]));
    }
    for (int64_t i = 0; i < count; i++) continue_even(at_zero + i, a->low, a->low_size, count);
    for (int64_t y = a->samples.from; y < a->samples.to; y++, out += count) {
        const int32_t *e = at_zero + (y >> 1) * count;
        if (!(y & 1)) {
            memcpy(out, e, (size_t)count * sizeof *out);
            continue;
        }
        const int32_t *d = patch_at(high, x0, y >> 1), *before = e - count, *after = e + count,
                      *after2 = e + 2 * count;
        for (int64_t i = 0; i < count; i++) out[i] = add(d[i], predict(before[i], e[i], after[i], after2[i]));
    }
}

struct rect layout_wavelet_band_rect(const struct grid *grid, int level, const struct rect *wanted, int band)
{
    struct axis x = axis_of(grid->size[level][0], wanted->x0, wanted->x1);
    struct axis y = axis_of(grid->size[level][1], wanted->y0, wanted->y1);
    struct span across = band & 1 ? x.high : x.low, along = band >> 1 ? y.high : y.low;
    return (struct rect){across.from, along.from, across.to, along.to};
}

bool layout_wavelet_inverse(const struct grid *grid, int level, const struct patch bands[CODER_BANDS],
                            const struct patch *wanted)
{
    struct axis x = axis_of(grid->size[level][0], wanted->rect.x0, wanted->rect.x1);
    struct axis y = axis_of(grid->size[level][1], wanted->rect.y0, wanted->rect.y1);
    int64_t lows = x.low.to - x.low.from, highs = x.high.to - x.high.from, rows = rect_height(&wanted->rect);
    int64_t width = rect_width(&wanted->rect), most = larger(lows, highs) + 1;
    int64_t column_room = (y.low.to - y.low.from + 3 * PAD) * most, line_room = 2 * (lows + highs) + 8 * PAD;
    int32_t *room = malloc((size_t)(larger(column_room, line_room) + (lows + highs) * rows) * sizeof *room);
    if (!room) return false;
    int32_t *low = room + larger(column_room, line_room), *high = low + lows * rows;
    inverse_columns(&y, &bands[0], &bands[BAND_LH], x.low.from, lows, room, low);
    if (highs) inverse_columns(&y, &bands[BAND_HL], &bands[BAND_HH], x.high.from, highs, room, high);
    for (int64_t j = 0; j < rows; j++)
        inverse_line(&x, low + j * lows, high + j * highs, room, wanted->samples + j * width);
    free(room);
    return true;
}

// Forward lifting of a line of `size` samples; `room` holds size + 4 PAD values.
static void forward_line(const int32_t *line, int64_t size, int32_t *room, int32_t *low, int32_t *high)
{
    int64_t lows = (size + 1) / 2, highs = size / 2;
    int32_t *even = room + PAD, *odd = even + lows + 2 * PAD;
    for (int64_t i = 0; i < lows; i++) even[i] = line[2 * i];
    continue_even(even, (struct span){0, lows}, lows, 1);
    for (int64_t i = -PAD; i < 0; i++) odd[i] = odd[highs - 1 - i] = 0;
    for (int64_t i = 0; i < highs; i++)
        odd[i] = subtract(line[2 * i + 1], predict(even[i - 1], even[i], even[i + 1], even[i + 2]));
    for (int64_t i = 0; i < lows; i++)
        low[i] = add(even[i], update(odd[i - 2], odd[i - 1], odd[i], odd[i + 1]));
    memcpy(high, odd, (size_t)highs * sizeof *high);
}

// Forward lifting of columns in place: `low` holds their even rows and `high` their odd ones.  `room` holds
// four rows.
static void forward_columns(const struct patch *low, const struct patch *high, int32_t *room)
{
    int64_t count = rect_width(&low->rect), lows = rect_height(&low->rect), highs = rect_height(&high->rect);
    int32_t *before = room, *after = room + count, *after2 = after + count, *zeros = after2 + count;
    int32_t *last = low->samples + (lows - 1) * count;
    for (int64_t i = 0; i < count; i++) {
        before[i] = lows > 1 ? subtract(times(2, low->samples[i]), low->samples[count + i]) : low->samples[i];
        after[i] = lows > 1 ? subtract(times(2, last[i]), last[i - count]) : last[i];
        after2[i] = lows > 1 ? subtract(times(2, after[i]), last[i]) : after[i];
        zeros[i] = 0;
    }
    for (int64_t j = 0; j < highs; j++) {
        const int32_t *e[4];
        for (int k = 0; k < 4; k++) {
            int64_t row = j - 1 + k;
            e[k] = row < 0 ? before : row < lows ? low->samples + row * count : row == lows ? after : after2;
        }
        int32_t *to = high->samples + j * count;
        for (int64_t i = 0; i < count; i++)
            to[i] = subtract(to[i], predict(e[0][i], e[1][i], e[2][i], e[3][i]));
    }
    for (int64_t j = 0; j < lows; j++) {
        const int32_t *d[4];
        for (int k = 0; k < 4; k++) {
            int64_t row = j - 2 + k;
            d[k] = row >= 0 && row < highs ? high->samples + row * count : zeros;
        }
        int32_t *to = low->samples + j * count;
        for (int64_t i = 0; i < count; i++) to[i] = add(to[i], update(d[0][i], d[1][i], d[2][i], d[3][i]));
    }
}

bool layout_wavelet_forward(const struct patch *fine, struct patch bands[CODER_BANDS])
{
    int64_t width = rect_width(&fine->rect), height = rect_height(&fine->rect);
    for (int b = 0; b < CODER_BANDS; b++) bands[b].rect = layout_half_rect(&fine->rect, b);
    int32_t *room = malloc((size_t)(4 * width + 8 * PAD) * sizeof *room);
    if (!room) return false;
    int64_t lows = rect_width(&bands[0].rect), highs = rect_width(&bands[BAND_HL].rect);
    for (int64_t y = 0; y < height; y++)
        forward_line(fine->samples + y * width, width, room,
                     bands[y & 1 ? BAND_LH : 0].samples + y / 2 * lows,
                     bands[y & 1 ? BAND_HH : BAND_HL].samples + y / 2 * highs);
    forward_columns(&bands[0], &bands[BAND_LH], room);
    if (highs) forward_columns(&bands[BAND_HL], &bands[BAND_HH], room);
    free(room);
    return true;
}

// ---- norms -----------------------------------------------------------------

// L2 norm along one axis of a low (or high) coefficient `levels` steps up: by synthesis of an impulse.
static double norm_1d(int levels, bool high)
{
    enum { EXACT = 6, COEFFICIENTS = 24, MOST = COEFFICIENTS << EXACT };
    static const double P[4] = {-0.0625, 0.5625, 0.5625, -0.0625};
    int exact = levels < EXACT ? levels : EXACT;
    double line[MOST] = {0}, even[MOST], d[MOST];
    int count = COEFFICIENTS;
    for (int l = 0; l < exact; l++, count *= 2) {
        for (int i = 0; i < count; i++) even[i] = line[i], d[i] = 0;
        if (l == 0) (high ? d : even)[count / 2] = 1;
        double updated[MOST];
        for (int i = 0; i < count; i++) {
            double sum = 0;
            for (int k = 0; k < 4; k++)
                if (i - 2 + k >= 0 && i - 2 + k < count) sum += P[k] / 2 * d[i - 2 + k];
            updated[i] = even[i] - sum;
        }
        for (int i = 0; i < count; i++) {
            double sum = 0;
            for (int k = 0; k < 4; k++)
                if (i - 1 + k >= 0 && i - 1 + k < count) sum += P[k] * updated[i - 1 + k];
            line[2 * i] = updated[i];
            line[2 * i + 1] = d[i] + sum;
        }
    }
    double squares = 0;
    for (int i = 0; i < count; i++) squares += line[i] * line[i];
    return sqrt(squares *
                ldexp(1, levels - exact)); // each further step doubles the support, nearly to the digit
}

double layout_wavelet_norm(int level, int band)
{
    return norm_1d(level + 1, band & 1) * norm_1d(level + 1, band >> 1);
}
