"""Did the run meet the rig file's tolerances? Truth of the emulator against the scenario's
reference.

The reference is computed here from the rig file, not taken from the daemon, so that a daemon that
follows the wrong reference, or the right one late, fails. Angles rad, times s of the scenario (0 =
ACTIVE began).
"""

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from eampc_rig import Rig, Scenario
from numpy.typing import NDArray

from eampc.hil.recording import Recording

# |mean error| over this last stretch is the steady error: long enough to average the encoder's
# counts.
FINAL_WINDOW_S = 0.2
# The frame's voltages are whole millivolts; this only covers the last bit of their conversion.
VOLTAGE_SLACK_V = 1e-9
NO_FAULT = {"", "none", "0", "0.0"}

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Judged:
    """One demand on the run: `value` must not exceed `limit`, or not fall below it."""

    name: str
    value: float
    limit: float
    unit: str
    at_least: bool = False

    @property
    def met(self) -> bool:
        # NaN meets nothing.
        return bool(self.value >= self.limit if self.at_least else self.value <= self.limit)


@dataclass(frozen=True)
class Assessment:
    """Figures of one scenario; `passed` if every demand is met.

    The bounds on angle and velocity are told beside it: they are soft in the law, and a tolerance
    of the rig file is what a run must meet.

    RMS and maximum error are over scenario times from tolerance.rms_from_s to the end; the final
    error is |mean error| over the last 0.2 s. u1, u2 are extremes while the law was at work; the
    all_frames pair is over every command frame, arming and stopping included. A missed cycle is an
    encoder frame of the scenario that no valve command answered before the next one, whosoever's
    fault; a deadline overrun is a cycle in which the daemon itself took longer than a period.
    """

    rms_error_rad: float
    max_error_rad: float
    final_error_rad: float
    missed_cycles: int
    u1_min_V: float
    u1_max_V: float
    u2_min_V: float
    u2_max_V: float
    passed: bool
    bounds_held: bool
    all_frames_min_V: float
    all_frames_max_V: float
    angle_max_abs_rad: float
    velocity_max_abs_rad_s: float
    disturbance_error_rms_rad_s2: float
    faults: list[str]
    modes_in_scenario: list[str]
    limited_cycles: int
    deadline_overruns: int
    arrival_to_sent_p50_us: float
    arrival_to_sent_p99_us: float
    arrival_to_sent_max_us: float
    demands: list[Judged] = field(default_factory=list)
    bounds: list[Judged] = field(default_factory=list)

    def as_summary(self) -> dict[str, Any]:
        """Plain values for summary.json."""
        summary = asdict(self)
        for name, entries in (("demands", self.demands), ("bounds", self.bounds)):
            summary[name] = [{**asdict(entry), "met": entry.met} for entry in entries]
        return summary


def error_figures(time_s: Array, error_rad: Array, rms_from_s: float) -> tuple[float, float, float]:
    """(RMS, maximum of |error|) from `rms_from_s` on, and |mean error| over the last 0.2 s; all
    rad.
    """
    if len(time_s) == 0:
        return np.nan, np.nan, np.nan
    window = error_rad[time_s >= rms_from_s - 1e-9]
    if len(window) == 0:
        window = np.array([np.nan])
    last = error_rad[time_s > time_s[-1] - FINAL_WINDOW_S + 1e-9]
    return (
        float(np.sqrt(np.mean(window**2))),
        float(np.max(np.abs(window))),
        float(abs(np.mean(last))),
    )


def scenario_rows(time_s: Array, duration_s: float, period_s: float) -> NDArray[np.bool_]:
    """True for the periods of the scenario: 0 ≤ t < duration."""
    return (time_s > -0.5 * period_s) & (time_s < duration_s - 0.5 * period_s)


def missed_cycles(truth: Recording) -> int:
    """Encoder frames without a valve command before the next encoder frame was due."""
    return int(np.count_nonzero(~np.isfinite(truth["answered_monotonic_s"])))


