"""What a run leaves behind: the daemon's record and the emulator's truth, both CSV with named
columns.

Row k of the truth is encoder frame k; the daemon's cycle k answers it. Columns keep the units of
their names.
"""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eampc.errors import RunFailed

TRUTH_COLUMNS = [
    "frame",
    "scenario_time_s",
    "angle_rad",
    "velocity_rad_s",
    "disturbance_rad_s2",
    "sent_monotonic_s",
    "answered_monotonic_s",
]
RECORD_COLUMNS = [
    "cycle",
    "scenario_time_s",
    "reference_angle_rad",
    "angle_rad",
    "disturbance_rad_s2",
    "u1_V",
    "u2_V",
    "region",
    "mode",
    "fault",
    "present_faults",
    "arrival_to_wake_us",
    "wake_to_decided_us",
    "decided_to_sent_us",
    "arrival_to_sent_us",
]
# The command frames as the emulated node received them; frame: the period they arrived in.
COMMAND_COLUMNS = ["frame", "offset_s", "valid", "u1_V", "u2_V", "enable", "counter"]


@dataclass(frozen=True)
class Recording:
    """Columns of one file by name; text columns (mode, fault) as strings, all others float64."""

    columns: dict[str, NDArray]

    def __getitem__(self, name: str) -> NDArray:
        return self.columns[name]

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def where(self, rows: NDArray) -> "Recording":
        return Recording({name: column[rows] for name, column in self.columns.items()})


def read_recording(path: Path, required: list[str]) -> Recording:
    """Empty cells become NaN. A file that is missing, empty or lacks a column is a failed run."""
    try:
        with open(path, newline="", encoding="utf-8") as file:
            lines = list(csv.reader(file))
    except OSError as error:
        raise RunFailed(f"{path}: the run left no readable log ({error.strerror})") from None
    if len(lines) < 2:
        raise RunFailed(f"{path}: the run left an empty log; no frame was exchanged")
    header, rows = lines[0], lines[1:]
    if missing := [name for name in required if name not in header]:
        raise RunFailed(f"{path}: the log has no column {', '.join(missing)}; versions differ?")
    if len(rows[-1]) < len(header):  # cut off in mid-line when the writer was killed
        rows.pop()
    return Recording({name: _column([row[i] for row in rows]) for i, name in enumerate(header)})


def _column(cells: list[str]) -> NDArray:
    try:
        return np.array([float(cell) if cell else np.nan for cell in cells])
    except ValueError:
        return np.array(cells)
