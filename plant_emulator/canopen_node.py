"""A CANopen slave (CiA 301) as far as a daemon and a commissioning tool talk to it: NMT states,
boot-up, heartbeat, emergency, and an SDO server with expedited transfers.

Knows neither bus nor clock: frames in, frames out, time by `elapse`.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import can

BOOT_UP, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0, 4, 5, 127
_NMT_STATES = {1: OPERATIONAL, 2: STOPPED, 128: PRE_OPERATIONAL}
_NMT_RESETS = (129, 130)
_NMT_ID, _EMERGENCY_ID, _SDO_REQUEST_ID, _SDO_REPLY_ID, _HEARTBEAT_ID = (
    0x000,
    0x080,
    0x600,
    0x580,
    0x700,
)
_NO_SUCH_OBJECT, _NO_SUCH_SUB_INDEX = 0x06020000, 0x06090011
_READ_ONLY, _WRONG_LENGTH, _UNKNOWN_COMMAND = 0x06010002, 0x06070010, 0x05040001
HEARTBEAT_MS, ERROR_REGISTER = (0x1017, 0), (0x1001, 0)


@dataclass(slots=True)
class SdoObject:
    """One entry of the object dictionary; `code` as struct's, little-endian."""

    value: int
    code: str
    writable: bool = False


class CanopenNode:
    """One slave. `objects`: (index, sub-index) → entry, its own 0x1001 and 0x1017 added."""

    def __init__(self, number: int, objects: dict[tuple[int, int], SdoObject]) -> None:
        self.number = number
        self.objects = {
            ERROR_REGISTER: SdoObject(0, "B"),
            HEARTBEAT_MS: SdoObject(100, "H", writable=True),
            **objects,
        }
        self._power_on = {key: entry.value for key, entry in self.objects.items()}
        self._since_heartbeat_s = 0.0
        self.state = BOOT_UP

    @property
    def operational(self) -> bool:
        """Whether the node sends and obeys PDOs."""
        return self.state == OPERATIONAL

    def elapse(self, duration_s: float) -> list[can.Message]:
        """Let time pass; return the boot-up message or the heartbeat if one is due."""
        if self.state == BOOT_UP:
            self.state = PRE_OPERATIONAL
            self._since_heartbeat_s = 0.0
            return [self._message(_HEARTBEAT_ID, bytes([BOOT_UP]))]
        self._since_heartbeat_s += duration_s
        period_s = 1e-3 * self.objects[HEARTBEAT_MS].value
        if period_s == 0.0 or self._since_heartbeat_s < period_s - 1e-9:
            return []
        self._since_heartbeat_s = 0.0
        return [self._message(_HEARTBEAT_ID, bytes([self.state]))]

    def receive(self, message: can.Message) -> list[can.Message]:
        """Take a frame of the bus; return what the node answers."""
        if message.is_extended_id or message.is_remote_frame or message.is_error_frame:
            return []
        data = bytes(message.data)
        if message.arbitration_id == _NMT_ID and len(data) == 2 and data[1] in (0, self.number):
            self._manage(data[0])
        is_request = message.arbitration_id == _SDO_REQUEST_ID + self.number and len(data) == 8
        if not is_request or self.state not in (PRE_OPERATIONAL, OPERATIONAL):
            return []
        return [self._message(_SDO_REPLY_ID, self._serve(data))]

    def emergency(self, code: int, register: int) -> can.Message:
        """Return the emergency message of an error, or with code 0 of its end."""
        self.objects[ERROR_REGISTER].value = register
        return self._message(_EMERGENCY_ID, struct.pack("<HB5x", code, register))

    def _manage(self, command: int) -> None:
        if command in _NMT_RESETS:
            for key, value in self._power_on.items():
                self.objects[key].value = value
            self.state = BOOT_UP
        elif self.state != BOOT_UP:
            self.state = _NMT_STATES.get(command, self.state)

    def _serve(self, request: bytes) -> bytes:
        command, index, sub = struct.unpack_from("<BHB", request)
        entry = self.objects.get((index, sub))
        if entry is None:
            known = any(key[0] == index for key in self.objects)
            return _abort(index, sub, _NO_SUCH_SUB_INDEX if known else _NO_SUCH_OBJECT)
        size = struct.calcsize("<" + entry.code)
        if command >> 5 == 2:  # upload
            head = struct.pack("<BHB", 0x43 | (4 - size) << 2, index, sub)
            return (head + struct.pack("<" + entry.code, entry.value)).ljust(8, b"\0")
        if command >> 5 != 1 or not command & 2:
            return _abort(index, sub, _UNKNOWN_COMMAND)
        if not entry.writable:
            return _abort(index, sub, _READ_ONLY)
        if command & 1 and 4 - (command >> 2 & 3) != size:
            return _abort(index, sub, _WRONG_LENGTH)
        (entry.value,) = struct.unpack_from("<" + entry.code, request, 4)
        return struct.pack("<BHB4x", 0x60, index, sub)

    def _message(self, base: int, data: bytes) -> can.Message:
        return can.Message(arbitration_id=base + self.number, is_extended_id=False, data=data)


def _abort(index: int, sub: int, reason: int) -> bytes:
    return struct.pack("<BHBI", 0x80, index, sub, reason)
