"""Show and announce that a robot has stopped: the band, the bell, and what to do next."""
