"""Attack a driving robot, and measure its emergency stop and its control loop meanwhile."""
