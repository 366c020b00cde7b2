"""Controllers, speed limits, progress monitoring and the trail."""
