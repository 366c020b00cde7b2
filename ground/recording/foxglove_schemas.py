"""Messages that Foxglove and Lichtblick draw: their schemas, and builders in m and rad.

Build JSON schemas of the contents of a recording; those of messages follow from their layout.
"""

import json
from base64 import b64encode
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from math import cos, sin
from struct import pack
from types import MappingProxyType
from typing import Final, NamedTuple, TypeAlias

from protocol.wire.message import LAYOUT, Field, Message
from runtime.units import NS_PER_S

Json: TypeAlias = dict[str, object]


class Schema(NamedTuple):
    """A name and a JSON schema as text."""

    name: str
    text: bytes


def record(title: str, **properties: Json) -> Json:
    """Return the schema of an object with all of these properties."""
    return {
        "title": title,
        "type": "object",
        "properties": properties,
        "required": list(properties),
    }


def many(items: Json) -> Json:
    """Return the schema of an array."""
    return {"type": "array", "items": items}


def named(content: Json) -> Schema:
    """Return a schema under its title."""
    return Schema(str(content["title"]), json.dumps(content).encode())


@cache
def schema_of(message: type[Message]) -> Schema:
    """Return the schema of a message; floating-point values may be null."""
    layout = LAYOUT[message.__name__]
    fields = {field.name: _field(field) for field in layout.fields}
    return named(record(f"sidestep.{message.__name__}", **fields))


def _field(field: Field) -> Json:
    if field.is_text:
        return {"type": "string", "maxLength": field.length}
    number = _number(field)
    if not field.length:
        return number
    return many(number) | {"minItems": field.length, "maxItems": field.length}


def _number(field: Field) -> Json:
    if field.limits is None:
        return {"type": ["number", "null"]}
    low, high = field.limits
    return {"type": "integer", "minimum": low, "maximum": high}


KEY_SCHEMA: Final = named(record("sidestep.FrameKey", key={"type": "string"}))


Point: TypeAlias = tuple[float, float]
Colour: TypeAlias = tuple[float, float, float, float]
FLOAT32: Final = 7
DIGITS: Final = 4
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


NUMBER: Final[Json] = {"type": "number"}
TEXT: Final[Json] = {"type": "string"}
WHOLE: Final[Json] = {"type": "integer", "minimum": 0}
NANOSECONDS: Final[Json] = WHOLE | {"maximum": NS_PER_S - 1}
TIME: Final = record("time", sec=WHOLE, nsec=NANOSECONDS)
DURATION: Final = record("duration", sec={"type": "integer"}, nsec=NANOSECONDS)
VECTOR: Final = record("foxglove.Vector3", x=NUMBER, y=NUMBER, z=NUMBER)
PLACE: Final = record("foxglove.Point3", x=NUMBER, y=NUMBER, z=NUMBER)
QUATERNION: Final = record("foxglove.Quaternion", x=NUMBER, y=NUMBER, z=NUMBER, w=NUMBER)
POSE: Final = record("foxglove.Pose", position=VECTOR, orientation=QUATERNION)
COLOUR: Final = record("foxglove.Color", r=NUMBER, g=NUMBER, b=NUMBER, a=NUMBER)


def solid(name: str, **sizes: Json) -> Json:
    """Return the schema of a primitive with a pose and one colour."""
    return record(f"foxglove.{name}Primitive", pose=POSE, **sizes, color=COLOUR)


CUBE: Final = solid("Cube", size=VECTOR)
SPHERE: Final = solid("Sphere", size=VECTOR)
CYLINDER: Final = solid("Cylinder", size=VECTOR, bottom_scale=NUMBER, top_scale=NUMBER)
ARROW: Final = solid(
    "Arrow",
    shaft_length=NUMBER,
    shaft_diameter=NUMBER,
    head_length=NUMBER,
    head_diameter=NUMBER,
)
LINE: Final = record(
    "foxglove.LinePrimitive",
    type=WHOLE,
    pose=POSE,
    thickness=NUMBER,
    scale_invariant={"type": "boolean"},
    points=many(PLACE),
    color=COLOUR,
    colors=many(COLOUR),
    indices=many(WHOLE),
)
ANYTHING: Final[Json] = {"type": "array", "items": {"type": "object"}}
ENTITY: Final = record(
    "foxglove.SceneEntity",
    timestamp=TIME,
    frame_id=TEXT,
    id=TEXT,
    lifetime=DURATION,
    frame_locked={"type": "boolean"},
    metadata=many(record("foxglove.KeyValuePair", key=TEXT, value=TEXT)),
    arrows=many(ARROW),
    cubes=many(CUBE),
    spheres=many(SPHERE),
    cylinders=many(CYLINDER),
    lines=many(LINE),
    triangles=ANYTHING,
    texts=ANYTHING,
    models=ANYTHING,
)
DELETION: Final = record("foxglove.SceneEntityDeletion", timestamp=TIME, type=WHOLE, id=TEXT)
ELEMENT: Final = record("foxglove.PackedElementField", name=TEXT, offset=WHOLE, type=WHOLE)
BYTES: Final[Json] = {"type": "string", "contentEncoding": "base64"}

POSE_IN_FRAME: Final = "foxglove.PoseInFrame"
POSES_IN_FRAME: Final = "foxglove.PosesInFrame"
SCENE_UPDATE: Final = "foxglove.SceneUpdate"
POINT_CLOUD: Final = "foxglove.PointCloud"
FRAME_TRANSFORM: Final = "foxglove.FrameTransform"
LOG: Final = "foxglove.Log"


def _shapes() -> Mapping[str, Schema]:
    found = (
        record(POSE_IN_FRAME, timestamp=TIME, frame_id=TEXT, pose=POSE),
        record(POSES_IN_FRAME, timestamp=TIME, frame_id=TEXT, poses=many(POSE)),
        record(SCENE_UPDATE, deletions=many(DELETION), entities=many(ENTITY)),
        record(
            POINT_CLOUD,
            timestamp=TIME,
            frame_id=TEXT,
            pose=POSE,
            point_stride=WHOLE,
            fields=many(ELEMENT),
            data=BYTES,
        ),
        record(
            FRAME_TRANSFORM,
            timestamp=TIME,
            parent_frame_id=TEXT,
            child_frame_id=TEXT,
            translation=VECTOR,
            rotation=QUATERNION,
        ),
        record(LOG, timestamp=TIME, level=WHOLE, message=TEXT, name=TEXT, file=TEXT, line=WHOLE),
    )
    return MappingProxyType({str(shape["title"]): named(shape) for shape in found})


SHAPES: Final = _shapes()
