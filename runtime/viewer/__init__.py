"""Window that shows a scene and its baked light: `gsgi view`. Needs the extra `gsgi[view]`."""
