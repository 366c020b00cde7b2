"""Present each robot as a MAVLink vehicle: other ground stations see an ArduPilot Rover.

The gateway is an ordinary client of the bus. Its protocols do no I/O: they receive messages and the
time, send messages through `mav_service.Outbox`, and send requests to the robot through
`robot_port.RobotPort`. North-east-down, centimetres and degrees exist only in this package.
"""
