// Shared by every fragment program, whatever the pass: what lies outside the map's exact outline is not drawn.
in vec3 v_relative;

bool outside_map(vec3 relative)
{
    return any(lessThan(relative.xy, outline.xy)) || any(greaterThan(relative.xy, outline.zw));
}

bool outside_map()
{
    return outside_map(v_relative);
}
