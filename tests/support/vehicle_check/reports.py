"""The judge's reports of vehicles in this folder; `python -m` writes them to `docs/evidence`."""

import json
from functools import cache
from pathlib import Path
from typing import Any, Final

from tests.support.vehicle_check.broken import (
    ArduPilotLike,
    CarelessVehicle,
    HastyVehicle,
    MuteVehicle,
)
from tests.support.vehicle_check.core import Core, MemoryNetwork
from vehicle_check.judge import as_dict, judge, rows
from vehicle_check.vehicle_under_test import CheckOptions

FOLDER: Final = Path(__file__).resolve().parents[3] / "docs" / "evidence" / "mavlink"
VEHICLES: Final[dict[str, type[Core]]] = {
    "ardupilot-like": ArduPilotLike,
    "hasty": HastyVehicle,
    "careless": CarelessVehicle,
    "mute": MuteVehicle,
}


@cache
def report(name: str) -> dict[str, Any]:
    """Judge a vehicle in simulated time, with motion, and return its report."""
    network = MemoryNetwork(VEHICLES[name]())
    outcome = judge(network, CheckOptions(allow_motion=True), list(rows().values()))
    return as_dict(name, outcome)


def statuses(found: dict[str, Any]) -> dict[int, str]:
    """Return the status of each row of a report."""
    return {one["row"]: one["status"] for one in found["rows"]}


if __name__ == "__main__":
    for vehicle in VEHICLES:
        text = json.dumps(report(vehicle), indent=1, ensure_ascii=False)
        (FOLDER / f"{vehicle}.json").write_text(text + "\n", encoding="utf-8")
