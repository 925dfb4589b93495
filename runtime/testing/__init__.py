"""Screenshot tests: a pytest plugin that draws frames without a window and compares them with golden images."""
