"""Draw a recorded run with matplotlib."""
