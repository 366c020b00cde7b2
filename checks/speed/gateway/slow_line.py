"""The profile for 57,600 baud: bytes per second and regular streams, while parameters are read."""

import argparse
from collections.abc import Sequence
from itertools import pairwise
from threading import Event, Thread
from typing import Final

from checks.harness.figures import Figure
from checks.speed.gateway.client import Arrival, Client, Line, PseudoLine
from checks.speed.gateway.stage import Air, Driver, Figures, on_air
from gateways.mavlink.mavlink_dialect import mavlink
from runtime.units import NS_PER_S

AT_MOST_KB_S: Final = 4.5
BAUD: Final = 57_600
SETTLE_S: Final = 3.0
AGAIN_S: Final = 4.0
"""The client asks for all parameters again after this time."""
GAP_AT_MOST_S: Final = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.5,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 0.6,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 0.6,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 2.0,
}
"""The streams that a person watches, and the longest time without one of each."""


def line_figures(options: argparse.Namespace) -> Figures:
    """Measure over a serial line, and over UDP with `--low-rate`."""
    figures = []
    serial = PseudoLine()
    with on_air(endpoints=(f"serial:{serial.device}:{BAUD},accept",)) as air:
        figures += on_line("serial line", air, serial, options)
    with on_air("--low-rate") as air:
        figures += on_line("UDP, --low-rate", air, air.line(), options)
    return figures, [
        f"slow line: the robot drives; the client reads all parameters every {AGAIN_S:g} s; the"
        " serial line is a pseudo-terminal, which carries bytes faster than a line of 57,600 baud",
        "any second: the largest sum of all windows of one second",
    ]


def on_line(name: str, air: Air, line: Line, options: argparse.Namespace) -> list[Figure]:
    """Drive, read parameters repeatedly, and count the received bytes."""
    over = Event()
    with Client(line) as client:
        driver = Driver(client, air)
        driver.take()
        reader = Thread(target=read_parameters, args=(client, over), daemon=True)
        reader.start()
        driver.drive(SETTLE_S)
        client.arrivals.clear()
        driver.drive(options.seconds)
        over.set()
        reader.join()
        arrivals = tuple(client.arrivals)
    return figures_of(name, arrivals)


def read_parameters(client: Client, over: Event) -> None:
    """Ask for all parameters again and again."""
    while not over.wait(AGAIN_S):
        client.send(mavlink.MAVLink_param_request_list_message(1, 1))


def figures_of(name: str, arrivals: Sequence[Arrival]) -> list[Figure]:
    """Return the rates and the gaps of what has arrived."""
    seconds = (arrivals[-1].at_ns - arrivals[0].at_ns) / NS_PER_S
    mean_kb = sum(one.size for one in arrivals[1:]) / seconds / 1e3
    parameters = sum(one.number == mavlink.MAVLINK_MSG_ID_PARAM_VALUE for one in arrivals)
    found = [
        Figure(name=f"{name}: mean", unit="kB/s", values=(mean_kb,), at_most=AT_MOST_KB_S),
        Figure(name=f"{name}: any second", unit="kB/s", values=(most_in_a_second(arrivals) / 1e3,)),
        Figure(name=f"{name}: parameters", unit="", values=(float(parameters),), at_least=1.0),
    ]
    for number, at_most_s in GAP_AT_MOST_S.items():
        times_ns = [one.at_ns for one in arrivals if one.number == number]
        gaps = tuple((b - a) / NS_PER_S for a, b in pairwise(times_ns)) or (float("inf"),)
        kind = mavlink.mavlink_map[number].msgname
        found += [
            Figure(name=f"{name}: between {kind}", unit="s", values=gaps),
            Figure(
                name=f"{name}: between {kind}, longest",
                unit="s",
                values=(max(gaps),),
                at_most=at_most_s,
            ),
        ]
    return found


def most_in_a_second(arrivals: Sequence[Arrival]) -> int:
    """Return the largest number of bytes in a window of one second."""
    most = first = inside = 0
    for one in arrivals:
        inside += one.size
        while one.at_ns - arrivals[first].at_ns >= NS_PER_S:
            inside -= arrivals[first].size
            first += 1
        most = max(most, inside)
    return most
