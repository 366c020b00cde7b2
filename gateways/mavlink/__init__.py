"""Present each robot as a MAVLink vehicle: other ground stations see an ArduPilot Rover.

The gateway is an ordinary client of the bus. Its protocols do no I/O: they receive messages and the
time, send messages through `traffic.Outbox`, and send requests to the robot through
`port.RobotPort`. North-east-down, centimetres and degrees exist only in this package.
"""
