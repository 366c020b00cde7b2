"""Missions, fences and rally points: uploads, downloads, the current item, and reached items."""
