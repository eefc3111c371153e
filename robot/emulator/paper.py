"""A launcher that takes the paper's 'NNNp' and nothing else, emulated.

In: bytes from the cable, as robot/emulator/firmware.py. Out: hits and deeds; it answers nothing. It strikes whenever it
stands ready, with no arming, and goes on whatever comes: no stop byte, no silence. Assumed: the cue comes back by
itself.
"""

from __future__ import annotations

from robot.device.protocol import Arrival, StrokeLine
from robot.emulator.firmware import Firmware


class PaperFirmware(Firmware):
    """An emulated launcher of Robotic Billiards (2015), section V, and no more."""

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
