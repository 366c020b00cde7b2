"""Containers on networks of their own, as `docker compose` starts them."""
