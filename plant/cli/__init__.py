"""The verbs `plant` and `worlds`."""
