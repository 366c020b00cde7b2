"""A recording in the place of a live bus."""
