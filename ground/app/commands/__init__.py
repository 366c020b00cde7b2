"""Turn actions into commands, to the robot and to the app."""
