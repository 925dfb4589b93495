"""Worlds: light in sectors, one .gsgi file each, and a manifest that lists them."""
