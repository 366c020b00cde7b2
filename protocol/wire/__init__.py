"""Typed messages and their encoding as MAVLink 2 frames."""
