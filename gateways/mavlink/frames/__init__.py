"""Coordinates: the robot's metres and radians to MAVLink's north-east-down and 1e-7 degrees.

The robot's x points east and y north of the origin; headings count counter-clockwise from x, in
radians. Other units and frames exist only in this package.
"""
