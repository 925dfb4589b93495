"""The command line `gsgi`."""
