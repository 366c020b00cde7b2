"""What every verb shares: the table of verbs, and the check that our packages are our own."""
