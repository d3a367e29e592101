// SPDX-License-Identifier: MIT
#include "common/terrain/pyramid.h"

#include "common/parallel.h"
#include "common/terrain/extrema.h"
#include "common/terrain/synthesis.h"
#include "common/terrain/upsample.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { ROWS_A_BLOCK = 64, DEFAULT_MIN_SIZE = 8, SMALLEST_MIN_SIZE = 3 };

static struct pyramid_level *at(struct pyramid *pyramid, int level)
{
    return &pyramid->all[level + PYRAMID_MAX_FINER];
}

static int blocks_of(int64_t rows)
{
    return (int)((rows + ROWS_A_BLOCK - 1) / ROWS_A_BLOCK);
}

static bool allocate(struct pyramid_level *level)
{
    level->samples =
        malloc((size_t)pyramid_width(level) * (size_t)pyramid_height(level) * sizeof *level->samples);
    return level->samples != NULL;
}

// ---- coarser levels --------------------------------------------------------

static int smallest_size(const struct terrain_options *options)
{
    int min_size = options->min_size > 0 ? options->min_size : DEFAULT_MIN_SIZE;
    // Rounding outward keeps up to three samples at three for ever.
    return min_size < SMALLEST_MIN_SIZE ? SMALLEST_MIN_SIZE : min_size;
}

static bool add_coarser(struct pyramid *pyramid, const struct terrain_options *options)
{
    int min_size = smallest_size(options);
    for (; pyramid->coarsest < PYRAMID_MAX_COARSER; pyramid->coarsest++) {
        const struct pyramid_level *fine = pyramid_level(pyramid, pyramid->coarsest);
        int64_t size[2] = {pyramid_width(fine), pyramid_height(fine)};
        if (size[0] <= min_size && size[1] <= min_size) return true;
        int64_t first[2] = {fine->extent.x0, fine->extent.y0}, coarse_first[2], coarse_size[2];
        for (int axis = 0; axis < 2; axis++) {
            coarse_first[axis] = downsample_first(first[axis]);
            coarse_size[axis] = downsample_size(first[axis], size[axis]);
        }
        struct pyramid_level *coarse = at(pyramid, pyramid->coarsest + 1);
        coarse->extent =
            (struct terrain_extent){coarse_first[0], coarse_first[1], coarse_first[0] + coarse_size[0],
                                    coarse_first[1] + coarse_size[1]};
        if (!allocate(coarse)) return false;
        if (!downsample(fine->samples, first, size, options->filter, coarse->samples)) return false;
    }
    return true;
}

static bool add_coarser_sphere(struct pyramid *pyramid, const struct terrain_options *options)
{
    int min_size = smallest_size(options);
    for (; pyramid->coarsest < PYRAMID_MAX_COARSER; pyramid->coarsest++) {
        const struct pyramid_level *fine = pyramid_level(pyramid, pyramid->coarsest);
        struct sphere_grid grid = sphere_level(pyramid->sphere, pyramid->coarsest);
        if (!sphere_has_coarser(&grid) || grid.columns <= min_size) return true;
        struct sphere_grid next = sphere_level(&grid, 1);
        struct pyramid_level *coarse = at(pyramid, pyramid->coarsest + 1);
        coarse->extent = sphere_extent(&next);
        if (!allocate(coarse) || !sphere_downsample(&grid, fine->samples, options->filter, coarse->samples))
            return false;
    }
    return true;
}

// ---- prediction: U of a level whose samples beyond the border are extrapolated linearly

static int32_t limit(int64_t q)
{
    return q > QUANTA_LIMIT ? QUANTA_LIMIT : q < -QUANTA_LIMIT ? -QUANTA_LIMIT : (int32_t)q;
}

