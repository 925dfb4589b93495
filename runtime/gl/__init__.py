"""OpenGL: the deferred frame, and indirect light as a pass in any moderngl host's frame."""
