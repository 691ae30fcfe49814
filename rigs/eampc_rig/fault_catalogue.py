"""Faults that the emulated rig and its bus produce on demand, and what the daemon makes of each.

Shared by the emulator, which makes them happen, and by `eampc hil --fault`, which judges the
answer. Detection limits are counted in control periods from the first one in which the fault holds,
that one included.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from eampc_rig.problem_sentences import nearest
from eampc_rig.rig_error import RigError

if TYPE_CHECKING:
    from eampc_rig.rig_file import Rig

# What the fault needs in order to happen.
ANYWHERE, SOCKETCAN, REAL_TIME, REAL_TIME_SOCKETCAN = "anywhere", "socketcan", "time", "both"
# A fault is held for so many times its detection limit unless an end is given.
_HOLD_FACTOR = 2
# An encoder counter of four bits tells apart gaps of up to 15 frames.
SILENCE_PERIODS_MAX = 12
# The encoder's angle is off by so much: no joint moves that far in one period.
JUMP_RAD = 0.5
# A joint that follows a reference moves its command past safety.encoder_frozen_command_V within
# so long; the freeze counts from there.
FROZEN_COMMAND_S = 1.0


@dataclass(frozen=True, slots=True)
class CatalogueEntry:
    """One fault on demand.

    name       as in `--fault NAME@...`
    raises     the daemon's fault, by its name; `raised` says what it is in lock-step
    what       what happens, half a sentence
    needs_key  key or table of the rig file without which (or at 0) the daemon does not watch it
    medium     one of ANYWHERE, SOCKETCAN, REAL_TIME, REAL_TIME_SOCKETCAN
    limit      detection limit in periods
    """

    name: str
    raises: str
    what: str
    limit: Callable[[Rig], int]
    needs_key: str | None = None
    medium: str = ANYWHERE

    def refusal(self, rig: Rig, bus_url: str, lockstep: bool) -> str | None:
        """Why it cannot be had on this rig, bus and pace; None if it can."""
        if self.needs_key is not None and not _has(rig, self.needs_key):
            return f"{rig.file} has no {self.needs_key}, so the daemon does not watch for it"
        if self.medium in (SOCKETCAN, REAL_TIME_SOCKETCAN) and not bus_url.startswith("socketcan:"):
            return (
                f"{bus_url.partition(':')[0]} has no CAN controller and no interface, so it cannot "
                "carry this fault; use --bus socketcan:vcan0 (tools/vcanrun makes one)"
            )
        if self.medium in (REAL_TIME, REAL_TIME_SOCKETCAN) and lockstep:
            return (
                "lock-step has no deadlines and waits for the very answer that this fault holds "
                "back; use --real-time"
            )
        return None

    def raised(self, lockstep: bool) -> str:
        """The daemon's fault by name. Lock-step has no clock: there a silence is told by the
        counter of the frame after it, and is a gap of the counter."""
        silence = self.raises == "encoder_timeout"
        return "encoder_counter_gap" if lockstep and silence else self.raises

    def hold_periods(self, rig: Rig) -> int:
        """How long the fault lasts unless an end is given."""
        if self.name == "encoder_counter_gap":
            return min(gap_frames(rig), SILENCE_PERIODS_MAX)
        limit = _HOLD_FACTOR * self.limit(rig)
        return min(limit, SILENCE_PERIODS_MAX) if self.name == "encoder_timeout" else limit

    def limit_periods(self, rig: Rig, lockstep: bool, held: int) -> int:
        """Detection limit of a fault that is held for `held` periods."""
        if lockstep and self.raises == "encoder_timeout":
            return held + 1  # with the first frame after the silence
        return self.limit(rig)


def _has(rig: Rig, key: str) -> bool:
    node: object = rig
    for part in key.split("."):
        node = getattr(node, part, None)
        if node is None or node == 0:
            return False
    return True


def _periods(rig: Rig, duration_s: float) -> int:
    return max(1, round(duration_s / rig.control.period_s))


def _at_once(_rig: Rig) -> int:
    return 1


def _timeout(rig: Rig) -> int:
    return _periods(rig, rig.safety.encoder_timeout_s)


def _invalid(rig: Rig) -> int:
    return min(rig.safety.encoder_invalid_frames, _timeout(rig))


def _frozen(rig: Rig) -> int:
    return _periods(rig, rig.safety.encoder_frozen_s + FROZEN_COMMAND_S)


def _gap(rig: Rig) -> int:
    return gap_frames(rig) + 1


def gap_frames(rig: Rig) -> int:
    """Frames to lose so that safety.encoder_counter_gap_max is passed."""
    return rig.safety.encoder_counter_gap_max + 1


def _supply(rig: Rig) -> int:
    return _periods(rig, rig.safety.supply_pressure_s)


def _heartbeat(rig: Rig) -> int:
    return _periods(rig, rig.safety.heartbeat_timeout_s)


def _e_stop_silent(rig: Rig) -> int:
    return _periods(rig, rig.safety.e_stop_timeout_s)


def _passive(rig: Rig) -> int:
    return _periods(rig, rig.safety.error_passive_s)


def _unconfirmed(rig: Rig) -> int:
    return rig.safety.tx_unconfirmed_periods + 1


def _refused(rig: Rig) -> int:
    return rig.safety.send_refused_frames + 1


def _link(rig: Rig) -> int:
    return 2  # without a frame the daemon's own period starts half a period late


def _overruns(rig: Rig) -> int:
    # Not every stop is a missed deadline where the emulator itself is late.
    return OVERRUN_EVERY_PERIODS * (rig.safety.deadline_overruns_max + 4)


# One deadline is missed every so many periods while deadline_overruns holds.
OVERRUN_EVERY_PERIODS = 4

CATALOGUE: tuple[CatalogueEntry, ...] = (
    CatalogueEntry("encoder_timeout", "encoder_timeout", "the encoder's frames stop", _timeout),
    CatalogueEntry(
        "encoder_crc",
        "encoder_crc",
        "one bit of every encoder frame is flipped after its CRC was made",
        _invalid,
        "bus.encoder.crc_signal",
    ),
    CatalogueEntry(
        "encoder_length",
        "encoder_length",
        "encoder frames lack their last byte",
        _invalid,
    ),
    CatalogueEntry(
        "encoder_out_of_range",
        "encoder_out_of_range",
        "the angle lies outside the range that the DBC gives its signal",
        _invalid,
    ),
    CatalogueEntry(
        "encoder_frozen",
        "encoder_frozen",
        "angle and velocity stay, counter and CRC go on; seen only while the command moves",
        _frozen,
        "safety.encoder_frozen_s",
    ),
    CatalogueEntry(
        "encoder_repeats",
        "encoder_frozen",
        "the same encoder frame again and again, counter and all",
        _timeout,
        "bus.encoder.counter_signal",
    ),
    CatalogueEntry(
        "encoder_jump",
        "encoder_jump",
        f"the angle is off by {JUMP_RAD:g} rad from one frame to the next",
        _at_once,
    ),
    CatalogueEntry(
        "encoder_counter_gap",
        "encoder_counter_gap",
        "encoder frames are lost, their counters used up; told by the first frame after them",
        _gap,
        "bus.encoder.counter_signal",
    ),
    CatalogueEntry(
        "encoder_status",
        "encoder_status",
        "the encoder's status signal reports a failure",
        _at_once,
        "safety.encoder_status_mask",
    ),
    CatalogueEntry(
        "heartbeat_lost",
        "heartbeat_lost",
        "the node's heartbeat stops, everything else goes on",
        _heartbeat,
        "bus.heartbeat",
    ),
    CatalogueEntry(
        "emergency_message",
        "emergency_message",
        "the node sends an emergency message, and takes it back at the end",
        _at_once,
        "bus.emergency",
    ),
    CatalogueEntry(
        "supply_pressure",
        "supply_pressure",
        "the supply pressure in the feedback falls to zero",
        _supply,
        "safety.supply_pressure_min_kPa",
    ),
    CatalogueEntry(
        "supply_unknown",
        "supply_pressure",
        "the valve feedback stops, so that nobody knows the supply pressure",
        _supply,
        "safety.supply_pressure_min_kPa",
    ),
    CatalogueEntry(
        "e_stop", "e_stop", "the emergency stop is pressed, and released at the end", _at_once,
        "bus.e_stop",
    ),
    CatalogueEntry(
        "e_stop_silent",
        "e_stop",
        "the emergency stop's own frames stop, as if its cable were cut",
        _e_stop_silent,
        "safety.e_stop_timeout_s",
    ),
    CatalogueEntry(
        "law_mismatch",
        "law_mismatch",
        "the node says that it was set up for another rig",
        _at_once,
        "bus.identity",
    ),
    CatalogueEntry(
        "bus_off",
        "bus_off",
        "an error frame says bus-off, one at the end that the controller is back",
        _at_once,
        medium=SOCKETCAN,
    ),
    CatalogueEntry(
        "error_passive",
        "error_passive",
        "an error frame says error-passive, one at the end error-active",
        _passive,
        medium=SOCKETCAN,
    ),
    CatalogueEntry(
        "link_down",
        "link_down",
        "the interface goes down, and up again at the end",
        _link,
        medium=REAL_TIME_SOCKETCAN,
    ),
    CatalogueEntry(
        "send_refused",
        "send_refused",
        "the interface's queue is full, every further frame is refused",
        _refused,
        medium=REAL_TIME_SOCKETCAN,
    ),
    CatalogueEntry(
        "tx_unconfirmed",
        "tx_unconfirmed",
        "the interface keeps frames and confirms none, and lets them go at the end",
        _unconfirmed,
        medium=REAL_TIME_SOCKETCAN,
    ),
    CatalogueEntry(
        "deadline_overruns",
        "deadline_overruns",
        "the daemon's process is stopped again and again for more than a period",
        _overruns,
        medium=REAL_TIME,
    ),
)  # fmt: skip
NAMES = tuple(entry.name for entry in CATALOGUE)


def catalogue_entry(name: str) -> CatalogueEntry:
    """The entry called `name`; raises RigError, one sentence, if there is none."""
    for entry in CATALOGUE:
        if entry.name == name:
            return entry
    found = nearest(name, NAMES)
    guess = f"did you mean {found}?" if found else f"use one of {', '.join(NAMES)}"
    raise RigError(f'there is no fault "{name}"; {guess}')


@dataclass(frozen=True, slots=True)
class TimedFault:
    """A fault and when it holds, in s of scenario time; end None: as long as the catalogue says."""

    entry: CatalogueEntry
    start_s: float
    end_s: float | None


def parse_timed_fault(text: str) -> TimedFault:
    """Read NAME@T or NAME@T..T2. Raises RigError, one sentence, for anything else."""
    name, at, times = text.partition("@")
    try:
        entry = catalogue_entry(name)
    except RigError as error:
        raise RigError(f'--fault "{text}": {error}') from None
    first, dots, last = times.partition("..")
    try:
        start_s = float(first)
        end_s = float(last) if dots else None
    except ValueError:
        start_s, end_s = math.nan, None
    if not at or not math.isfinite(start_s) or (end_s is not None and not math.isfinite(end_s)):
        raise RigError(
            f'--fault "{text}": write NAME@SECONDS or NAME@SECONDS..SECONDS of scenario time, '
            "as in e_stop@2.0..2.5"
        )
    if end_s is not None and end_s <= start_s:
        raise RigError(f'--fault "{text}": the end must come after the start')
    return TimedFault(entry, start_s, end_s)
