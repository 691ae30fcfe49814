"""The truth of a run, one row per encoder frame, written at the end as CSV or NPZ."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from eampc_rig.rig_error import RigError

COLUMNS = (
    "frame",
    "scenario_time_s",
    "angle_rad",
    "velocity_rad_s",
    "disturbance_rad_s2",
    "u1_V",
    "u2_V",
    "pressure1_kPa",
    "pressure2_kPa",
    "torque_N_m",
    "valve_node_safe",
    "sent_monotonic_s",
    "answered_monotonic_s",
)
_SUFFIXES = (".csv", ".npz")
TruthRow = tuple[float, ...]


class TruthLog:
    """Rows in the order of COLUMNS. State and pressures are those when the frame was sent, the
    voltages those applied after its answer; times are CLOCK_MONOTONIC, NaN = no answer."""

    def __init__(self, path: Path | None) -> None:
        """Keep rows for `path`; None keeps nothing.

        Raises RigError if the name ends in neither .csv nor .npz or the file cannot be made: a run
        must not end with nowhere to write to.
        """
        self._path = path
        self._rows: list[TruthRow] = []
        if path is None:
            return
        if path.suffix not in _SUFFIXES:
            raise RigError(f'--log "{path}": the name must end in .csv or .npz')
        if not path.absolute().parent.is_dir():
            raise RigError(f'--log "{path}": the folder {path.parent} does not exist')
        try:
            path.open("wb").close()
        except OSError as error:
            raise RigError(f'--log "{path}": cannot be written ({error.strerror})') from None

    def append(self, row: TruthRow) -> None:
        """Keep one row."""
        if self._path is not None:
            self._rows.append(row)

    def write(self) -> None:
        """Write what was kept; raises OSError."""
        if self._path is None:
            return
        if self._path.suffix == ".csv":
            with self._path.open("w", newline="", encoding="utf-8") as file:
                writer = csv.writer(file)
                writer.writerow(COLUMNS)
                writer.writerows(self._rows)
            return
        table = np.array(self._rows, dtype=float).reshape(-1, len(COLUMNS))
        columns = {name: table[:, index] for index, name in enumerate(COLUMNS)}
        np.savez_compressed(self._path, **columns)
