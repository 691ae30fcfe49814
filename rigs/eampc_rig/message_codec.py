"""One DBC message as bytes and as physical values, with rolling counter and CRC-8."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from cantools.database.can import Message, Signal

from eampc_rig.crc8 import frame_crc


@dataclass(frozen=True)
class DecodedFrame:
    """What a frame said: physical values by role; raw counter; whether length and CRC were right.

    With a wrong length there are no values.
    """

    values: Mapping[str, float]
    counter: int | None
    length_ok: bool
    crc_ok: bool

    @property
    def valid(self) -> bool:
        """Whether the frame may be believed (the counter is the reader's own business)."""
        return self.length_ok and self.crc_ok


class MessageCodec:
    """Encodes and decodes one message with cantools; signals go by role ("angle"), not by name.

    `roles` maps role → signal name; the roles "counter" and "crc" are filled in here.
    """

    def __init__(self, message: Message, roles: Mapping[str, str]) -> None:
        self._message = message
        self._roles = dict(roles)
        self._signals: dict[str, Signal] = {
            role: message.get_signal_by_name(name) for role, name in roles.items()
        }
        self._unused = {
            signal.name: 0 for signal in message.signals if signal.name not in roles.values()
        }
        self._ranges = {role: physical_range(signal) for role, signal in self._signals.items()}
        self._carriers = [role for role in roles if role not in ("counter", "crc")]
        crc = self._signals.get("crc")
        self._crc_byte = None if crc is None else crc.start // 8
        counter = self._signals.get("counter")
        self.counter_modulus = None if counter is None else 1 << counter.length

    @property
    def name(self) -> str:
        """The message's name in the DBC."""
        return self._message.name

    @property
    def frame_id(self) -> int:
        """The CAN id, without flag bits."""
        return self._message.frame_id

    @property
    def is_extended(self) -> bool:
        """Whether the id has 29 bits."""
        return self._message.is_extended_frame

    @property
    def length(self) -> int:
        """Data bytes of the frame."""
        return self._message.length

    @property
    def data_id(self) -> int:
        """What goes into the CRC before the data: the id's low 16 bits."""
        return self.frame_id & 0xFFFF

    @property
    def roles(self) -> tuple[str, ...]:
        """The roles that this message carries."""
        return tuple(self._roles)

    def range_of(self, role: str) -> tuple[float, float]:
        """Return the least and greatest physical value that a role's signal carries."""
        return self._ranges[role]

    def value_beyond_range(self, role: str) -> float | None:
        """Return a physical value that the role's signal can carry although its DBC range leaves
        it out; None if there is none."""
        signal, (low, high) = self._signals[role], self._ranges[role]
        for raw in _raw_ends(signal):
            value = float(raw * signal.scale + signal.offset)
            if not low <= value <= high:
                return value
        return None

    def encode(
        self, values: Mapping[str, float], counter: int = 0, hold_in_range: bool = True
    ) -> bytes:
        """Return the frame's bytes for physical `values` by role (units as in the DBC).

        Values beyond a signal's range are held at its end, as a real node's would be, unless
        `hold_in_range` is false; roles that the message does not carry are ignored, missing ones
        are 0. `counter` counts frames and is reduced modulo the signal's 2^length.
        """
        physical: dict[str, Any] = dict(self._unused)
        for role in self._carriers:
            low, high = self._ranges[role]
            value = values.get(role, 0.0)
            if hold_in_range:
                value = low if value < low else high if value > high else value
            physical[self._roles[role]] = value
        if self.counter_modulus is not None:
            physical[self._roles["counter"]] = counter % self.counter_modulus
        if self._crc_byte is None:
            return self._message.encode(physical, strict=False)
        physical[self._roles["crc"]] = 0
        data = bytearray(self._message.encode(physical, strict=False))
        data[self._crc_byte] = frame_crc(bytes(data), self._crc_byte, self.data_id)
        return bytes(data)

    def decode(self, data: bytes) -> DecodedFrame:
        """Return what `data` says; never raises for bytes from the bus."""
        if len(data) != self.length:
            return DecodedFrame({}, None, length_ok=False, crc_ok=False)
        data = bytes(data)
        physical: Any = self._message.decode(data, decode_choices=False)
        values = {role: float(physical[self._roles[role]]) for role in self._carriers}
        crc_ok = (
            self._crc_byte is None
            or frame_crc(data, self._crc_byte, self.data_id) == data[self._crc_byte]
        )
        counter = int(physical[self._roles["counter"]]) if self.counter_modulus else None
        return DecodedFrame(values, counter, length_ok=True, crc_ok=crc_ok)

    def signal_layout(self, role: str) -> dict[str, Any]:
        """Return where a role's signal lies: start_bit as the DBC counts (least significant bit
        for Intel, most significant bit for Motorola byte order), length in bits, little_endian,
        is_signed, factor, offset (physical = raw · factor + offset), and the physical range that
        the DBC gives it, cut to what its bits carry: minimum, maximum."""
        signal = self._signals[role]
        return {
            "start_bit": int(signal.start),
            "length": int(signal.length),
            "little_endian": signal.byte_order == "little_endian",
            "is_signed": bool(signal.is_signed),
            "factor": float(signal.scale),
            "offset": float(signal.offset),
            "minimum": self._ranges[role][0],
            "maximum": self._ranges[role][1],
        }

    def layout(self) -> dict[str, Any]:
        """Return the message's entry for the law file: id, extended, length, signals, crc."""
        crc = None
        if self._crc_byte is not None:
            crc = {"byte": self._crc_byte, "data_id": self.data_id}
        return {
            "id": self.frame_id,
            "extended": self.is_extended,
            "length": self.length,
            "signals": {role: self.signal_layout(role) for role in self._roles if role != "crc"},
            "crc": crc,
        }


def physical_range(signal: Signal) -> tuple[float, float]:
    """Return the values that `signal` can carry: its raw range, cut to the DBC's [min|max]."""
    ends = sorted(raw * signal.scale + signal.offset for raw in _raw_ends(signal))
    low, high = float(ends[0]), float(ends[1])
    if signal.minimum is not None:
        low = max(low, float(signal.minimum))
    if signal.maximum is not None:
        high = min(high, float(signal.maximum))
    return low, high


def _raw_ends(signal: Signal) -> tuple[int, int]:
    if signal.is_signed:
        return -(1 << (signal.length - 1)), (1 << (signal.length - 1)) - 1
    return 0, (1 << signal.length) - 1
