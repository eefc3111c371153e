"""Records of a simulation while it is stepped: samples at the requested times, impacts and pots.

In: addresses of a record and states at two looks. Between them a ball is carried by the velocity that MuJoCo moved it
with, which is that of the middle of the step.
"""

from __future__ import annotations

import numpy as np
from numba import carray

from models.compiled import compiled, compiled_in_place
from models.engine import columns as col
from models.mujoco import memory as mem


@compiled_in_place
def note(record_at, n, now, kind, i, other, b):  # type: ignore[no-untyped-def]
    """Count an event of ball i, and record it if there is room."""
    record = mem.doubles(record_at)
    number, times = int(record[mem.EVENT_COUNT]), int(record[mem.TIME_COUNT])
    record[mem.EVENT_COUNT] = number + 1.0
    if number < int(record[mem.EVENT_ROOM]):
        o = mem.RECORD_HEAD + times * (1 + n * col.ROW_SIZE) + number * mem.EVENT_SIZE
        record[o], record[o + 1], record[o + 2], record[o + 3] = now, float(kind), float(i), float(other)
        record[o + 4], record[o + 5] = b[col.X], b[col.Y]


@compiled
def look_back(record_at, now, then, before, b, past, balls):  # type: ignore[no-untyped-def]
    """Record the samples up to `now`, between the state at `then` and the present one, and keep the latter."""
    record, n = mem.doubles(record_at), b.shape[0]
    count, number = int(record[mem.TIME_COUNT]), int(record[mem.NEXT_TIME])
    step = now - then
    while number < count and record[mem.RECORD_HEAD + number] <= now + 1e-12:
        f = min((record[mem.RECORD_HEAD + number] - then) / step, 1.0) if step > 0.0 else 1.0
        # A velocity is that of the middle of the step before it.
        g = (f - 0.5) * step / (0.5 * (step + before)) if step > 0.0 else 0.0
        for i in range(n):
            out = carray(
                mem.doubles(record_at + 8 * (mem.RECORD_HEAD + count + (number * n + i) * col.ROW_SIZE)), col.ROW_SIZE
            )
            if balls[i, mem.SUNK] > 0.0:
                out[:] = np.nan
                continue
            for k in range(2):
                v0, v1 = past[i, 2 + k], b[i, col.VX + k]
                bend = 0.5 * f * (f - 1.0) * step * step * (v1 - v0) / (0.5 * (step + before)) if step > 0.0 else 0.0
                out[k] = past[i, k] + f * (b[i, col.X + k] - past[i, k]) + bend if step > 0.0 else b[i, col.X + k]
                out[2 + k] = v1 + g * (v1 - v0)
            for k in range(3):
                w0, w1 = past[i, 4 + k], b[i, col.WX + k]
                out[4 + k] = w1 + g * (w1 - w0)
            out[7] = past[i, 7] + f * (balls[i, mem.TURNED] - past[i, 7]) if step > 0.0 else balls[i, mem.TURNED]
        number += 1
    record[mem.NEXT_TIME] = float(number)
    for i in range(n):
        past[i, 0], past[i, 1], past[i, 2], past[i, 3] = b[i, col.X], b[i, col.Y], b[i, col.VX], b[i, col.VY]
        past[i, 4], past[i, 5], past[i, 6] = b[i, col.WX], b[i, col.WY], b[i, col.WZ]
        past[i, 7] = balls[i, mem.TURNED]
