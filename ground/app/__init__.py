"""Contain the full-screen ground station. Textual is imported when a screen is opened."""
