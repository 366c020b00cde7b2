"""ir-sim, the peer."""
