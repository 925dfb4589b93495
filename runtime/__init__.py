"""Online part: a .gsgi file in, pixels out. Needs numpy and moderngl; imports neither the baker nor torch."""
