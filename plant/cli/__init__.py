"""Command line of the verbs `plant` and `worlds`."""
