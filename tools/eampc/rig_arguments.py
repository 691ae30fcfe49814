"""How every command that reads a rig file names the rig, its variant and changes of its keys."""

from pathlib import Path
from typing import Annotated

import typer

RigArgument = Annotated[Path, typer.Argument(metavar="RIG", help="Rig folder, or its rig.toml.")]
VariantOption = Annotated[
    str | None, typer.Option("--variant", metavar="NAME", help="Variant of the rig file.")
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="Change one key of the rig file for once; repeatable."
    ),
]
