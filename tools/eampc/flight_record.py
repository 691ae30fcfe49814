"""Flight records of the daemon: the last control cycles before a fault, or on request.

The file is a MessagePack map that explains itself (daemon/service/flight_recorder.hpp); its rows
become arrays by column name.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgpack
import numpy as np

from eampc.errors import UserError

if TYPE_CHECKING:
    from eampc.hil.figures import LoopData

FORMAT = "eampc-flight"
VERSION = 1
# What a MessagePack map with that first key begins with: cheaper than reading a log of gigabytes.
MAGIC = b"\xa6format\xac" + FORMAT.encode()


@dataclass(frozen=True)
class FlightRecord:
    """One flight record.

    path       where it lies
    about      rig_name, law_sha256, bus, period_s, reason, fault, fault_text, written_utc, texts
    columns    name → (n,) float64, units in the names; NaN where nothing was measured
    """

    path: Path
    about: dict[str, Any]
    columns: dict[str, np.ndarray]

    def texts(self, column: str) -> list[str]:
        """The column's numbers in words (mode, fault, refusal, verdict)."""
        words = self.about["texts"][column]
        return [words.get(str(int(number)), str(int(number))) for number in self.columns[column]]


def is_flight_record(path: Path) -> bool:
    """Whether the file begins like one; False for what cannot be read."""
    try:
        with open(path, "rb") as file:
            return MAGIC in file.read(64)
    except OSError:
        return False


def read_flight_record(path: Path) -> FlightRecord:
    """Read a flight record; UserError with one sentence if it is none, or is damaged."""
    try:
        content = msgpack.unpackb(path.read_bytes(), raw=False)
    except OSError as error:
        raise UserError(f"{path}: cannot read the flight record: {error.strerror}") from None
    except (ValueError, msgpack.UnpackException):
        raise UserError(
            f"{path}: is not a whole flight record; ask for one with: eampc flight"
        ) from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise UserError(f"{path}: is not a flight record; ask for one with: eampc flight")
    if content.get("version") != VERSION:
        raise UserError(
            f"{path}: is a flight record of version {content.get('version')}, but this eampc reads "
            f"version {VERSION}; use the eampc that wrote it"
        )
    try:
        names = [column["name"] for column in content.pop("columns")]
        data = content.pop("data")
        rows = np.frombuffer(data["f64"], dtype="<f8").reshape(data["shape"])
        columns = dict(zip(names, rows.T.astype(float), strict=True))
    except (KeyError, TypeError, ValueError):
        raise UserError(
            f"{path}: is a damaged flight record; ask for one with: eampc flight"
        ) from None
    if len(rows) == 0:
        raise UserError(f"{path}: holds no cycle; the daemon had run none yet")
    return FlightRecord(path, content, columns)


def loop_data(record: FlightRecord) -> LoopData:
    """Curves over seconds before the fault (0: its first cycle), or before the last cycle."""
    from eampc.hil.figures import LoopData

    columns, modes = record.columns, record.texts("mode")
    faulty = np.flatnonzero(columns["fault"])
    zero = faulty[0] if record.about["fault"] and len(faulty) else len(columns["cycle"]) - 1
    period_s = record.about["period_s"]
    time_s = (columns["cycle"] - columns["cycle"][zero]) * period_s
    active = np.array([mode == "ACTIVE" for mode in modes], dtype=bool)
    reason = record.about["fault_text"] if record.about["fault"] else "on request"
    none = np.array([])
    return LoopData(
        title=f"{record.path.name}: {reason}",
        time_label="time from the fault, s" if record.about["fault"] else "time to the end, s",
        cycle_time_s=time_s,
        cycle_reference_rad=np.where(active, columns["reference_angle_rad"], np.nan),
        cycle_angle_rad=columns["angle_rad"],
        cycle_u1_V=columns["u1_V"],
        cycle_u2_V=columns["u2_V"],
        cycle_disturbance_rad_s2=columns["disturbance_rad_s2"],
        arrival_to_wake_us=columns["arrival_to_wake_us"],
        wake_to_decided_us=columns["wake_to_decided_us"],
        decided_to_sent_us=columns["decided_to_sent_us"],
        arrival_to_sent_us=columns["arrival_to_sent_us"],
        plant_time_s=none,
        plant_angle_rad=none,
        plant_disturbance_rad_s2=none,
        mode_changes=[
            (float(time_s[i]), modes[i]) for i in range(1, len(modes)) if modes[i] != modes[i - 1]
        ],
    )
