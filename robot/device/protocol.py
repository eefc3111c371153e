"""The protocol between the computer and the launcher: frames, strokes, the stop byte and the status.

In: bytes. Out: messages, and the reverse.

A stroke is 'NNNp', as in Robotic Billiards (2015), section V: three digits, 001 to 200, and a 'p'. All else is framed:

    request   :SSSS BODY*CCCC\\n        SSSS sequence number, CCCC checksum, both in upper-case hexadecimal digits
    reply     =SSSS BODY*CCCC\\n        with the request's number; 0000 for the greeting and what was not requested
    stop      !                        one byte, anywhere, also in the middle of a frame
    beat      :0000 ALIVE*CCCC\\n       keeps a waiting controller from counting as gone; has no reply

The checksum is CRC-16/CCITT-FALSE (x^16 + x^12 + x^5 + 1, start FFFF) over all that stands before the '*': it finds
every error of up to three bits in a frame, and one in 65536 of all others passes. Bodies hold upper-case letters,
digits, blanks, '.' and '-', so that neither a stroke nor a stop can stand inside a frame that arrives unharmed.

'NNNp' has no checksum, and so it never acts alone: a frame `ARM NNN K` precedes it, where K is one more than the number
of strokes ever begun. When armed, the launcher strikes on exactly this NNN, once, and is then disarmed; K makes a
second stroke of the same number impossible, however often either line is sent, and by whom.

A launcher in one of GUARDED_STATES stops on its own if it receives no undamaged frame for SILENCE_S: its controller was
killed, hangs, or its cable is out. A controller that waits for a late reply sends a beat every BEAT_S, so that three
successive lines may be lost.
Left out: encryption and addressing, since a cable connects one launcher.
"""

from __future__ import annotations

import binascii
import dataclasses
import re
from dataclasses import dataclass

from models.errors import BadInput

PROTOCOL_VERSION = "CUELAB 2"
PROTOCOLS = CUELAB, PAPER = "cuelab", "paper"  # this protocol, and 'NNNp' alone
UNGUARDED_VERSION = "CUELAB 1"  # version that does not stop without its controller
STOP_BYTE = b"!"
FIRST_STRING, LAST_STRING = 1, 200  # strings of the paper
UNSOLICITED_SEQUENCE = 0  # sequence number of the greeting, of beats, and of messages without a request
BEAT_BODY = "ALIVE"  # body of a beat
SILENCE_S = 0.4  # time without an undamaged frame after which a guarded launcher stops on its own
BEAT_S = 0.08  # interval of beats
MAX_SEQUENCE = 0xFFFF
MAX_FRAME_BYTES = 96  # longest frame
LAUNCHER_STATES = ("UNHOMED", "IDLE", "MOVING", "ARMED", "STRIKING", "EXTENDED", "RETRACTING", "STOPPED", "FAULT")
BUSY_STATES = ("MOVING", "STRIKING", "RETRACTING")  # states that end without a command
GUARDED_STATES = (*BUSY_STATES, "ARMED")  # states that require frames from a controller
SILENCE_BIT = 8  # a bit of FAULT_BITS
FAULT_BITS = {
    1: "the stage is stuck",
    2: "the rack did not come back",
    4: "restarted in mid-stroke",
    SILENCE_BIT: f"stopped by itself, its controller being silent for {SILENCE_S:g} s",
}
BODY_PATTERN = re.compile(r"[A-Z0-9.\- ]{1,80}")
FRAME_PATTERN = re.compile(rb"([:=][0-9A-F]{4} [A-Z0-9.\- ]{1,80})\*([0-9A-F]{4})")


class LauncherError(RuntimeError):
    """What the launcher did not do, and why, in one line. Its actions are known, unless the class states otherwise."""


class LinkLost(LauncherError):
    """The launcher does not answer, or its cable is out, so that its state is unknown."""


class LauncherStopped(LauncherError):
    """The launcher is stopped; it continues only after a reset."""


@dataclass(frozen=True)
class Message:
    """A frame that arrived undamaged."""

    sequence: int
    body: str


@dataclass(frozen=True)
class StrokeLine:
    """An 'NNNp' that arrived, whether it acts or not."""

    string: int


@dataclass(frozen=True)
class StopByte:
    """A '!' that arrived."""


Arrival = Message | StrokeLine | StopByte


@dataclass(frozen=True)
class LauncherStatus:
    """The launcher's status report."""

    state: str = "UNHOMED"  # one of LAUNCHER_STATES
    boots: int = 0  # number of starts; after another start the position of its stage is unknown
    stops: int = 0  # number of stops ever, by the byte or by silence; a reset must name it
    begun: int = 0  # strokes ever begun; stored without power, written before the first pulse
    done: int = 0  # number of the last completed stroke
    armed: int = 0  # string that may strike now, 0 for none
    x_um: int = 0  # stage position, from home [micrometre]
    y_um: int = 0
    string: int = 0  # of the last stroke done, 0 for none
    speed_um_s: int = 0  # of the cue at the ball, measured in that stroke [micrometre/s]
    force_mn: int = 0  # peak of that stroke [millinewton]
    dropped: int = 0  # bytes discarded since it was switched on: noise, frames with a wrong checksum
    refused: int = 0  # number of refused 'NNNp' since then
    faults: int = 0  # bits of FAULT_BITS

    @property
    def cue_speed(self) -> float:
        """Measured cue speed of the last completed stroke [m/s]."""
        return self.speed_um_s * 1e-6

    @property
    def peak_force(self) -> float:
        """Measured peak force of the last completed stroke [N]."""
        return self.force_mn * 1e-3

    def troubles(self) -> tuple[str, ...]:
        """The faults in words."""
        return tuple(words for bit, words in FAULT_BITS.items() if self.faults & bit)


