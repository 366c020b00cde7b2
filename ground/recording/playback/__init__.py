"""Play a recording in place of a live bus."""
