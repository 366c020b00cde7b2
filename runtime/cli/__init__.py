"""What every verb shares: the table of verbs, output that is safe for terminals, own packages."""
