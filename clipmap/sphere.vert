// A vertex of a ring about the viewer over a sphere (Clasen & Hege 2006, sections 3.3 and 5.1): it turns with the pattern,
// finds its longitude and latitude relative to the viewer's, samples one level or a blend of two, and is placed radially.
// SIZE: texels on a side; LAST: the coarsest layer.  FORM: 0 stable, 1 corrected, 2 published (sphere_rings.h); sphere_angles() is this program's twin.
// FETCH: 0 the level's triangles, 1 four texels of one level, 2 eight of two (sphere.h).
// KEPT: all of this was done in a frame before.

#ifdef KEPT
layout(location = 0) in vec3 kept;

vec3 relative_position()
{
    return kept;
}
#else
layout(location = 0) in vec4 ring; // east, north, 1 - cos(angle), and the ring's number

uniform sampler2DArray heights; // all levels but the coarsest
uniform sampler2D whole;        // that one, WHOLE texels on a side
uniform ivec4 windows[32]; // x, y: slot of the viewer's texel; z: texels of a turn or SIZE
uniform vec4 grids[32];    // xy: texels per radian; zw: the viewer's fraction of a texel
uniform ivec2 bilinear_rows[32]; // up to and from which cells are bilinear, counted from the viewer's row
uniform vec4 viewer;       // sine and cosine of the polar angle; level of ring 0; levels a ring
uniform vec4 pattern;      // cosine and sine of its turn from east; the finest and the coarsest level that is there
uniform float polar;       // the viewer's polar angle

vec2 stable_angles(vec3 v)
{
    // Half the difference of the polar angles comes from small numbers alone (numerics.md, D2).
    float a = viewer.x * -v.y + viewer.y * v.z, x = viewer.y * -v.y + viewer.x * (1.0 - v.z);
    float across = sqrt(x * x + v.x * v.x);
    float east = x == 0.0 && v.x == 0.0 ? 0.0 : atan(v.x, x);
    return vec2(east, -2.0 * atan(a, viewer.x + across));
}

vec2 acos_angles(vec3 v, float sign_of_z)
{
    float px = -v.y, pz = 1.0 - v.z, x = viewer.y * px + sign_of_z * viewer.x * pz, z = -viewer.x * px + viewer.y * pz;
    float east = x == 0.0 && v.x == 0.0 ? 0.0 : atan(v.x, x);
    return vec2(east, polar - acos(clamp(z, -1.0, 1.0)));
}

// Equations 11 and 14 near the viewer, blended with 3 and 4.
vec2 published_angles(vec3 v)
{
    const float PI = 3.14159265;
    float t = polar / PI - 0.5, stretch = 1.0 + 1.0 / PI / (0.25 - t * t) - t * t / 6.0 - 4.0 / PI;
    float angle = length(v.xy), w = clamp(angle * 1024.0 / PI - 1.0, 0.0, 1.0);
    return mix(vec2(v.x * stretch, -angle), acos_angles(v, -1.0), w);
}

vec2 angles_of(vec3 v)
{
#if FORM == 0
    return stable_angles(v);
#elif FORM == 1
    return acos_angles(v, 1.0);
#else
    return published_angles(v);
#endif
}

float texel(ivec2 slot, int layer)
{
    return layer == LAST ? texelFetch(whole, slot, 0).x : texelFetch(heights, ivec3(slot, layer), 0).x;
}

// The surface of a level: its triangles, split along (i, j)-(i+1, j+1) as everywhere, or bilinear cells (terrain.h).
float height_in(int layer, vec2 angles)
{
    vec4 grid = grids[layer];
    ivec4 window = windows[layer];
    vec2 place = angles * grid.xy + grid.zw, corner = floor(place), f = place - corner;
    int x0 = (int(corner.x) + window.x + 2 * window.z) % window.z, x1 = x0 + 1 == window.z ? 0 : x0 + 1;
    int size = layer == LAST ? WHOLE : SIZE;
    int y0 = (int(corner.y) + window.y + 2 * size) % size, y1 = y0 + 1 == size ? 0 : y0 + 1;
    float sw = texel(ivec2(x0, y0), layer), se = texel(ivec2(x1, y0), layer), nw = texel(ivec2(x0, y1), layer),
          ne = texel(ivec2(x1, y1), layer);
#if FETCH == 0
    bool bilinear = int(corner.y) <= bilinear_rows[layer].x || int(corner.y) >= bilinear_rows[layer].y;
#else
    const bool bilinear = true;
#endif
    // What ne weighs tells the rest; split along the diagonal, a side's other corner weighs nothing.
    float w = bilinear ? f.x * f.y : min(f.x, f.y);
    return sw + (f.x - w) * (se - sw) + (f.y - w) * (nw - sw) + w * (ne - sw);
}

float height_at(float ring_number, vec2 angles)
{
    float level = clamp(viewer.z - ring_number * viewer.w, pattern.z, pattern.w);
    int layer = int(floor(level));
    float z = height_in(layer, angles);
#if FETCH == 0
    float w = clamp((level - float(layer)) * 2.0 - 1.0, 0.0, 1.0);
#elif FETCH == 1
    float w = 0.0;
#else
    float w = level - float(layer);
#endif
    if (w > 0.0) z = z * (1.0 - w) + height_in(layer + 1, angles) * w;
    return z;
}

vec3 relative_position()
{
    vec3 v = vec3(ring.x * pattern.x - ring.y * pattern.y, ring.x * pattern.y + ring.y * pattern.x, ring.z);
    float z = relative_height(height_at(ring.w, angles_of(v)));
    float distance = axes[1].w + z;
    return vec3(distance * v.xy, z - distance * v.z);
}
#endif
