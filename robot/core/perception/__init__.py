"""Perception: from raw sensor values to pose, ranges, tracks and monitors."""
