"""Scenarios of real MAVLink clients. Each runs in the environment of its client, as a process.

`steps` and `scene` need only the standard library, as the environments have nothing of Sidestep.
"""
