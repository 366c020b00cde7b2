"""The app over a recording."""
