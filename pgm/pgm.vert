// Lays the persistent grid over the ground: row table to place, place to height.  Livny et al. 2008, sections 3.1 to 3.5.
// FILTER_NEAREST, FILTER_BILINEAR or FILTER_TRIANGLE says how a level is read; WEIGHT_PUBLISHED takes Equation 7 as printed.
layout(location = 0) in vec2 grid; // row; X in [-1, 1]

layout(std140) uniform sampling {
    vec4 axes;               // e_f, e_r
    ivec4 base;              // x: quanta of texel 0; y: last slot
    vec4 cells[LEVELS_MAX];  // a level's cells in a metre, x and y; the eye's fraction of a cell
    ivec4 slots[LEVELS_MAX]; // its first and last texel
    ivec4 eyes[LEVELS_MAX];  // texel of the cell that the eye is in
    vec4 rows[ROWS_MAX + 1]; // q, w, level, parent's weight (published: 1 / range)
};
uniform isampler2D heights;

float fetch(ivec2 texel)
{
    return float(texelFetch(heights, texel, 0).r + base.x);
}

// Height of a level in quanta.  Cells are counted from the one the eye is in, so that no digits are lost.  The
// border's cells go on for one cell beyond it: they hold triangles that the map's outline cuts.
float level_height(int level, vec2 place)
{
    vec2 cell = clamp(place * cells[level].xy + cells[level].zw, -1e9, 1e9);
    ivec4 slot = slots[level];
    ivec2 eye = eyes[level].xy;
#if defined(FILTER_NEAREST)
    return fetch(clamp(eye + ivec2(floor(cell + 0.5)), slot.xy, slot.zw));
#else
    ivec2 texel = clamp(eye + ivec2(floor(cell)), slot.xy, max(slot.zw - 1, slot.xy));
    ivec2 next = min(texel + 1, slot.zw);
    vec2 part = clamp(cell - vec2(texel - eye), -1.0, 2.0);
    float near_corner = fetch(texel), far_corner = fetch(next);
#if defined(FILTER_BILINEAR)
    float east = fetch(ivec2(next.x, texel.y)), north = fetch(ivec2(texel.x, next.y));
    float south_edge = near_corner + part.x * (east - near_corner);
    float north_edge = north + part.x * (far_corner - north);
    return south_edge + part.y * (north_edge - south_edge);
#else
    float corner = fetch(part.x >= part.y ? ivec2(next.x, texel.y) : ivec2(texel.x, next.y));
    return near_corner + max(part.x, part.y) * (corner - near_corner) + min(part.x, part.y) * (far_corner - corner);
#endif
#endif
}

vec3 relative_position()
{
    vec4 row = rows[int(grid.x)];
    vec2 place = axes.xy * row.x + axes.zw * (grid.y * row.y);
    int level = int(row.z);
    float quanta = level_height(level, place), weight = row.w;
#if defined(WEIGHT_PUBLISHED)
    if (weight != 0.0) weight = length(place) * weight - 1.0;
#endif
    // Written so that equal heights blend to exactly themselves.
    if (weight != 0.0) quanta += weight * (level_height(min(level + 1, base.y), place) - quanta);
    return vec3(place, relative_height(quanta));
}
