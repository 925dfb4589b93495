"""The tasks of a bake on the nodes of a Ray cluster."""
