"""The closed loops of one case and their running times: EAMPC as printed, EAMPC without offset, and
min-max MPC, all on the same simulated joint behind the same encoder and valve frames.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from eampc_rig import Rig, load_rig
from numpy.typing import NDArray

from eampc import _core
from eampc.errors import UserError
from eampc.law import Law
from eampc.law_design import design
from eampc.reproduce.active_set_peer import PeerTimes, active_set_times
from eampc.reproduce.min_max_control import MinMaxControl, MinMaxStep
from eampc.reproduce.min_max_problem import MinMaxProblem
from eampc.reproduce.paper_cases import PaperCase
from eampc.simulation import simulate, simulated_plant

Array = NDArray[np.float64]
# Called with what is being done, how much of it is done, and the whole.
Progress = Callable[[str, int, int], None]

SCENARIO = "step"
# Mean over this last part of a run is its final error.
_FINAL_WINDOW_S = 0.2
_STEPS_PER_REPORT = 100
# (13), (14) as printed: the predictor with x held, and the estimate that settles at e^{−aT} d.
_AS_PRINTED = {"estimator.as_printed": True, "estimator.bias_compensation": False}


@dataclass(frozen=True)
class Curve:
    """One closed loop, an entry per period; angle and velocity are the joint's own."""

    time_s: Array
    angle_rad: Array
    velocity_rad_s: Array
    control: Array
    reference_rad: float

    @property
    def error_rad(self) -> Array:
        """Angle minus reference."""
        return self.angle_rad - self.reference_rad

    @property
    def final_error_rad(self) -> float:
        """Mean error over the last 0.2 s, with its sign."""
        late = self.time_s > self.time_s[-1] - _FINAL_WINDOW_S + 1e-9
        return float(np.mean(self.error_rad[late]))

    @property
    def settling_time_s(self) -> float:
        """From when on the angle stays within 2 % of the first distance about its final value."""
        distance = abs(self.angle_rad[0] - self.reference_rad)
        outside = np.abs(self.error_rad - self.final_error_rad) > 0.02 * distance
        return float(self.time_s[np.flatnonzero(outside)[-1]]) if outside.any() else 0.0

    @property
    def overshoot_rad(self) -> float:
        """How far the angle went beyond the reference, seen from the start."""
        direction = np.sign(self.reference_rad - self.angle_rad[0])
        return float(max(0.0, np.max(direction * self.error_rad)))

    def control_travel(self, from_s: float, to_s: float = np.inf) -> float:
        """Σ|Δu| over the steps that begin in [from_s, to_s): how smooth the input is."""
        steps = np.abs(np.diff(self.control))
        return float(steps[(self.time_s[:-1] >= from_s) & (self.time_s[:-1] < to_s)].sum())


@dataclass(frozen=True)
class EampcTimes:
    """Processor time of one run, seconds over all its periods."""

    estimators_and_law_s: float
    control_cycle_s: float  # with frames decoded and encoded, and safety


@dataclass(frozen=True)
class MinMaxTimes:
    """Processor time of one run, seconds over all its periods."""

    total_s: float
    solver_s: float  # of it, inside Clarabel
    solutions: int  # quadratic programs
    longest_step_s: float


@dataclass(frozen=True)
class CaseResult:
    """Curves and times of one case. Runs of the three controllers took turns."""

    case: PaperCase
    rig: Rig
    tracking_rig: Rig
    problem: MinMaxProblem
    seconds: float
    printed: Curve
    tracking: Curve
    min_max: Curve
    printed_times: tuple[EampcTimes, ...]
    tracking_times: tuple[EampcTimes, ...]
    min_max_times: tuple[MinMaxTimes, ...]
    active_set: PeerTimes | None  # the programs of the last run by another solver
    printed_pieces: int
    tracking_pieces: int
    min_max_vertices: int  # most rows of the epigraph in one step
    min_max_slack: float  # largest relative violation planned
    final_error_limits_rad: tuple[float, float]  # of the rig file: printed, tracking

    @property
    def steps(self) -> int:
        """Periods in one run."""
        return len(self.min_max.time_s)

    @property
    def ratios(self) -> tuple[float, ...]:
        """Min-max MPC over EAMPC (`tracking`, estimators and law), run by run."""
        pairs = zip(self.min_max_times, self.tracking_times, strict=True)
        return tuple(slow.total_s / fast.estimators_and_law_s for slow, fast in pairs)

    @property
    def settles(self) -> bool | None:
        """Whether both EAMPC curves end within the rig's tolerances; None for a run too short."""
        if self.seconds < self.rig.scenario(SCENARIO).duration_s:
            return None
        curves = zip((self.printed, self.tracking), self.final_error_limits_rad, strict=True)
        return all(abs(curve.final_error_rad) <= limit for curve, limit in curves)


