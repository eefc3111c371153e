"""The callback of MuJoCo's passive forces, `mjcb_passive`, installed once for all worlds of this process.

In: the address of a world's table (models/mujoco/memory.py) in a numeric field of the model. Out: the forces and the
step of models/mujoco/forces.py; models that no world has made are left alone.
"""

from __future__ import annotations

import ctypes
import secrets
from functools import cache
from typing import Any, Final

import mujoco
import numba
from numba import types

from models.compiled import callback
from models.mujoco import layout
from models.mujoco import memory as mem
from models.mujoco.forces import act

PROCESS_NUMBER: Final = (
    secrets.randbits(50) + 1.0
)  # random number of this process: addresses are invalid in another one
kept_alive: dict[int, Any] = {}  # what compiled code points to, by address: models may outlive their World


def _act(model, data, where, table_at):  # type: ignore[no-untyped-def]
    act(model, data, where, table_at)


@cache
def install() -> None:
    """Make the callback and install it in MuJoCo, once.

    What it does is compiled by itself and kept on disk; only the few lines that know addresses of this process are
    compiled anew.
    """
    offsets = layout.offsets()
    where, numeric, process = int(offsets.ctypes.data), int(offsets[layout.MODEL_NUMERIC]), PROCESS_NUMBER
    doubles, longs = mem.doubles, mem.longs
    kept = callback(_act, types.void(*[types.int64] * 4))
    go = ctypes.CFUNCTYPE(None, *[ctypes.c_longlong] * 4)(kept.address)

    @numba.cfunc(types.void(types.int64, types.int64))
    def passive(model, data):  # type: ignore[no-untyped-def]
        field = longs(model + numeric)[0]
        if field != 0 and doubles(field)[0] == process:
            go(model, data, where, longs(field)[1])

    kept_alive[where], kept_alive[passive.address] = offsets, (passive, kept)
    mujoco.set_mjcb_passive(ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(passive.address))
