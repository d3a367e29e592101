// The end of every vertex program: the renderer's position, kept for capture and measuring, and its place on the screen.
#ifdef PASS_POSITION
#define v_relative v_corner // side.geom stands between this and the fragments
#define v_ground v_corner_ground
#endif
invariant gl_Position;
out vec3 v_relative;
out vec3 v_ground;

void main()
{
    v_relative = relative_position();
    v_ground = in_reliefs(v_relative);
    gl_Position = clip_from_relative * vec4(v_relative, 1.0);
}
