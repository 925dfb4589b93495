"""The fit of the `surface` operator: Gaussians that are read at surface points."""
