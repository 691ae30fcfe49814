"""The rig's messages, found in the DBC by the names that section [bus] gives."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import cantools
from cantools.database.can import Database, Message, Signal

from eampc_rig.message_codec import MessageCodec
from eampc_rig.problem_sentences import nearest
from eampc_rig.rig_error import RigError

if TYPE_CHECKING:
    from eampc_rig.field_types import Section
    from eampc_rig.rig_file import Rig

MAX_CLASSIC_BYTES = 8
DEFAULT_HEARTBEAT = "Heartbeat"
MESSAGES = (
    "encoder",
    "valve_command",
    "valve_feedback",
    "sync",
    "heartbeat",
    "emergency",
    "e_stop",
    "identity",
    "nmt_start",
)


@dataclass(frozen=True)
class Frames:
    """Codecs of the rig's messages; None where the rig has no such message."""

    encoder: MessageCodec
    valve_command: MessageCodec
    valve_feedback: MessageCodec | None
    sync: MessageCodec | None
    heartbeat: MessageCodec | None
    emergency: MessageCodec | None = None
    e_stop: MessageCodec | None = None
    identity: MessageCodec | None = None
    nmt_start: MessageCodec | None = None
    nmt_start_values: Mapping[str, int] = field(default_factory=dict)
    e_stop_released_raw: int = 0
    heartbeat_monitored: bool = False  # False: only the DBC has one

    def layout(self) -> dict[str, Any]:
        """Return the `bus` table of the law file: encoder, valve_command, sync, and the monitored
        messages valve_feedback, heartbeat, emergency, e_stop (with released_raw), identity; and
        nmt_start with the frame's bytes (data_raw, the first one lowest) and operational_raw. None
        where the rig has none."""
        sync = None
        if self.sync is not None:
            whole = self.sync.layout()
            sync = {
                "id": whole["id"],
                "extended": whole["extended"],
                "length": whole["length"],
                "counter_signal": whole["signals"].get("counter"),
            }
        return {
            "encoder": self.encoder.layout(),
            "valve_command": self.valve_command.layout(),
            "sync": sync,
            "valve_feedback": _layout(self.valve_feedback),
            "heartbeat": _layout(self.heartbeat if self.heartbeat_monitored else None),
            "emergency": _layout(self.emergency),
            "e_stop": _layout(self.e_stop, released_raw=self.e_stop_released_raw),
            "identity": _layout(self.identity),
            "nmt_start": self._nmt_start_layout(),
        }

    def _nmt_start_layout(self) -> dict[str, Any] | None:
        codec, values = self.nmt_start, self.nmt_start_values
        if codec is None:
            return None
        data = codec.encode({"command": values["command"], "node": values["node"]})
        return {
            "id": codec.frame_id,
            "extended": codec.is_extended,
            "length": codec.length,
            "data_raw": int.from_bytes(data, "little"),
            "operational_raw": values["operational_raw"],
        }


def _layout(codec: MessageCodec | None, **more: int) -> dict[str, Any] | None:
    return None if codec is None else {**codec.layout(), **more}


def resolve_frames(rig: Rig) -> Frames:
    """Find every message and signal that `rig.bus` names.

    Raises RigError for a DBC that cannot be read, a name it does not have, a message that is not
    a classic CAN frame, a CRC that is not one whole byte, or ranges too narrow for the rig.
    """
    database = _database(rig)
    frames = Frames(
        encoder=_codec(rig, database, "encoder", rig.bus.encoder),
        valve_command=_codec(rig, database, "valve_command", rig.bus.valve_command),
        valve_feedback=_optional(rig, database, "valve_feedback", rig.bus.valve_feedback),
        sync=_optional(rig, database, "sync", rig.bus.sync),
        heartbeat=_heartbeat(rig, database),
        emergency=_optional(rig, database, "emergency", rig.bus.emergency),
        e_stop=_optional(rig, database, "e_stop", rig.bus.e_stop),
        identity=_optional(rig, database, "identity", rig.bus.identity),
        nmt_start=_optional(rig, database, "nmt_start", rig.bus.nmt_start),
        nmt_start_values={}
        if rig.bus.nmt_start is None
        else rig.bus.nmt_start.model_dump(include={"command", "node", "operational_raw"}),
        e_stop_released_raw=0 if rig.bus.e_stop is None else rig.bus.e_stop.released_raw,
        heartbeat_monitored=rig.bus.heartbeat is not None,
    )
    _check_ids(rig, frames)
    low, high = rig.valve.min_V, rig.valve.max_V
    for role in ("u1", "u2"):
        signal = f"bus.valve_command.{role}_signal"
        _check_range(rig, frames.valve_command, role, signal, "valve.min_V..max_V", low, high)
    for role, limit_key in (("angle", "angle_max_rad"), ("velocity", "velocity_max_rad_s")):
        if role in frames.encoder.roles:
            limit = getattr(rig.constraints, limit_key)
            signal, origin = f"bus.encoder.{role}_signal", f"constraints.{limit_key}"
            _check_range(rig, frames.encoder, role, signal, origin, -limit, limit)
    return frames


