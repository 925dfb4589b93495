"""Placement of the cameras, and what they see."""
