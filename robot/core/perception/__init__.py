"""From raw sensor values to what the navigators use."""
