"""The judge: test any MAVLink vehicle as a client does, by the rows of the acceptance list.

It imports nothing of the gateways, so its verdicts are independent of them.
"""
