"""Reference trajectories as numbers: a CSV file or a scenario's reference → rows (rad, rad/s,
rad/s²) on a grid.

CSV columns by name: time_s, angle_rad and optionally velocity_rad_s and acceleration_rad_s2, times
strictly increasing and not negative. Between rows the angle is a cubic Hermite curve through the
given (or, without that column, differenced) velocities; acceleration is the given column, or the
derivative of the velocity.
"""

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eampc.errors import UserError

REQUIRED = ("time_s", "angle_rad")
OPTIONAL = ("velocity_rad_s", "acceleration_rad_s2")
# eampcd takes no more (kMaxTableRows): it keeps the table in locked memory. 300 s at 200 Hz.
LARGEST_ROW_COUNT = 60_000

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ReferenceTable:
    """rows: (n, 3) of angle rad, velocity rad/s, acceleration rad/s², `sample_period_s` apart."""

    sample_period_s: float
    rows: Array

    def at(self, time_s: Array) -> Array:
        """(len(time_s), 3), linear between rows and held outside them, as the daemon reads it."""
        grid = np.arange(len(self.rows)) * self.sample_period_s
        held = np.column_stack([np.interp(time_s, grid, column) for column in self.rows.T])
        held[time_s > grid[-1], 1:] = 0.0
        return held

    def delayed(self, delay_s: float) -> "ReferenceTable":
        """The same motion, started `delay_s` later; until then its first angle is held."""
        count = math.ceil(max(0.0, delay_s) / self.sample_period_s)
        if count + len(self.rows) > LARGEST_ROW_COUNT:
            raise UserError(
                f"the trajectory would start {delay_s:.0f} s into the run, beyond the table's "
                f"{LARGEST_ROW_COUNT} rows; disarm and arm again to restart the time"
            )
        hold = np.tile([self.rows[0, 0], 0.0, 0.0], (count, 1))
        return ReferenceTable(self.sample_period_s, np.vstack([hold, self.rows]))


def load_reference_table(path: Path, sample_period_s: float) -> ReferenceTable:
    """The CSV file's trajectory on the grid 0, T, 2T …; before its first time its first angle is
    held.
    """
    columns = _read_columns(path)
    time_s, angle = columns["time_s"], columns["angle_rad"]
    rows_needed = math.floor(time_s[-1] / sample_period_s + 1e-9) + 1
    if rows_needed > LARGEST_ROW_COUNT:
        raise UserError(
            f"{path}: {time_s[-1]:g} s at {sample_period_s:g} s per row are {rows_needed} rows; "
            f"at most {LARGEST_ROW_COUNT} fit"
        )
    velocity = columns.get("velocity_rad_s")
    if velocity is None:
        velocity = np.gradient(angle, time_s, edge_order=min(2, len(angle) - 1))
    grid = np.arange(rows_needed) * sample_period_s
    row = np.column_stack([*_hermite(grid, time_s, angle, velocity), np.zeros(rows_needed)])
    if "acceleration_rad_s2" in columns:
        row[:, 2] = np.interp(grid, time_s, columns["acceleration_rad_s2"])
    elif rows_needed > 1:
        row[:, 2] = np.gradient(row[:, 1], sample_period_s)
    row[grid < time_s[0] - 1e-9 * sample_period_s, 1:] = 0.0
    return ReferenceTable(sample_period_s, row)


def _read_columns(path: Path) -> dict[str, Array]:
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            lines = [line for line in csv.reader(file) if line and any(c.strip() for c in line)]
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not text"
        raise UserError(f"{path}: cannot read the trajectory: {reason}") from None
    header = [name.strip() for name in lines[0]] if lines else []
    for name in REQUIRED:
        if name not in header:
            raise UserError(
                f"{path}: the first line must name the columns {', '.join(REQUIRED)} (and may name "
                f"{', '.join(OPTIONAL)}); {name} is missing"
            )
    for name in header:
        if name not in REQUIRED + OPTIONAL or header.count(name) > 1:
            raise UserError(
                f"{path}: column {name!r} is unknown or there twice; the columns are "
                f"{', '.join(REQUIRED + OPTIONAL)}"
            )
    if len(lines) < 3:
        raise UserError(f"{path}: a trajectory needs at least two rows below the column names")
    values = np.empty((len(lines) - 1, len(header)))
    for number, line in enumerate(lines[1:], start=1):
        try:
            numbers = [float(cell) for cell in line]
        except ValueError:
            numbers = []
        if len(numbers) != len(header):
            raise UserError(
                f"{path}: data row {number} ({','.join(line)}) is not {len(header)} numbers"
            )
        values[number - 1] = numbers
    columns = {name: values[:, index] for index, name in enumerate(header)}
    _check_numbers(path, values, columns["time_s"])
    return columns


def _check_numbers(path: Path, values: Array, time_s: Array) -> None:
    if not np.isfinite(values).all():
        row = int(np.argwhere(~np.isfinite(values))[0, 0]) + 1
        raise UserError(f"{path}: data row {row} holds a value that is not finite")
    if time_s[0] < 0.0:
        raise UserError(f"{path}: time_s starts at {time_s[0]:g}; it must not be negative")
    if (steps := np.diff(time_s)).min() <= 0.0:
        row = int(np.argmin(steps)) + 2
        raise UserError(
            f"{path}: time_s must strictly increase, but data row {row} has {time_s[row - 1]:g} "
            f"after {time_s[row - 2]:g}"
        )


def _hermite(grid: Array, time_s: Array, angle: Array, velocity: Array) -> tuple[Array, Array]:
    """Cubic Hermite interpolation: angle and its derivative on the grid, held outside the nodes."""
    inside = np.clip(grid, time_s[0], time_s[-1])
    i = np.clip(np.searchsorted(time_s, inside, side="right") - 1, 0, len(time_s) - 2)
    h = time_s[i + 1] - time_s[i]
    s = (inside - time_s[i]) / h
    y0, y1, m0, m1 = angle[i], angle[i + 1], velocity[i], velocity[i + 1]
    value = (
        (2 * s**3 - 3 * s**2 + 1) * y0
        + (s**3 - 2 * s**2 + s) * h * m0
        + (3 * s**2 - 2 * s**3) * y1
        + (s**3 - s**2) * h * m1
    )
    slope = (
        (6 * s**2 - 6 * s) * (y0 - y1) / h + (3 * s**2 - 4 * s + 1) * m0 + (3 * s**2 - 2 * s) * m1
    )
    return value, slope
