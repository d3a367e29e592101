// Shading of the method's own: words of normal and of colour, four of a cell in a texel, fetched once a fragment each, or
// twice to blend with the parent's (Livny et al. 2008, section 5).  The fragment finds its texels itself, from its place and
// its level.
//   COORDINATES_AUTOMATIC  they are interpolated between vertices instead, and where these read different tiles of the atlas
//                          they sweep over all that lies between (Figure 15)
//   ONE_FETCH              the level alone
//   NO_FETCH               nothing: each cell slopes up from its south-west corner; shows levels, and what the rest costs
//   NEAREST_WORD           the word of the nearest corner, not a blend of four
//   FETCH_MIPMAP           the hardware's mipmaps of the finest level
//   OWN_COLOUR             there is a colour image
//   MANY_SHADING, MANY_COLOURS  a texture for each level, chosen by branching
in float v_lambda;
#if defined(COORDINATES_AUTOMATIC)
in vec2 v_texel;
#if defined(OWN_COLOUR)
in vec2 v_colour_texel;
#endif
#endif

#if defined(FETCH_MIPMAP)
uniform sampler2D shading;

vec4 filtered_texel(sampler2D texels, int finest, float level)
{
#if defined(ONE_FETCH)
    level = floor(level);
#endif
    return textureLod(texels, texture_place(finest, v_relative.xy), level);
}

vec2 ground_slope()
{
    return filtered_texel(shading, 0, v_lambda).xy;
}
#if defined(OWN_COLOUR)
uniform sampler2D colours;

vec3 ground_colour()
{
    return filtered_texel(colours, base.y + 1, colour_level(v_lambda)).rgb;
}
#endif
#else
#if defined(MANY_SHADING)
uniform usampler2D shading[HEIGHT_LEVELS];
#else
uniform usampler2D shading;
#endif

uvec4 slope_words(int level, ivec2 texel)
{
#if defined(MANY_SHADING)
    uvec4 found = uvec4(0u);
    MANY_SHADING
    return found;
#else
    return texelFetch(shading, texel, 0);
#endif
}

vec2 slope_of(uint word)
{
    ivec2 parts = ivec2(int(word) << 16 >> 16, int(word) >> 16);
    return vec2(parts) / 32767.0;
}

vec3 colour_of(uint word)
{
    return vec3(word & 255u, word >> 8 & 255u, word >> 16 & 255u) / 255.0;
}

uint nearest(uvec4 words, vec2 part)
{
    uvec2 row = part.y >= 0.5 ? words.zw : words.xy;
    return part.x >= 0.5 ? row.y : row.x;
}

// Of the corners of a cell: south-west, south-east, north-west, north-east.
vec4 weights_of(vec2 part)
{
    vec2 east = clamp(part, 0.0, 1.0), west = 1.0 - east;
    return vec4(west.x, east.x, west.x, east.x) * vec4(west.yy, east.yy);
}

vec2 slope_between(uvec4 words, vec2 part)
{
#if defined(NEAREST_WORD)
    return slope_of(nearest(words, part));
#else
    return mat4x2(slope_of(words.x), slope_of(words.y), slope_of(words.z), slope_of(words.w)) * weights_of(part);
#endif
}

vec3 colour_between(uvec4 words, vec2 part)
{
#if defined(NEAREST_WORD)
    return colour_of(nearest(words, part));
#else
    return mat4x3(colour_of(words.x), colour_of(words.y), colour_of(words.z), colour_of(words.w)) * weights_of(part);
#endif
}

vec2 slope_at(int level)
{
    cell own = cell_at(level, v_relative.xy);
    ivec2 texel = texel_of(level, own.corner);
#if defined(NO_FETCH)
    return 0.5 * own.part - 1e-9 * vec2(texel);
#else
    return slope_between(slope_words(level, texel), own.part);
#endif
}

bool is_held(int level)
{
#if defined(TILED)
    vec2 cell_place = clamp(v_relative.xy * cells[level].xy + cells[level].zw, -1e9, 1e9);
    ivec2 corner = eyes[level].xy + ivec2(floor(cell_place));
    bool inside = all(greaterThanEqual(corner, slots[level].xy)) && all(lessThan(corner, slots[level].zw));
    return inside || (slots[level].xy == ivec2(0) && slots[level].zw == tiles[level].xy - 1); // full: the map ends
#else
    return true;
#endif
}

// The finest level, from one on, that is in memory here: between two rows it may end.
int held_level(int level, int last)
{
    while (level < last && !is_held(level)) level++;
    return level;
}

vec2 ground_slope()
{
#if defined(COORDINATES_AUTOMATIC)
    return slope_between(slope_words(int(v_lambda), ivec2(floor(v_texel))), fract(v_texel));
#else
    int wanted = min(int(floor(v_lambda)), base.y), level = held_level(wanted, base.y);
    vec2 slope = slope_at(level);
#if !defined(ONE_FETCH)
    if (level == wanted && level < base.y && is_held(level + 1)) slope = mix(slope, slope_at(level + 1), fract(v_lambda));
#endif
    return slope;
#endif
}
#if defined(OWN_COLOUR)
#if defined(MANY_COLOURS)
uniform usampler2D colours[COLOUR_LEVELS];
#else
uniform usampler2D colours;
#endif

uvec4 colour_words(int slot, ivec2 texel)
{
#if defined(MANY_COLOURS)
    int level = slot - base.y - 1;
    uvec4 found = uvec4(0u);
    MANY_COLOURS
    return found;
#else
    return texelFetch(colours, texel, 0);
#endif
}

vec3 colour_at(int slot)
{
    cell own = cell_at(slot, v_relative.xy);
    ivec2 texel = texel_of(slot, own.corner);
#if defined(NO_FETCH)
    return vec3(0.5 * own.part, 0.5) + 1e-9 * vec3(texel, 0.0);
#else
    return colour_between(colour_words(slot, texel), own.part);
#endif
}

vec3 ground_colour()
{
    int wanted = colour_slot(v_lambda);
#if defined(COORDINATES_AUTOMATIC)
    return colour_between(colour_words(wanted, ivec2(floor(v_colour_texel))), fract(v_colour_texel));
#else
    int slot = held_level(wanted, base.z);
    vec3 colour = colour_at(slot);
#if !defined(ONE_FETCH)
    if (slot == wanted && slot < base.z && is_held(slot + 1)) colour = mix(colour, colour_at(slot + 1), fract(colour_level(v_lambda)));
#endif
    return colour;
#endif
}
#endif
#endif

vec3 surface_normal()
{
    vec2 slope = ground_slope();
    return vec3(slope, sqrt(max(1.0 - dot(slope, slope), 0.0)));
}
