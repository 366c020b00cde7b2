"""The page of contacts by own motion: each trial driven again, drawn, and explained by a rule."""
