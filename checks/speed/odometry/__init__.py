"""Odometry: the error of the estimated pose over many drives, against its own covariance."""
