"""Faults of a run, placed on its encoder frames, as the emulator takes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from eampc_rig import Rig
from eampc_rig.fault_catalogue import (
    CATALOGUE,
    CatalogueEntry,
    TimedFault,
    parse_timed_fault,
)

from eampc.errors import UserError

LIST = "list"


@dataclass(frozen=True)
class PlannedFault:
    """One fault on demand. It holds for encoder frames first ≤ k < end.

    raised  the daemon's fault by name; action: the rig file's on it
    limit   periods within which the daemon must see it, counted from `first` on
    """

    entry: CatalogueEntry
    first: int
    end: int
    raised: str
    action: str
    limit: int

    @property
    def emulator_argument(self) -> str:
        return f"{self.entry.name}@{self.first}:{self.end - self.first}"

    def described(self, period_s: float, active: int) -> str:
        """For the report: what happens when, in scenario time."""
        start_s, end_s = (period_s * (frame - active) for frame in (self.first, self.end))
        return f"{self.entry.name} from {start_s:g} to {end_s:g} s: {self.entry.what}"


def read_faults(texts: Sequence[str], rig: Rig, bus_url: str, lockstep: bool) -> list[TimedFault]:
    """The faults that the command line asks for; UserError for one that this rig, bus or pace
    cannot have."""
    faults = [parse_timed_fault(text) for text in texts]
    for text, fault in zip(texts, faults, strict=True):
        if reason := fault.entry.refusal(rig, bus_url, lockstep):
            raise UserError(f'--fault "{text}": {reason}')
    return faults


def plan_faults(
    faults: Sequence[TimedFault], rig: Rig, active: int, lockstep: bool
) -> list[PlannedFault]:
    """active: encoder frame of scenario time zero. In the order of their beginnings."""
    planned = []
    for fault in faults:
        entry = fault.entry
        first = active + round(fault.start_s / rig.control.period_s)
        held = entry.hold_periods(rig)
        if fault.end_s is not None:
            held = max(1, active + round(fault.end_s / rig.control.period_s) - first)
        if first < 0:
            raise UserError(
                f"--fault {entry.name}@{fault.start_s:g}: this is before the run's first frame, "
                f"which is {active * rig.control.period_s:g} s before ACTIVE"
            )
        raised = entry.raised(lockstep)
        planned.append(
            PlannedFault(
                entry=entry,
                first=first,
                end=first + held,
                raised=raised,
                action=rig.safety.action(raised),
                limit=entry.limit_periods(rig, lockstep, held),
            )
        )
    return sorted(planned, key=lambda fault: fault.first)


def fault_list(rig: Rig, bus_url: str, lockstep: bool) -> list[tuple[str, str, str]]:
    """(name, what happens, within how many periods and then what, or why it cannot be had)."""
    rows = []
    for entry in CATALOGUE:
        reason = entry.refusal(rig, bus_url, lockstep)
        raised = entry.raised(lockstep)
        limit = entry.limit_periods(rig, lockstep, entry.hold_periods(rig))
        seen = f"{raised} within {limit} periods, then {rig.safety.action(raised)}"
        rows.append((entry.name, entry.what, f"not here: {reason}" if reason else seen))
    return rows
