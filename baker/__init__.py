"""The offline part: turns a glTF scene into a .gsgi file."""
