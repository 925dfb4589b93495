"""Offline part: a glTF scene in, a .gsgi file out."""
