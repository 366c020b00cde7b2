"""The verbs `trial`, `study` and `reexecute`."""
