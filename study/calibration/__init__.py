"""Calibration of odometry with UMBmark squares."""
