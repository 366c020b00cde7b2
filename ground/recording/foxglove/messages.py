"""Build Foxglove primitives; metres, radians, x forward and y to the left."""

from base64 import b64encode
from collections.abc import Iterable, Sequence
from math import cos, sin
from struct import pack
from typing import Final, TypeAlias

from ground.recording.mcap.json_schemas import Json
from runtime.units import NS_PER_S

Point: TypeAlias = tuple[float, float]
Colour: TypeAlias = tuple[float, float, float, float]
FLOAT32: Final = 7
DIGITS: Final = 4
LINE_STRIP: Final = 0
LINE_LOOP: Final = 1
LINE_LIST: Final = 2
PRIMITIVES: Final = (
    *("arrows", "cubes", "spheres", "cylinders"),
    *("lines", "triangles", "texts", "models"),
)


def stamp(time_ns: int) -> Json:
    """Return a Foxglove time."""
    sec, nsec = divmod(time_ns, NS_PER_S)
    return {"sec": sec, "nsec": nsec}


def vector(x: float, y: float, z: float = 0.0) -> Json:
    """Return a vector in m, rounded to 0.1 mm: more digits are noise and double the file."""
    return {"x": round(x, DIGITS), "y": round(y, DIGITS), "z": round(z, DIGITS)}


def turn(angle_rad: float) -> Json:
    """Return the quaternion of a rotation about the vertical axis."""
    along, upright = round(cos(angle_rad / 2.0), DIGITS), round(sin(angle_rad / 2.0), DIGITS)
    return {"x": 0.0, "y": 0.0, "z": upright, "w": along}


def pose(x_m: float, y_m: float, heading_rad: float = 0.0, z_m: float = 0.0) -> Json:
    """Return a pose on the ground plane, or `z_m` above it."""
    return {"position": vector(x_m, y_m, z_m), "orientation": turn(heading_rad)}


def colour(tint: Colour) -> Json:
    """Return a colour from its red, green, blue and alpha parts in 0 to 1."""
    red, green, blue, alpha = tint
    return {"r": red, "g": green, "b": blue, "a": alpha}


def entity(name: str, frame: str, time_ns: int, **primitives: Sequence[Json]) -> Json:
    """Return an entity; it is drawn until another one of the same name on the topic replaces it."""
    return {
        "timestamp": stamp(time_ns),
        "frame_id": frame,
        "id": name,
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": True,
        "metadata": [],
        **{kind: primitives.get(kind, []) for kind in PRIMITIVES},
    }


def scene(*entities: Json) -> Json:
    """Return an update of the scene with these entities."""
    return {"deletions": [], "entities": list(entities)}


def disc(centre: Point, radius_m: float, height_m: float, tint: Colour) -> Json:
    """Return a vertical cylinder on the floor."""
    return {
        "pose": pose(*centre, z_m=height_m / 2.0),
        "size": vector(2.0 * radius_m, 2.0 * radius_m, height_m),
        "bottom_scale": 1.0,
        "top_scale": 1.0,
        "color": colour(tint),
    }


def ball(centre: Point, radius_m: float, tint: Colour) -> Json:
    """Return a sphere on the floor."""
    size_m = 2.0 * radius_m
    return {
        "pose": pose(*centre, z_m=radius_m),
        "size": vector(size_m, size_m, size_m),
        "color": colour(tint),
    }


def arrow(tail: Point, heading_rad: float, length_m: float, tint: Colour) -> Json:
    """Return a horizontal arrow."""
    return {
        "pose": pose(*tail, heading_rad, z_m=0.1),
        "shaft_length": 0.7 * length_m,
        "shaft_diameter": 0.08 * length_m,
        "head_length": 0.3 * length_m,
        "head_diameter": 0.2 * length_m,
        "color": colour(tint),
    }


def line(kind: int, points: Iterable[Point], thickness_m: float, tint: Colour) -> Json:
    """Return a line of the given kind through the points."""
    return {
        "type": kind,
        "pose": pose(0.0, 0.0),
        "thickness": thickness_m,
        "scale_invariant": False,
        "points": [vector(x_m, y_m, 0.02) for x_m, y_m in points],
        "color": colour(tint),
        "colors": [],
        "indices": [],
    }


def cloud(frame: str, time_ns: int, points: Sequence[Point]) -> Json:
    """Return a cloud of points 0.1 m above the floor."""
    packed = b"".join(pack("<fff", x_m, y_m, 0.1) for x_m, y_m in points)
    fields = [
        {"name": name, "offset": 4 * place, "type": FLOAT32} for place, name in enumerate("xyz")
    ]
    return {
        "timestamp": stamp(time_ns),
        "frame_id": frame,
        "pose": pose(0.0, 0.0),
        "point_stride": 12,
        "fields": fields,
        "data": b64encode(packed).decode(),
    }
