"""The rows of the acceptance list, by theme."""
