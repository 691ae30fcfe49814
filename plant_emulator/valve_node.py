"""The valve node: which command frames it believes, and what it does without one.

A frame counts if length and CRC are right and its rolling counter has moved. Without a frame that
counts for `timeout_s`, before the first one, and with the enable bit at 0 the node applies its safe
voltages; a safe voltage of None leaves that valve as it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import can
from eampc_rig.message_codec import MessageCodec

# Bits of the feedback frame's status signal.
STATUS_SAFE = 1  # the safe voltage is applied, for whatever reason
STATUS_TIMED_OUT = 2  # ... because no valid command came in time
STATUS_REFUSED = 4  # a command frame was refused since the last feedback

# The time-out may fall on a frame's instant; rounding must not move it behind.
_AGE_TOLERANCE_S = 1e-9


@dataclass(slots=True)
class CommandCounts:
    """How many command frames were accepted, refused for which reason, or are missing."""

    accepted: int = 0
    wrong_length: int = 0
    bad_crc: int = 0
    repeated_counter: int = 0
    lost: int = 0

    @property
    def refused(self) -> int:
        """Frames that came but did not count."""
        return self.wrong_length + self.bad_crc + self.repeated_counter


class ValveNode:
    """Voltages in V; time is the plant's own (`elapse`), never the wall clock."""

    def __init__(self, codec: MessageCodec, safe_V: float, timeout_s: float) -> None:
        """Start in the safe state: no command has come yet."""
        self._codec = codec
        self.safe_V: tuple[float | None, float | None] = (safe_V, safe_V)
        self.timeout_s = timeout_s
        self._age_s = timeout_s
        self._last_counter: int | None = None
        self._refused_since_feedback = False
        self._enabled = False
        self.timed_out = True
        self.u1_V = safe_V
        self.u2_V = safe_V
        self.counts = CommandCounts()

    def is_command(self, message: can.Message) -> bool:
        """Return whether the frame has the command's id; it may still be refused."""
        return (
            message.arbitration_id == self._codec.frame_id
            and message.is_extended_id == self._codec.is_extended
            and not message.is_remote_frame
            and not message.is_error_frame
        )

    def receive(self, data: bytes) -> bool:
        """Take a command frame's data; return whether it counted."""
        frame = self._codec.decode(data)
        if not frame.length_ok:
            self.counts.wrong_length += 1
        elif not frame.crc_ok:
            self.counts.bad_crc += 1
        elif frame.counter is not None and frame.counter == self._last_counter:
            self.counts.repeated_counter += 1
        else:
            self._accept(frame.values, frame.counter)
            return True
        self._refused_since_feedback = True
        return False

    @property
    def gave_up(self) -> bool:
        """Whether commands came once and then stopped."""
        return self.timed_out and self.counts.accepted > 0

    @property
    def time_left_s(self) -> float:
        """Seconds until the node gives up waiting; 0 if it has."""
        return 0.0 if self.timed_out else max(0.0, self.timeout_s - self._age_s)

    def elapse(self, duration_s: float) -> bool:
        """Let time pass; return whether the time-out struck in it."""
        if self.timed_out:
            return False
        self._age_s += duration_s
        if self._age_s < self.timeout_s - _AGE_TOLERANCE_S:
            return False
        self.timed_out = True
        self._go_safe()
        return True

    def take_status(self) -> int:
        """Return the feedback frame's status bits and start a new feedback interval."""
        status = STATUS_REFUSED if self._refused_since_feedback else 0
        if self.timed_out or not self._enabled:
            status |= STATUS_SAFE
        if self.timed_out:
            status |= STATUS_TIMED_OUT
        self._refused_since_feedback = False
        return status

    def _accept(self, values: dict[str, float], counter: int | None) -> None:
        if counter is not None and self._last_counter is not None and not self.timed_out:
            modulus = self._codec.counter_modulus or 1
            self.counts.lost += (counter - self._last_counter - 1) % modulus
        self._last_counter = counter
        self.counts.accepted += 1
        self._age_s = 0.0
        self.timed_out = False
        self._enabled = values.get("enable", 1.0) != 0.0
        if self._enabled:
            self.u1_V, self.u2_V = values["u1"], values["u2"]
        else:
            self._go_safe()

    def _go_safe(self) -> None:
        u1_V, u2_V = self.safe_V
        self.u1_V = self.u1_V if u1_V is None else u1_V
        self.u2_V = self.u2_V if u2_V is None else u2_V
