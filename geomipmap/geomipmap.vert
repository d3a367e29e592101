// A vertex of a tile: its place follows from its number, its height is stored above the tile's base.
// TILE_ROW: vertices on a side of a tile.
const int TILE_VERTICES = TILE_ROW * TILE_ROW;

layout(location = 0) in int above; // quanta above the base of the tile

uniform isamplerBuffer places; // by slot: first cell in x and y, counted from the map's south-west corner; base in quanta;
                               // the tile's height: it holds every 2^height-th sample
uniform ivec2 eye_cell;        // the cell that the eye is in, counted likewise
uniform vec2 eye_fraction;     // and its place in that cell
uniform vec2 spacing;          // metres between samples

vec3 relative_position()
{
    int slot = gl_VertexID / TILE_VERTICES;
    int vertex = gl_VertexID - slot * TILE_VERTICES;
    ivec4 place = texelFetch(places, slot);
    ivec2 cell = place.xy + (ivec2(vertex % TILE_ROW, vertex / TILE_ROW) << place.w) - eye_cell;
    return vec3(relative_place(vec2(cell), eye_fraction, spacing), relative_height(float(place.z + above)));
}
