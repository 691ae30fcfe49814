"""What a Monte-Carlo campaign found: table, JSON, Markdown, and the figure of a replayed trial."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rich.table import Table

from eampc.simulation import SimulationResult
from eampc.verification import CampaignSettings, Verification

# Index of a trial → the command line that replays it.
ReplayCommand = Callable[[int], str]

# More than this many indices are for --json and the report file, not for a terminal.
SHOWN_INDICES = 12


class WorstCase(NamedTuple):
    """The trial with the largest value of one column."""

    name: str
    column: str
    unit: str
    index: int
    value: float
    bound: float  # NaN: none is stated


_QUANTITIES = (
    ("largest angle", "angle_rad", "rad"),
    ("largest velocity", "velocity_rad_s", "rad/s"),
    ("largest tracking error, last quarter", "tracking_error_rad", "rad"),
    ("largest RMS tracking error", "rms_error_rad", "rad"),
    ("longest beyond the angle bound", "angle_violations", "cycles"),
    ("longest beyond the velocity bound", "velocity_violations", "cycles"),
    ("longest outside the parameter box", "outside_box", "cycles"),
    ("longest at an end of the control range", "saturated", "cycles"),
)
HARD_SENTENCES = {
    "range_violations": "voltages outside valve.min_V..max_V",
    "slew_violations": "voltage steps above valve.slew_max_V_per_s",
    "non_finite": "states or controls that are not a number",
}
_FIGURE_INCH = (8.0, 9.0)
_FIGURE_DPI = 120


def worst_cases(found: Verification) -> list[WorstCase]:
    """One trial per quantity; those that never occurred are left out."""
    bounds = {
        "angle_rad": found.settings.angle_bound_rad,
        "velocity_rad_s": found.settings.velocity_bound_rad_s,
    }
    rows = [
        WorstCase(name, column, unit, *found.worst(column), bounds.get(column, math.nan))
        for name, column, unit in _QUANTITIES
    ]
    return [row for row in rows if row.value > 0.0]


def verification_summary(found: Verification, command: ReplayCommand) -> dict[str, Any]:
    """Plain numbers, texts and lists, for --json."""
    settings = found.settings
    return {
        "trials": found.trials,
        "first_index": int(found.columns["index"][0]),
        "seed": settings.seed,
        "duration_s": settings.duration_s,
        "tolerances": settings.tolerances,
        "ranges": settings.ranges,
        "angle_bound_rad": settings.angle_bound_rad,
        "velocity_bound_rad_s": settings.velocity_bound_rad_s,
        "closed_loop_cycles": found.closed_loop_cycles,
        "cycles": int(found.columns["cycles"].sum()),
        "wall_seconds": found.wall_seconds,
        "core_seconds": found.core_seconds,
        "closed_loop_cycles_per_s_and_core": found.cycles_per_s_and_core,
        "hard_violations": found.hard_violations,
        "trials_beyond_state_bounds": found.beyond_state_bounds.tolist(),
        "cycles_beyond_angle_bound": int(found.columns["angle_violations"].sum()),
        "cycles_beyond_velocity_bound": int(found.columns["velocity_violations"].sum()),
        "trials_ended_by_a_fault": found.faulted.tolist(),
        "worst": [
            {
                "name": row.name,
                "index": row.index,
                "value": row.value,
                "unit": row.unit,
                "bound": None if math.isnan(row.bound) else row.bound,
                "replay": command(row.index),
            }
            for row in worst_cases(found)
        ],
    }


def worst_table(found: Verification) -> Table:
    """The worst trials, one line each."""
    table = Table(title="worst trials")
    for name in ("quantity", "value", "bound", "trial"):
        table.add_column(name, justify="left" if name == "quantity" else "right")
    for row in worst_cases(found):
        bound = "" if math.isnan(row.bound) else f"{row.bound:g} {row.unit}"
        table.add_row(row.name, f"{_number(row)} {row.unit}", bound, str(row.index))
    return table


def verdict_sentences(found: Verification) -> list[str]:
    """What held and what did not, a sentence each."""
    frames = int(found.columns["cycles"].sum())
    sentences = [
        f"{HARD_SENTENCES[name]}: {'none' if count == 0 else count} in {frames:,} frames"
        for name, count in found.hard_violations.items()
    ]
    for text, column in (
        (f"|θ| ≤ {found.settings.angle_bound_rad:g} rad", "angle_violations"),
        (f"|θ̇| ≤ {found.settings.velocity_bound_rad_s:g} rad/s", "velocity_violations"),
    ):
        counts = found.columns[column]
        trials, cycles = int((counts > 0).sum()), int(counts.sum())
        share = cycles / max(1, found.closed_loop_cycles)
        sentences.append(
            f"{text}: {'held in every trial' if trials == 0 else ''}"
            + (f"left in {trials:,} trials, {cycles:,} cycles ({share:.2%})" if trials else "")
        )
    if found.faulted.size:
        sentences.append(f"ended by a fault of the daemon: {indices(found.faulted)}")
    return sentences


def speed_sentence(found: Verification) -> str:
    """Cycles per second, and of what."""
    return (
        f"{found.trials:,} trials, {found.closed_loop_cycles:,} closed-loop cycles in "
        f"{found.wall_seconds:.2f} s; {found.cycles_per_s_and_core / 1e6:.2f} million closed-loop "
        "cycles per second of one core, arming included in the time"
    )


def campaign_sentences(settings: CampaignSettings) -> list[str]:
    """What the trials are drawn from."""
    ranges = settings.ranges
    tolerances = ", ".join(f"{name} ±{share}" for name, share in _percent(settings))
    return [
        f"plants: {tolerances}; uniform, every fourth at a corner of them",
        f"disturbance: |d| ≤ {ranges['disturbance_rad_s2']:g} rad/s², its rate ≤ "
        f"{ranges['disturbance_rate_rad_s3']:g} rad/s³ ([tightening]), a ramp and a sine",
        f"reference: steps up to {ranges['reference_step_rad']:g} rad and sines up to "
        f"{ranges['reference_velocity_rad_s']:g} rad/s, "
        f"within ±{ranges['reference_angle_rad']:g} rad",
        f"start: within ±{ranges['start_angle_rad']:g} rad and "
        f"±{ranges['start_velocity_rad_s']:g} rad/s of the rig's initial state, before arming",
        f"noise: standard deviation up to {ranges['encoder_noise_rad']:.3g} rad and "
        f"{ranges['velocity_noise_rad_s']:.3g} rad/s, then the encoder's own counts",
        f"seed {settings.seed}, {settings.duration_s:g} s with the law in charge",
    ]


def markdown_report(title: str, found: Verification, command: ReplayCommand) -> str:
    """The whole report: campaign, verdict, worst trials with their command lines, violations."""
    lines = [f"# {title}", "", speed_sentence(found) + ".", "", "## Campaign", ""]
    lines += [f"- {sentence}" for sentence in campaign_sentences(found.settings)]
    lines += ["", "## Verdict", ""]
    lines += [f"- {sentence}" for sentence in verdict_sentences(found)]
    lines += [
        "",
        "## Worst trials",
        "",
        "| quantity | value | bound | replay |",
        "|---|---|---|---|",
    ]
    for row in worst_cases(found):
        bound = "" if math.isnan(row.bound) else f"{row.bound:g} {row.unit}"
        lines.append(
            f"| {row.name} | {_number(row)} {row.unit} | {bound} | `{command(row.index)}` |"
        )
    lines += ["", "## Trials beyond the state bounds", ""]
    lines += _violation_table(found)
    return "\n".join(lines) + "\n"


def trial_figure(path: Path, run: SimulationResult, settings: CampaignSettings, title: str) -> None:
    """Angle, velocity, voltages and disturbance of one replayed trial over time."""
    figure = Figure(figsize=_FIGURE_INCH, dpi=_FIGURE_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(4, 1, sharex=True)
    time = run.scenario_time_s
    axes[0].plot(time, run.reference_angle_rad, "k--", lw=1.0, label=r"$y_r$")
    axes[0].plot(time, run.true_angle_rad, label=r"$\theta$")
    axes[1].plot(time, run.true_velocity_rad_s, label=r"$\dot\theta$")
    for axis, bound in (
        (axes[0], settings.angle_bound_rad),
        (axes[1], settings.velocity_bound_rad_s),
    ):
        for side in (-bound, bound):
            axis.axhline(side, color="tab:red", lw=0.8, label="bound" if side > 0.0 else None)
    axes[2].step(time, run.u1_V, where="post", label="$u_1$")
    axes[2].step(time, run.u2_V, where="post", label="$u_2$")
    axes[3].plot(time, run.true_disturbance_rad_s2, label="$d$")
    axes[3].plot(time, run.disturbance_rad_s2, lw=1.0, label=r"$\hat d$")
    labels = ("joint angle, rad", "velocity, rad/s", "valve voltages, V", "disturbance, rad/s²")
    for axis, label in zip(axes, labels, strict=True):
        axis.set_ylabel(label)
        axis.axvline(0.0, color="0.6", lw=0.8)
        axis.grid(alpha=0.3)
        axis.legend(loc="upper right", fontsize="small")
    active = np.flatnonzero(run.active)
    if active.size:
        # While arming, d̂ also carries what the model does not know of half-empty muscles.
        shown = run.disturbance_rad_s2[active], run.true_disturbance_rad_s2[active]
        low, high = min(map(np.min, shown)), max(map(np.max, shown))
        axes[3].set_ylim(low - 0.1 * (high - low) - 1.0, high + 0.1 * (high - low) + 1.0)
    axes[3].set_xlabel("time with the law in charge, s")
    axes[0].set_title(title)
    figure.savefig(path)


def _violation_table(found: Verification) -> list[str]:
    if not found.beyond_state_bounds.size:
        return ["None."]
    columns = found.columns
    rows = np.flatnonzero(np.isin(columns["index"], found.beyond_state_bounds))
    rows = rows[np.argsort(-columns["velocity_rad_s"][rows], kind="stable")]
    lines = [
        f"{len(rows)} of {found.trials}; the index is what `--replay` takes.",
        "",
        "| index | largest angle, rad | cycles | largest velocity, rad/s | cycles |",
        "|---|---|---|---|---|",
    ]
    for row in rows:
        lines.append(
            f"| {columns['index'][row]} | {columns['angle_rad'][row]:.4f} | "
            f"{columns['angle_violations'][row]} | {columns['velocity_rad_s'][row]:.3f} | "
            f"{columns['velocity_violations'][row]} |"
        )
    return lines


def _percent(settings: CampaignSettings) -> list[tuple[str, str]]:
    return [(name, f"{100.0 * ratio:g} %") for name, ratio in settings.tolerances.items()]


def _number(row: WorstCase) -> str:
    return f"{row.value:.0f}" if row.unit == "cycles" else f"{row.value:.4g}"


def indices(trials: np.ndarray) -> str:
    """The first of them, and how many more there are."""
    shown = ", ".join(map(str, trials[:SHOWN_INDICES]))
    return shown + (
        f" and {len(trials) - SHOWN_INDICES} more" if len(trials) > SHOWN_INDICES else ""
    )
