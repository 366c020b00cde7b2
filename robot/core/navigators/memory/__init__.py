"""What navigators remember between ticks."""
