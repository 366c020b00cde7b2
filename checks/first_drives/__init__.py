"""First drives of a new user beside busy processes."""
