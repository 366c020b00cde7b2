"""What must hold at every tick."""
