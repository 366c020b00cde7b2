"""Make the rows of text of each panel from a station; no terminal is needed."""
