"""`eampc export`: a law as C99 for a microcontroller."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer


def register(app: typer.Typer) -> None:
    app.command(epilog="Example: eampc export rig.law --c99 firmware/law")(export)


def export(
    law: Annotated[Path, typer.Argument(metavar="FILE", help="Law file.")],
    c99: Annotated[
        Path, typer.Option("--c99", metavar="DIR", help="Folder for law.h, law.c and their test.")
    ],
    single: Annotated[
        bool,
        typer.Option("--float", help="Single precision; its largest error stands in law.h."),
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print what was written as JSON.")
    ] = False,
) -> None:
    """Write a law as self-contained C99."""
    from eampc.c99_export import export_c99, single_precision_error
    from eampc.law import load_law

    loaded = load_law(law)
    paths = export_c99(loaded, c99, single)
    error = single_precision_error(loaded) if single else 0.0
    if as_json:
        typer.echo(json.dumps({"files": [str(path) for path in paths], "error": error}))
        return
    kind = f"float, within {error:.1e} of the double law" if single else "double"
    typer.echo(f"wrote {', '.join(path.name for path in paths)} to {c99} ({kind})")
    typer.echo(f"check it with: make -C {c99} check")
