// The uniform grid of the baselines: vertex k is sample (k % stride, k / stride) of every step-th sample, the last
// row and column clamped to the map's edge.
layout(location = 0) in float height_quanta;
uniform ivec4 grid;  // x: vertices a row of the buffer; y: step in samples; z, w: last sample of the extent relative to the first
uniform ivec2 first; // first sample relative to floor(eye / g)
uniform vec2 fraction;
uniform vec2 spacing;

vec3 relative_position()
{
    ivec2 sample_offset = min(ivec2(gl_VertexID % grid.x, gl_VertexID / grid.x) * grid.y, grid.zw);
    return vec3(relative_place(vec2(first + sample_offset), fraction, spacing), relative_height(height_quanta));
}
