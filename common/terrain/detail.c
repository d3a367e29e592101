// SPDX-License-Identifier: MIT
#include "common/terrain/detail.h"

#include "common/terrain/synthesis.h"
#include "common/terrain/upsample.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>

// Windows are made tile by tile, so that the coarser windows under a tile fit a small array: a tile of 64
// needs 36 samples a side of the next level, then 22, 15, 12, 10 and from there on at most 9.
enum { TILE = 64, SCRATCH = 36 * 36 + 22 * 22 + 15 * 15 + 12 * 12 + 10 * 10 + 81 * DETAIL_MAX_FINER };

// Towards the poles rows have posts of their own.  A row asks for posts of those about it, at most a quarter
// as far apart as its own, at 8 more places a level.
enum { MOST_POSTS = 1024, POSTS = 96 * 1024, REACH = 3 };

static int32_t limit(int32_t q)
{
    return q > QUANTA_LIMIT ? QUANTA_LIMIT : q < -QUANTA_LIMIT ? -QUANTA_LIMIT : q;
}

// The cosine of the latitude of row j within .0016 (Bhaskara I), 0 on the poles.  Only exact operations and
// divisions: the same on any machine.
static double parallel_at(const struct sphere_grid *grid, int64_t j)
{
    double t = (double)j / (double)grid->pole, square = t * t;
    return 4 * (1 - square) / (4 + square);
}

// Whether posts 2^exponent columns apart come out even over half a turn.
static bool divides(const struct sphere_grid *grid, int exponent)
{
    return (grid->columns & (((int64_t)2 << exponent) - 1)) == 0;
}

static int exponent_of(const struct sphere_grid *grid, int64_t row)
{
    int64_t i = 0;
    if (llabs(row) > grid->pole) sphere_fold(grid, &i, &row);
    if (2 * llabs(row) < grid->pole) return 0;
    double parallel = parallel_at(grid, row);
    int exponent = 0;
    for (; 2 * parallel <= 1 && divides(grid, exponent + 1); exponent++) parallel *= 2;
    return exponent;
}

int detail_exponent(const struct detail *detail, int level, int64_t row)
{
    struct sphere_grid grid = sphere_level(&detail->grid, level);
    return exponent_of(&grid, row);
}

// ---- noise -----------------------------------------------------------------

// Every 2^skipped-th post of a row from `first` on, counted from the grid's first column.
struct run {
    int64_t first;
    int skipped, count;
};

// Where even posts are crowded, a row has as many deviates as it has room for at the distance of rows, and
// heights between them are linear; a pole has one.
static void add_wide_noise(const struct run *run, int64_t turn, double deviates,
                           const struct synthesis_row *noise, int32_t *row)
{
    double apart = deviates / (double)turn, ends[2] = {0, 0};
    int64_t held = -1;
    for (int k = 0; k < run->count; k++) {
        double place = (double)(run->first + ((int64_t)k << run->skipped)) * apart;
        int64_t at = (int64_t)place, next = (double)at + 1 < deviates ? at + 1 : 0;
        if (at != held) {
            ends[0] = synthesis_deviate(noise, at);
            ends[1] = synthesis_deviate(noise, next);
            held = at;
        }
        double f = place - (double)at;
        row[k] += synthesis_rounded(noise->sigma_q * ((1 - f) * ends[0] + f * ends[1]));
    }
}

