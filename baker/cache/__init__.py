"""Finished tasks on disk, so that no work is repeated or lost."""
