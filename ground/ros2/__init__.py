"""What a robot tells, as the topics of ROS 2, and files of them: for the gateway and recordings.

It needs the extra `ros2`: import it where it is used, and not at the start of a verb.
"""