static void add_noise(const struct detail *detail, int level, int64_t y, int exponent, struct run run,
                      int32_t *row)
{
    struct sphere_grid grid = sphere_level(&detail->grid, level);
    double sigma_q = detail->sigma_q[-level];
    if (sigma_q * DETAIL_DEVIATE < 0.5) return; // all of it would be rounded away
    int64_t i = grid.first + run.first * ((int64_t)1 << exponent), j = y, turn = grid.columns >> exponent,
            first = grid.first >> exponent;
    sphere_fold(&grid, &i, &j);
    // Up to 45 degrees there is room for more than half of them anyway.
    double room = 2 * llabs(j) < grid.pole ? (double)turn : parallel_at(&grid, j) * (double)grid.columns;
    struct synthesis_row noise = {.sigma_q = sigma_q};
    if (2 * room < (double)turn || run.skipped) noise = synthesis_row(j, level, detail->seed, sigma_q);
    run.first = (i - grid.first) >> exponent;
    int64_t step = (int64_t)1 << run.skipped;
    for (int left = run.count; left > 0; left -= run.count) {
        int64_t here = (turn - run.first + step - 1) >> run.skipped; // to the end of the turn
        run.count = here < left ? (int)here : left;
        if (2 * room < (double)turn)
            add_wide_noise(&run, turn, fmax(floor(room), 1), &noise, row);
        else if (run.skipped == 0)
            synthesis_add_row(row, run.count, first + run.first, j, level, detail->seed, sigma_q);
        else
            for (int k = 0; k < run.count; k++)
                row[k] += synthesis_rounded(
                    sigma_q * synthesis_deviate(&noise, first + run.first + ((int64_t)k << run.skipped)));
        row += run.count;
        run.first += run.count * step - turn;
    }
}

static void finish_row(const struct detail *detail, int level, int64_t y, int exponent, struct run run,
                       int32_t *row)
{
    add_noise(detail, level, y, exponent, run, row);
    for (int i = 0; i < run.count; i++) row[i] = limit(row[i]);
}

void detail_refine(const struct detail *detail, int level, int exponent, const int32_t *coarse, int64_t post,
                   int64_t y0, int width, int height, int32_t *out)
{
    upsample(coarse, post, y0, width, height, out);
    for (int j = 0; j < height; j++)
        finish_row(detail, level, y0 + j, exponent, (struct run){post, 0, width}, out + (int64_t)j * width);
}

// ---- rows of posts ---------------------------------------------------------

struct row { // samples first, first + 1, ..., 2^exponent columns apart, counted from the grid's first column
    int exponent, count;
    int skipped; // each is a post, those between them are not made: posts are 2^(exponent - skipped) apart
    int64_t first;
    int32_t *posts;
};

static void read_row(const struct detail *detail, int64_t y, struct row *row)
{
    const struct sphere_grid *grid = &detail->grid;
    for (int k = 0; k < row->count; k++) {
        int64_t i = grid->first + (row->first + k) * ((int64_t)1 << row->exponent), j = y;
        if (detail->samples) {
            sphere_fold(grid, &i, &j);
            row->posts[k] = detail->samples[(j + grid->pole) * grid->columns + i - grid->first];
        } else
            detail->read(detail->user, i, j, 1, 1, &row->posts[k]);
    }
}

// The samples of a row 2^exponent columns apart: posts, or linear between them.
static void samples_of(const struct row *row, int exponent, int64_t first, int count, int32_t *out)
{
    int finer = row->exponent - exponent;
    if (finer <= 0) {
        const int32_t *posts = row->posts + (first * ((int64_t)1 << -finer) - row->first);
        for (int k = 0; k < count; k++) out[k] = posts[(int64_t)k << -finer];
        return;
    }
    int64_t scale = (int64_t)1 << finer, post = (first >> finer) - row->first, rest = first & (scale - 1);
    for (int k = 0; k < count; k++) {
        int64_t a = row->posts[post], b = rest ? row->posts[post + 1] : a;
        out[k] = (int32_t)((a * scale + (b - a) * rest + scale / 2) >> finer);
        if (++rest == scale) rest = 0, post++;
    }
}

static void heights_of(const struct row *row, int exponent, int64_t first, int count, float *out)
{
    for (int k = 0; k < count; k++) {
        double place = ldexp((double)(first + k), exponent - row->exponent), at = floor(place);
        const int32_t *post = row->posts + ((int64_t)at - row->first);
        out[k] = (float)(place > at ? post[0] + (place - at) * ((double)post[1] - post[0]) : post[0]);
    }
}

