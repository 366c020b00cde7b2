"""Contain the widgets of the app, and the rows of text that they show."""
