"""Read glTF 2.0 files as scenes."""
