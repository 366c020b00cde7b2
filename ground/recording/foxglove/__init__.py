"""Build messages that Foxglove and Lichtblick draw."""
