"""A bake as tasks that several processes and machines can share."""
