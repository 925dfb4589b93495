"""The study of what accuracy costs: all methods of storing B, from the same light and in the same frame."""
