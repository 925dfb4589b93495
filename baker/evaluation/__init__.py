"""Measures how close a bake is to path tracing."""
