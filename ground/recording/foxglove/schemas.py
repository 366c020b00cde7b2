"""Define the schemas of well-known messages that Foxglove and Lichtblick draw."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from ground.recording.mcap.json_schemas import Json, Schema, many, named, record
from runtime.units import NS_PER_S

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
