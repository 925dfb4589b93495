"""The runtime: turns a .gsgi file into pixels. It needs numpy and moderngl, and imports neither the baker nor torch."""
