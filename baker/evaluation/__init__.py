"""How close a bake comes to path tracing."""
