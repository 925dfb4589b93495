"""The .gsgi file; FORMAT.md specifies it."""
