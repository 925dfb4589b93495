"""Finished tasks on disk, so that no work is done twice and none is lost."""
