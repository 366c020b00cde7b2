"""Cost of drawing the map."""
