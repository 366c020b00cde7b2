"""Input from MAVLink clients: any bytes, complete frames, and the traffic of several clients."""
