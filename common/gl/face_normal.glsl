// Shading `common`: the normal of the drawn triangle itself, so that a picture shows geometry and nothing else.
float cosine_to(vec3 direction)
{
    vec3 normal = cross(dFdx(v_ground), dFdy(v_ground));
    float cosine = dot(normal, direction) * inversesqrt(max(dot(normal, normal), 1e-30));
    return normal.z < 0.0 ? -cosine : cosine;
}
