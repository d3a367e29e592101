// The position pass: which side of each triangle the eye is on, and a drawn point that lies on the triangle.
//
// The rasteriser snaps corners to a sub-pixel grid (1/256 pixel; OpenGL asks for 1/16 at least).  On a ridge line it may
// therefore show the far slope, seen from below, where nothing is wrong: a pixel whose centre lies between the edge as it
// is and the edge as snapped belongs to the near slope and to the far one alike.  terrain.frag lets a triangle face
// away only by more than that can explain; and since such a pixel's centre lies outside the triangle, where a plane
// nearly edge-on runs away, it takes the nearest point of the triangle instead of the plane's.
layout(triangles) in;
layout(triangle_strip, max_vertices = 3) out;
in vec3 v_corner[];
out vec3 v_relative;
noperspective out vec3 v_weight; // barycentric coordinates on the screen
flat out vec4 v_corners[3];      // xyz: corners; w: their depth
flat out vec4 v_side;            // xyz: altitudes on the screen, pixels; w: 1 seen from above, -1 from below, 0 a corner is behind the eye

vec3 altitudes_px()
{
    vec2 p[3];
    for (int i = 0; i < 3; i++) p[i] = gl_in[i].gl_Position.xy / gl_in[i].gl_Position.w * 0.5 * shade.zw;
    vec2 a = p[2] - p[1], b = p[0] - p[2], c = p[1] - p[0];
    float doubled_area = abs(c.x * b.y - c.y * b.x);
    return doubled_area / max(vec3(length(a), length(b), length(c)), vec3(1e-30));
}

void main()
{
    vec3 normal = cross(v_corner[1] - v_corner[0], v_corner[2] - v_corner[0]);
    bool below = dot(normal, v_corner[0]) > 0.0;
    bool before = min(gl_in[0].gl_Position.w, min(gl_in[1].gl_Position.w, gl_in[2].gl_Position.w)) > 0.0;
    vec4 side = before ? vec4(altitudes_px(), below ? -1.0 : 1.0) : vec4(0.0);
    for (int i = 0; i < 3; i++) {
        v_relative = v_corner[i];
        v_weight = vec3(i == 0, i == 1, i == 2);
        for (int k = 0; k < 3; k++) v_corners[k] = vec4(v_corner[k], gl_in[k].gl_Position.w);
        v_side = before || !below ? side : vec4(1e9, 1e9, 1e9, -1.0); // near by, and never a ridge line
        gl_Position = gl_in[i].gl_Position;
        EmitVertex();
    }
    EndPrimitive();
}
