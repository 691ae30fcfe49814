"""Tables II and III: running time of five runs of either controller, the paper's and ours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean, median

from eampc.reproduce.paper_runs import CaseResult


@dataclass(frozen=True)
class Table:
    """A heading row and rows of text; the first column names the row."""

    title: str
    heading: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def time_table(result: CaseResult) -> Table:
    """Processor times, run by run, the paper's rows above ours."""
    case, runs = result.case, len(result.min_max_times)
    columns = max(runs, len(case.eampc_s))
    tracking_s = [times.estimators_and_law_s for times in result.tracking_times]
    printed_s = [times.estimators_and_law_s for times in result.printed_times]
    min_max_s = [times.total_s for times in result.min_max_times]
    rows = [
        _row("paper: EAMPC, s", case.eampc_s, ".2f", columns),
        _row("paper: min-max MPC, s", case.min_max_s, ".2f", columns),
        _row("paper: ratio", _ratios(case.eampc_s, case.min_max_s), ".1f", columns),
        _row("EAMPC (tracking), ms", [1e3 * s for s in tracking_s], ".3f", columns),
        _row("EAMPC (paper), ms", [1e3 * s for s in printed_s], ".3f", columns),
        _row("min-max MPC, ms", [1e3 * s for s in min_max_s], ".1f", columns),
        _row("ratio, min-max / tracking", result.ratios, ",.0f", columns),
        _row("ratio, min-max / paper", _ratios(printed_s, min_max_s), ",.0f", columns),
    ]
    heading = (
        "running time (ours: processor time)",
        *(f"run {k + 1}" for k in range(columns)),
        "median",
    )
    return Table(
        f"Table {case.table}: running time of two algorithms, case {case.number}, "
        f"{result.seconds:g} s of closed loop = {result.steps} steps",
        heading,
        tuple(rows),
    )


def step_table(result: CaseResult) -> Table:
    """One step of either controller, and where the time of the min-max step goes."""
    steps = result.steps
    times = result.min_max_times
    tracking = result.tracking_times
    min_max_s = median(t.total_s for t in times) / steps
    rows = []
    for name, eampc_s in (
        ("EAMPC: estimators and law", [t.estimators_and_law_s for t in tracking]),
        ("EAMPC: whole cycle, with frames and safety", [t.control_cycle_s for t in tracking]),
    ):
        step_s = median(eampc_s) / steps
        rows.append((name, f"{1e6 * step_s:.3f}", f"{min_max_s / step_s:,.0f}"))
    solver_s = median(t.solver_s for t in times) / steps
    rows += [
        ("min-max MPC: step", f"{1e6 * min_max_s:.1f}", "1"),
        ("min-max MPC: of it inside Clarabel", f"{1e6 * solver_s:.1f}", "–"),
        (
            "min-max MPC: longest step (solver set up for a new vertex)",
            f"{1e6 * max(t.longest_step_s for t in times):.0f}",
            "–",
        ),
    ]
    if result.active_set is not None:
        peer_s = result.active_set.mean_s
        eampc_s = median(t.estimators_and_law_s for t in tracking) / steps
        rows.append(
            (
                f"its program by DAQP, solver alone: {peer_s / eampc_s:,.0f} times the law",
                f"{1e6 * peer_s:.1f}",
                f"{min_max_s / peer_s:,.1f}",
            )
        )
    solutions = fmean(t.solutions for t in times) / steps
    return Table(
        f"One step, case {result.case.number} (EAMPC: tracking; {solutions:.3f} quadratic programs "
        f"per min-max step, at most {result.min_max_vertices} vertices)",
        (
            "processor time, mean over the steps, median of the runs",
            "µs",
            "min-max step is … times this",
        ),
        tuple(rows),
    )


def curve_table(result: CaseResult) -> Table:
    """What the curves of figures 2 to 9 come to."""
    rows = []
    for name, curve in (
        ("EAMPC, offset-free (tracking)", result.tracking),
        ("EAMPC, as printed (paper)", result.printed),
        ("min-max MPC", result.min_max),
    ):
        rows.append(
            (
                name,
                in_mrad(curve.final_error_rad),
                f"{curve.settling_time_s:.2f}",
                f"{1e3 * curve.overshoot_rad:.1f}",
                f"{abs(curve.velocity_rad_s).max():.2f}",
                f"{abs(curve.control).max():.1f}",
                f"{curve.control_travel(0.0, 1.0):.0f}",
                f"{curve.control_travel(1.0):.1f}",
            )
        )
    return Table(
        f"Curves, case {result.case.number}",
        (
            "controller",
            "final error, mrad",
            "settling time, s",
            "overshoot of y_r, mrad",
            "largest |θ̇|, rad/s",
            "largest |u|",
            "Σ|Δu| in the first second",
            "Σ|Δu| after",
        ),
        tuple(rows),
    )


def in_mrad(angle_rad: float) -> str:
    """Three digits, without the unit."""
    return f"{1e3 * angle_rad:.3g}".replace("-", "−")


def _ratios(fast: Sequence[float], slow: Sequence[float]) -> list[float]:
    return [b / a for a, b in zip(fast, slow, strict=True)]


def _row(name: str, values: Sequence[float], digits: str, columns: int) -> tuple[str, ...]:
    """Name, one cell per run, the median."""
    cells = [f"{value:{digits}}" for value in values]
    return (name, *cells, *[""] * (columns - len(cells)), f"{median(values):{digits}}")
