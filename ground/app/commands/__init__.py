"""From actions to commands, of the robot and of the app."""
