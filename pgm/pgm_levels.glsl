// Where the samples of heights' levels, and after them those of colours', are, for vertices and for fragments.  TILED: some
// levels are tiles about the viewer, whose texels wrap, or arrive later.  EDGE_CLAMPED: what lies beyond the map reads its border.
layout(std140) uniform sampling {
    vec4 ground_axes;        // e_f, e_r
    vec4 across;             // X of the columns in use: x X + y; z: from a level of heights to one of colours
    vec4 eye;                // the eye in the world; w: height over the sampling plane
    ivec4 base;              // x: quanta of texel 0; y: last slot of heights; z: last slot of colours
    vec4 cells[SLOTS_MAX];  // a level's cells in a metre, x and y; the eye's fraction of a cell
    ivec4 slots[SLOTS_MAX]; // first and last sample, counted from the tile's origin
    ivec4 eyes[SLOTS_MAX];  // cell that the eye is in, counted so; the tile's texel in the atlas
    ivec4 tiles[SLOTS_MAX]; // sides of the tile; the origin's sample, modulo 2
};
// The cell of a level that a place is in.  Cells are counted from the one the eye is in, so that no digits are lost.
// The border's cells go on for one cell beyond it: they hold triangles that the map's outline cuts.
struct cell {
    ivec2 corner; // south-west sample, counted from the tile's origin
    vec2 part;    // of the cell
};

cell cell_at(int level, vec2 place)
{
    vec2 from_eye = clamp(place * cells[level].xy + cells[level].zw, -1e9, 1e9);
    ivec4 slot = slots[level];
    ivec2 eye_cell = eyes[level].xy, corner = clamp(eye_cell + ivec2(floor(from_eye)), slot.xy, max(slot.zw - 1, slot.xy));
#if defined(EDGE_CLAMPED)
    const float beyond = 0.0;
#else
    const float beyond = 1.0;
#endif
    return cell(corner, clamp(from_eye - vec2(corner - eye_cell), -beyond, 1.0 + beyond));
}

ivec2 texel_of(int level, ivec2 corner)
{
#if defined(TILED)
    ivec2 side = tiles[level].xy;
    corner -= side * ivec2(greaterThanEqual(corner, side));
#endif
    return corner + eyes[level].zw;
}

// For the hardware's sampler, where a level is a texture by itself.
vec2 texture_place(int level, vec2 place)
{
    vec2 from_eye = clamp(place * cells[level].xy + cells[level].zw, -1e9, 1e9);
    return (from_eye + vec2(eyes[level].xy) + 0.5) / vec2(slots[level].zw + 1);
}

// Level of the colour image, from the finest on, that is as fine as level lambda of the heights; and its slot.
float colour_level(float lambda)
{
    return clamp(lambda + across.z, 0.0, float(base.z - base.y - 1));
}

int colour_slot(float lambda)
{
    return base.y + 1 + int(floor(colour_level(lambda)));
}
