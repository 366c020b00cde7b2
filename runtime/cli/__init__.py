"""What every verb of the executable shares: the table of verbs."""
