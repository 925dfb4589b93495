"""Coverage-guided fuzzing of the readers of files by atheris (libFuzzer): `./dev fuzz MINUTES`; a test runs it briefly.

The corpus stands in tests/data/fuzz/, a folder for each target. What a long run finds is put into build/fuzz/: more
inputs, and `crash-*` for what broke a promise. Such a file becomes a named case or test, and part of the corpus.
"""
