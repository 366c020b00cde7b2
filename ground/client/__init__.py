"""The client: the link to a robot, and one typed operation for everything an operator can do."""
