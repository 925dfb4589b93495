// Worlds: the light of each sector ends at the borders of its box, where that of its neighbours takes over.

// Weight, 0 to 1, at the point `x` of a sector whose box has corners at `low` and `high`, world space, m. It falls
// linearly within `margin` m on both sides of each face. A face at which light does not end lies 1e30 m away.
float sector_window(vec3 x, vec3 low, vec3 high, float margin) {
    vec3 w = clamp(min(x - low, high - x) / (2.0 * margin) + 0.5, 0.0, 1.0);
    return w.x * w.y * w.z;
}
