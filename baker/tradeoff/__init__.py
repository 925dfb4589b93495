"""The study of what accuracy costs: every method of storing B, baked from the same light and drawn in the same frame."""
