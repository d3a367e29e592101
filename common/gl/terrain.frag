// The one fragment program: a height ramp with Lambert shading, or the position itself, or depth alone.
#if defined(PASS_SHADED)
layout(location = 0) out vec4 colour;

vec3 ramp(float t)
{
    const vec3 valley = vec3(0.36, 0.50, 0.36), meadow = vec3(0.64, 0.68, 0.45), slope = vec3(0.78, 0.67, 0.48);
    const vec3 rock = vec3(0.60, 0.53, 0.48), snow = vec3(0.97, 0.97, 0.98);
    vec3 c = mix(valley, meadow, clamp(t / 0.22, 0.0, 1.0));
    c = mix(c, slope, clamp((t - 0.22) / 0.25, 0.0, 1.0));
    c = mix(c, rock, clamp((t - 0.47) / 0.25, 0.0, 1.0));
    return mix(c, snow, clamp((t - 0.72) / 0.22, 0.0, 1.0));
}

void main()
{
    // Derivatives come before the discard: they need the neighbours that it would take away.
    vec3 normal = cross(dFdx(v_relative), dFdy(v_relative));
    if (outside_map()) discard;
    normal *= inversesqrt(max(dot(normal, normal), 1e-30)) * (normal.z < 0.0 ? -1.0 : 1.0);
    const vec3 to_sun = vec3(-0.5, 0.5, 0.70710678); // north-west, 45 degrees high
    vec3 light = vec3(0.34, 0.38, 0.45) + vec3(0.86, 0.82, 0.74) * max(dot(normal, to_sun), 0.0);
    float t = (v_relative.z + height.w - shade.x) * shade.y;
    colour = vec4(ramp(t) * light, 1.0);
}
#elif defined(PASS_POSITION)
layout(location = 0) out vec4 position_and_side;

void main()
{
    if (outside_map()) discard;
    position_and_side = vec4(v_relative, gl_FrontFacing ? 1.0 : -1.0);
}
#else
void main()
{
    if (outside_map()) discard;
}
#endif
