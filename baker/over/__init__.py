"""The fit of the `over` operator: Gaussians blended along the ray, as in the paper."""
