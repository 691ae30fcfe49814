"""Monte-Carlo of the closed loop in compiled code: the daemon's own control cycle against random
nonlinear plants.

Each trial draws its plant (uniform within the tolerances, every fourth at a corner of them), its
disturbance (a ramp and a sine that keep the bounds of [tightening] together), its reference (a step
or a sine inside the parameter box), its start and its noise from the campaign's seed and its own
index alone: any trial can be replayed bit for bit, on any number of threads or machines.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from eampc_rig import Rig, resolve_frames
from numpy.typing import NDArray

from eampc import _core
from eampc.errors import UserError
from eampc.law import Law
from eampc.law_design import parameter_box, require_rig
from eampc.simulation import SimulationResult, require_law_of, simulated_plant, simulation_result

# Symbol of the model → half-width in `_core.PlantTolerances`, and its default: what one knows of a
# pneumatic joint before it is identified.
TOLERANCES: dict[str, tuple[str, float]] = {
    "J": ("moment_of_inertia", 0.2),
    "b": ("control_gain", 0.2),
    "b1": ("stiffness", 0.2),
    "b_v": ("viscous_damping", 0.5),
    "tau_v": ("valve_lag", 0.5),
}
# References keep this share of constraints.angle_max_rad: the loop must have room to overshoot.
REFERENCE_SHARE = 0.8
# Starts lie within these shares of the state bounds about the rig's initial state.
START_ANGLE_SHARE, START_VELOCITY_SHARE = 0.5, 0.25
# Progress and cancelling of a cluster go by chunks: a second or so of one core each.
CLUSTER_CHUNK = 2000

Columns = dict[str, NDArray[Any]]
Progress = Callable[[int], None]
# A broken one of these is a fault of the software, whatever the plant does.
HARD = ("range_violations", "slew_violations", "non_finite")
STATE = ("angle_violations", "velocity_violations")


@dataclass(frozen=True)
class CampaignSettings:
    """All that the trials depend on but the law: plain numbers, the same on every machine."""

    seed: int
    duration_s: float
    tolerances: dict[str, float]  # symbol → ratio
    ranges: dict[str, float]  # attributes of _core.TrialRanges
    plant: dict[str, Any]
    angle_bound_rad: float
    velocity_bound_rad_s: float

    def compiled(self) -> Any:
        """The same as `_core.Campaign`."""
        campaign = _core.Campaign(self.plant)
        tolerances, ranges = _core.PlantTolerances(), _core.TrialRanges()
        for symbol, ratio in self.tolerances.items():
            setattr(tolerances, TOLERANCES[symbol][0], ratio)
        for name, value in self.ranges.items():
            setattr(ranges, name, value)
        campaign.tolerances, campaign.ranges = tolerances, ranges
        for name in ("seed", "duration_s", "angle_bound_rad", "velocity_bound_rad_s"):
            setattr(campaign, name, getattr(self, name))
        return campaign


@dataclass(frozen=True)
class Verification:
    """A campaign's outcome: one entry per trial in every column, in the order of the indices.

    angle_rad, velocity_rad_s: largest |θ| and |θ̇|; tracking_error_rad: largest |θ − y_r| in the
    last quarter; rms_error_rad: of the same in the whole run; the counts are of cycles, those of
    `HARD` but non_finite of frames; fault is the daemon's number at the end.
    """

    settings: CampaignSettings
    columns: Columns
    wall_seconds: float
    core_seconds: float
    """Processor time of all threads together."""

    @property
    def trials(self) -> int:
        return len(self.columns["index"])

    @property
    def closed_loop_cycles(self) -> int:
        """Cycles with the law in charge; arming is not counted."""
        return int(self.columns["closed_loop_cycles"].sum())

    @property
    def cycles_per_s_and_core(self) -> float:
        """Closed-loop cycles per second of processor time, arming's time included."""
        return self.closed_loop_cycles / self.core_seconds

    @cached_property
    def hard_violations(self) -> dict[str, int]:
        """Frames or cycles that broke what must never break."""
        return {name: int(self.columns[name].sum()) for name in HARD}

    @cached_property
    def beyond_state_bounds(self) -> NDArray[np.int64]:
        """Indices of the trials in which θ or θ̇ left the law's bounds."""
        left = (self.columns["angle_violations"] > 0) | (self.columns["velocity_violations"] > 0)
        return self.columns["index"][left]

    @cached_property
    def faulted(self) -> NDArray[np.int64]:
        """Indices of the trials that the daemon ended by itself."""
        return self.columns["index"][self.columns["fault"] != 0]

    def worst(self, column: str) -> tuple[int, float]:
        """(index, value) of the trial with the largest value of a column; the first of equals."""
        values = self.columns[column]
        row = int(np.argmax(values))
        return int(self.columns["index"][row]), float(values[row])


