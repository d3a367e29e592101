// SPDX-License-Identifier: MIT
#include "common/terrain/relief/filter_fit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { SMALLEST = 32, MARGIN = 10 }; // samples from the border whose U(D(T)) needs no ghosts: 5 + 2 * 2, even

// What one tap adds to U(D(T)) at sample x of a line: D with that tap alone, then U.
static double response(const int32_t *line, int64_t stride, int64_t x, int tap)
{
    static const double BETWEEN[4] = {-1 / 16.0, 9 / 16.0, 9 / 16.0, -1 / 16.0};
    double sum = 0;
    bool odd = x & 1;
    for (int k = odd ? -1 : 0; k <= (odd ? 2 : 0); k++) {
        int64_t centre = 2 * ((x >> 1) + k);
        double value = line[(centre + tap) * stride];
        if (tap > 0) value += line[(centre - tap) * stride];
        sum += (odd ? BETWEEN[k + 1] : 1) * value;
    }
    return sum;
}

static void add_line(struct filter_sums *sums, const int32_t *line, int64_t stride, int64_t size)
{
    for (int64_t x = MARGIN; x < size - MARGIN; x++) {
        double of[FILTER_HALF], base = line[x * stride]; // heights over this one keep the sums small
        for (int i = 0; i < FILTER_HALF; i++) of[i] = response(line, stride, x, i) - (i ? 2 : 1) * base;
        for (int i = 0; i < FILTER_HALF; i++)
            for (int j = 0; j <= i; j++) sums->square[i][j] += of[i] * of[j];
    }
}

void filter_sums_add(struct filter_sums *sums, const int32_t *samples, int64_t width, int64_t height)
{
    for (int64_t y = 0; y < height && width >= SMALLEST; y++) add_line(sums, samples + y * width, 1, width);
    for (int64_t x = 0; x < width && height >= SMALLEST; x++) add_line(sums, samples + x, width, height);
}

// Gauss with the largest pivot.
static bool solve(double *a, double *b, int count)
{
    for (int c = 0; c < count; c++) {
        int best = c;
        for (int r = c + 1; r < count; r++)
            if (fabs(a[r * count + c]) > fabs(a[best * count + c])) best = r;
        if (!(fabs(a[best * count + c]) > 0)) return false;
        for (int k = 0; k < count; k++) {
            double kept = a[c * count + k];
            a[c * count + k] = a[best * count + k], a[best * count + k] = kept;
        }
        double kept = b[c];
        b[c] = b[best], b[best] = kept;
        for (int r = 0; r < count; r++) {
            double factor = a[r * count + c] / a[c * count + c];
            if (r == c || factor == 0) continue;
            for (int k = c; k < count; k++) a[r * count + k] -= factor * a[c * count + k];
            b[r] -= factor * b[c];
        }
    }
    for (int c = 0; c < count; c++) b[c] /= a[c * count + c];
    return true;
}

// The taps sum to 1, so the error at a sample is the sum of taps times (response - base), whose square is
// least under that constraint: one Lagrange multiplier.
bool filter_solve(const struct filter_sums *sums, double half[FILTER_HALF])
{
    enum { N = FILTER_HALF + 1 };
    double a[N * N] = {0}, b[N] = {0}, scale = 0;
    for (int i = 0; i < FILTER_HALF; i++) scale = fmax(scale, sums->square[i][i]);
    if (!(scale > 0)) return false;
    for (int i = 0; i < FILTER_HALF; i++) {
        for (int j = 0; j < FILTER_HALF; j++)
            a[i * N + j] = (i >= j ? sums->square[i][j] : sums->square[j][i]) / scale;
        a[i * N + FILTER_HALF] = a[FILTER_HALF * N + i] = i ? 2 : 1;
    }
    b[FILTER_HALF] = 1;
    if (!solve(a, b, N)) return false;
    memcpy(half, b, FILTER_HALF * sizeof *half);
    return true;
}

// D along one axis, from `count` lines; out of `size / 2` values a line, those near the border made of what
// is inside.
static void reduce_lines(const double *from, int64_t size, int64_t stride, int64_t lines, int64_t line_stride,
                         const double half[FILTER_HALF], double *out, int64_t out_stride, int64_t out_line)
{
    for (int64_t n = 0; n < lines; n++)
        for (int64_t i = 0; i < (size + 1) / 2; i++) {
            double sum = 0;
            for (int k = 1 - FILTER_HALF; k < FILTER_HALF; k++) {
                int64_t at = 2 * i + k;
                at = at < 0 ? 0 : at >= size ? size - 1 : at;
                sum += half[abs(k)] * from[n * line_stride + at * stride];
            }
            out[n * out_line + i * out_stride] = sum;
        }
}

static double four_point(const double *at, int64_t stride)
{
    return (9 * (at[0] + at[stride]) - at[-stride] - at[2 * stride]) / 16;
}

static double predicted(const double *coarse, int64_t width, int64_t x, int64_t y)
{
    const double *at = coarse + (y >> 1) * width + (x >> 1);
    if (!(y & 1)) return x & 1 ? four_point(at, 1) : at[0];
    if (!(x & 1)) return four_point(at, width);
    double rows[4];
    for (int k = 0; k < 4; k++) rows[k] = four_point(at + (k - 1) * width, 1);
    return four_point(rows + 1, 1);
}

double filter_rms_q(const int32_t *samples, int64_t width, int64_t height, const double half[FILTER_HALF])
{
    if (width < SMALLEST || height < SMALLEST) return -1;
    int64_t across = (width + 1) / 2, along = (height + 1) / 2;
    double *fine = malloc((size_t)(width * height + across * height + across * along) * sizeof *fine);
    if (!fine) return -1;
    double *rows = fine + width * height, *coarse = rows + across * height, squares = 0;
    for (int64_t i = 0; i < width * height; i++) fine[i] = samples[i];
    reduce_lines(fine, width, 1, height, width, half, rows, 1, across);
    reduce_lines(rows, height, across, across, 1, half, coarse, across, 1);
    for (int64_t y = MARGIN; y < height - MARGIN; y++)
        for (int64_t x = MARGIN; x < width - MARGIN; x++) {
            double off = predicted(coarse, across, x, y) - fine[y * width + x];
            squares += off * off;
        }
    free(fine);
    return sqrt(squares / ((double)(width - 2 * MARGIN) * (double)(height - 2 * MARGIN)));
}
