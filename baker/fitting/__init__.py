"""Code that the fits of both operators share."""
