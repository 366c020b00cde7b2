"""Values that define a world and its robots, frozen and in SI units."""
