"""What both fits share."""
