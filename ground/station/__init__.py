"""Model everything the ground station shows, without a terminal."""
