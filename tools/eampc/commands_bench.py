"""`eampc bench law` and `eampc bench offline`: the law engine beside its peers, in one run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eampc.rig_arguments import SetOption

if TYPE_CHECKING:
    from eampc.benchmark.problems import BenchmarkProblem, BoundedForm

LAW_PROBLEMS = (
    "p3_u2_N10",
    "p3_u2_N20",
    "p5_u2_N5",
    "p5_u2_N10",
    "p5_u2_N15",
    "p5_u2_N20",
    "p5_u0_N10",
    "p5_u0_N20",
)
OFFLINE_PROBLEMS = (
    "p3_u2_N5",
    "p3_u2_N8",
    "p3_u2_N10",
    "p3_u2_N15",
    "p3_u2_N20",
    "p5_u2_N5",
    "p5_u2_N8",
    "p5_u2_N10",
    "p5_u2_N15",
    "p5_u2_N20",
    "p5_u0_N10",
    "p5_u0_N15",
    "p5_u0_N20",
)

ProblemOption = Annotated[
    list[str] | None,
    typer.Option(
        "--problem",
        metavar="NAME",
        help="Published problem: p5_u2_N10 or p5_u2_N3-20; repeatable. Default: a list of them.",
    ),
]
OutputOption = Annotated[
    Path | None, typer.Option("-o", "--output", metavar="FILE.md", help="Markdown report.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")]


def register(app: typer.Typer) -> None:
    bench = typer.Typer(
        help="Measure the law engine beside its peers.",
        no_args_is_help=True,
        rich_markup_mode=None,
        epilog="Example: eampc bench law --problem p5_u2_N10",
    )
    bench.command(epilog="Example: eampc bench law --problem p5_u2_N10 --rig rigs/reference")(law)
    bench.command(epilog="Example: eampc bench offline --problem p5_u2_N3-20")(offline)
    app.add_typer(bench, name="bench")


def law(
    problem: ProblemOption = None,
    rig: Annotated[
        list[str] | None,
        typer.Option(
            "--rig",
            metavar="RIG[:VARIANT]",
            help="Also the law of this rig; repeatable. Alone: only rigs.",
        ),
    ] = None,
    changes: SetOption = None,
    peer: Annotated[
        list[str] | None,
        typer.Option("--peer", metavar="NAME", help="Of daqp, osqp, piqp, clarabel. Default: all."),
    ] = None,
    points: Annotated[
        int, typer.Option("--points", min=16, max=1_000_000, help="Random feasible parameters.")
    ] = 4096,
    report: OutputOption = None,
    as_json: JsonOption = False,
) -> None:
    """Time one evaluation of the explicit law, and one solve of each peer, on the same points."""
    from eampc.benchmark import bench_report as reports
    from eampc.benchmark.law_structure import build_law
    from eampc.benchmark.online import PEERS, measure
    from eampc.benchmark.online_peers import require_peers
    from eampc.benchmark.problems import published
    from eampc.errors import UserError
    from eampc.terminal import progress_bar

    peers = tuple(peer or PEERS)
    for name in peers:
        if name not in PEERS:
            raise UserError(f"no peer is called {name}; there are {', '.join(PEERS)}")
    require_peers(
        tuple(dict.fromkeys(("daqp", *peers)))
    )  # daqp also says which points are feasible
    _require_folder(report)
    stated = [published(name) for name in _names(problem, () if rig else LAW_PROBLEMS)]
    figures = []
    with progress_bar() as bar:
        task = bar.add_task("law", total=len(stated) + len(rig or []))

        def run(of: BenchmarkProblem, tables: object, form: BoundedForm) -> None:
            figures.append(
                measure(
                    of,
                    tables,
                    form,
                    peers=peers,
                    points=points,
                    report=lambda step: bar.update(task, description=f"{of.name}: {step}"),
                )
            )
            bar.advance(task)

        for of in stated:
            bar.update(task, description=f"{of.name}: design")
            built = build_law(of)
            run(of, built.tables, of.bounded(built.active_rows()))
        for text in rig or []:
            bar.update(task, description=f"{text}: design")
            run(*_rig_law(text, changes))
    notes = reports.online_notes(figures)
    columns = tuple(name for name, _ in reports.LAW_COLUMNS)
    parts = [
        ("law", columns, reports.law_rows(figures)),
        ("peers", reports.PEER_COLUMNS, reports.peer_rows(figures)),
    ]
    _tell("Explicit law beside its peers", figures, parts, notes, report, as_json)


def offline(
    problem: ProblemOption = None,
    limit_s: Annotated[
        float,
        typer.Option("--limit-s", min=0.1, help="Time for each of PPOPT's algorithms, seconds."),
    ] = 60.0,
    no_peer: Annotated[bool, typer.Option("--no-peer", help="Without PPOPT.")] = False,
    points: Annotated[
        int, typer.Option("--points", min=16, max=1_000_000, help="Points that check coverage.")
    ] = 20_000,
    report: OutputOption = None,
    as_json: JsonOption = False,
) -> None:
    """Time the critical regions and the law's structure, and PPOPT on the same problems.

    Exit status 1 if a feasible point lies in none of our regions.
    """
    from eampc.benchmark import bench_report as reports
    from eampc.benchmark.offline import measure
    from eampc.benchmark.online_peers import require_peers
    from eampc.benchmark.problems import published
    from eampc.terminal import progress_bar

    require_peers(("daqp",) if no_peer else ("daqp", "ppopt"))
    _require_folder(report)
    stated = [published(name) for name in _names(problem, OFFLINE_PROBLEMS)]
    figures = []
    with progress_bar() as bar:
        task = bar.add_task("regions", total=len(stated))
        for of in stated:
            figures.append(
                measure(
                    of,
                    peer=not no_peer,
                    limit_s=limit_s,
                    points=points,
                    report=lambda step, of=of: bar.update(task, description=f"{of.name}: {step}"),
                )
            )
            bar.advance(task)
    parts = [("regions", reports.OFFLINE_COLUMNS, reports.offline_rows(figures))]
    _tell(
        "Offline: regions and structure", figures, parts, reports.offline_notes(), report, as_json
    )
    if any(f.uncovered for f in figures):
        raise typer.Exit(1)


def _names(patterns: list[str] | None, default: tuple[str, ...]) -> list[str]:
    from eampc.benchmark.problems import published_names

    return [name for pattern in patterns or default for name in published_names(pattern)]


def _rig_law(text: str, changes: list[str] | None) -> tuple[BenchmarkProblem, object, BoundedForm]:
    from eampc_rig import load_rig, parse_override

    from eampc.benchmark.law_structure import active_rows, tables_of
    from eampc.benchmark.problems import of_rig
    from eampc.hil.law_choice import cached_law
    from eampc.law import load_law
    from eampc.law_design import design

    path, _, variant = text.partition(":")
    rig = load_rig(path, variant or None, dict(parse_override(change) for change in changes or []))
    law = load_law(cached_law(rig, lambda kept: design(rig).save(kept)))
    problem = of_rig(rig, law)
    return problem, tables_of(law), problem.bounded(active_rows(law))


def _require_folder(report: Path | None) -> None:
    from eampc.errors import UserError

    if report is not None and not report.parent.is_dir():
        raise UserError(f"{report}: the folder {report.parent} does not exist; make it first")


def _tell(
    title: str,
    figures: list,
    parts: list[tuple[str, tuple[str, ...], list[list[str]]]],
    notes: list[str],
    report: Path | None,
    as_json: bool,
) -> None:
    from eampc.benchmark import bench_report as reports
    from eampc.benchmark.machine import machine, machine_sentence
    from eampc.terminal import output_console

    here = machine()
    if report is not None:
        tables = [(columns, rows) for _, columns, rows in parts]
        report.write_text(reports.markdown(title, here, tables, notes), encoding="utf-8")
    if as_json:
        typer.echo(json.dumps(reports.as_json(here, figures)))
        return
    console = output_console()
    console.print(machine_sentence(here), markup=False)
    for name, columns, rows in parts:
        console.print(reports.rich_table(name, columns, rows))
    for note in notes:
        console.print(note, markup=False)
    if report is not None:
        console.print(f"report: {report}")
