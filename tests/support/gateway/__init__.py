"""A vehicle of the gateway with a robot that the tests simulate."""
