"""Parameters: names for MAVLink, the PARAM protocol, the packed file and the descriptions."""
