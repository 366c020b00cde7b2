"""A fleet driven for a long time while faults happen."""
