"""`eampc hil` and `eampc demo`: the closed loop of daemon and emulated rig, judged against the
rig's tolerances.
"""

import importlib.metadata
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eampc.rig_arguments import RigArgument, SetOption, VariantOption

if TYPE_CHECKING:
    from eampc_rig import Rig

DEFAULT_MULTICAST = "udp_multicast:239.74.163.2:43113"

ScenarioOption = Annotated[
    str,
    typer.Option("--scenario", metavar="NAME|all", help="Scenario of the rig file, or all."),
]
SetEmulatorOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set-emulator",
        metavar="KEY=VALUE",
        help="Change one key of the emulated rig only: a model error; repeatable.",
    ),
]
OutOption = Annotated[
    Path | None,
    typer.Option("--out", metavar="DIR", help="Report folder. Default: reports/RIG[-VARIANT]."),
]
LawOption = Annotated[
    Path | None,
    typer.Option(
        "--law", metavar="FILE", help="Law file. Default: designed once, kept in ~/.cache/eampc."
    ),
]
LcmOption = Annotated[
    str | None,
    typer.Option("--lcm-url", metavar="URL|none", help="Telemetry. Default: the rig file's."),
]
CandumpOption = Annotated[
    Path | None,
    typer.Option("--candump", metavar="FILE", help="Record the bus in the format of candump -L."),
]
FaultOption = Annotated[
    list[str] | None,
    typer.Option(
        "--fault",
        metavar="NAME@T[..T2]|list",
        help="Let a fault happen at scenario time T (until T2), in s; repeatable. The run is then "
        "judged by how the daemon stops. list: all of them, and what happens.",
    ),
]


def register(app: typer.Typer) -> None:
    app.command(
        epilog="Example: eampc hil rigs/reference --scenario all "
        "--bus udp_multicast:239.74.163.2:43113 --out reports/today"
    )(hil)
    app.command(epilog="Example: eampc demo rigs/reference --real-time")(demo)


def hil(
    rig: RigArgument,
    scenario: ScenarioOption = "all",
    bus: Annotated[
        str,
        typer.Option(
            "--bus", metavar="URL", help="socketcan:vcan0 or udp_multicast:239.74.163.2:43113."
        ),
    ] = DEFAULT_MULTICAST,
    variant: VariantOption = None,
    changes: SetOption = None,
    emulator_changes: SetEmulatorOption = None,
    out: OutOption = None,
    law: LawOption = None,
    lockstep: Annotated[
        bool,
        typer.Option(
            "--lockstep/--real-time",
            help="As fast as the bus goes and the same every time, or at the rig's rate.",
        ),
    ] = True,
    lcm_url: LcmOption = None,
    candump: CandumpOption = None,
    fault: FaultOption = None,
) -> None:
    """Run daemon and emulated rig, write a report.

    Exit status 0 only if the rig's tolerances hold; with --fault, if every fault is answered as
    the rig file says.
    """
    if fault and "list" in fault:
        _list_faults(rig, variant, tuple(changes or ()), bus, lockstep)
        return
    passed = _run(
        rig_path=rig,
        scenario=scenario,
        bus_url=bus,
        variant=variant,
        changes=tuple(changes or ()),
        emulator_changes=tuple(emulator_changes or ()),
        out=out,
        law=law,
        lockstep=lockstep,
        lcm_url=lcm_url,
        candump=candump,
        faults=tuple(fault or ()),
    )
    if not passed:
        raise typer.Exit(1)


def demo(
    rig: RigArgument = Path("rigs/reference"),
    scenario: ScenarioOption = "all",
    variant: VariantOption = None,
    out: OutOption = None,
    law: LawOption = None,
    lockstep: Annotated[
        bool,
        typer.Option(
            "--lockstep/--real-time",
            help="As fast as the bus goes and the same every time, or at the rig's rate (a busy "
            "machine that stalls for longer than safety.encoder_timeout_s then ends the run).",
        ),
    ] = True,
    lcm_url: LcmOption = None,
) -> None:
    """As hil, on the best bus this machine has.

    Says which bus that is, and why.
    """
    from eampc.hil.bus_choice import choose_bus

    choice = choose_bus(DEFAULT_MULTICAST)
    typer.echo(f"bus: {choice.url}, because {choice.reason}")
    passed = _run(
        rig_path=rig,
        scenario=scenario,
        bus_url=choice.url,
        variant=variant,
        changes=(),
        emulator_changes=(),
        out=out,
        law=law,
        lockstep=lockstep,
        lcm_url=lcm_url,
        candump=None,
    )
    if not passed:
        raise typer.Exit(1)


