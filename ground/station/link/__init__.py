"""Presence, loss and rates of what arrives."""
