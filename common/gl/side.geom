// The position pass: which side of each triangle the eye is on, and a drawn point that lies on the triangle.
//
// The rasteriser snaps corners to a sub-pixel grid (1/256 pixel; OpenGL asks for 1/16 at least).  On a ridge line it may
// therefore show the far slope, seen from below, where nothing is wrong: a pixel whose centre lies between the edge as it
// is and the edge as snapped belongs to the near slope and to the far one alike.  terrain.frag lets a triangle face
// away only by more than that can explain; and since such a pixel's centre lies outside the triangle, where a plane
// nearly edge-on runs away, it takes the nearest point of the triangle instead of the plane's.
//
// All that tells inside from outside is flat: clipping leaves it as it is, while llvmpipe spoils noperspective outputs
// of triangles that it clips (0 / 0 where two corners share a column of the screen).
layout(triangles) in;
layout(triangle_strip, max_vertices = 3) out;
in vec3 v_corner[];
out vec3 v_relative, v_ground;
flat out vec4 v_corners[3]; // xyz: corners; w: their depth
flat out vec2 v_screen[3];  // the corners in the picture, pixels
flat out vec3 v_altitude;   // of the triangle in the picture, over each corner's opposite edge, pixels
flat out int v_side;        // FRONT, BACK; a corner nearer than the near plane, v_screen runs to infinity: NEAR_FRONT, NEAR_BACK

void main()
{
    vec3 normal = cross(v_corner[1] - v_corner[0], v_corner[2] - v_corner[0]);
    bool below = dot(normal, v_corner[0]) > 0.0;
    bool before = true;
    for (int i = 0; i < 3; i++) before = before && abs(gl_in[i].gl_Position.z) <= gl_in[i].gl_Position.w;
    vec2 p[3];
    for (int i = 0; i < 3; i++) p[i] = (gl_in[i].gl_Position.xy / gl_in[i].gl_Position.w * 0.5 + 0.5) * shade.zw;
    vec2 a = p[2] - p[1], b = p[0] - p[2], c = p[1] - p[0];
    vec3 altitude = abs(c.x * b.y - c.y * b.x) / max(vec3(length(a), length(b), length(c)), vec3(1e-30));
    for (int i = 0; i < 3; i++) {
        v_relative = v_corner[i];
        v_ground = in_reliefs(v_relative);
        for (int k = 0; k < 3; k++) {
            v_corners[k] = vec4(v_corner[k], gl_in[k].gl_Position.w);
            v_screen[k] = p[k];
        }
        v_altitude = altitude;
        v_side = before ? (below ? BACK : FRONT) : (below ? NEAR_BACK : NEAR_FRONT);
        gl_Position = gl_in[i].gl_Position;
        EmitVertex();
    }
    EndPrimitive();
}
