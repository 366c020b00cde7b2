"""A vehicle of the gateway on a robot that tests play."""