def _database(rig: Rig) -> Database:
    key = f'{rig.file}: bus.dbc names "{rig.bus.dbc}"'
    try:
        database = cantools.database.load_file(str(rig.dbc_path))
    except FileNotFoundError:
        raise RigError(f"{key}, but {rig.dbc_path} does not exist; put the DBC there") from None
    except OSError as error:
        raise RigError(f"{key}, which cannot be read ({error.strerror})") from None
    except (cantools.Error, ValueError, KeyError) as error:
        reason = " ".join(str(error).split())
        raise RigError(f"{key}, which is not a DBC that cantools reads: {reason}") from None
    if not isinstance(database, Database):
        raise RigError(f"{key}, which describes diagnostics, not CAN messages; name a DBC")
    return database


def _optional(rig: Rig, database: Database, key: str, table: Section | None) -> MessageCodec | None:
    return None if table is None else _codec(rig, database, key, table)


def _heartbeat(rig: Rig, database: Database) -> MessageCodec | None:
    if rig.bus.heartbeat is not None:
        return _codec(rig, database, "heartbeat", rig.bus.heartbeat)
    found = [m for m in database.messages if m.name == DEFAULT_HEARTBEAT]
    if not found or found[0].length > MAX_CLASSIC_BYTES:
        return None
    names = {signal.name for signal in found[0].signals}
    return MessageCodec(found[0], {"state": "State"} if "State" in names else {})


def _codec(rig: Rig, database: Database, key: str, table: Section) -> MessageCodec:
    names = table.model_dump(exclude_none=True)
    message = _message(rig, database, f"bus.{key}.message", names.pop("message"))
    roles = {
        name.removesuffix("_signal"): signal
        for name, signal in names.items()
        if name.endswith("_signal")
    }
    seen: dict[str, str] = {}
    for role, name in roles.items():
        _signal(rig, message, f"bus.{key}.{role}_signal", name)
        if name in seen:
            raise RigError(
                f'{rig.file}: bus.{key}.{role}_signal and {seen[name]}_signal both name "{name}"; '
                "give each its own signal"
            )
        seen[name] = role
    if "crc" in roles:
        _check_crc(rig, f"bus.{key}.crc_signal", message.get_signal_by_name(roles["crc"]))
    return MessageCodec(message, roles)


def _message(rig: Rig, database: Database, key: str, name: str) -> Message:
    messages = {message.name: message for message in database.messages}
    if name not in messages:
        mend = _mend(name, messages)
        raise RigError(
            f'{rig.file}: {key} names the message "{name}", which {rig.bus.dbc} does not have; '
            f"{mend}"
        )
    message = messages[name]
    if message.length > MAX_CLASSIC_BYTES or message.is_multiplexed():
        problem = "is multiplexed" if message.is_multiplexed() else f"has {message.length} bytes"
        raise RigError(
            f"{rig.file}: {key} names {name}, which {problem}; eampc needs a plain classic CAN "
            f"message of at most {MAX_CLASSIC_BYTES} bytes"
        )
    return message


def _signal(rig: Rig, message: Message, key: str, name: str) -> None:
    names = [signal.name for signal in message.signals]
    if name not in names:
        raise RigError(
            f'{rig.file}: {key} names the signal "{name}", which {message.name} in {rig.bus.dbc} '
            f"does not have; {_mend(name, names)}"
        )
    signal = message.get_signal_by_name(name)
    if signal.is_float:
        raise RigError(
            f"{rig.file}: {key} names {name}, a floating-point signal; eampc reads integers with "
            "factor and offset"
        )


def _mend(name: str, names: Iterable[str]) -> str:
    names = list(names)
    has = f"it has {', '.join(names) or 'none'}"
    found = nearest(name, names)
    return f'{has}; did you mean "{found}"?' if found else has


def _check_crc(rig: Rig, key: str, signal: Signal) -> None:
    first = 0 if signal.byte_order == "little_endian" else 7
    if signal.length != 8 or signal.start % 8 != first:
        raise RigError(
            f"{rig.file}: {key} names {signal.name}, which is not one whole byte "
            f"({signal.length} bits from bit {signal.start}); a CRC-8 needs its own byte"
        )


def _check_ids(rig: Rig, frames: Frames) -> None:
    seen: dict[tuple[int, bool], str] = {}
    for key in MESSAGES:
        codec: MessageCodec | None = getattr(frames, key)
        if codec is None:
            continue
        identity = (codec.frame_id, codec.is_extended)
        if identity in seen:
            raise RigError(
                f"{rig.file}: bus.{key}.message and bus.{seen[identity]}.message have the same "
                f"CAN id 0x{codec.frame_id:X}; each needs its own"
            )
        seen[identity] = key


def _check_range(
    rig: Rig, codec: MessageCodec, role: str, key: str, origin: str, low: float, high: float
) -> None:
    bottom, top = codec.range_of(role)
    slack = 1e-9 * max(1.0, abs(low), abs(high))
    if bottom - slack <= low and high <= top + slack:
        return
    raise RigError(
        f"{rig.file}: {key} carries {bottom:.6g}..{top:.6g} in {rig.bus.dbc}, but {origin} asks "
        f"for {low:.6g}..{high:.6g}; widen the signal or narrow the limits"
    )
