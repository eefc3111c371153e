"""Offsets in MuJoCo's structs that a compiled callback needs, found by searching for known values and addresses.

The offsets differ between versions of MuJoCo, and its Python package states none. A small model is made whose
timestep, time and contacts have values that stand nowhere else; what points to an array is found by its address.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

SCANNED_BYTES = 1 << 19  # largest size of a struct: an mjData has some 160 kB
CHUNK_BYTES = 4096  # bytes read at a time, so that memory far behind a struct is never touched
PROBE_NUMBER = 0.123456789012345e-3  # a number that occurs nowhere else
(
    MODEL_TIMESTEP, MODEL_NUMERIC, DATA_TIME, DATA_NCON, DATA_QPOS, DATA_QVEL, DATA_USERDATA, DATA_PASSIVE,
    DATA_CONTACT, DATA_KBIP, DATA_D, CONTACT_SIZE, CONTACT_DIST, CONTACT_FRAME, CONTACT_MARGIN, CONTACT_GEOM,
    CONTACT_ROW, DATA_SENSORDATA, OFFSETS,
) = range(19)  # fmt: skip
PROBE_XML = """
<mujoco><size nuserdata="3"/><custom><numeric name="mark" data="1 2"/></custom><worldbody>
<geom type="plane" size="1 1 1"/><geom type="plane" size="1 1 1"/><site name="mark"/>
<body name="a" pos="0 0 0.09"><freejoint/><geom size="0.1"/></body>
<body name="b" pos="1 0 0.09"><freejoint/><geom size="0.1"/></body>
<body name="c" pos="2 0 0.09"><freejoint/><geom size="0.1"/></body>
</worldbody><sensor><framepos objtype="site" objname="mark"/></sensor></mujoco>
"""


class LayoutError(RuntimeError):
    """Raised for a version of MuJoCo with an unknown layout of its structs."""


def _find(start: int, wanted: bytes, step: int) -> int:
    """Offset of bytes behind an address, at a multiple of `step`."""
    seen = b""
    while len(seen) < SCANNED_BYTES:
        seen += ctypes.string_at(start + len(seen), CHUNK_BYTES)
        at = seen.find(wanted, max(0, len(seen) - CHUNK_BYTES - len(wanted)))
        while at >= 0 and at % step:
            at = seen.find(wanted, at + 1)
        if at >= 0:
            return at
    raise LayoutError(f"MuJoCo {mujoco.__version__}: {wanted!r} not found; use a version named in pyproject.toml")


def _pointer(start: int, array: NDArray[Any]) -> int:
    return _find(start, np.int64(array.ctypes.data).tobytes(), 8)


def _count(model: Any, data: Any, before: int) -> int:
    """Offset of `ncon`, below `before`: an int that is 6, 4 and 2 where 3, 2 and 1 balls touch two planes."""
    found: set[int] | None = None
    for raised in range(3):  # without a reset: the most contacts that there have been stay the same
        data.qpos.reshape(-1, 7)[:raised, 2] = 1.0
        mujoco.mj_forward(model, data)
        ints = np.frombuffer(ctypes.string_at(data._address, before), np.int32)
        here = set(np.flatnonzero(ints == data.ncon).tolist())
        found = here if found is None else found & here
    if not found or len(found) != 1:
        raise LayoutError(f"MuJoCo {mujoco.__version__}: the number of contacts stands in {len(found or ())} places")
    return 4 * found.pop()


@cache
def offsets() -> NDArray[np.int64]:
    """Offsets in bytes, by the names above: (OFFSETS,).

    Raises:
        LayoutError: for a version of MuJoCo in which they are not found.
    """
    model: Any = mujoco.MjModel.from_xml_string(PROBE_XML)
    data: Any = mujoco.MjData(model)
    model.opt.timestep = PROBE_NUMBER
    mujoco.mj_forward(model, data)
    data.time = PROBE_NUMBER
    out = np.zeros(OFFSETS, np.int64)
    own, its = int(model._address), int(data._address)
    out[MODEL_TIMESTEP] = _find(own, np.float64(PROBE_NUMBER).tobytes(), 8)
    out[MODEL_NUMERIC] = _pointer(own, model.numeric_data)
    out[DATA_TIME] = _find(its, np.float64(PROBE_NUMBER).tobytes(), 8)
    contact = data.contact
    for name, array in (
        (DATA_QPOS, data.qpos), (DATA_QVEL, data.qvel), (DATA_USERDATA, data.userdata),
        (DATA_PASSIVE, data.qfrc_passive), (DATA_CONTACT, contact.dist), (DATA_KBIP, data.efc_KBIP),
        (DATA_D, data.efc_D), (DATA_SENSORDATA, data.sensordata),
    ):  # fmt: skip
        out[name] = _pointer(its, array)
    first = contact.dist.ctypes.data
    out[CONTACT_SIZE] = contact.dist.strides[0]
    for name, array in (
        (CONTACT_DIST, contact.dist), (CONTACT_FRAME, contact.frame), (CONTACT_MARGIN, contact.includemargin),
        (CONTACT_GEOM, contact.geom), (CONTACT_ROW, contact.efc_address),
    ):  # fmt: skip
        out[name] = array.ctypes.data - first
    out[DATA_NCON] = _count(model, data, int(out[DATA_QPOS]))
    return out
