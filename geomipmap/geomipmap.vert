// A vertex of a tile: its place follows from its number, its height is stored above the tile's base.
// TILE_ROW: vertices on a side of a tile.  MORPH: vertices that the next coarser level lacks move towards it.
const int TILE_VERTICES = TILE_ROW * TILE_ROW;

layout(location = 0) in int above; // quanta above the base of the tile

uniform isamplerBuffer places; // by slot: first cell in x and y, counted from the map's south-west corner; base in quanta;
                               // the tile's height: it holds every 2^height-th sample
uniform ivec2 eye_cell;        // the cell that the eye is in, counted likewise
uniform vec2 eye_fraction;     // and its place in that cell
uniform vec2 spacing;          // metres between samples

#ifdef MORPH
uniform HEIGHTS heights;      // all slots, one after the other
uniform samplerBuffer morphs; // by slot, two texels: morph of the south, east, north and west side; morph inside, level
                              // inside, levels of the sides in steps of 8

// Quanta that a vertex moves: to the middle of the edge that replaces it at the next coarser level.
float morphed(int slot, ivec2 at, int vertex)
{
    vec4 sides = texelFetch(morphs, 2 * slot), inside = texelFetch(morphs, 2 * slot + 1);
    bvec4 on = bvec4(at.y == 0, at.x == TILE_ROW - 1, at.y == TILE_ROW - 1, at.x == 0);
    int side = on.x ? 0 : on.y ? 1 : on.z ? 2 : 3, both = at.x | at.y;
    bool inner = !any(on);
    float morph = inner ? inside.x : sides[side];
    int level = inner ? int(inside.y) : int(inside.z) >> 3 * side & 7;
    // Corners are vertices of every level, so a vertex on two sides never moves.
    if (morph == 0.0 || (both & ((2 << level) - 1)) != 1 << level) return 0.0;
    int edge = (at.x & 1 << level) + (at.y & 1 << level) * TILE_ROW;
    int first = slot * TILE_VERTICES + vertex;
    int bend = int(texelFetch(heights, first - edge).x) + int(texelFetch(heights, first + edge).x) - 2 * above;
    return morph * 0.5 * float(bend);
}
#endif

vec3 relative_position()
{
    int slot = gl_VertexID / TILE_VERTICES;
    int vertex = gl_VertexID - slot * TILE_VERTICES;
    ivec4 place = texelFetch(places, slot);
    ivec2 at = ivec2(vertex % TILE_ROW, vertex / TILE_ROW);
    ivec2 cell = place.xy + (at << place.w) - eye_cell;
    float quanta = float(place.z + above);
#ifdef MORPH
    quanta += morphed(slot, at, vertex);
#endif
    return vec3(relative_place(vec2(cell), eye_fraction, spacing), relative_height(quanta));
}