def _run(
    *,
    rig_path: Path,
    scenario: str,
    bus_url: str,
    variant: str | None,
    changes: tuple[str, ...],
    emulator_changes: tuple[str, ...],
    out: Path | None,
    law: Path | None,
    lockstep: bool,
    lcm_url: str | None,
    candump: Path | None,
    faults: tuple[str, ...] = (),
) -> bool:
    """True if every scenario met the rig's tolerances."""
    from eampc_rig import load_rig, open_bus, parse_override

    from eampc.hil.bus_log import BusLog
    from eampc.hil.fault_plan import read_faults
    from eampc.hil.fault_report import fault_table
    from eampc.hil.law_choice import cached_law, checked_law
    from eampc.hil.processes import daemon_program, ended_by_signal
    from eampc.hil.report import Circumstances, left_bounds, terminal_table, unmet, write_report
    from eampc.hil.report_folder import make_folder
    from eampc.hil.scenario_run import RunSettings, run_scenario
    from eampc.terminal import output_console, progress_bar

    overrides = dict(parse_override(change) for change in changes)
    loaded = load_rig(rig_path, variant, overrides)
    # The emulator would say the same of a bad key, but only after the daemon is up.
    load_rig(rig_path, variant, {**overrides, **dict(parse_override(c) for c in emulator_changes)})
    names = _scenario_names(loaded, scenario)
    timed_faults = tuple(read_faults(faults, loaded, bus_url, lockstep))
    # All that may be wrong comes before the design, which may take half a minute.
    daemon_program()
    law_path = checked_law(law, loaded) if law else None
    open_bus(bus_url).shutdown()
    folder = make_folder(
        out or Path("reports") / "-".join(filter(None, (loaded.rig.name, variant)))
    )
    law_path = law_path or cached_law(loaded, lambda path: _design(loaded, path))
    settings = RunSettings(
        rig_path=rig_path,
        variant=variant,
        overrides=changes,
        emulator_overrides=emulator_changes,
        bus_url=bus_url,
        lockstep=lockstep,
        law=law_path,
        lcm_url=lcm_url or loaded.telemetry.lcm_url,
        faults=timed_faults,
    )
    runs = []
    with ended_by_signal(), ExitStack() as stack:
        if candump:
            stack.enter_context(BusLog(bus_url, candump))
        progress = stack.enter_context(progress_bar())
        for name in names:
            task = progress.add_task(name, total=1.0)
            runs.append(
                run_scenario(
                    loaded,
                    name,
                    settings,
                    folder / name,
                    lambda done, task=task: progress.update(task, completed=done),
                )
            )
        drawing = progress.add_task("report", total=None)
        page = write_report(
            loaded,
            runs,
            Circumstances(
                rig_name=loaded.rig.name,
                variant=variant,
                changes=changes,
                emulator_changes=emulator_changes,
                bus_url=bus_url,
                lockstep=lockstep,
                law=law_path,
                inputs_sha256=loaded.inputs_sha256,
                version=importlib.metadata.version("eampc"),
            ),
            folder,
        )
        progress.update(drawing, total=1.0, completed=1.0)
    console = output_console()
    console.print(fault_table(runs) if timed_faults else terminal_table(loaded, runs))
    for run in runs:
        for sentence in unmet(run):
            console.print(f"not met: {sentence}")
        for sentence in [] if timed_faults else left_bounds(run):
            console.print(f"outside the bounds: {sentence}")
    console.print(f"report: {page}")
    return all(run.assessment.passed for run in runs)


def _list_faults(
    rig_path: Path, variant: str | None, changes: tuple[str, ...], bus_url: str, lockstep: bool
) -> None:
    from eampc_rig import load_rig, parse_override
    from rich.table import Table

    from eampc.hil.fault_plan import fault_list
    from eampc.terminal import output_console

    rig = load_rig(rig_path, variant, dict(parse_override(change) for change in changes))
    table = Table("Fault", "What happens", "The daemon")
    for row in fault_list(rig, bus_url, lockstep):
        table.add_row(*row)
    output_console().print(table)


def _design(rig: "Rig", path: Path) -> None:
    from eampc.commands_design import design_with_progress

    law = design_with_progress(rig)
    law.save(path)
    typer.echo(f"law: designed {path} ({law.statistics['regions']} regions)")


def _scenario_names(rig: "Rig", wanted: str) -> list[str]:
    if wanted == "all" and rig.scenarios:
        return list(rig.scenarios)
    rig.scenario(wanted)
    return [wanted]
