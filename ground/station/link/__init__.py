"""Detect presence, loss and rates of arriving data."""
