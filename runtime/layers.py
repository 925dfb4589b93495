"""The layers that a frame can be read in. Pure names: the command line lists them without loading anything."""

LAYERS = ("final", "primary", "indirect", "albedo", "normal", "depth")
