"""ir-sim, for comparison."""
