"""What may only take speed away or stop the robot."""
