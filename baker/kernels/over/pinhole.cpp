#include "over/pinhole.h"

Camera camera_from(nb::handle pinhole)
{
    const auto pose = nb::cast<Input<double, 4, 4>>(pinhole.attr("view_from_world"));
    Camera camera;
    for (size_t i = 0; i < 3; ++i) {
        for (size_t j = 0; j < 3; ++j)
            camera.rotation[i][j] = pose(i, j);
        camera.translation[i] = pose(i, 3);
    }
    for (size_t i = 0; i < 3; ++i) // the pose is rigid: the transposed rotation is its inverse
        camera.position[i] = -(camera.rotation[0][i] * camera.translation[0] +
            camera.rotation[1][i] * camera.translation[1] + camera.rotation[2][i] * camera.translation[2]);
    const auto number = [&](const char* name) { return nb::cast<double>(pinhole.attr(name)); };
    camera.fx = number("fx"), camera.fy = number("fy"), camera.cx = number("cx"), camera.cy = number("cy");
    camera.width = nb::cast<int>(pinhole.attr("width"));
    camera.height = nb::cast<int>(pinhole.attr("height"));
    require(camera.width > 0 && camera.height > 0, "pinhole: width and height must be positive");
    require(camera.fx > 0 && camera.fy > 0, "pinhole: fx and fy must be positive");
    return camera;
}

Blend blend_from(nb::handle blend)
{
    const auto number = [&](const char* name) { return nb::cast<double>(blend.attr(name)); };
    const Blend result{number("near"), number("dilation"), number("alpha_min"), number("alpha_max")};
    require(result.dilation >= 0, "blend: dilation must not be negative");
    require(0 < result.alpha_min && result.alpha_min <= result.alpha_max && result.alpha_max < 1,
        "blend: 0 < alpha_min <= alpha_max < 1 is required");
    return result;
}

int degree_of(size_t coefficients)
{
    for (int degree = 0; degree <= 3; ++degree)
        if (size_t(degree + 1) * (degree + 1) == coefficients)
            return degree;
    throw nb::type_error("sh: shape must be (N, K, 3) with K one of 1, 4, 9, 16");
}
