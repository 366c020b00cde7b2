"""From a place to go to, to wheel speeds within limits."""