def assess(
    rig: Rig,
    scenario_name: str,
    reference_rad: Array,
    truth: Recording,
    record: Recording,
    lockstep: bool = True,
) -> Assessment:
    """Figures and verdict of one run.

    reference_rad  the scenario's angle at the truth's rows, all rows
    truth          the emulator's log, all frames
    record         the daemon's log, all cycles
    lockstep       no cycle may be missed; in real time missed cycles are told, and their effect on
                   the errors judged: a late encoder frame may be the emulator's own fault
    """
    scenario = rig.scenarios[scenario_name]
    period_s = rig.control.period_s
    rows = scenario_rows(truth["scenario_time_s"], scenario.duration_s, period_s)
    during = truth.where(rows)
    cycles = record.where(scenario_rows(record["scenario_time_s"], scenario.duration_s, period_s))
    error = during["angle_rad"] - reference_rad[rows]
    rms, largest, final = error_figures(
        during["scenario_time_s"], error, scenario.tolerance.rms_from_s
    )
    # Afterwards the rig is on its own, and not every rig comes to rest by itself.
    until_the_end = record["cycle"] <= (during["frame"][-1] if len(during) else -1)
    all_u = np.concatenate([record["u1_V"], record["u2_V"]])
    values = {
        "rms_error_rad": rms,
        "max_error_rad": largest,
        "final_error_rad": final,
        "missed_cycles": missed_cycles(during),
        "u1_min_V": _least(cycles["u1_V"]),
        "u1_max_V": -_least(-cycles["u1_V"]),
        "u2_min_V": _least(cycles["u2_V"]),
        "u2_max_V": -_least(-cycles["u2_V"]),
        "all_frames_min_V": _least(all_u),
        "all_frames_max_V": -_least(-all_u),
        "angle_max_abs_rad": -_least(-np.abs(during["angle_rad"])),
        "velocity_max_abs_rad_s": -_least(-np.abs(during["velocity_rad_s"])),
        "disturbance_error_rms_rad_s2": _disturbance_error(during, cycles),
        "faults": sorted({str(fault) for fault in record["fault"][until_the_end]} - NO_FAULT),
        "modes_in_scenario": sorted({str(mode) for mode in cycles["mode"]}),
        "limited_cycles": _limited(cycles),
        "deadline_overruns": int(np.count_nonzero(cycles["arrival_to_sent_us"] > 1e6 * period_s)),
        **_latency(cycles),
    }
    demands = _demands(rig, scenario, values)
    unseen = round(scenario.duration_s / period_s) - len(error)
    demands.append(Judged("frames not sent", max(0, unseen), 0, ""))
    if lockstep:
        demands.append(Judged("missed cycles", values["missed_cycles"], 0, ""))
    bounds = _bounds(rig, values)
    return Assessment(
        passed=all(demand.met for demand in demands),
        bounds_held=all(bound.met for bound in bounds),
        demands=demands,
        bounds=bounds,
        **values,
    )


def _demands(rig: Rig, scenario: Scenario, values: dict[str, Any]) -> list[Judged]:
    tolerance, valve = scenario.tolerance, rig.valve
    demands = [
        Judged(name, values[key], limit, "rad")
        for name, key, limit in (
            ("RMS error", "rms_error_rad", tolerance.rms_error_max_rad),
            ("largest error", "max_error_rad", tolerance.max_error_max_rad),
            ("final error", "final_error_rad", tolerance.final_error_max_rad),
        )
        if limit is not None
    ]
    highest_V, lowest_V = valve.max_V + VOLTAGE_SLACK_V, valve.min_V - VOLTAGE_SLACK_V
    return [
        *demands,
        Judged("highest voltage", values["all_frames_max_V"], highest_V, "V"),
        Judged("lowest voltage", values["all_frames_min_V"], lowest_V, "V", at_least=True),
        Judged("faults", len(values["faults"]), 0, ""),
    ]


def _bounds(rig: Rig, values: dict[str, Any]) -> list[Judged]:
    bounds = rig.constraints
    return [
        Judged("|angle|", values["angle_max_abs_rad"], bounds.angle_max_rad, "rad"),
        Judged("|velocity|", values["velocity_max_abs_rad_s"], bounds.velocity_max_rad_s, "rad/s"),
    ]


def _least(values: Array) -> float:
    return float(np.min(values)) if len(values) else float("nan")


def _limited(cycles: Recording) -> int:
    if "limits" not in cycles or len(cycles) == 0:
        return 0
    limits = cycles["limits"]
    if limits.dtype.kind == "f":
        return int(np.count_nonzero(limits))
    return int(np.count_nonzero(~np.isin(limits, ["", "0", "none"])))


def _disturbance_error(during: Recording, cycles: Recording) -> float:
    _, true_rows, cycle_rows = np.intersect1d(during["frame"], cycles["cycle"], return_indices=True)
    if len(true_rows) == 0:
        return float("nan")
    difference = cycles["disturbance_rad_s2"][cycle_rows] - during["disturbance_rad_s2"][true_rows]
    return float(np.sqrt(np.mean(difference**2)))


def _latency(cycles: Recording) -> dict[str, float]:
    sent = cycles["arrival_to_sent_us"]
    sent = sent[np.isfinite(sent)]
    if len(sent) == 0:
        sent = np.array([np.nan])
    return {
        "arrival_to_sent_p50_us": float(np.percentile(sent, 50)),
        "arrival_to_sent_p99_us": float(np.percentile(sent, 99)),
        "arrival_to_sent_max_us": float(np.max(sent)),
    }
