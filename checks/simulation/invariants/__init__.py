"""The invariants, which are checked at every tick."""