// Value at `index`, beyond the end of a line of `size` values that are `stride` apart.
static int32_t extrapolate(const int32_t *line, int64_t stride, int64_t size, int64_t index)
{
    int64_t end = index < 0 ? 0 : size - 1, inner = size < 2 ? end : index < 0 ? 1 : size - 2;
    int64_t edge = line[end * stride];
    return limit(edge + llabs(index - end) * (edge - line[inner * stride]));
}

// What U of a whole level reads.
struct prediction {
    struct terrain_extent fine; // extent of the finer level
    int64_t columns;
    int32_t *coarse; // owned; starts at (fine.x0 >> 1) - 1, (fine.y0 >> 1) - 1
};

// Copies a level with the samples beyond its border that U needs.  The finer extent lies within the coarser
// one.
static bool prediction_init(struct prediction *prediction, const struct pyramid_level *coarse,
                            const struct terrain_extent *fine)
{
    int64_t width = pyramid_width(coarse), height = pyramid_height(coarse);
    int64_t x0 = (fine->x0 >> 1) - 1 - coarse->extent.x0, y0 = (fine->y0 >> 1) - 1 - coarse->extent.y0;
    int64_t columns = upsample_coarse_size(fine->x0, (int)(fine->x1 - fine->x0));
    int64_t rows = upsample_coarse_size(fine->y0, (int)(fine->y1 - fine->y0));
    int32_t *out = malloc((size_t)(columns * rows) * sizeof *out);
    *prediction = (struct prediction){*fine, columns, out};
    if (!out) return false;
    int64_t from = x0 < 0 ? -x0 : 0, to = width - x0 < columns ? width - x0 : columns; // columns inside
    for (int64_t j = 0; j < rows; j++, out += columns) {
        const int32_t *row = coarse->samples + x0;
        bool inside = y0 + j >= 0 && y0 + j < height;
        for (int64_t i = from; i < to; i++)
            out[i] = inside ? row[(y0 + j) * width + i] : extrapolate(row + i, width, height, y0 + j);
        for (int64_t i = 0; i < from; i++) out[i] = extrapolate(out + from, 1, to - from, i - from);
        for (int64_t i = to; i < columns; i++) out[i] = extrapolate(out + from, 1, to - from, i - from);
    }
    return true;
}

// U of the rows of one block of the finer level.
static int64_t predict_block(const struct prediction *p, int block, int32_t *out)
{
    int64_t y = p->fine.y0 + (int64_t)block * ROWS_A_BLOCK;
    int64_t rows = p->fine.y1 - y < ROWS_A_BLOCK ? p->fine.y1 - y : ROWS_A_BLOCK;
    upsample(p->coarse + ((y >> 1) - (p->fine.y0 >> 1)) * p->columns, p->fine.x0, y,
             (int)(p->fine.x1 - p->fine.x0), (int)rows, out);
    return rows;
}

// ---- finer levels ----------------------------------------------------------

struct synthesis {
    struct prediction prediction;
    struct pyramid_level *fine;
    int level;
    uint64_t seed;
    enum terrain_noise noise;
    struct synthesis_table table;
};

static void add_noise(const struct synthesis *s, int32_t *row, int64_t y)
{
    const struct pyramid_level *fine = s->fine;
    if (fine->sigma_q == 0) return;
    if (s->noise == TERRAIN_NOISE_TABLE)
        synthesis_add_table_row(row, pyramid_width(fine), fine->extent.x0, y, &s->table, fine->sigma_q);
    else
        synthesis_add_row(row, pyramid_width(fine), fine->extent.x0, y, s->level, s->seed, fine->sigma_q);
}

static void synthesise_block(int block, void *user)
{
    const struct synthesis *s = user;
    int64_t width = pyramid_width(s->fine), y = s->fine->extent.y0 + (int64_t)block * ROWS_A_BLOCK;
    int32_t *row = s->fine->samples + (int64_t)block * ROWS_A_BLOCK * width;
    int64_t rows = predict_block(&s->prediction, block, row);
    for (int64_t j = 0; j < rows; j++, row += width) {
        add_noise(s, row, y + j);
        for (int64_t i = 0; i < width; i++) row[i] = limit(row[i]);
    }
}

