"""After an edit of a scene: what its earlier bake has traced is kept where it still holds."""
