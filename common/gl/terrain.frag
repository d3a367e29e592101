// The one fragment program: a height ramp with Lambert shading, or the position itself, or depth alone.
#if defined(PASS_SHADED)
layout(location = 0) out vec4 colour;

// Green valleys, dry slopes, grey rock, snow.
vec3 ramp(float t)
{
    const vec3 valley = vec3(0.34, 0.52, 0.38), meadow = vec3(0.66, 0.70, 0.46), slope = vec3(0.82, 0.70, 0.50);
    const vec3 rock = vec3(0.66, 0.58, 0.53), snow = vec3(1.0, 1.0, 1.0);
    vec3 c = mix(valley, meadow, clamp(t * 3.2, 0.0, 1.0));
    c = mix(c, slope, clamp((t - 0.31) * 4.0, 0.0, 1.0));
    c = mix(c, rock, clamp((t - 0.56) * 5.0, 0.0, 1.0));
    return mix(c, snow, clamp((t - 0.76) * 6.0, 0.0, 1.0));
}

void main()
{
    // Derivatives come before the discard: they need the neighbours that it would take away.
    vec3 normal = cross(dFdx(v_relative), dFdy(v_relative));
    if (outside_map()) discard;
    normal *= inversesqrt(max(dot(normal, normal), 1e-30)) * (normal.z < 0.0 ? -1.0 : 1.0);
    const vec3 to_sun = vec3(-0.58, 0.58, 0.57); // north-west, 35 degrees high
    vec3 light = vec3(0.30, 0.35, 0.44) + vec3(1.05, 0.99, 0.88) * max(dot(normal, to_sun), 0.0);
    float t = (v_relative.z + height.w - shade.x) * shade.y;
    colour = vec4(ramp(sqrt(clamp(t, 0.0, 1.0))) * light, 1.0); // the root spreads the lowlands, where most ground is
}
#elif defined(PASS_POSITION)
noperspective in vec3 v_edge_px; // side.geom
const float SNAP_PX = 1.4142136 / 256.0;
layout(location = 0) out vec4 position_and_side;

void main()
{
    if (outside_map()) discard;
    float inside_px = min(v_edge_px.x, min(v_edge_px.y, v_edge_px.z));
    position_and_side = vec4(v_relative, inside_px > SNAP_PX ? -1.0 : 1.0);
}
#else
void main()
{
    if (outside_map()) discard;
}
#endif
