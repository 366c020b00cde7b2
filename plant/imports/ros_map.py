"""Read a ROS map as map_server does: a .yaml file and the .pgm picture that it names.

A pixel is free if its occupancy is below free_thresh; occupied and unknown pixels are blocked.
"""

from math import pi
from pathlib import Path
from typing import Final

from plant.imports.cells import Cells
from plant.imports.map_yaml import MapYaml, load_map_yaml
from plant.imports.netpbm import load_pgm
from plant.imports.refusal import refuse

MAX_COORDINATE_M: Final = 1e6
MODES: Final = ("trinary", "scale")
TRUE: Final = ("1", "true", "yes")
FALSE: Final = ("0", "false", "no")


def load_ros_map(path: Path) -> Cells:
    """Return the map's cells, in its frame, without a blocked rim; raise WorldError."""
    settings = load_map_yaml(path)
    image = path.parent / settings.text("image", "map.pgm")
    cell_m = settings.number("resolution", "0.05", 0.001, 10.0)
    x_m, y_m, yaw_rad = settings.numbers("origin", "[0.0, 0.0, 0.0]", 3, MAX_COORDINATE_M)
    if abs(yaw_rad) > 2.0 * pi:
        raise settings.refuse(
            "origin", f"a yaw of {yaw_rad:g}", "[0.0, 0.0, 0.0], the yaw in radians"
        )
    free_below, negated = _threshold(settings), _negated(settings)
    if image.suffix.lower() != ".pgm":
        reason = f"{image.name} is no .pgm file"
        raise settings.refuse("image", reason, "map.pgm, and save the picture as PGM")
    whiteness = load_pgm(image)
    occupancy = whiteness if negated else 1.0 - whiteness
    free = occupancy < free_below
    if not free.any():
        fix = "check negate and free_thresh"
        raise refuse(
            str(path), "free_thresh", "no pixel is free", fix, settings.line("free_thresh")
        )
    return Cells(~free[::-1], cell_m, (x_m, y_m), yaw_rad).trimmed()


def _threshold(settings: MapYaml) -> float:
    """Return free_thresh, after a check of the keys that belong to it."""
    free_below = settings.number("free_thresh", "0.196", 0.0, 1.0)
    occupied_above = settings.number("occupied_thresh", "0.65", 0.0, 1.0)
    if free_below > occupied_above:
        raise settings.refuse("free_thresh", f"above occupied_thresh ({occupied_above:g})", "0.196")
    mode = settings.text("mode", "trinary") if "mode" in settings else MODES[0]
    if mode not in MODES:
        raise settings.refuse("mode", f"{mode!r} is none of {', '.join(MODES)}", "trinary")
    return free_below


def _negated(settings: MapYaml) -> bool:
    word = settings.text("negate", "0").lower()
    if word not in (*TRUE, *FALSE):
        raise settings.refuse("negate", f"{word!r} is neither 0 nor 1", "0")
    return word in TRUE
