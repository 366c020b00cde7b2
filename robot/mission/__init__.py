"""Missions and the fence: upload, checks, storage and execution."""