// What a row's posts are made of, in the next coarser level: samples 2^exponent columns apart.
struct support {
    int exponent, count, rows; // 1 row or 4 of them
    int64_t first, row;
    bool between; // whether there are posts between the samples
};

static struct support support_of(const struct sphere_grid *coarse, const struct row *row, int64_t y)
{
    struct support s = {.rows = y & 1 ? 4 : 1, .row = y & 1 ? (y >> 1) - 1 : y >> 1};
    s.between = row->exponent == 0 || (row->skipped == 0 && divides(coarse, row->exponent));
    s.exponent = s.between ? row->exponent : row->exponent - 1;
    s.first = s.between ? (row->first >> 1) - 1 : row->first;
    s.count = s.between ? upsample_coarse_size(row->first, row->count) : row->count;
    return s;
}

static inline int32_t four_point(int32_t a, int32_t b, int32_t c, int32_t d)
{
    return 9 * (b + c) - a - d;
}

// U, and noise.
static void make_row(const struct detail *detail, int level, int64_t y, const struct support *s,
                     const struct row *coarse, struct row *row)
{
    int32_t z[4][MOST_POSTS];
    for (int k = 0; k < s->rows; k++) samples_of(&coarse[k], s->exponent, s->first, s->count, z[k]);
    int shift = 0;
    if (s->rows == 4) {
        for (int i = 0; i < s->count; i++) z[0][i] = four_point(z[0][i], z[1][i], z[2][i], z[3][i]);
        shift = 4;
    }
    int32_t even = shift ? 1 << (shift - 1) : 0, odd = 1 << (shift + 3);
    for (int k = 0; k < row->count; k++) {
        const int32_t *c = z[0] + (s->between ? ((row->first + k) >> 1) - (row->first >> 1) : k);
        if (s->between && (row->first + k) & 1)
            row->posts[k] = (four_point(c[0], c[1], c[2], c[3]) + odd) >> (shift + 4);
        else
            row->posts[k] = (c[s->between] + even) >> shift;
    }
    finish_row(detail, level, y, row->exponent - row->skipped,
               (struct run){row->first * ((int64_t)1 << row->skipped), row->skipped, row->count}, row->posts);
}

// Makes rows y0.. of posts, which know what they hold; `room`: for coarser ones.
static void make_rows(const struct detail *detail, int level, int64_t y0, int height, struct row *rows,
                      int32_t *room)
{
    enum { MOST_ROWS = TILE / 2 + 4 };
    if (level == 0) {
        for (int k = 0; k < height; k++) read_row(detail, y0 + k, &rows[k]);
        return;
    }
    struct sphere_grid grid = sphere_level(&detail->grid, level + 1);
    struct row coarse[MOST_ROWS];
    int64_t from[MOST_ROWS], to[MOST_ROWS], first_row = (y0 >> 1) - 1;
    int count = upsample_coarse_size(y0, height), least[MOST_ROWS];
    for (int k = 0; k < count; k++) from[k] = INT64_MAX, to[k] = INT64_MIN, least[k] = INT_MAX;
    for (int k = 0; k < height; k++) {
        struct support s = support_of(&grid, &rows[k], y0 + k);
        int64_t scale = (int64_t)1 << s.exponent, west = s.first * scale,
                east = (s.first + s.count - 1) * scale;
        for (int64_t j = s.row - first_row; rows[k].count && j < s.row - first_row + s.rows; j++) {
            from[j] = west < from[j] ? west : from[j];
            to[j] = east > to[j] ? east : to[j];
            least[j] = s.exponent < least[j] ? s.exponent : least[j];
        }
    }
    for (int k = 0; k < count; k++) {
        if (from[k] > to[k]) {
            coarse[k] = (struct row){.posts = room};
            continue;
        }
        int own = exponent_of(&grid, first_row + k), e = own > least[k] ? own : least[k];
        coarse[k] = (struct row){.exponent = e, .skipped = e - own, .posts = room};
        coarse[k].first = from[k] >> e;
        coarse[k].count = (int)(((to[k] + ((int64_t)1 << e) - 1) >> e) - coarse[k].first) + 1;
        room += coarse[k].count;
    }
    make_rows(detail, level + 1, first_row, count, coarse, room);
    for (int k = 0; k < height; k++) {
        struct support s = support_of(&grid, &rows[k], y0 + k);
        if (rows[k].count) make_row(detail, level, y0 + k, &s, &coarse[s.row - first_row], &rows[k]);
    }
}

