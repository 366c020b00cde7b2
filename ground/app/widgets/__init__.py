"""What the app puts on the screen, one widget per file."""
