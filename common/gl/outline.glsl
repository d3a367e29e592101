// Shared by every fragment program, whatever the pass: what lies outside the map's exact outline is not drawn.
in vec3 v_relative; // metres from the eye
in vec3 v_ground;   // in_reliefs(v_relative)

// MAP_UNBOUNDED: nothing is tested; all that is drawn lies inside, or a renderer shows what comes of drawing on beyond the
// map.
bool outside_map(vec3 ground)
{
#if defined(MAP_UNBOUNDED)
    return false;
#else
    return any(lessThan(ground.xy, outline.xy)) || any(greaterThan(ground.xy, outline.zw));
#endif
}

bool outside_map()
{
    return outside_map(v_ground);
}