// Whether posts are single columns all about some rows, down to the stored ones.
static bool is_plain(const struct detail *detail, int level, int64_t y0, int height)
{
    int64_t south = (y0 >> -level) - REACH, north = ((y0 + height - 1) >> -level) + 1 + REACH;
    return detail_exponent(detail, 0, south) == 0 && detail_exponent(detail, 0, north) == 0 &&
           llabs(south) < detail->grid.pole && llabs(north) < detail->grid.pole;
}

static void read_stored(const struct detail *detail, int64_t x0, int64_t y0, int width, int height,
                        int32_t *out)
{
    if (detail->samples)
        sphere_window(&detail->grid, detail->samples, x0, y0, width, height, out);
    else
        detail->read(detail->user, x0, y0, width, height, out);
}

static void make_tile(const struct detail *detail, int level, int64_t x0, int64_t y0, int width, int height,
                      int32_t *out, int32_t *scratch)
{
    if (level == 0) {
        read_stored(detail, x0, y0, width, height, out);
        return;
    }
    int coarse_width = upsample_coarse_size(x0, width), coarse_height = upsample_coarse_size(y0, height);
    make_tile(detail, level + 1, (x0 >> 1) - 1, (y0 >> 1) - 1, coarse_width, coarse_height, scratch,
              scratch + coarse_width * coarse_height);
    struct sphere_grid grid = sphere_level(&detail->grid, level);
    detail_refine(detail, level, 0, scratch, x0 - grid.first, y0, width, height, out);
}

// Where windows are put, `width` a row: as samples or, of what lies between posts, unrounded.
struct target {
    int32_t *samples;
    float *heights;
    int width;
};

static void put_plain_tile(const struct detail *detail, int level, int64_t x0, int64_t y0, int width,
                           int height, const struct target *to, int64_t at)
{
    int32_t tile[TILE * TILE], scratch[SCRATCH];
    make_tile(detail, level, x0, y0, width, height, tile, scratch);
    for (int j = 0; j < height; j++, at += to->width)
        for (int i = 0; i < width; i++)
            if (to->samples)
                to->samples[at + i] = tile[j * width + i];
            else
                to->heights[at + i] = (float)tile[j * width + i];
}

static void put_round_tile(const struct detail *detail, int level, int exponent, int64_t post, int64_t y0,
                           int width, int height, const struct target *to, int64_t at)
{
    struct sphere_grid grid = sphere_level(&detail->grid, level);
    int32_t room[POSTS], *next = room;
    struct row rows[TILE];
    for (int j = 0; j < height; j++) {
        int e = exponent_of(&grid, y0 + j), own = e > exponent ? e : exponent, wider = own - exponent;
        int64_t last = post + width - 1;
        rows[j] = (struct row){.exponent = own, .skipped = own - e, .first = post >> wider, .posts = next};
        rows[j].count = (int)(((last + ((int64_t)1 << wider) - 1) >> wider) - rows[j].first) + 1;
        next += rows[j].count;
    }
    make_rows(detail, level, y0, height, rows, next);
    for (int j = 0; j < height; j++, at += to->width)
        if (to->samples)
            samples_of(&rows[j], exponent, post, width, to->samples + at);
        else
            heights_of(&rows[j], exponent, post, width, to->heights + at);
}

