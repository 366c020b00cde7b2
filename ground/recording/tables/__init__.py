"""Recordings as tables and figures."""
