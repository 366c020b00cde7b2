"""The navigators and their shared code."""
