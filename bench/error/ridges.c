// SPDX-License-Identifier: MIT
#include "bench/error/ridges.h"

#include "bench/error/truth.h"
#include "common/report.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct shape { // a triangle in the picture
    double corner_px[3][2];
    double nearness[3]; // 1 / depth: linear in the picture
};

static bool add_pixel(struct ridges *ridges, size_t pixel)
{
    if (ridges->count == ridges->capacity) {
        size_t capacity = ridges->capacity ? 2 * ridges->capacity : 256;
        size_t *grown = realloc(ridges->pixels, capacity * sizeof *grown);
        if (!grown) return fail("no memory for %zu pixels of ridge lines", capacity);
        ridges->pixels = grown;
        ridges->capacity = capacity;
    }
    ridges->pixels[ridges->count++] = pixel;
    int x = (int)(pixel % (size_t)ridges->view->width), y = (int)(pixel / (size_t)ridges->view->width);
    ridges->cells[y / RIDGES_CELL_PX * ridges->columns + x / RIDGES_CELL_PX] = 1;
    return true;
}

bool ridges_begin(struct ridges *ridges, const struct view *view, float *positions)
{
    int columns = view->width / RIDGES_CELL_PX + 1, rows = view->height / RIDGES_CELL_PX + 1;
    if (columns != ridges->columns || rows != ridges->rows) {
        free(ridges->cells);
        ridges->cells = malloc((size_t)columns * (size_t)rows);
        if (!ridges->cells) return fail("no memory for the cells of ridge lines");
        ridges->columns = columns;
        ridges->rows = rows;
    }
    ridges->view = view;
    ridges->positions = positions;
    ridges->count = 0;
    memset(ridges->cells, 0, (size_t)columns * (size_t)rows);
    for (size_t p = 0; p < (size_t)view->width * (size_t)view->height; p++)
        if (positions[4 * p + 3] < 0 && !add_pixel(ridges, p)) return false;
    return true;
}

void ridges_finish(struct ridges *ridges)
{
    free(ridges->pixels);
    free(ridges->cells);
    *ridges = (struct ridges){0};
}

static bool faces_the_eye(const float corner[9])
{
    double a[3], b[3], dot = 0;
    for (int k = 0; k < 3; k++) {
        a[k] = (double)corner[3 + k] - (double)corner[k];
        b[k] = (double)corner[6 + k] - (double)corner[k];
    }
    for (int k = 0; k < 3; k++) {
        int i = (k + 1) % 3, j = (k + 2) % 3;
        dot += (a[i] * b[j] - a[j] * b[i]) * (double)corner[k];
    }
    return dot < 0;
}

// False when a corner is not before the eye.
static bool project(const struct view *view, const float corner[9], struct shape *shape)
{
    for (int i = 0; i < 3; i++) {
        double relative[3], depth = 0;
        for (int k = 0; k < 3; k++) {
            relative[k] = (double)corner[3 * i + k];
            depth += relative[k] * view->forward[k];
        }
        if (!view_project(view, relative, shape->corner_px[i])) return false;
        shape->nearness[i] = 1 / depth;
    }
    return true;
}

static double cross(const double origin[2], const double a[2], const double b[2])
{
    return (a[0] - origin[0]) * (b[1] - origin[1]) - (a[1] - origin[1]) * (b[0] - origin[0]);
}

// Least depth of the triangle within TRUTH_SNAP_PX of a place in the picture; INFINITY where it is farther
// away.
static double least_depth_about(const struct shape *shape, const double centre[2])
{
    const double(*p)[2] = shape->corner_px;
    double doubled_area = cross(p[0], p[1], p[2]), nearness = 0, slope[2] = {0, 0};
    if (doubled_area == 0) return INFINITY;
    for (int i = 0; i < 3; i++) {
        const double *a = p[(i + 1) % 3], *b = p[(i + 2) % 3];
        double weight = cross(centre, a, b) / doubled_area, length = hypot(b[0] - a[0], b[1] - a[1]);
        if (weight * fabs(doubled_area) < -TRUTH_SNAP_PX * length) return INFINITY;
        nearness += weight * shape->nearness[i];
        slope[0] += (a[1] - b[1]) / doubled_area * shape->nearness[i];
        slope[1] += (b[0] - a[0]) / doubled_area * shape->nearness[i];
    }
    double nearest = fmax(shape->nearness[0], fmax(shape->nearness[1], shape->nearness[2]));
    return 1 / fmin(nearness + hypot(slope[0], slope[1]) * TRUTH_SNAP_PX, nearest);
}

static void explain(struct ridges *ridges, const struct shape *shape)
{
    const int width = ridges->view->width;
    const double *f = ridges->view->forward;
    for (size_t k = 0; k < ridges->count;) {
        size_t pixel = ridges->pixels[k];
        float *drawn = ridges->positions + 4 * pixel;
        double depth = f[0] * (double)drawn[0] + f[1] * (double)drawn[1] + f[2] * (double)drawn[2];
        const double centre[2] = {(double)(pixel % (size_t)width) + 0.5,
                                  (double)(pixel / (size_t)width) + 0.5};
        if (least_depth_about(shape, centre) <= depth) {
            drawn[3] = 1;
            ridges->pixels[k] = ridges->pixels[--ridges->count];
        } else
            k++;
    }
}

// Whether the triangle's box in the picture meets a cell with a pixel in question.
static bool meets_cells(const struct ridges *ridges, const struct shape *shape)
{
    int low[2], high[2];
    const int size[2] = {ridges->columns, ridges->rows};
    for (int axis = 0; axis < 2; axis++) {
        double a = shape->corner_px[0][axis], b = shape->corner_px[1][axis], c = shape->corner_px[2][axis];
        double least = floor((fmin(a, fmin(b, c)) - TRUTH_SNAP_PX) / RIDGES_CELL_PX);
        double most = floor((fmax(a, fmax(b, c)) + TRUTH_SNAP_PX) / RIDGES_CELL_PX);
        if (most < 0 || least >= size[axis]) return false;
        low[axis] = (int)fmax(least, 0);
        high[axis] = (int)fmin(most, size[axis] - 1);
    }
    for (int y = low[1]; y <= high[1]; y++)
        for (int x = low[0]; x <= high[0]; x++)
            if (ridges->cells[y * ridges->columns + x]) return true;
    return false;
}

void ridges_feed(struct ridges *ridges, const float *triangles, size_t count)
{
    struct shape shape;
    for (size_t k = 0; k < count && ridges->count > 0; k++)
        if (faces_the_eye(triangles + 9 * k) && project(ridges->view, triangles + 9 * k, &shape) &&
            meets_cells(ridges, &shape))
            explain(ridges, &shape);
}