def run_case(
    case: PaperCase, rigs: Path, seconds: float, runs: int, progress: Progress
) -> CaseResult:
    """Every run of one case; `rigs` is the folder that holds its rig."""
    folder = rigs / case.rig_name
    if not folder.is_dir():
        raise UserError(
            f"{folder}: no such rig; run eampc reproduce in the repository, or name the folder of "
            "the ready rigs with --rigs"
        )
    paper = load_rig(folder)
    printed = load_rig(folder, overrides=_AS_PRINTED)
    tracking = load_rig(folder, "tracking")
    progress("laws", 0, 2)
    printed_law = design(printed)
    progress("laws", 1, 2)
    tracking_law = design(tracking)
    progress("laws", 2, 2)
    problem = MinMaxProblem.of_rig(paper, printed_law)

    printed_times, tracking_times, loops = [], [], []
    for run in range(runs):
        printed_times.append(_eampc_times(printed, printed_law, seconds))
        tracking_times.append(_eampc_times(tracking, tracking_law, seconds))
        loop = _MinMaxLoop(paper, printed_law, problem, seconds)
        loop.run(_share_of(progress, run, runs))
        loops.append(loop)
    return CaseResult(
        case=case,
        rig=paper,
        tracking_rig=tracking,
        problem=problem,
        seconds=seconds,
        printed=_eampc_curve(printed, printed_law, seconds),
        tracking=_eampc_curve(tracking, tracking_law, seconds),
        min_max=loops[-1].curve,
        printed_times=tuple(printed_times),
        tracking_times=tuple(tracking_times),
        min_max_times=tuple(loop.times for loop in loops),
        active_set=loops[-1].by_active_set(),
        printed_pieces=len(printed_law.pieces[1]),
        tracking_pieces=len(tracking_law.pieces[1]),
        min_max_vertices=max(len(step.vertices) for step in loops[-1].decisions),
        min_max_slack=max(step.slack for step in loops[-1].decisions),
        final_error_limits_rad=(_error_limit_rad(printed), _error_limit_rad(tracking)),
    )


def _share_of(progress: Progress, run: int, runs: int) -> Callable[[int, int], None]:
    return lambda done, whole: progress("min-max runs", run * whole + done, runs * whole)


def _error_limit_rad(rig: Rig) -> float:
    limit = rig.scenario(SCENARIO).tolerance.final_error_max_rad
    return np.inf if limit is None else limit


def _disturbance(rig: Rig) -> list[dict[str, object]]:
    return [term.model_dump() for term in rig.scenario(SCENARIO).disturbance]


def _eampc_curve(rig: Rig, law: Law, seconds: float) -> Curve:
    lasting = load_rig(
        rig.file,
        rig.variant,
        {
            f"scenarios.{SCENARIO}.duration_s": seconds,
            f"scenarios.{SCENARIO}.tolerance.rms_from_s": 0.0,  # it must lie within the duration
        },
    )
    run = simulate(lasting, law, SCENARIO)
    active = run.active
    return Curve(
        time_s=run.scenario_time_s[active],
        angle_rad=run.true_angle_rad[active],
        velocity_rad_s=run.true_velocity_rad_s[active],
        control=run.control[active],
        reference_rad=float(run.reference_angle_rad[active][-1]),
    )


def _eampc_times(rig: Rig, law: Law, seconds: float) -> EampcTimes:
    times = _core.time_steps(
        law.checked,
        plant=simulated_plant(rig),
        disturbance=_disturbance(rig),
        duration_s=seconds,
        reference_rad=rig.scenario(SCENARIO).reference.amplitude_rad,
    )
    return EampcTimes(
        estimators_and_law_s=times["estimators_and_law_s"],
        control_cycle_s=times["control_cycle_s"],
    )


class _MinMaxLoop:
    """One run of the min-max controller; the law lends the frames of its rig."""

    def __init__(self, rig: Rig, law: Law, problem: MinMaxProblem, seconds: float) -> None:
        self._rig = rig
        self._joint = _core.JointOnBus(law.checked, simulated_plant(rig), _disturbance(rig))
        self._problem = problem
        self._steps = round(seconds / rig.control.period_s)
        self.decisions: list[MinMaxStep] = []
        self._measured: list[Array] = []

    def run(self, report: Callable[[int, int], None]) -> None:
        control = MinMaxControl(self._problem)
        joint, valve = self._joint, self._rig.valve
        rows, step_s = [], np.zeros(self._steps)
        for k in range(self._steps):
            if k % _STEPS_PER_REPORT == 0:
                report(k, self._steps)
            truth = (joint.time_s, joint.angle_rad, joint.velocity_rad_s)
            state = np.array(joint.measure())
            started = time.thread_time()
            step = control.step(state)
            step_s[k] = time.thread_time() - started
            difference_V = valve.control_gain_V * step.control
            joint.advance(valve.bias_V + difference_V, valve.bias_V - difference_V)
            rows.append((*truth, step.control))
            self._measured.append(state)
            self.decisions.append(step)
        report(self._steps, self._steps)
        self.curve = Curve(*np.array(rows).T, reference_rad=self._problem.reference_rad)
        self.times = MinMaxTimes(
            total_s=float(step_s.sum()),
            solver_s=sum(step.solver_s for step in self.decisions),
            solutions=sum(step.solutions for step in self.decisions),
            longest_step_s=float(step_s.max()),
        )

    def by_active_set(self) -> PeerTimes | None:
        """The run's programs by DAQP."""
        return active_set_times(self._problem, np.array(self._measured), self.decisions)
