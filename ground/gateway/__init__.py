"""Present each robot as a MAVLink vehicle: other ground stations see an ArduPilot Rover.

The gateway is an ordinary client of the bus. Its protocols do no I/O: messages and time go in,
messages come out through `traffic.Outbox`, and requests to the robot go through `port.RobotPort`.
North-east-down, centimetres and degrees exist only in this package.
"""
