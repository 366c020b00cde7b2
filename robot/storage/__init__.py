"""What survives a restart of the robot, and the thread that writes it."""
