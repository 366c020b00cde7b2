"""Navigators for studies only: bounds with means that the robot does not have."""
