// Elevation files of any kind, read into one form: integer heights, row 0 south, voids marked.
//
// Read by the end of the name:
//   .png   16-bit grey, with a sidecar NAME.json; without one: 30 m between samples, a metre a step, and a
//   note .nc .cdf   NetCDF's classic format (heightfield_netcdf.h) .hgt   SRTM: a square of big-endian int16,
//   -32768 void; N47W122 in the name gives the latitude, so the spacing in x .relief   compressed by `terrain
//   pack`: its level 0 is decoded (relief_file.h) .raw .bin .r16 .f32 ...   headerless, with a sidecar
//   NAME.json that gives width, height and dtype any other, when built with GDAL: what GDAL reads
//
// Sidecar (JSON; unknown keys are ignored):  height_m = sample * height_scale + height_offset
//   spacing_m       metres between samples, a number or [x, y]; required
//   width, height   samples; must agree with the file; required for raw files
//   dtype           "uint16" (default), "int16", "float32" (raw only)
//   endian          raw only: "little" (default) or "big"
//   height_scale, height_offset   default 1 and 0
//   nodata          a sample value that means void, or null
//   radius_m, spacing_deg   of a whole planet in simple cylindrical projection (longitude and latitude evenly
//                   spaced, the first column at 180 W, or half a sample east of it), when width * spacing_deg
//                   is 360 and the rows reach from pole to pole: with a row on each pole (height - 1), or
//                   pixel-centred (height); then spacing_m is not needed.  Any other map is a plane
// Voids: nodata, NaN, infinities, and -32768 and -9999 where samples have a sign.  (numerics.md, E1 and E2)
// SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_HEIGHTFIELD_H
#define COMMON_TERRAIN_HEIGHTFIELD_H

#include "common/terrain/sidecar.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define HEIGHTFIELD_VOID INT32_MIN
#define HEIGHTFIELD_EARTH_RADIUS_M 6371007.2 // the sphere of the same area
enum { HEIGHTFIELD_FLOAT_BITS = 20 };        // of quantised floats

struct heightfield {
    char name[64]; // of the file, without folder and ending
    int64_t width, height;
    int32_t *samples; // owned; quanta, row 0 south, HEIGHTFIELD_VOID where void
    double spacing_m[2], quantum_m, offset_m;
    double radius_m;    // of a whole planet; 0: a plane
    bool pixel_centred; // whole planet: samples are the centres of cells
};

// False after one line on stderr; the heightfield is then empty.
bool heightfield_load(struct heightfield *field, const char *path);

// Spacing, scale, and whether it is a planet, of a map of field->width x field->height samples.
void heightfield_describe(struct heightfield *field, const struct sidecar *sidecar);

// What an .hgt file of `size` bytes holds; *placed tells whether its name gives the latitude.  False after
// one line on stderr.
bool heightfield_describe_hgt(const char *path, size_t size, struct sidecar *sidecar, bool *placed);

// Tells what was assumed of a PNG without a sidecar or an .hgt file whose name gives no latitude.
void heightfield_note_assumed(const char *path, const struct sidecar *sidecar);

// A PNG and its sidecar in memory; `path` names them in messages.
bool heightfield_load_memory(struct heightfield *field, const char *path, const void *png, size_t png_size,
                             const char *sidecar, size_t sidecar_size);

// Takes heights in metres, row 0 south, not finite where void, and chooses an offset (whole metres, or the
// height itself when all are equal) and a quantum (the coarsest power of two up to a metre that keeps them
// exactly, else the finest that fits) so that |q| <= 2^bits.  Sets samples, quantum_m and offset_m.
bool heightfield_quantise(struct heightfield *field, const double *height_m, int bits);

// Writes OUT.png (16-bit grey) and OUT.json; voids are written as a declared nodata.  Both are whole or
// absent.  Heights that span more than 16 bits are rounded to a coarser step, with a note.  `origin` becomes
// the sidecar's "source".
bool heightfield_save(const struct heightfield *field, const char *path, const char *origin);

// Whether a raw sample of a signed or floating type is void, whatever is declared: NaN, infinities, -32768,
// -9999 and what no height in any unit reaches (1e30: files that mark voids with the lowest float often do
// not say so).
bool heightfield_is_void(double raw, bool has_nodata, double nodata);

bool heightfield_is_raw(const char *path); // by the end of its name

void heightfield_finish(struct heightfield *field); // accepts a zeroed struct

#endif
