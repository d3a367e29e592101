// The position pass: which side of each triangle the eye is on, from its corners as they are.
//
// The rasteriser snaps corners to a sub-pixel grid (1/256 pixel; OpenGL asks for 1/16 at least).  On a ridge line it may
// therefore show the far slope, seen from below, where nothing is wrong: a pixel whose centre lies between the edge as it is and the edge as
// snapped belongs to the near slope and to the far one alike.  A triangle faces away only by more than that can explain: the
// pixel's centre must lie more than sqrt(2) steps inside (a corner moves by half a step along each axis, and the distance is
// interpolated between corners that moved as far).
layout(triangles) in;
layout(triangle_strip, max_vertices = 3) out;
in vec3 v_corner[];
out vec3 v_relative;
noperspective out vec3 v_edge_px; // distance to the three edges, pixels; negated when the triangle faces the eye

vec3 altitudes_px()
{
    vec2 p[3];
    for (int i = 0; i < 3; i++) {
        if (gl_in[i].gl_Position.w <= 0.0) return vec3(1e9); // a corner behind the eye: near by, and never a ridge line
        p[i] = gl_in[i].gl_Position.xy / gl_in[i].gl_Position.w * 0.5 * shade.zw;
    }
    vec2 a = p[2] - p[1], b = p[0] - p[2], c = p[1] - p[0];
    float doubled_area = abs(c.x * b.y - c.y * b.x);
    return doubled_area / max(vec3(length(a), length(b), length(c)), vec3(1e-30));
}

void main()
{
    vec3 normal = cross(v_corner[1] - v_corner[0], v_corner[2] - v_corner[0]);
    vec3 altitude = dot(normal, v_corner[0]) > 0.0 ? altitudes_px() : vec3(-1.0);
    for (int i = 0; i < 3; i++) {
        v_relative = v_corner[i];
        v_edge_px = vec3(i == 0, i == 1, i == 2) * altitude;
        if (altitude.x < 0.0) v_edge_px = vec3(-1.0);
        gl_Position = gl_in[i].gl_Position;
        EmitVertex();
    }
    EndPrimitive();
}
