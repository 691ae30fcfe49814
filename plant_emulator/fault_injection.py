"""Faults of the joint node and its bus, by encoder frame: KIND@FRAME[:COUNT[:VALUE]].

drop       COUNT frames (1) are not sent, their counters are used up
delay      COUNT frames (1) come VALUE seconds late (half a period); in lock-step whole periods,
           at least one
duplicate  COUNT frames (1) are sent twice
corrupt    COUNT frames (1) have bit VALUE (0) flipped after the CRC was made
freeze     for COUNT frames (until the end) the measured values stay; counter and CRC go on
stop       for COUNT frames (until the end) the node sends nothing at all

Beside these, every name of eampc_rig.fault_catalogue: the fault holds for COUNT frames (until the
end).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from eampc_rig import fault_catalogue
from eampc_rig.problem_sentences import nearest
from eampc_rig.rig_error import RigError

_OWN_KINDS = ("drop", "delay", "duplicate", "corrupt", "freeze", "stop")
KINDS = (*_OWN_KINDS, *fault_catalogue.NAMES)
_UNTIL_THE_END = ("freeze", "stop", *fault_catalogue.NAMES)
_WITH_VALUE = ("delay", "corrupt")


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault: acts on frames first ≤ k < end. `value` is seconds (delay) or a bit (corrupt)."""

    kind: str
    first: int
    end: float
    value: float | None = None

    def acts_on(self, frame: int) -> bool:
        """Return whether encoder frame `frame` is concerned."""
        return self.first <= frame < self.end


@dataclass(frozen=True, slots=True)
class Delivery:
    """Bytes of an encoder frame that go out `delay_s` after their instant."""

    delay_s: float
    data: bytes


def parse_fault(text: str) -> Fault:
    """Read KIND@FRAME[:COUNT[:VALUE]]; an empty COUNT means the default.

    Raises RigError, one sentence, for anything else.
    """
    kind, at, rest = text.partition("@")
    start = f'--fault "{text}"'
    if kind not in KINDS:
        found = nearest(kind, KINDS)
        guess = f'; did you mean "{found}"?' if found else ""
        raise RigError(f'{start}: unknown kind "{kind}", use one of {", ".join(KINDS)}{guess}')
    parts = rest.split(":")
    if not at or len(parts) > 3:
        raise RigError(f"{start}: write KIND@FRAME[:COUNT[:VALUE]], as in drop@100:3")
    first = _whole(start, "FRAME", parts[0], 0)
    end = math.inf if kind in _UNTIL_THE_END else float(first + 1)
    if len(parts) > 1 and parts[1]:
        end = float(first + _whole(start, "COUNT", parts[1], 1))
    value = None
    if len(parts) > 2 and parts[2]:
        value = _value(start, kind, parts[2])
    return Fault(kind, first, end, value)


def _whole(start: str, name: str, text: str, least: int) -> int:
    if not (text.isascii() and text.isdigit()) or int(text) < least:
        raise RigError(f'{start}: {name} is "{text}", but must be a whole number from {least} on')
    return int(text)


def _value(start: str, kind: str, text: str) -> float:
    if kind not in _WITH_VALUE:
        raise RigError(f'{start}: {kind} takes no VALUE; leave ":{text}" out')
    if kind == "corrupt":
        bit = _whole(start, "VALUE (the bit to flip)", text, 0)
        if bit > 63:
            raise RigError(f"{start}: VALUE is bit {bit}, but a frame has bits 0..63")
        return float(bit)
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not 0.0 < seconds < math.inf:
        raise RigError(f'{start}: VALUE is "{text}", but must be a delay in seconds, above 0')
    return seconds


class FaultInjector:
    """Applies a list of faults to the frames of one run."""

    def __init__(self, faults: Iterable[Fault], period_s: float) -> None:
        self._faults = tuple(faults)
        self._period_s = period_s
        self._frozen: tuple[float, float] | None = None
        self._last_data: bytes | None = None

    def holds(self, kind: str, frame: int) -> bool:
        """Return whether a fault of this kind acts on encoder frame `frame`."""
        return self._find(kind, frame) is not None

    def silent(self, frame: int) -> bool:
        """Return whether the node is stopped at this frame."""
        return self.holds("stop", frame)

    def measured(self, frame: int, angle: float, velocity: float) -> tuple[float, float]:
        """Return the values to send: those of the freeze's first frame while one acts."""
        if self.holds("encoder_jump", frame):
            angle += fault_catalogue.JUMP_RAD
        if not (self.holds("freeze", frame) or self.holds("encoder_frozen", frame)):
            self._frozen = None
            return angle, velocity
        if self._frozen is None:
            self._frozen = (angle, velocity)
        return self._frozen

    def deliveries(self, frame: int, data: bytes) -> list[Delivery]:
        """Return what goes out instead of encoder frame `frame` with these bytes."""
        if self.silent(frame) or any(
            self.holds(kind, frame) for kind in ("drop", "encoder_timeout", "encoder_counter_gap")
        ):
            return []
        if self.holds("encoder_repeats", frame) and self._last_data is not None:
            data = self._last_data
        self._last_data = data
        if self._skips_a_frame(frame):
            return []
        data = self._damaged(frame, data)
        delay = self._find("delay", frame)
        delay_s = 0.0
        if delay:
            delay_s = 0.5 * self._period_s if delay.value is None else delay.value
        copies = 2 if self.holds("duplicate", frame) else 1
        return [Delivery(delay_s, data)] * copies

    def misses_deadline(self, frame: int) -> bool:
        """Return whether the daemon is to be stopped from after this frame to after the next."""
        fault = self._find("deadline_overruns", frame)
        every = fault_catalogue.OVERRUN_EVERY_PERIODS
        return fault is not None and (frame - fault.first) % every == 0

    def _skips_a_frame(self, frame: int) -> bool:
        # The frame after the missed one is lost: a newer frame would take its place, unnoticed.
        return frame >= 2 and self.misses_deadline(frame - 2)

    def _damaged(self, frame: int, data: bytes) -> bytes:
        corrupt = self._find("corrupt", frame) or self._find("encoder_crc", frame)
        if corrupt:
            bit = int(corrupt.value or 0) % (8 * len(data))
            damaged = bytearray(data)
            damaged[bit // 8] ^= 1 << (bit % 8)
            data = bytes(damaged)
        return data[:-1] if self.holds("encoder_length", frame) else data

    def _find(self, kind: str, frame: int) -> Fault | None:
        for fault in self._faults:
            if fault.kind == kind and fault.acts_on(frame):
                return fault
        return None
