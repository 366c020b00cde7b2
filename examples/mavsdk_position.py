"""Print where the robot is, by MAVSDK (`pip install mavsdk==4.1.0`).

First `make up ARGS="--mavlink udpin:127.0.0.1:14550 --headless"`, or the gateway beside a running
robot. It ends with ctrl+c or after 10 positions.
"""

from threading import Event

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.telemetry import Position, Telemetry

ADDRESS = "udpout://127.0.0.1:14550"
POSITIONS = 10


def main() -> None:
    """Connect, and print the first positions, one a second."""
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    mavsdk.add_any_connection(ADDRESS)
    system = mavsdk.first_autopilot(10.0)
    if system is None:
        raise SystemExit(f"no vehicle at {ADDRESS}: is the gateway running?")
    telemetry = Telemetry(system)
    for _ in range(POSITIONS):
        Event().wait(1.0)
        show(telemetry.position())


def show(position: Position) -> None:
    """Print a latitude and a longitude in degrees."""
    print(f"{position.latitude_deg:.7f} {position.longitude_deg:.7f}")


if __name__ == "__main__":
    main()
