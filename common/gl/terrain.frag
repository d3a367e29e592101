// The one fragment program: a height ramp with Lambert shading, or the position itself, or depth alone.  Two pieces before
// it say what is shaded: `vec3 surface_normal()` (unit; face_normal.glsl, or the renderer's own) and
// `vec3 ground_colour()` (height_colour.glsl or image_colour.glsl).
#if defined(PASS_SHADED)
layout(location = 0) out vec4 colour;

void main()
{
    // Derivatives come before the discard: they need the neighbours that it would take away.
    vec3 normal = surface_normal(), ground = ground_colour();
    if (outside_map()) discard;
    const vec3 to_sun = vec3(-0.58, 0.58, 0.57); // north-west, 35 degrees high
    vec3 light = vec3(0.30, 0.35, 0.44) + vec3(1.05, 0.99, 0.88) * max(dot(normal, to_sun), 0.0);
    colour = vec4(ground * light, 1.0);
}
#elif defined(PASS_POSITION)
noperspective in vec3 v_weight; // side.geom
flat in vec4 v_corners[3];
flat in vec4 v_side;
layout(location = 0) out vec4 position_and_side;

// sqrt(2) steps of the sub-pixel grid: a corner moves by half a step along each axis, and the distance to an edge is
// interpolated between corners that moved as far.
const float SNAP_PX = 1.4142136 / 256.0;

vec3 nearest_point_of_triangle()
{
    vec3 weight = max(v_weight, 0.0) / vec3(v_corners[0].w, v_corners[1].w, v_corners[2].w);
    vec3 sum = weight.x * v_corners[0].xyz + weight.y * v_corners[1].xyz + weight.z * v_corners[2].xyz;
    return sum / (weight.x + weight.y + weight.z);
}

void main()
{
    if (outside_map()) discard;
    vec3 inside_px = v_weight * v_side.xyz;
    bool below = v_side.w < 0.0 && min(inside_px.x, min(inside_px.y, inside_px.z)) > SNAP_PX;
    bool outside = v_side.w != 0.0 && min(v_weight.x, min(v_weight.y, v_weight.z)) < 0.0 && v_side.x < 1e8;
    position_and_side = vec4(outside ? nearest_point_of_triangle() : v_relative, below ? -1.0 : 1.0);
}
#else
void main()
{
    if (outside_map()) discard;
}
#endif