static void put(const struct detail *detail, int level, int exponent, int64_t post, int64_t y0, int width,
                int height, const struct target *to)
{
    int64_t first = sphere_level(&detail->grid, level).first;
    for (int y = 0; y < height; y += TILE)
        for (int x = 0; x < width; x += TILE) {
            int w = width - x < TILE ? width - x : TILE, h = height - y < TILE ? height - y : TILE;
            int64_t at = (int64_t)y * to->width + x;
            if (exponent == 0 && is_plain(detail, level, y0 + y, h))
                put_plain_tile(detail, level, first + post + x, y0 + y, w, h, to, at);
            else
                put_round_tile(detail, level, exponent, post + x, y0 + y, w, h, to, at);
        }
}

void detail_posts(const struct detail *detail, int level, int exponent, int64_t post, int64_t y0, int width,
                  int height, int32_t *out)
{
    put(detail, level, exponent, post, y0, width, height, &(struct target){.samples = out, .width = width});
}

void detail_heights(const struct detail *detail, int level, int exponent, int64_t post, int64_t y0, int width,
                    int height, float *out)
{
    put(detail, level, exponent, post, y0, width, height, &(struct target){.heights = out, .width = width});
}

void detail_window(const struct detail *detail, int level, int64_t x0, int64_t y0, int width, int height,
                   int32_t *out)
{
    struct sphere_grid grid = sphere_level(&detail->grid, level);
    detail_posts(detail, level, 0, x0 - grid.first, y0, width, height, out);
}

int detail_cell_exponent(const struct detail *detail, int level, int64_t j)
{
    return detail_exponent(detail, level, j >= 0 ? j : j + 1);
}

void detail_corners(int64_t post, const bool wider[2], const int32_t *around, int stride,
                    double corners[2][2])
{
    for (int north = 0; north < 2; north++)
        for (int east = 0; east < 2; east++) {
            const int32_t *z = around + north * stride + 1 + east;
            bool between = wider[north] && (post + east) & 1;
            corners[north][east] = between ? 0.5 * ((double)z[-1] + z[1]) : z[0];
        }
}

struct terrain_extent detail_under(const struct detail *detail, int level, int64_t x0, int64_t y0, int width,
                                   int height)
{
    struct terrain_extent e = {x0, y0, x0 + width, y0 + height};
    if (level >= 0) return e;
    for (; level < 0; level++) {
        int columns = upsample_coarse_size(e.x0, (int)(e.x1 - e.x0)),
            rows = upsample_coarse_size(e.y0, (int)(e.y1 - e.y0));
        e.x0 = (e.x0 >> 1) - 1, e.y0 = (e.y0 >> 1) - 1;
        e.x1 = e.x0 + columns, e.y1 = e.y0 + rows;
    }
    int64_t aside = detail_aside(detail, e.y0, e.y1 - 1);
    e.x0 -= aside;
    e.x1 += aside;
    if (e.x1 - e.x0 > detail->grid.columns) e.x1 = e.x0 + detail->grid.columns;
    return e;
}

int64_t detail_aside(const struct detail *detail, int64_t south, int64_t north)
{
    int64_t farthest = llabs(south) > llabs(north) ? llabs(south) : llabs(north);
    int exponent = detail_exponent(detail, 0, farthest < detail->grid.pole ? farthest : detail->grid.pole);
    return exponent ? (int64_t)6 << exponent : 0;
}

double detail_noise_limit(const struct detail *detail, int levels, double norm)
{
    double sum = 0, rounded = norm > DETAIL_NORM ? 1.5 : 1; // once more for samples between posts
    for (int k = 1; k <= levels; k++) sum += norm * (DETAIL_DEVIATE * detail->sigma_q[k] + rounded);
    return sum;
}
