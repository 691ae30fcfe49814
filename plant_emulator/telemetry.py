"""The truth as LCM messages on channel EAMPC_PLANT, one per encoder frame."""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Callable
from typing import Any

from eampc_rig.rig_error import RigError

from plant_emulator.truth_log import COLUMNS, TruthRow

CHANNEL = "EAMPC_PLANT"
NO_LCM = "none"
_INDEX = {name: index for index, name in enumerate(COLUMNS)}
# Fields of plant_t that are columns of the truth log as they stand.
_FIELDS = (
    "scenario_time_s",
    "angle_rad",
    "velocity_rad_s",
    "disturbance_rad_s2",
    "u1_V",
    "u2_V",
    "pressure1_kPa",
    "pressure2_kPa",
    "torque_N_m",
)


class _LibraryChatter:
    """Keeps what the LCM library itself prints on standard error: a paragraph on routes where one
    sentence will do."""

    def __enter__(self) -> _LibraryChatter:
        sys.stderr.flush()
        self._kept = tempfile.TemporaryFile()
        self._stderr = os.dup(2)
        os.dup2(self._kept.fileno(), 2)
        return self

    def __exit__(self, *_: object) -> None:
        os.dup2(self._stderr, 2)
        os.close(self._stderr)
        self._kept.close()

    def first_line(self) -> str:
        """Return the first line printed so far, or nothing."""
        self._kept.seek(0)
        lines = self._kept.read().decode("utf-8", "replace").split("\n")
        return lines[0].strip()


class Telemetry:
    """Publishes rows of the truth log; a network that refuses is reported once, then left alone."""

    def __init__(self, url: str, warn: Callable[[str], None]) -> None:
        """Open LCM at `url`; "none" publishes nothing.

        Raises RigError if the LCM types are not installed or LCM refuses the URL.
        """
        self._url = url
        self._warn = warn
        self._lcm: Any = None
        self._plant_t: Any = None
        if url == NO_LCM:
            return
        try:
            import lcm
            from eampc_lcm import plant_t
        except ImportError as error:
            raise RigError(
                f"LCM telemetry needs the module {error.name}, which is not installed; install "
                "eampc, or give --lcm-url none"
            ) from None
        with _LibraryChatter() as chatter:
            try:
                self._lcm = lcm.LCM(url)
            except (RuntimeError, OSError) as error:
                raise RigError(
                    f'LCM cannot be opened at "{url}" ({chatter.first_line() or error}); check '
                    "the URL and the multicast route, or give --lcm-url none"
                ) from None
        self._plant_t = plant_t

    def publish(self, row: TruthRow) -> None:
        """Publish one row of the truth log."""
        if self._lcm is None:
            return
        message = self._plant_t()
        message.utime = time.time_ns() // 1000
        message.frame = int(row[_INDEX["frame"]])
        message.valve_node_safe = bool(row[_INDEX["valve_node_safe"]])
        for name in _FIELDS:
            setattr(message, name, row[_INDEX[name]])
        try:
            self._lcm.publish(CHANNEL, message.encode())
        except (RuntimeError, OSError) as error:
            self._lcm = None
            self._warn(f'LCM at "{self._url}" does not take messages ({error}); going on without')
