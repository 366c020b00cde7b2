"""Families of worlds made to fool a navigator, each a function of a few parameters."""