enum { MARGIN = 4 }; // samples next to the border are not measured: there U and D only extrapolate

struct residual {
    struct prediction prediction;
    const struct pyramid_level *fine;
    int32_t *predicted; // a whole level
    double *squares;    // a sum for each block
};

static void measure_block(int block, void *user)
{
    const struct residual *r = user;
    int64_t width = pyramid_width(r->fine), y = (int64_t)block * ROWS_A_BLOCK;
    int32_t *predicted = r->predicted + y * width;
    int64_t rows = predict_block(&r->prediction, block, predicted);
    const int32_t *row = r->fine->samples + y * width;
    double sum = 0;
    for (int64_t j = 0; j < rows; j++, row += width, predicted += width) {
        if (y + j < MARGIN || y + j >= pyramid_height(r->fine) - MARGIN) continue;
        for (int64_t i = MARGIN; i < width - MARGIN; i++) {
            double d = row[i] - predicted[i];
            sum += d * d;
        }
    }
    r->squares[block] = sum;
}

// Root mean square, in quanta, of T_level - U(T_level+1) away from the border; negative when memory runs out.
static double residual_rms(const struct pyramid *pyramid, int level)
{
    const struct pyramid_level *fine = pyramid_level(pyramid, level);
    int64_t width = pyramid_width(fine), height = pyramid_height(fine);
    int blocks = blocks_of(height);
    struct residual r = {.fine = fine};
    bool good = prediction_init(&r.prediction, pyramid_level(pyramid, level + 1), &fine->extent);
    r.predicted = malloc((size_t)(width * height) * sizeof *r.predicted);
    r.squares = calloc((size_t)blocks, sizeof *r.squares);
    good = good && r.predicted && r.squares;
    double sum = 0;
    if (good) {
        parallel_blocks(blocks, 0, measure_block, &r);
        for (int i = 0; i < blocks; i++) sum += r.squares[i];
    }
    free(r.prediction.coarse);
    free(r.predicted);
    free(r.squares);
    return good ? sqrt(sum / ((double)(width - 2 * MARGIN) * (double)(height - 2 * MARGIN))) : -1;
}

// Least squares over the logarithms.
void pyramid_fit_noise(const double *rms_q, int count, double *noise_log2, double *noise_slope)
{
    double log_sigma[PYRAMID_FIT_LEVELS], mean = 0, up = 0, down = 0, middle = (count - 1) / 2.0;
    *noise_log2 = -INFINITY, *noise_slope = 0;
    if (count == 0) return;
    for (int l = 0; l < count; l++) {
        log_sigma[l] = log2(rms_q[l]);
        mean += log_sigma[l] / count;
    }
    for (int l = 0; l < count; l++) {
        up += (l - middle) * (log_sigma[l] - mean);
        down += (l - middle) * (l - middle);
    }
    // One level tells no slope: take that of a surface of bounded slope.  Detail never grows as it gets
    // finer.
    double slope = count > 1 ? up / down : 1;
    *noise_slope = slope < 0 ? 0 : slope;
    *noise_log2 = mean - *noise_slope * middle;
}

// Noise of the finer levels.  Ground too small to measure, or without residuals, gets none.
static bool choose_noise(struct pyramid *pyramid)
{
    double rms_q[PYRAMID_FIT_LEVELS];
    int count = 0;
    for (int l = 0; l < pyramid->coarsest && count < PYRAMID_FIT_LEVELS; l++) {
        const struct pyramid_level *level = pyramid_level(pyramid, l);
        if (pyramid_width(level) < PYRAMID_FIT_SIZE || pyramid_height(level) < PYRAMID_FIT_SIZE) break;
        double rms = residual_rms(pyramid, l);
        if (rms < 0) return false;
        if (rms == 0) break;
        rms_q[count++] = rms;
    }
    pyramid_fit_noise(rms_q, count, &pyramid->noise_log2, &pyramid->noise_slope);
    return true;
}

