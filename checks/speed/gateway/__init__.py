"""Measure the MAVLink gateway with a real robot, real sockets and a client on pymavlink."""
