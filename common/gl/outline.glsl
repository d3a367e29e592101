// Shared by every fragment program, whatever the pass: what lies outside the map's exact outline is not drawn.
in vec3 v_relative;

bool outside_map()
{
    return any(lessThan(v_relative.xy, outline.xy)) || any(greaterThan(v_relative.xy, outline.zw));
}
