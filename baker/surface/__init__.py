"""The fit of the `surface` operator: Gaussians read at surface points."""
