"""Lists of the app as values: columns with heads, a filter by words, and a sort order."""
