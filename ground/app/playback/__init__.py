"""Connect the app with a recording."""
