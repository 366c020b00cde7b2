"""Functions that only reduce speed or stop the robot: guard, failsafes and fence."""
