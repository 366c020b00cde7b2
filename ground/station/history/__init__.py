"""Keep what arrived in the past minutes."""