def checksum(data: bytes) -> int:
    """CRC-16/CCITT-FALSE; 0x29B1 for b"123456789"."""
    return binascii.crc_hqx(data, 0xFFFF)


def frame(lead: str, sequence: int, body: str) -> bytes:
    """A framed line; lead ":" for a request, "=" for a reply."""
    if not 0 <= sequence <= MAX_SEQUENCE:
        raise BadInput(f"sequence number is {sequence}; give 0 to {MAX_SEQUENCE}")
    if not BODY_PATTERN.fullmatch(body):
        raise BadInput(f"frame body is {body!r}; use up to 80 upper-case letters, digits, blanks, '.' and '-'")
    text = f"{lead}{sequence:04X} {body}".encode("ascii")
    return text + b"*%04X\n" % checksum(text)


def unframe(line: bytes) -> Message | None:
    """The message of a line without its newline; None if it is damaged."""
    found = FRAME_PATTERN.fullmatch(line)
    if found is None or checksum(found[1]) != int(found[2], 16):
        return None
    return Message(int(found[1][1:5], 16), found[1][6:].decode("ascii"))


def stop_notice(stops: int, interrupted: str) -> bytes:
    """The answer to a stop byte: the number of stops, and the state that the first one since a reset interrupted."""
    return frame("=", UNSOLICITED_SEQUENCE, f"STOPPED {stops} {interrupted}")


def interrupted_state(message: Message) -> str | None:
    """The interrupted state, if this is the answer to a stop; None otherwise."""
    words = message.body.split(" ")
    if message.sequence != UNSOLICITED_SEQUENCE or words[0] != "STOPPED":
        return None
    return words[2] if len(words) == 3 and words[2] in LAUNCHER_STATES else ""


def next_sequence(sequence: int) -> int:
    """The next number; 0 is skipped."""
    return sequence % MAX_SEQUENCE + 1


def string_number(string: str | int) -> int:
    """The number of a string: 47 for '047p', '047' or 47; BadInput for anything else."""
    text = f"{string:03d}" if isinstance(string, int) and not isinstance(string, bool) else str(string)
    digits = text.removesuffix("p")
    if not (len(digits) == 3 and digits.isascii() and digits.isdigit() and FIRST_STRING <= int(digits) <= LAST_STRING):
        raise BadInput(f"speed string is {string!r}; give three digits, 001 to 200, and a 'p'")
    return int(digits)


def stroke_line(string: int) -> bytes:
    """b'047p' for 47."""
    return b"%03dp" % string_number(string)


def status_body(status: LauncherStatus) -> str:
    """A status as the body of a reply."""
    return " ".join(["OK", status.state, *(str(v) for v in dataclasses.astuple(status)[1:])])


def parse_status(body: str) -> LauncherStatus | None:
    """The status in a reply's body; None if it is not one."""
    words = body.split(" ")
    fields = dataclasses.fields(LauncherStatus)
    if len(words) != len(fields) + 1 or words[0] != "OK" or words[1] not in LAUNCHER_STATES:
        return None
    if not all(re.fullmatch(r"-?\d{1,12}", word) for word in words[2:]):
        return None
    return LauncherStatus(words[1], *(int(word) for word in words[2:]))


class Reader:
    """Parses bytes into arrivals, in order; invalid bytes are counted and discarded.

    A lead byte always starts a new frame, so that after any garbage the next complete frame is read. An 'NNNp' counts
    only with exactly three digits and outside a frame: more or fewer digits are noise.
    """

    def __init__(self, lead: str, *, commands: bool) -> None:
        """Create a reader outside a frame.

        Args:
            lead: of the frames to read, ":" or "=".
            commands: whether strokes and stop bytes count, as for the launcher.
        """
        self._lead, self._commands = ord(lead), commands
        self._held = bytearray()
        self._framed = False
        self.dropped = 0  # number of bytes

    @property
    def waiting(self) -> bool:
        """Whether a line is incomplete."""
        return bool(self._held)

    def forget(self) -> None:
        """Discard the incomplete line."""
        self.dropped += len(self._held)
        self._held.clear()
        self._framed = False

    def feed(self, data: bytes) -> list[Arrival]:
        """The arrivals that these bytes complete."""
        found: list[Arrival] = []
        for byte in data:
            if self._commands and byte == STOP_BYTE[0]:
                self.forget()
                found.append(StopByte())
            elif byte == self._lead:
                self.forget()
                self._held.append(byte)
                self._framed = True
            elif self._framed:
                self._in_frame(byte, found)
            else:
                self._outside(byte, found)
        return found

    def _in_frame(self, byte: int, found: list[Arrival]) -> None:
        if byte != ord("\n"):
            self._held.append(byte)
            if len(self._held) > MAX_FRAME_BYTES:
                self.forget()
            return
        got = unframe(bytes(self._held))
        if got is None:
            self._held.append(byte)
            self.forget()
        else:
            found.append(got)
            self._held.clear()
            self._framed = False

    def _outside(self, byte: int, found: list[Arrival]) -> None:
        if self._commands and ord("0") <= byte <= ord("9"):
            self._held.append(byte)
            if len(self._held) > MAX_FRAME_BYTES:
                self.forget()
        elif (
            self._commands
            and byte == ord("p")
            and len(self._held) == 3
            and FIRST_STRING <= int(self._held) <= LAST_STRING
        ):
            found.append(StrokeLine(int(self._held)))
            self._held.clear()
        else:
            self.forget()
            self.dropped += 1
