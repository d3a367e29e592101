// A vertex of a block or a stitch: its place follows from its number and the block's corner, its heights from the level's
// toroidal texture.  Morph: Losasso & Hoppe 2004, section 6.2; clipmap_alpha_at() is this program's float32 twin.
// SIZE: slots on a side.  ROW: vertex numbers a row.  SPLIT: vertices are numbered in half cells.  PUBLISHED_ALPHA: alpha as
// printed.

layout(location = 0) in ivec2 corner; // of the block, in cells from floor(eye / g)

uniform sampler2DArray heights; // z and z_c in quanta
uniform ivec3 slot;             // cell + slot.xy is a toroidal slot, 0 .. 2 SIZE - 1; slot.z: layer
uniform vec4 place;             // the eye's fraction of a cell; metres between samples
uniform vec4 sides;             // the lines, in cells, from which the morph runs inwards: west, south, east, north
uniform vec3 morph;             // its width in cells, 1 / width, and the least alpha of the level

#ifdef SHADING_OWN
out float v_alpha; // blends the normal maps as it does the heights
#endif

vec2 heights_at(ivec2 cell)
{
    ivec2 texel = cell + slot.xy;
    texel -= SIZE * ivec2(greaterThanEqual(texel, ivec2(SIZE)));
    return texelFetch(heights, ivec3(texel, slot.z), 0).xy;
}

vec3 relative_position()
{
    ivec2 vertex = ivec2(gl_VertexID & (ROW - 1), gl_VertexID / ROW);
#ifdef SPLIT
    // The middle of an edge: the finer level's vertex there, bit for bit (halves and the mean of two quanta are exact).
    ivec2 from = corner + (vertex >> 1), to = from + (vertex & 1);
    vec2 cell = vec2(from + to) * 0.5;
    vec2 z = (heights_at(from) + heights_at(to)) * 0.5;
#else
    ivec2 from = corner + vertex;
    vec2 cell = vec2(from);
    vec2 z = heights_at(from);
#endif
    vec2 inwards = min(cell - sides.xy, sides.zw - cell);
    float d = min(inwards.x, inwards.y);
    float alpha = min(max((morph.x - d) * morph.y, morph.z), 1.0);
#ifndef PUBLISHED_ALPHA
    if (d <= 0.0) alpha = 1.0;
#endif
#ifdef SHADING_OWN
    v_alpha = alpha;
#endif
    // z + (z_c - z) alpha keeps a flat surface flat; it need not reach z_c at 1, hence the choice (numerics.md, section 0).
    float z_morphed = alpha >= 1.0 ? z.y : z.x + (z.y - z.x) * alpha;
    return vec3(relative_place(cell, place.xy, place.zw), relative_height(z_morphed));
}
