"""CPU time and memory of the gateway: one robot that drives, one client, default rates."""

import argparse
from typing import Final

from checks.harness.figures import Figure
from checks.harness.processes import cpu_s, resident_mb
from checks.speed.gateway.client import Client
from checks.speed.gateway.stage import Driver, Figures, on_air
from runtime.units import NS_PER_S

CPU_AT_MOST: Final = 3.0
RESIDENT_AT_MOST_MB: Final = 60.0
SETTLE_S: Final = 5.0


def cost_figures(options: argparse.Namespace) -> Figures:
    """Measure while the robot drives."""
    shares, sizes, rates, kb = [], [], [], []
    with on_air() as air, Client(air.line()) as client:
        driver = Driver(client, air)
        driver.take()
        driver.drive(SETTLE_S)
        for _ in range(options.repetitions):
            begun_s = cpu_s(air.pid)
            client.arrivals.clear()
            driver.drive(options.seconds)
            took_s = (client.arrivals[-1].at_ns - client.arrivals[0].at_ns) / NS_PER_S
            shares.append(100.0 * (cpu_s(air.pid) - begun_s) / took_s)
            sizes.append(resident_mb(air.pid))
            rates.append(len(client.arrivals) / took_s)
            kb.append(sum(one.size for one in client.arrivals) / took_s / 1e3)
    figures = [
        Figure(name="CPU of one core", unit="%", values=tuple(shares), at_most=CPU_AT_MOST),
        Figure(name="resident", unit="MB", values=tuple(sizes), at_most=RESIDENT_AT_MOST_MB),
        Figure(name="messages to the client", unit="Hz", values=tuple(rates)),
        Figure(name="bytes to the client", unit="kB/s", values=tuple(kb)),
    ]
    return figures, [f"cost: one robot that drives, one client; each reading {options.seconds:g} s"]
