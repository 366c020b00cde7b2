"""The navigators, and what only they use."""
