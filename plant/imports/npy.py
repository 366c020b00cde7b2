"""Read a table of numbers from a .npy file (numpy.lib.format), without unpickling."""

import ast
import re
from typing import Final

import numpy as np
from numpy.typing import NDArray

from plant.imports.refusal import refuse

MAGIC: Final = b"\x93NUMPY"
LENGTH_BYTES: Final = {1: 2, 2: 4, 3: 4}
MAX_HEADER_BYTES: Final = 10_000
MAX_SIDE: Final = 1000
NUMBERS: Final = re.compile(r"[<>|=]?(b1|[iu][1248]|f[248])")
FIX: Final = "give a grid_N.npy of the data set"


def parse_npy(data: bytes, file: str) -> NDArray[np.float64]:
    """Return rows and columns of numbers; raise WorldError for anything else."""
    header, body = _header(data, file)
    kind, shape, by_column = (header.get(key) for key in ("descr", "shape", "fortran_order"))
    if not isinstance(kind, str) or not NUMBERS.fullmatch(kind):
        raise refuse(file, "npy", f"expected a table of numbers, found {kind!r:.40}", FIX)
    if not isinstance(shape, tuple) or len(shape) != 2 or not isinstance(by_column, bool):
        raise refuse(file, "npy", f"expected rows and columns, found shape {shape!r:.40}", FIX)
    if not all(isinstance(side, int) and 1 <= side <= MAX_SIDE for side in shape):
        reason = f"{shape[0]!r:.20} x {shape[1]!r:.20}, a side must be 1 to {MAX_SIDE}"
        raise refuse(file, "npy", reason, "give a smaller grid")
    needed = shape[0] * shape[1] * np.dtype(kind).itemsize
    if len(body) != needed:
        reason = f"{len(body)} bytes of numbers, but {shape[0]} x {shape[1]} needs {needed}"
        raise refuse(file, "npy", reason, "is the file cut? save it again")
    table = np.frombuffer(body, dtype=kind).astype(np.float64)
    return table.reshape(shape, order="F" if by_column else "C")


def _header(data: bytes, file: str) -> tuple[dict[str, object], bytes]:
    """Return the header of the file and the bytes of its table."""
    size = LENGTH_BYTES.get(data[6] if len(data) > 6 else 0, 0)
    if not data.startswith(MAGIC) or not size:
        raise refuse(file, "npy", f"no .npy file: it starts with {data[:8]!r}", FIX)
    end = 8 + size + int.from_bytes(data[8 : 8 + size], "little")
    if end > min(len(data), MAX_HEADER_BYTES):
        raise refuse(file, "npy", "its header does not end", "is the file cut? save it again")
    try:
        header = ast.literal_eval(data[8 + size : end].decode("latin-1").strip())
    except (ValueError, SyntaxError, RecursionError, MemoryError):
        header = None
    if not isinstance(header, dict):
        raise refuse(file, "npy", "its header cannot be read", "save it again with numpy.save")
    return header, data[end:]
