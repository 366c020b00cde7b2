"""Verbs that command a robot."""
