"""What each panel says, as rows of text made from a station: no terminal is needed for it."""
