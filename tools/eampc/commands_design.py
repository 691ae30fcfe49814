"""`eampc design` and `eampc law show`: rig → law file, law file → text."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

PIPE_WIDTH = 130


def design(
    rig: Annotated[Path, typer.Argument(metavar="RIG", help="Rig folder, or its rig.toml.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="PATH", help="Law file to write.")
    ],
    variant: Annotated[
        str | None, typer.Option("--variant", metavar="NAME", help="Variant of the rig file.")
    ] = None,
    changes: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", help="Change one key of the rig file; repeatable."
        ),
    ] = None,
    no_progress: Annotated[bool, typer.Option("--no-progress", help="No progress bar.")] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the law's figures as JSON.")
    ] = False,
) -> None:
    """Design the explicit law of a rig and write it to one file."""
    from eampc_rig import load_rig, parse_override
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    from eampc.errors import DesignError
    from eampc.law_design import design as design_law
    from eampc.law_report import law_summary, summary_table

    loaded = load_rig(rig, variant, dict(parse_override(change) for change in changes or []))
    if not output.parent.is_dir():
        raise DesignError(f"{output}: the folder {output.parent} does not exist; make it first")
    with Progress(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        TimeElapsedColumn(),
        console=Console(stderr=True),
        transient=True,
        disable=no_progress or not sys.stderr.isatty(),
    ) as bar:
        task = bar.add_task("model")

        def report(step: str, done: int, known: int) -> None:
            of = f" of {known} known" if known else ""
            bar.update(task, description=f"{step}: {done}{of}")

        law = design_law(loaded, report)
    size_bytes = law.save(output)
    if as_json:
        typer.echo(json.dumps({"path": str(output), **law_summary(law)}))
    else:
        _console().print(summary_table(law, str(output), size_bytes))


def show(
    law: Annotated[Path, typer.Argument(metavar="FILE", help="Law file.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print it as JSON.")] = False,
) -> None:
    """Print what a law file holds."""
    from eampc.law import load_law
    from eampc.law_report import law_summary, print_law

    loaded = load_law(law)
    if as_json:
        typer.echo(json.dumps(law_summary(loaded)))
    else:
        print_law(loaded, _console())


def _console():
    from rich.console import Console

    terminal = sys.stdout.isatty()
    return Console(highlight=False, soft_wrap=not terminal, width=None if terminal else PIPE_WIDTH)
