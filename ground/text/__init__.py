"""Text for people, shared by the command line and the app."""
