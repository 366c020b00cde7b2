"""Missions and the fence: how they come to the robot, what it checks, and how it drives one."""
