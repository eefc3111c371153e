"""An emulated launcher that accepts only the paper's 'NNNp'.

In: bytes from the cable, as in robot/emulator/firmware.py. Out: hits and actions; it never answers. It strikes whenever
it is ready, without arming, and ignores stop bytes and silence. Assumed: the cue retracts by itself.
"""

from __future__ import annotations

from robot.device.protocol import Arrival, StrokeLine
from robot.emulator.firmware import Firmware


class PaperFirmware(Firmware):
    """An emulated launcher as described in Robotic Billiards (2015), section V."""

    def _answer(self, arrival: Arrival) -> bytes:
        if isinstance(arrival, StrokeLine) and self.state == "IDLE":
            self.state, self._armed = "ARMED", arrival.string
            self._stroke(arrival.string)
        return b""

    def _finish(self) -> None:
        super()._finish()
        self._retract()

    def _boot(self) -> None:
        super()._boot()
        self.state = "IDLE"

    def _silent_by(self, then: float) -> bool:
        return False
