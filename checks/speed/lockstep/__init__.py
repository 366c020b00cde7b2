"""Speed of the closed loop in lockstep over Zenoh, and where the time of a tick goes."""
