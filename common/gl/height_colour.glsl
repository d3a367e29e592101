// Green valleys, dry slopes, grey rock, snow: linear in height between the heights (0 lowest, 1 highest of the map) at which
// each is pure.
vec3 ground_colour()
{
    const vec3 valley = vec3(0.34, 0.52, 0.38), meadow = vec3(0.66, 0.70, 0.46), slope = vec3(0.82, 0.70, 0.50);
    const vec3 rock = vec3(0.66, 0.58, 0.53), snow = vec3(1.0, 1.0, 1.0);
    const vec4 from = vec4(0.0, 0.0977, 0.3136, 0.5776), to = vec4(0.0977, 0.3136, 0.5776, 0.8587);
    vec4 part = clamp((v_ground.z - from) / (to - from), 0.0, 1.0);
    return valley + (meadow - valley) * part.x + (slope - meadow) * part.y + (rock - slope) * part.z + (snow - rock) * part.w;
}