double pyramid_noise_q(const struct pyramid *pyramid, int level)
{
    return exp2(pyramid->noise_log2 + pyramid->noise_slope * level);
}

static bool add_finer(struct pyramid *pyramid, const struct terrain_options *options)
{
    pyramid->finest = -options->synthesize_levels;
    if (pyramid->finest == 0) return true;
    if (!choose_noise(pyramid)) return false;
    for (int l = -1; l >= pyramid->finest; l--) {
        const struct pyramid_level *coarse = pyramid_level(pyramid, l + 1);
        struct pyramid_level *fine = at(pyramid, l);
        fine->sigma_q = pyramid_noise_q(pyramid, l);
        const struct terrain_extent *e = &coarse->extent;
        fine->extent = (struct terrain_extent){2 * e->x0, 2 * e->y0, 2 * e->x1 - 1, 2 * e->y1 - 1};
        struct synthesis s = {.fine = fine, .level = l, .seed = options->seed, .noise = options->noise};
        synthesis_fill_table(&s.table, options->seed);
        bool good = allocate(fine) && prediction_init(&s.prediction, coarse, &fine->extent);
        if (good) parallel_blocks(blocks_of(pyramid_height(fine)), 0, synthesise_block, &s);
        free(s.prediction.coarse);
        if (!good) return false;
    }
    return true;
}

// ---- what each level differs from the finest -------------------------------

struct comparison {
    const struct pyramid *pyramid;
    struct level_error {
        double squares, max;
    } * errors; // [block][level - finest]
};

// Compares the samples of one row of the finest level with the piecewise-linear surface of a coarser one.
// Everything but the sum of squares is exact: heights are integers over 2^shift.
static void compare_row(const struct pyramid_level *finest, const struct pyramid_level *level, int shift,
                        bool around, int64_t y, struct level_error *error)
{
    int64_t cell = (int64_t)1 << shift, width = pyramid_width(level);
    int64_t v = y & (cell - 1), row = (y >> shift) - level->extent.y0;
    const int32_t *south = level->samples + row * width, *north = v ? south + width : south;
    const int32_t *truth = finest->samples + (y - finest->extent.y0) * pyramid_width(finest);
    double scale = ldexp(1, -shift), sum = 0, max = error->max;
    for (int64_t x = finest->extent.x0; x < finest->extent.x1;) {
        int64_t i = (x >> shift) - level->extent.x0, x_cell = (x >> shift) * cell;
        int64_t end = x_cell + cell < finest->extent.x1 ? x_cell + cell : finest->extent.x1;
        bool last = i + 1 >= width; // then x is on the last column itself, or the next column is the first
        int64_t east = !last ? i + 1 : around ? 0 : i;
        double sw = south[i], se = south[east], nw = north[i], ne = north[east];
        double fraction = (double)v * scale;
        for (; x < end; x++) { // north-west of the diagonal u < v, then south-east of it
            double u = (double)(x - x_cell) * scale;
            double height = x - x_cell < v ? sw + fraction * (nw - sw) + u * (ne - nw)
                                           : sw + u * (se - sw) + fraction * (ne - se);
            double d = fabs(height - truth[x - finest->extent.x0]);
            sum += d * d;
            max = d > max ? d : max;
        }
    }
    error->squares += sum;
    error->max = max;
}

static void compare_rows(int block, void *user)
{
    const struct comparison *c = user;
    const struct pyramid_level *finest = pyramid_level(c->pyramid, c->pyramid->finest);
    int levels = c->pyramid->coarsest - c->pyramid->finest + 1;
    struct level_error *errors = c->errors + (ptrdiff_t)block * levels;
    int64_t y0 = finest->extent.y0 + (int64_t)block * ROWS_A_BLOCK;
    int64_t y1 = y0 + ROWS_A_BLOCK < finest->extent.y1 ? y0 + ROWS_A_BLOCK : finest->extent.y1;
    for (int shift = 1; shift < levels; shift++)
        for (int64_t y = y0; y < y1; y++)
            compare_row(finest, pyramid_level(c->pyramid, c->pyramid->finest + shift), shift,
                        c->pyramid->sphere != NULL, y, &errors[shift]);
}