def campaign_settings(
    rig: Rig,
    *,
    seconds: float = 2.0,
    seed: int = 1,
    tolerances: Mapping[str, float] | None = None,
) -> CampaignSettings:
    """What `verify` and `replay` run: defaults of the rig, tolerances (ratios by symbol) on top.

    Raises UserError for a symbol that does not exist, a ratio outside 0..1 or a duration of less
    than four periods.
    """
    require_rig(rig)
    given = dict(tolerances or {})
    for symbol, ratio in given.items():
        if symbol not in TOLERANCES:
            raise UserError(f"no tolerance is called {symbol}; there are {', '.join(TOLERANCES)}")
        if not 0.0 <= ratio < 1.0:
            raise UserError(f"the tolerance of {symbol} is {ratio:g}; give 0 % to below 100 %")
    if not 4.0 * rig.control.period_s <= seconds <= 3600.0:
        raise UserError(f"a trial cannot last {seconds:g} s; give four periods to 3600 s")
    if not 0 <= seed < 2**64:
        raise UserError(f"the seed {seed} is outside 0..2^64 - 1")
    if rig.model.valve_time_constant_s is None and rig.emulator.valve_time_constant_s is None:
        if given.get("tau_v"):
            raise UserError(f"{rig.file}: the rig's valves are ideal; leave out tau_v")
        given["tau_v"] = 0.0
    return CampaignSettings(
        seed=seed,
        duration_s=seconds,
        tolerances={symbol: given.get(symbol, default) for symbol, (_, default) in _items()},
        ranges=_ranges(rig),
        plant={**simulated_plant(rig), "encoder_noise_rad": 0.0, "velocity_noise_rad_s": 0.0},
        angle_bound_rad=rig.constraints.angle_max_rad,
        velocity_bound_rad_s=rig.constraints.velocity_max_rad_s,
    )


def verify(
    rig: Rig,
    law: Law,
    settings: CampaignSettings,
    trials: int = 10_000,
    *,
    first: int = 0,
    threads: int = 0,
    progress: Progress | None = None,
    scheduler: str | None = None,
) -> Verification:
    """Run trials `first` .. `first + trials - 1`; 0 threads means one per core.

    `progress` is called with the number of trials done. `scheduler` is the address of a Dask
    scheduler: its workers share the trials, the result is the same. Raises UserError if the law is
    of another rig, RunFailed if the cluster fails.
    """
    require_law_of(rig, law)
    started = time.perf_counter()
    if scheduler is None:
        columns, core_seconds = _core.run_campaign(
            law.checked, settings.compiled(), first, trials, threads, progress
        )
    else:
        from eampc.verification_cluster import run_on_cluster

        columns, core_seconds = run_on_cluster(
            scheduler, law.to_bytes(), settings, first, trials, threads, progress
        )
    return Verification(settings, columns, time.perf_counter() - started, core_seconds)


def replay(
    rig: Rig, law: Law, settings: CampaignSettings, index: int
) -> tuple[Verification, SimulationResult, dict[str, Any]]:
    """One trial again, bit for bit: its row, its cycles, and what it drew."""
    require_law_of(rig, law)
    if index < 0:
        raise UserError(f"there is no trial {index}; indices begin with 0")
    started = time.perf_counter()
    campaign = settings.compiled()
    row, cycles = _core.replay_trial(law.checked, campaign, index)
    seconds = time.perf_counter() - started
    drawn = _core.trial_of(law.checked, campaign, index)
    return Verification(settings, row, seconds, seconds), simulation_result(cycles), drawn


def _items() -> list[tuple[str, tuple[str, float]]]:
    return list(TOLERANCES.items())


def _ranges(rig: Rig) -> dict[str, float]:
    tightening, limits, box = rig.tightening, rig.constraints, rig.parameter_box
    theorem = tightening.kind == "theorem"
    # b_δ and b_δt bound d and its rate whatever the state is; the rest of Assumption 2.2 only adds.
    level = tightening.bound_delta_rad_s2 if theorem else tightening.disturbance_max_rad_s2
    rate = tightening.bound_delta_t_rad_s3 if theorem else tightening.disturbance_rate_max_rad_s3
    reference = REFERENCE_SHARE * limits.angle_max_rad
    names = {parameter.name for parameter in parameter_box(rig)}
    angle_noise, velocity_noise = _noise(rig)
    return {
        "disturbance_rad_s2": level or 0.0,
        "disturbance_rate_rad_s3": rate or 0.0,
        "start_angle_rad": START_ANGLE_SHARE * limits.angle_max_rad,
        "start_velocity_rad_s": START_VELOCITY_SHARE * limits.velocity_max_rad_s,
        "reference_angle_rad": reference,
        "reference_step_rad": min(box.angle_error_max_rad or math.inf, 2.0 * reference),
        "reference_velocity_rad_s": (box.reference_velocity_max_rad_s or 0.0)
        if "reference_velocity" in names
        else limits.velocity_max_rad_s,
        "encoder_noise_rad": angle_noise,
        "velocity_noise_rad_s": velocity_noise,
    }


def _noise(rig: Rig) -> tuple[float, float]:
    """Largest standard deviations: the emulator's, or one count of the signal where it has none."""
    encoder = resolve_frames(rig).encoder
    velocity = (
        abs(encoder.signal_layout("velocity")["factor"]) if "velocity" in encoder.roles else 0.0
    )
    return (
        rig.emulator.encoder_noise_rad or abs(encoder.signal_layout("angle")["factor"]),
        rig.emulator.velocity_noise_rad_s or velocity,
    )
