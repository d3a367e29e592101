// Shading of the method's own: the word of each sample, four of a cell in a texel, fetched once a fragment, or twice to
// blend with the parent's (Livny et al. 2008, section 5).  The fragment finds its texels itself, from its place and its
// level.  COORDINATES_AUTOMATIC: they are interpolated between vertices instead, and where these read different tiles of
// the atlas they sweep over all that lies between (Figure 15).  ONE_FETCH: the level alone.
in float v_lambda;
in vec2 v_texel;
uniform usampler2D shading;

vec2 slope_of(uint word)
{
    ivec2 parts = ivec2(int(word) << 16 >> 16, int(word) >> 16);
    return vec2(parts) / 32767.0;
}

vec2 fetched(ivec2 texel, vec2 part)
{
    uvec4 words = texelFetch(shading, texel, 0);
    vec2 at = clamp(part, 0.0, 1.0);
    vec2 south = mix(slope_of(words.x), slope_of(words.y), at.x), north = mix(slope_of(words.z), slope_of(words.w), at.x);
    return mix(south, north, at.y);
}

vec2 slope_at(int level, vec2 place)
{
    cell own = cell_at(level, place);
    return fetched(texel_of(level, own.corner), own.part);
}

// The finest level, from one on, that is in memory at a place: between two rows it may end.
int held_level(int level, vec2 place)
{
    while (level < base.y) {
        vec2 cell_place = clamp(place * cells[level].xy + cells[level].zw, -1e9, 1e9);
        ivec2 corner = eyes[level].xy + ivec2(floor(cell_place));
        if (all(greaterThanEqual(corner, slots[level].xy)) && all(lessThan(corner, slots[level].zw))) break;
        if (slots[level].x == 0 && slots[level].y == 0 && slots[level].zw == tiles[level].xy - 1) break; // whole: the map ends
        level++;
    }
    return level;
}

vec3 surface_normal()
{
#if defined(COORDINATES_AUTOMATIC)
    vec2 slope = fetched(ivec2(floor(v_texel)), fract(v_texel));
#else
    int wanted = min(int(floor(v_lambda)), base.y), level = held_level(wanted, v_relative.xy);
    vec2 slope = slope_at(level, v_relative.xy);
#if !defined(ONE_FETCH)
    if (level == wanted && level < base.y) slope = mix(slope, slope_at(level + 1, v_relative.xy), fract(v_lambda));
#endif
#endif
    return vec3(slope, sqrt(max(1.0 - dot(slope, slope), 0.0)));
}
