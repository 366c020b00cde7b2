"""Places in a world: where robots fit, start and go, and the shortest way there."""
