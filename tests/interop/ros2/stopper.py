"""`python stopper.py PORT`: read the odometry of r1, then stop it, with a node of pyzeros."""

import asyncio
import json
import os
import sys

import asyncio_for_robotics
import pyzeros
import zenoh
from ros2_pyterfaces.cyclone import all_msgs, all_srvs

PATIENCE_S = 150.0
SETTINGS = {
    "mode": "client",
    "connect/endpoints": [f"tcp/127.0.0.1:{sys.argv[1]}"],
    "scouting/multicast/enabled": False,
    "timestamping/enabled": True,
}


async def main() -> None:
    """Print the place of the robot and the answer to the stop, as a line of JSON."""
    async with asyncio.timeout(PATIENCE_S):
        odometry = await anext(pyzeros.Sub(all_msgs.Odometry, "/r1/odom").listen_reliable())
        client = pyzeros.Client(all_srvs.Trigger, "/r1/emergency_stop")
        await client.wait_for_service()
        answer = await client.call_async(all_srvs.Trigger.Request())
    found = [odometry.pose.pose.position.x, answer.success, answer.message]
    print(json.dumps(found), flush=True)
    os._exit(0)  # the library does not end its subscriber


config = zenoh.Config()
for key, value in SETTINGS.items():
    config.insert_json5(key, json.dumps(value))
with zenoh.open(config) as session, pyzeros.auto_context(node="stopper", zenoh_session=session):
    asyncio.run(asyncio_for_robotics.scoped(main)())
