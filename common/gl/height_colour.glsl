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

vec3 ground_colour()
{
    float t = (v_relative.z + height.w - shade.x) * shade.y;
    return ramp(sqrt(clamp(t, 0.0, 1.0))); // the root spreads the lowlands, where most ground is
}
