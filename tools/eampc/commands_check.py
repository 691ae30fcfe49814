"""`eampc check`: is everything ready? A checklist, before the air is on."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eampc.commands_operator import SocketOption
from eampc.errors import RunFailed
from eampc.rig_arguments import RigArgument, SetOption, VariantOption

if TYPE_CHECKING:
    from eampc.readiness.finding import Finding

BusOption = Annotated[
    str,
    typer.Option("--bus", metavar="URL", help="socketcan:can0 (or can0), or udp_multicast:…"),
]
SecondsOption = Annotated[
    float, typer.Option("--seconds", min=0.1, max=600.0, help="How long to listen, s.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="For scripts.")]


def register(app: typer.Typer) -> None:
    app.command(epilog="Example: eampc check rigs/reference --bus socketcan:can0")(check)


def check(
    rig: RigArgument,
    bus: BusOption,
    variant: VariantOption = None,
    changes: SetOption = None,
    seconds: SecondsOption = 2.0,
    socket: SocketOption = None,
    as_json: JsonOption = False,
) -> None:
    """Is everything ready: bus, machine, nodes?

    Listens only; nothing is sent. Interface state, bit rate and counters, frames that still wait in
    its queue, real-time limits, every message of the rig with rate, jitter, counter gaps and CRC
    errors, supply pressure; what is not as it should be comes with what to do. Exit status 1 if
    anything is not.
    """
    findings = _look(
        rig, variant, changes, bus if ":" in bus else f"socketcan:{bus}", seconds, socket
    )
    wrong = [finding for finding in findings if finding.ok is False]
    if as_json:
        ready = {"ready": not wrong, "findings": [finding.as_json() for finding in findings]}
        typer.echo(json.dumps(ready, indent=2, ensure_ascii=False))
    else:
        _show(findings)
    if wrong:
        raise RunFailed(f"{len(wrong)} of {len(findings)} lines are not as they should be")


def _look(
    rig_path: Path,
    variant: str | None,
    changes: list[str] | None,
    url: str,
    seconds: float,
    socket: Path | None,
) -> list[Finding]:
    from eampc_rig import (
        RigError,
        load_rig,
        open_bus,
        parse_bus_url,
        parse_override,
        resolve_frames,
    )

    from eampc.readiness.finding import Finding
    from eampc.readiness.interface import look_at_interface
    from eampc.readiness.machine import look_at_machine
    from eampc.readiness.traffic import judge_traffic, listen

    rig = load_rig(rig_path, variant, dict(parse_override(change) for change in changes or []))
    frames = resolve_frames(rig)
    address = parse_bus_url(url)
    findings = [Finding("rig", f"{rig.rig.name}, T = {1e3 * rig.control.period_s:g} ms", True)]
    findings += look_at_machine(socket)
    if address.transport == "socketcan":
        findings += look_at_interface(address.channel)
    else:
        findings.append(Finding("interface", f"{address}: emulation, no controller to look at"))
    try:
        with open_bus(url) as opened:
            findings += judge_traffic(rig, frames, listen(opened, seconds))
    except RigError as error:
        findings.append(Finding("traffic", str(error), False, "bring the bus up first"))
    return findings


def _show(findings: list[Finding]) -> None:
    from eampc.terminal import output_console

    console = output_console()
    for finding in findings:
        mark = {True: "✓", False: "✗", None: "·"}[finding.ok]
        console.print(f"{mark} {finding.topic}: {finding.found}", markup=False)
        if finding.remedy:
            console.print(f"    → {finding.remedy}", markup=False)
