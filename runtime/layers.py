"""The layers of a frame that can be read. Names only, so that the command line lists them without loading anything."""

LAYERS = ("final", "primary", "indirect", "albedo", "normal", "depth")
