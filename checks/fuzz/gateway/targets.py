"""The targets of the gateway."""

from typing import Final

from checks.fuzz.gateway.payloads import PATHS, frames, payloads, raw, records
from checks.fuzz.gateway.traffic import traffic, traffic_records
from checks.fuzz.target import FuzzTarget

GATEWAY: Final = (
    FuzzTarget(name="gateway_frames", samples=frames, run=raw, weight=10),
    FuzzTarget(name="gateway_payloads", samples=records, run=payloads, words=PATHS, weight=20),
    FuzzTarget(name="gateway_traffic", samples=traffic_records, run=traffic, weight=20),
)
