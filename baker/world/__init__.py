"""Bakes of worlds in sectors, each with a file of its own."""
