"""Predict what another navigator would do: run it from an instant and return its path."""
