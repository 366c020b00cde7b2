"""The judge: check any MAVLink vehicle from outside against the rows of the acceptance list.

It imports nothing of the gateway, so that its judgement is independent of it.
"""
