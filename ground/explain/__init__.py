"""Explain the decision of one tick in plain words, and list the instants that decided a run."""
