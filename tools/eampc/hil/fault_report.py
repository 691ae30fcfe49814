"""The faults of a run as tables: for the terminal and for the page."""

import html
from collections.abc import Sequence

from rich.table import Table

from eampc.hil.fault_assessment import FaultVerdict
from eampc.hil.scenario_run import ScenarioRun

HEADINGS = ("Fault", "In state", "Seen after, cycles", "Action on the wire", "Latched")


def _cells(verdict: FaultVerdict) -> list[str]:
    seen = "never" if verdict.detected_cycles is None else str(verdict.detected_cycles)
    action = verdict.action
    if verdict.deviation_V is not None:
        within = f"{1e3 * verdict.deviation_V:.1f} mV"
        action = f"{action}, within {within}" if verdict.deviation_V < 1.0 else f"not {action}"
    elif verdict.detected_cycles is not None:
        action = "at rest already"
    return [
        f"{verdict.name}"
        if verdict.name == verdict.raised
        else f"{verdict.name} (as {verdict.raised})",
        verdict.state,
        f"{seen} ≤ {verdict.limit_cycles}",
        action,
        "yes" if verdict.latched else "no",
    ]


def fault_table(runs: Sequence[ScenarioRun]) -> Table:
    """One row per fault of every run."""
    table = Table("Scenario", *HEADINGS)
    for run in runs:
        for verdict in run.verdicts:
            table.add_row(run.name, *_cells(verdict))
    return table


def fault_section(run: ScenarioRun) -> str:
    """The faults of one run as HTML; nothing where there were none."""
    if not run.verdicts or run.wire is None:
        return ""
    e = html.escape
    head = "".join(f"<th>{e(heading)}</th>" for heading in HEADINGS)
    body = "".join(
        "<tr>" + "".join(f"<td>{e(cell)}</td>" for cell in _cells(verdict)) + "</tr>"
        for verdict in run.verdicts
    )
    wire = run.wire
    events = "".join(f"<li>{e(text)}</li>" for text in run.faults)
    return f"""<p>Faults on demand; the run is judged by how the daemon stops, not by its
tracking.</p><ul>{events}</ul>
<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>
<p>Of {wire.frames} command frames on the wire {wire.voltage_violations} left the valves' range,
{wire.slew_violations} the slew limit, {wire.invalid_frames} had a wrong length or CRC; automatic
resumes: {wire.automatic_resumes}.</p>
"""
