"""Telemetry that lcm-logger recorded, as arrays for figures. Channels EAMPC_STATE, EAMPC_HEALTH,
EAMPC_PLANT.
"""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import lcm
import numpy as np
from eampc_lcm import health_t, plant_t, state_t

from eampc.errors import UserError
from eampc.hil.figures import LoopData

TYPES = {"EAMPC_STATE": state_t, "EAMPC_PLANT": plant_t, "EAMPC_HEALTH": health_t}
# Every log of ours starts with an event's sync word; a file that does not is something else.
SYNC_WORD = bytes.fromhex("eda1da01")


@dataclass(frozen=True)
class TelemetryLog:
    """Messages by channel in the log's order; `undecodable`: how many of ours did not decode."""

    path: Path
    messages: dict[str, list[Any]]
    undecodable: int


def read_telemetry_log(path: Path) -> TelemetryLog:
    """UserError if the file is not an LCM log or holds no message of the daemon or the emulator."""
    try:
        with open(path, "rb") as file:
            start = file.read(len(SYNC_WORD))
    except OSError as error:
        raise UserError(f"{path}: cannot read the log: {error.strerror}") from None
    if start != SYNC_WORD:
        raise UserError(f"{path}: is not an LCM log; record one with lcm-logger")
    messages: dict[str, list[Any]] = {channel: [] for channel in TYPES}
    others: Counter[str] = Counter()
    undecodable = 0
    for event in lcm.EventLog(str(path), "r"):
        if event.channel not in TYPES:
            others[event.channel] += 1
            continue
        try:
            messages[event.channel].append(TYPES[event.channel].decode(event.data))
        except ValueError:  # another layout: the fingerprint differs
            undecodable += 1
    if not messages["EAMPC_STATE"] and not messages["EAMPC_PLANT"]:
        raise UserError(_nothing_here(path, others, undecodable))
    return TelemetryLog(path, messages, undecodable)


def _nothing_here(path: Path, others: Counter[str], undecodable: int) -> str:
    if undecodable:
        return (
            f"{path}: none of its {undecodable} EAMPC messages decodes: "
            "another version of eampc wrote it"
        )
    seen = ", ".join(sorted(others)[:5]) or "no message at all"
    return f"{path}: holds no EAMPC_STATE or EAMPC_PLANT message, but {seen}"


def loop_data(log: TelemetryLog) -> LoopData:
    """Curves over seconds since the first message; the reference only where the law followed it."""
    states, plants = log.messages["EAMPC_STATE"], log.messages["EAMPC_PLANT"]
    first_us = min(message.utime for message in [*states[:1], *plants[:1]])

    def column(messages: list[Any], name: str) -> np.ndarray:
        return np.array([getattr(message, name) for message in messages], dtype=float)

    def seconds(messages: list[Any]) -> np.ndarray:
        return (column(messages, "utime") - first_us) * 1e-6

    modes = [state.mode_text for state in states]
    time_s = seconds(states)
    active = np.array([mode == "ACTIVE" for mode in modes], dtype=bool)
    return LoopData(
        title=log.path.name,
        time_label="time since the log began, s",
        cycle_time_s=time_s,
        cycle_reference_rad=np.where(active, column(states, "reference_angle_rad"), np.nan),
        cycle_angle_rad=column(states, "angle_rad"),
        cycle_u1_V=column(states, "u1_V"),
        cycle_u2_V=column(states, "u2_V"),
        cycle_disturbance_rad_s2=column(states, "disturbance_rad_s2"),
        arrival_to_wake_us=column(states, "arrival_to_wake_us"),
        wake_to_decided_us=column(states, "wake_to_decided_us"),
        decided_to_sent_us=column(states, "decided_to_sent_us"),
        arrival_to_sent_us=column(states, "arrival_to_sent_us"),
        plant_time_s=seconds(plants),
        plant_angle_rad=column(plants, "angle_rad"),
        plant_disturbance_rad_s2=column(plants, "disturbance_rad_s2"),
        mode_changes=[
            (float(time_s[i]), modes[i]) for i in range(1, len(modes)) if modes[i] != modes[i - 1]
        ],
    )
