"""The page that puts our figures beside the paper's numbers, and the same as JSON."""

from __future__ import annotations

import importlib.metadata
import json
import platform
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

from eampc.reproduce.document import (
    Block,
    Heading,
    Paragraph,
    Picture,
    Points,
    as_html,
    as_markdown,
)
from eampc.reproduce.paper_assumptions import assumptions, differences
from eampc.reproduce.paper_figures import PaperFigure
from eampc.reproduce.paper_runs import CaseResult, Curve
from eampc.reproduce.paper_tables import curve_table, in_mrad, step_table, time_table

TITLE = "EAMPC and min-max MPC: the paper's two cases, reproduced"

Figures = dict[int, list[PaperFigure]]


def write_page(results: Sequence[CaseResult], figures: Figures, folder: Path) -> Path:
    """index.html, README.md and summary.json in `folder`; returns the path of index.html."""
    blocks = _blocks(results, figures)
    (folder / "README.md").write_text(as_markdown(TITLE, blocks, folder), encoding="utf-8")
    summary = json.dumps(summary_of(results), indent=2, ensure_ascii=False)
    (folder / "summary.json").write_text(summary + "\n", encoding="utf-8")
    page = folder / "index.html"
    page.write_text(as_html(TITLE, blocks), encoding="utf-8")
    return page


def summary_of(results: Sequence[CaseResult]) -> dict[str, Any]:
    """Every figure of the page for programs; SI units in the names, runs in order."""
    return {
        "machine": machine(),
        "cases": {str(result.case.number): _case_summary(result) for result in results},
    }


def machine() -> dict[str, str]:
    """What the running times belong to."""
    return {
        "processor": _processor(),
        "python": platform.python_version(),
        "clarabel": importlib.metadata.version("clarabel"),
        "eampc": importlib.metadata.version("eampc"),
    }


def _case_summary(result: CaseResult) -> dict[str, Any]:
    return {
        "seconds": result.seconds,
        "steps": result.steps,
        "settles": result.settles,
        "disturbance_max_rad_s2": result.problem.disturbance_max_rad_s2,
        "curves": {
            name: _curve_summary(curve)
            for name, curve in (
                ("tracking", result.tracking),
                ("paper", result.printed),
                ("min_max", result.min_max),
            )
        },
        "processor_time_s": {
            "paper_printed": {
                "eampc": list(result.case.eampc_s),
                "min_max": list(result.case.min_max_s),
            },
            "tracking": [t.estimators_and_law_s for t in result.tracking_times],
            "tracking_whole_cycle": [t.control_cycle_s for t in result.tracking_times],
            "paper": [t.estimators_and_law_s for t in result.printed_times],
            "paper_whole_cycle": [t.control_cycle_s for t in result.printed_times],
            "min_max": [t.total_s for t in result.min_max_times],
            "min_max_in_clarabel": [t.solver_s for t in result.min_max_times],
        },
        "ratio": list(result.ratios),
        "min_max": {
            "quadratic_programs": [t.solutions for t in result.min_max_times],
            "most_vertices": result.min_max_vertices,
            "largest_slack": result.min_max_slack,
            "by_active_set": result.active_set and result.active_set._asdict(),
        },
    }


def _curve_summary(curve: Curve) -> dict[str, float]:
    return {
        "final_error_rad": curve.final_error_rad,
        "settling_time_s": curve.settling_time_s,
        "overshoot_rad": curve.overshoot_rad,
        "largest_velocity_rad_s": float(abs(curve.velocity_rad_s).max()),
        "largest_control": float(abs(curve.control).max()),
        "control_travel_first_second": curve.control_travel(0.0, 1.0),
        "control_travel_after": curve.control_travel(1.0),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def _blocks(results: Sequence[CaseResult], figures: Figures) -> list[Block]:
    of = machine()
    blocks: list[Block] = [
        Points(tuple(_finding(result) for result in results)),
        Paragraph(
            "Both controllers ran in turn on one core of the same machine, in the same closed loop "
            f"({of['processor']}; Python {of['python']}, Clarabel {of['clarabel']}, eampc "
            f"{of['eampc']}). An EAMPC step is the daemon's compiled code; a min-max step is a "
            "Python loop around compiled parts, of which Clarabel takes the most: the tables say "
            "how much."
        ),
    ]
    for result in results:
        case = result.case
        blocks += [
            Heading(f"Case {case.number}: {case.set_up}"),
            *(
                Picture(figure.path, f"Fig. {figure.number}. {figure.caption}")
                for figure in figures[case.number]
            ),
            curve_table(result),
            Points(differences(result)),
            time_table(result),
            step_table(result),
        ]
    blocks += [Heading("What had to be assumed"), Points(assumptions(results))]
    return blocks


def _finding(result: CaseResult) -> str:
    tracking, printed, min_max = (
        in_mrad(curve.final_error_rad)
        for curve in (result.tracking, result.printed, result.min_max)
    )
    return (
        f"Case {result.case.number}: a min-max step (by Clarabel) takes "
        f"{median(result.ratios):,.0f} times as long as an EAMPC step (estimators and law; the "
        "paper: 24 times). After "
        f"{result.seconds:g} s θ is {tracking} mrad from y_r with the offset-free law, "
        f"{printed} mrad with the law as printed, {min_max} mrad with min-max MPC."
    )
