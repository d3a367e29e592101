// Lays the persistent grid over the ground: row table to place, place to height.  Livny et al. 2008, sections 3.1 to 3.5.
//   FILTER_NEAREST, _BILINEAR, _TRIANGLE  how a level is read between samples
//   FETCH_PACKED, _PLAIN, _MIPMAP, _LINEAR  what a texel holds (pgm_atlas.h); WIDE: heights span more than 16 bits
//   TILED                                 some levels are tiles about the viewer: their texels wrap; or arrive later
//   MANY_HEIGHTS                          a texture for each level, chosen by branching
//   MAPPING_PUBLISHED                     Equation 1 as printed; WEIGHT_PUBLISHED: Equation 7 as printed
// The levels' tiles, cells and texels are in pgm_levels.glsl.
layout(location = 0) in vec2 grid; // row; X in [-1, 1]

layout(std140) uniform grid_rows {
    vec4 rows[ROWS_MAX + 1]; // q, w, level, parent's weight (published: 1 / range)
};

#if defined(FILTER_NEAREST)
float filtered(vec4 corners, vec2 part) // corners: south-west, south-east, north-west, north-east
{
    vec2 row = part.y >= 0.5 ? corners.zw : corners.xy;
    return part.x >= 0.5 ? row.y : row.x;
}
#elif defined(FILTER_BILINEAR)
float filtered(vec4 corners, vec2 part)
{
    vec2 west_east = corners.xz + part.x * (corners.yw - corners.xz);
    return west_east.x + part.y * (west_east.y - west_east.x);
}
#else
float filtered(vec4 corners, vec2 part)
{
    float corner = part.x >= part.y ? corners.y : corners.z;
    return corners.x + max(part.x, part.y) * (corner - corners.x) + min(part.x, part.y) * (corners.w - corner);
}
#endif

#if defined(FETCH_PACKED)
#if defined(WIDE)
uniform isampler2D heights;
#else
uniform usampler2D heights;

vec4 unpacked(uvec2 pairs)
{
    ivec2 both = ivec2(pairs);
    return vec4(ivec4(both << 16 >> 16, both >> 16).xzyw);
}
#endif

// The parent's cell has twice the side: this one is its even or its odd half.
float blended_height(int level, vec2 place, float weight)
{
    cell own = cell_at(level, place);
    ivec2 texel = texel_of(level, own.corner);
    ivec2 half_of_parent = level == base.y ? ivec2(0) : (own.corner + tiles[level].zw) & 1;
    vec2 parent_part = level == base.y ? own.part : 0.5 * (own.part + vec2(half_of_parent));
#if defined(WIDE)
    vec4 corners = vec4(texelFetch(heights, ivec2(2 * texel.x, texel.y), 0));
    vec4 parents = vec4(texelFetch(heights, ivec2(2 * texel.x + 1, texel.y), 0));
#else
    uvec4 packed_corners = texelFetch(heights, texel, 0);
    vec4 corners = unpacked(packed_corners.xy), parents = unpacked(packed_corners.zw);
#endif
    float quanta = filtered(corners, own.part);
    quanta += weight * (filtered(parents, parent_part) - quanta);
    return quanta + float(base.x);
}
#elif defined(FETCH_MIPMAP)
uniform sampler2D heights;

// Boxes of 2 x 2 texels, blended by the hardware's sampler, which may weigh in 256 steps.
float blended_height(int level, vec2 place, float weight)
{
    return textureLod(heights, texture_place(0, place), float(level) + weight).r + float(base.x);
}
#else
#if defined(FETCH_LINEAR)
uniform sampler2D heights;

// By the hardware's sampler: at a tile's rim, with whatever lies beside it in the atlas.
float level_height(int level, cell at)
{
    vec2 texel = vec2(texel_of(level, at.corner)) + at.part + 0.5;
    return textureLod(heights, texel / vec2(textureSize(heights, 0)), 0.0).r + float(base.x);
}
#else
#if defined(MANY_HEIGHTS)
uniform isampler2D heights[HEIGHT_LEVELS];

float fetch(int level, ivec2 corner)
{
    ivec2 texel = texel_of(level, corner);
    int found = 0;
    MANY_HEIGHTS
    return float(found + base.x);
}
#else
uniform isampler2D heights;

float fetch(int level, ivec2 corner)
{
    return float(texelFetch(heights, texel_of(level, corner), 0).r + base.x);
}
#endif

// Fetches the corners that its filter reads, and no others.
float level_height(int level, cell at)
{
    ivec2 next = min(at.corner + 1, slots[level].zw);
#if defined(FILTER_NEAREST)
    return fetch(level, ivec2(at.part.x >= 0.5 ? next.x : at.corner.x, at.part.y >= 0.5 ? next.y : at.corner.y));
#else
    float south_west = fetch(level, at.corner), north_east = fetch(level, next);
#if defined(FILTER_BILINEAR)
    float south_east = fetch(level, ivec2(next.x, at.corner.y)), north_west = fetch(level, ivec2(at.corner.x, next.y));
#else
    bool south = at.part.x >= at.part.y;
    float south_east = fetch(level, ivec2(south ? next.x : at.corner.x, south ? at.corner.y : next.y)), north_west = south_east;
#endif
    return filtered(vec4(south_west, south_east, north_west, north_east), at.part);
#endif
}
#endif

float blended_height(int level, vec2 place, float weight)
{
    float quanta = level_height(level, cell_at(level, place));
    int parent = min(level + 1, base.y);
    // Written so that equal heights blend to exactly themselves.
    if (weight != 0.0) quanta += weight * (level_height(parent, cell_at(parent, place)) - quanta);
    return quanta;
}
#endif

// Place on the sampling plane relative to the eye.
vec2 place_of(vec4 row)
{
    float side = (across.x * grid.y + across.y) * row.y;
#if defined(MAPPING_PUBLISHED)
    // Equation 1 in the world's coordinates, the grid at a distance of 1 m: digits cancel.
    float scale = inversesqrt(row.x * row.x + side * side + eye.w * eye.w);
    vec3 vertex = eye.xyz + scale * vec3(ground_axes.xy * row.x + ground_axes.zw * side, -eye.w);
    float ground = eye.z - eye.w;
    vec3 point = eye.xyz + (eye.z - ground) / (eye.z - vertex.z) * (vertex - eye.xyz);
    return point.xy - eye.xy;
#else
    return ground_axes.xy * row.x + ground_axes.zw * side;
#endif
}

#if defined(SHADING_OWN)
out float v_lambda; // level and parent's weight, for fragments
#if defined(COORDINATES_AUTOMATIC)
out vec2 v_texel; // of the vertex in its own level's tile
#if defined(OWN_COLOUR)
out vec2 v_colour_texel;
#endif

vec2 interpolated_texel(int level, vec2 place)
{
    cell own = cell_at(level, place);
    return vec2(texel_of(level, own.corner)) + own.part;
}
#endif
#endif

vec3 relative_position()
{
    vec4 row = rows[int(grid.x)];
    vec2 place = place_of(row);
    float weight = row.w;
#if defined(WEIGHT_PUBLISHED)
    if (weight != 0.0) weight = length(place) * weight - 1.0;
#endif
#if defined(SHADING_OWN)
    v_lambda = max(row.z + weight, 0.0);
#if defined(COORDINATES_AUTOMATIC)
    v_texel = interpolated_texel(int(row.z), place);
#if defined(OWN_COLOUR)
    v_colour_texel = interpolated_texel(colour_slot(v_lambda), place);
#endif
#endif
#endif
    return vec3(place, relative_height(blended_height(int(row.z), place, weight)));
}