static bool measure_errors(struct pyramid *pyramid)
{
    const struct pyramid_level *finest = pyramid_level(pyramid, pyramid->finest);
    int levels = pyramid->coarsest - pyramid->finest + 1, blocks = blocks_of(pyramid_height(finest));
    struct comparison c = {pyramid, calloc((size_t)blocks * (size_t)levels, sizeof *c.errors)};
    if (!c.errors) return false;
    parallel_blocks(blocks, 0, compare_rows, &c);
    double count = (double)pyramid_width(finest) * (double)pyramid_height(finest);
    for (int k = 0; k < levels; k++) {
        struct pyramid_level *level = at(pyramid, pyramid->finest + k);
        double squares = 0;
        for (int block = 0; block < blocks; block++) {
            const struct level_error *e = &c.errors[(ptrdiff_t)block * levels + k];
            squares += e->squares;
            level->max_error_q = e->max > level->max_error_q ? e->max : level->max_error_q;
        }
        level->rms_error_q = sqrt(squares / count);
    }
    free(c.errors);
    return true;
}

// Nodes over single cells are the planar ray caster's; bounds are read off samples where they would serve.
static bool measure_extrema(struct pyramid *pyramid)
{
    enum { NODES_FROM = 3 };
    for (int l = pyramid->finest; l <= pyramid->coarsest; l++) {
        struct pyramid_level *level = at(pyramid, l);
        int first_height = l == pyramid->finest && !pyramid->sphere ? 0 : NODES_FROM;
        if (!extrema_init(&level->extrema, level->samples, pyramid_width(level), pyramid_height(level),
                          first_height))
            return false;
        const struct terrain_extrema_nodes *root = &level->extrema.nodes[level->extrema.heights - 1];
        level->min_q = root->min_q[0];
        level->max_q = root->max_q[0];
    }
    return true;
}

bool pyramid_init(struct pyramid *pyramid, int32_t *samples, const struct terrain_extent *extent,
                  const struct terrain_options *options)
{
    pyramid->finest = pyramid->coarsest = 0;
    at(pyramid, 0)->extent = *extent;
    at(pyramid, 0)->samples = samples;
    return add_coarser(pyramid, options) && add_finer(pyramid, options) && measure_errors(pyramid) &&
           measure_extrema(pyramid);
}

bool pyramid_init_sphere(struct pyramid *pyramid, int32_t *samples, const struct sphere_grid *sphere,
                         const struct terrain_options *options)
{
    pyramid->finest = pyramid->coarsest = 0;
    pyramid->sphere = sphere;
    at(pyramid, 0)->extent = sphere_extent(sphere);
    at(pyramid, 0)->samples = samples;
    return add_coarser_sphere(pyramid, options) && choose_noise(pyramid) && measure_errors(pyramid) &&
           measure_extrema(pyramid);
}

void pyramid_finish(struct pyramid *pyramid)
{
    for (size_t i = 0; i < sizeof pyramid->all / sizeof *pyramid->all; i++) {
        free(pyramid->all[i].samples);
        extrema_finish(&pyramid->all[i].extrema);
    }
    memset(pyramid, 0, sizeof *pyramid);
}

size_t pyramid_bytes(const struct pyramid *pyramid)
{
    size_t bytes = 0;
    for (int l = pyramid->finest; l <= pyramid->coarsest; l++) {
        const struct pyramid_level *level = pyramid_level(pyramid, l);
        bytes += (size_t)(pyramid_width(level) * pyramid_height(level)) * sizeof *level->samples;
        bytes += extrema_bytes(&level->extrema);
    }
    return bytes;
}
