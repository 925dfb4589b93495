"""A scene and its baked light as a page for browsers."""
