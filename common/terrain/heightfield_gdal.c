// Whatever GDAL reads; compiled in only where pkg-config finds GDAL.
// SPDX-License-Identifier: MIT
#include "common/terrain/heightfield_gdal.h"

#ifdef RELIEF_GDAL

#include "common/report.h"

#include <math.h>
#include <stdlib.h>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpedantic" // GDAL's enumerators go beyond int
#include <cpl_error.h>
#include <gdal.h>
#include <ogr_srs_api.h>
#pragma GCC diagnostic pop

static const double DEGREE = 0.017453292519943295;

// Metres between samples, from the geotransform and the reference system.
static bool read_spacing(GDALDatasetH dataset, const char *path, struct heightfield *field, bool *south_up)
{
    double transform[6]; // x = t0 + column t1 + row t2, y = t3 + column t4 + row t5
    *south_up = false;
    if (GDALGetGeoTransform(dataset, transform) != CE_None || transform[1] == 0 || transform[5] == 0) {
        note("%s: tells no spacing; 30 m between samples is assumed", path);
        field->spacing_m[0] = field->spacing_m[1] = 30;
        return true;
    }
    if (transform[2] != 0 || transform[4] != 0)
        return fail("%s: its grid is rotated; a grid with north up is expected (gdalwarp makes one)", path);
    *south_up = transform[5] > 0;
    OGRSpatialReferenceH reference = GDALGetSpatialRef(dataset);
    double unit_m[2] = {1, 1};
    if (reference && OSRIsGeographic(reference)) {
        double middle = transform[3] + transform[5] * (double)field->height / 2;
        unit_m[1] = HEIGHTFIELD_EARTH_RADIUS_M * DEGREE;
        unit_m[0] = unit_m[1] * cos(middle * DEGREE);
    } else if (reference)
        unit_m[0] = unit_m[1] = OSRGetLinearUnits(reference, NULL);
    field->spacing_m[0] = fabs(transform[1]) * unit_m[0];
    field->spacing_m[1] = fabs(transform[5]) * unit_m[1];
    return true;
}

// Raw values to metres, voids to NaN.
static void scale_heights(GDALRasterBandH band, double *values, size_t count)
{
    int has_nodata = 0, has_scale = 0, has_offset = 0;
    double nodata = GDALGetRasterNoDataValue(band, &has_nodata);
    double scale = GDALGetRasterScale(band, &has_scale), offset = GDALGetRasterOffset(band, &has_offset);
    if (!has_scale || scale == 0) scale = 1;
    if (!has_offset) offset = 0;
    // A 32-bit band gives its values as they are, but its nodata may be written with more digits.
    bool single = GDALGetRasterDataType(band) == GDT_Float32;
    for (size_t i = 0; i < count; i++) {
        bool is_void = heightfield_is_void(values[i], has_nodata, nodata) ||
                       (has_nodata && single && (float)values[i] == (float)nodata);
        values[i] = is_void ? (double)NAN : values[i] * scale + offset;
    }
}

static void turn_over(double *values, int64_t width, int64_t height)
{
    for (int64_t y = 0; y < height / 2; y++)
        for (int64_t x = 0; x < width; x++) {
            double *a = &values[y * width + x], *b = &values[(height - 1 - y) * width + x], kept = *a;
            *a = *b;
            *b = kept;
        }
}

static bool take_band(struct heightfield *field, const char *path, GDALDatasetH dataset, double *values)
{
    GDALRasterBandH band = GDALGetRasterBand(dataset, 1);
    int width = (int)field->width, height = (int)field->height;
    bool south_up;
    if (!read_spacing(dataset, path, field, &south_up)) return false;
    if (GDALRasterIO(band, GF_Read, 0, 0, width, height, values, width, height, GDT_Float64, 0, 0) != CE_None)
        return fail("%s: cannot be read whole (%s); a raster that GDAL reads is expected", path,
                    CPLGetLastErrorMsg());
    scale_heights(band, values, (size_t)width * (size_t)height);
    if (!south_up) turn_over(values, field->width, field->height);
    return heightfield_quantise(field, values, HEIGHTFIELD_FLOAT_BITS);
}

bool heightfield_load_gdal(struct heightfield *field, const char *path)
{
    GDALAllRegister();
    CPLPushErrorHandler(CPLQuietErrorHandler); // one line of ours instead of GDAL's several
    GDALDatasetH dataset = GDALOpen(path, GA_ReadOnly);
    bool good = dataset && GDALGetRasterCount(dataset) > 0;
    if (!good)
        fail("%s: %s; .png, .hgt, .raw or a raster that GDAL reads is accepted", path,
             dataset ? "has no raster band" : CPLGetLastErrorMsg());
    if (good) {
        field->width = GDALGetRasterXSize(dataset);
        field->height = GDALGetRasterYSize(dataset);
        double *values = malloc((size_t)field->width * (size_t)field->height * sizeof *values);
        good = values ? take_band(field, path, dataset, values) : fail("%s: does not fit in memory", path);
        free(values);
    }
    if (dataset) GDALClose(dataset);
    CPLPopErrorHandler();
    return good;
}

#endif
