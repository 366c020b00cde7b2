"""Reading, checking and writing of world files."""
