"""The report folder: summary.json for programs, index.html for people, a table for the terminal."""

import html
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from eampc_rig import Rig, Tolerance
from rich.table import Table

from eampc.hil.assessment import Judged, scenario_rows
from eampc.hil.fault_report import fault_section
from eampc.hil.figures import LoopData, write_figures
from eampc.hil.scenario_run import ScenarioRun

MRAD = 1e3

STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.5 system-ui, sans-serif; color: #222; margin: 2rem auto; max-width: 76rem;
  padding: 0 1rem; }
h1 { font-size: 1.5rem; margin-bottom: .2rem; }
h2 { margin-top: 2.5rem; border-top: 1px solid #ddd; padding-top: 1rem; }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums; }
th, td { padding: .3rem .8rem; border-bottom: 1px solid #ddd; text-align: right; }
th { font-weight: 600; vertical-align: bottom; }
th:first-child, td:first-child { text-align: left; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: .1rem 1rem; }
dt { color: #666; }
dd { margin: 0; overflow-wrap: anywhere; }
img { max-width: 100%; height: auto; display: block; margin: .6rem 0; }
.ok { color: #00704f; font-weight: 600; }
.bad { color: #b33000; font-weight: 600; }
li.ok { font-weight: 400; }
.note { color: #666; }
"""


@dataclass(frozen=True)
class Circumstances:
    """What the reader must know to repeat the run."""

    rig_name: str
    variant: str | None
    changes: tuple[str, ...]
    emulator_changes: tuple[str, ...]
    bus_url: str
    lockstep: bool
    law: Path
    inputs_sha256: str
    version: str


def loop_data(rig: Rig, run: ScenarioRun) -> LoopData:
    """The curves of one scenario, its arming and stopping left out."""
    scenario, period_s = rig.scenarios[run.name], rig.control.period_s
    rows = scenario_rows(run.truth["scenario_time_s"], scenario.duration_s, period_s)
    truth = run.truth.where(rows)
    cycles = run.record.where(
        scenario_rows(run.record["scenario_time_s"], scenario.duration_s, period_s)
    )
    modes, times = cycles["mode"], cycles["scenario_time_s"]
    return LoopData(
        title=f"{rig.rig.name}{f' ({rig.variant})' if rig.variant else ''}, {run.name}",
        cycle_time_s=times,
        cycle_reference_rad=cycles["reference_angle_rad"],
        cycle_angle_rad=cycles["angle_rad"],
        cycle_u1_V=cycles["u1_V"],
        cycle_u2_V=cycles["u2_V"],
        cycle_disturbance_rad_s2=cycles["disturbance_rad_s2"],
        arrival_to_wake_us=cycles["arrival_to_wake_us"],
        wake_to_decided_us=cycles["wake_to_decided_us"],
        decided_to_sent_us=cycles["decided_to_sent_us"],
        arrival_to_sent_us=cycles["arrival_to_sent_us"],
        plant_time_s=truth["scenario_time_s"],
        plant_reference_rad=run.reference_rad[rows],
        plant_angle_rad=truth["angle_rad"],
        plant_disturbance_rad_s2=truth["disturbance_rad_s2"],
        valve_range_V=(rig.valve.min_V, rig.valve.max_V),
        angle_max_rad=rig.constraints.angle_max_rad,
        error_window_from_s=scenario.tolerance.rms_from_s,
        error_limit_rad=scenario.tolerance.rms_error_max_rad,
        period_s=period_s,
        mode_changes=[
            (float(times[i]), str(modes[i]))
            for i in range(1, len(modes))
            if modes[i] != modes[i - 1]
        ],
    )


def write_report(
    rig: Rig, runs: Sequence[ScenarioRun], circumstances: Circumstances, folder: Path
) -> Path:
    """Figures, summary.json and index.html in `folder`; returns the page's path."""
    pictures = {run.name: write_figures(loop_data(rig, run), run.folder) for run in runs}
    summary = _summary(rig, runs, circumstances)
    (folder / "summary.json").write_text(
        json.dumps(_json_safe(summary), indent=2, ensure_ascii=False) + "\n", encoding="utf-8"
    )
    page = folder / "index.html"
    page.write_text(_page(rig, runs, circumstances, pictures, folder), encoding="utf-8")
    return page


def _summary(rig: Rig, runs: Sequence[ScenarioRun], of: Circumstances) -> dict[str, Any]:
    return {
        "rig": of.rig_name,
        "variant": of.variant,
        "changes": list(of.changes),
        "emulator_changes": list(of.emulator_changes),
        "bus": of.bus_url,
        "pace": "lock-step" if of.lockstep else "real time",
        "law_inputs_sha256": of.inputs_sha256,
        "version": of.version,
        "period_s": rig.control.period_s,
        "passed": all(run.assessment.passed for run in runs),
        "scenarios": {
            run.name: {
                **run.assessment.as_summary(),
                "daemon_peak_memory_MB": run.daemon_memory_MB,
                "daemon_counters": run.status.get("counters", {}),
                "seconds": round(run.seconds, 3),
                "faults": [verdict.as_summary() for verdict in run.verdicts],
                "wire": None if run.wire is None else asdict(run.wire),
            }
            for run in runs
        },
    }


def _json_safe(value: Any) -> Any:
    """JSON has no NaN: null instead."""
    if isinstance(value, dict):
        return {key: _json_safe(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_json_safe(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _rows(rig: Rig, runs: Sequence[ScenarioRun]) -> list[list[str]]:
    rows = []
    for run in runs:
        figures, tolerance = run.assessment, rig.scenarios[run.name].tolerance
        if run.verdicts:  # a joint that was stopped tracks nothing
            tolerance = Tolerance()
        rows.append(
            [
                run.name,
                _against(figures.rms_error_rad, tolerance.rms_error_max_rad),
                _against(figures.max_error_rad, tolerance.max_error_max_rad),
                _against(figures.final_error_rad, tolerance.final_error_max_rad),
                str(figures.missed_cycles),
                f"{figures.u1_min_V:.2f} to {figures.u1_max_V:.2f}",
                f"{figures.u2_min_V:.2f} to {figures.u2_max_V:.2f}",
                f"{figures.arrival_to_sent_p50_us:.0f} / {figures.arrival_to_sent_p99_us:.0f}",
                "passed" if figures.passed else "FAILED",
            ]
        )
    return rows


HEADINGS = (
    "Scenario", "RMS error\nmrad", "Max error\nmrad", "Final error\nmrad", "Missed\ncycles",
    "u1\nV", "u2\nV", "Answer µs\np50 / p99", "Result",
)  # fmt: skip


def _against(value_rad: float, limit_rad: float | None) -> str:
    text = f"{MRAD * value_rad:.3f}"
    return (
        text
        if limit_rad is None
        else f"{text} ≤ {MRAD * limit_rad:g}"
        if value_rad <= limit_rad
        else f"{text} > {MRAD * limit_rad:g}"
    )


def terminal_table(rig: Rig, runs: Sequence[ScenarioRun]) -> Table:
    table = Table()
    for number, heading in enumerate(HEADINGS):
        table.add_column(heading, justify="left" if number == 0 else "right", no_wrap=True)
    for run, row in zip(runs, _rows(rig, runs), strict=True):
        colour = "green" if run.assessment.passed else "red"
        table.add_row(*row[:-1], f"[{colour}]{row[-1]}[/{colour}]")
    return table


def unmet(run: ScenarioRun) -> list[str]:
    """One sentence per demand that the run did not meet."""
    return [
        f"{run.name}: {_demand_text(demand)}" for demand in run.assessment.demands if not demand.met
    ]


def left_bounds(run: ScenarioRun) -> list[str]:
    """One sentence per state bound of the rig that the joint left."""
    return [
        f"{run.name}: {_demand_text(bound)}" for bound in run.assessment.bounds if not bound.met
    ]


def _demand_text(demand: Judged) -> str:
    relation = {
        (True, False): "is within",
        (False, False): "exceeds",
        (True, True): "is not below",
        (False, True): "falls below",
    }[demand.met, demand.at_least]
    unit = f" {demand.unit}" if demand.unit else ""
    return f"{demand.name} {demand.value:.6g}{unit} {relation} {demand.limit:.6g}{unit}"


def _page(
    rig: Rig,
    runs: Sequence[ScenarioRun],
    of: Circumstances,
    pictures: dict[str, list[Path]],
    folder: Path,
) -> str:
    e = html.escape
    variant = f", variant {of.variant}" if of.variant else ""
    facts = {
        "Rig": f"{of.rig_name}{variant}: {rig.rig.description}",
        "Changes": ", ".join(of.changes) or "none",
        "Changes to the emulated rig only": ", ".join(of.emulator_changes) or "none",
        "Bus": of.bus_url,
        "Pace": "lock-step: the emulator waits for every answer, time is counted in frames"
        if of.lockstep
        else f"real time, {1 / rig.control.period_s:g} Hz",
        "Law": f"{of.law}, designed from inputs {of.inputs_sha256[:12]}",
        "Version": of.version,
        "Written": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
    }
    head = "".join(f"<th>{e(text).replace(chr(10), '<br>')}</th>" for text in HEADINGS)
    body = "".join(
        "<tr>"
        + "".join(f"<td>{e(cell)}</td>" for cell in row[:-1])
        + f'<td class="{"ok" if run.assessment.passed else "bad"}">{e(row[-1])}</td></tr>'
        for run, row in zip(runs, _rows(rig, runs), strict=True)
    )
    sections = "".join(_section(run, pictures[run.name], folder) for run in runs)
    passed = all(run.assessment.passed for run in runs)
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>eampc hil: {e(of.rig_name)}</title><style>{STYLE}</style></head><body>
<h1>Closed loop of {e(of.rig_name)}: <span class="{"ok" if passed else "bad"}">
{_headline(runs, passed)}</span></h1>
<p class="note">Real daemon, real bus, emulated rig. RMS and largest error count from the scenario's
<code>rms_from_s</code>; the final error is the mean over the last 0.2 s. d̂ holds all that the
linear model does not know: the real disturbance and the model's own error.</p>
<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>
<dl>{"".join(f"<dt>{e(name)}</dt><dd>{e(text)}</dd>" for name, text in facts.items())}</dl>
{sections}
<p class="note">All numbers: <a href="summary.json">summary.json</a>.</p>
</body></html>
"""


def _headline(runs: Sequence[ScenarioRun], passed: bool) -> str:
    if any(run.verdicts for run in runs):
        return "every fault answered" if passed else "a fault was not answered as it should be"
    return "every tolerance met" if passed else "a tolerance was not met"


def _section(run: ScenarioRun, pictures: Sequence[Path], folder: Path) -> str:
    e = html.escape
    figures = run.assessment
    demands = "".join(
        f'<li class="{"ok" if demand.met else "bad"}">{e(_demand_text(demand))}</li>'
        for demand in (*figures.demands, *figures.bounds)
    )
    images = "".join(
        f'<img src="{e(path.relative_to(folder).as_posix())}" alt="{e(run.name)}: {e(path.stem)}">'
        for path in pictures
    )
    name = run.folder.relative_to(folder).as_posix()
    memory = f"{run.daemon_memory_MB:.1f} MB" if run.daemon_memory_MB else "unknown"
    latency = " / ".join(
        f"{value:.0f}"
        for value in (
            figures.arrival_to_sent_p50_us,
            figures.arrival_to_sent_p99_us,
            figures.arrival_to_sent_max_us,
        )
    )
    logs = ", ".join(
        f'<a href="{e(name)}/{file}">{label}</a>'
        for file, label in (
            ("record.csv", "daemon"),
            ("truth.csv", "plant"),
            ("eampcd.log", "eampcd's output"),
            ("plant_emulator.log", "emulator's output"),
        )
    )
    return f"""<h2>{e(run.name)}</h2>{fault_section(run)}{images}
<ul>{demands}</ul>
<p class="note">Daemon's peak memory {memory}; answer p50 / p99 / max {latency} µs;
it took longer than a period in {figures.deadline_overruns} cycles; limits acted in
{figures.limited_cycles} cycles. Logs: {logs}.</p>
"""
