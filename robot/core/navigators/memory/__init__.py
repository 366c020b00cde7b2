"""The navigators' state between ticks."""
