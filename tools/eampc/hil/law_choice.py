"""Which law a run uses: the named file if it belongs to the rig, or one designed and kept.

A law belongs to a rig if both come from the same inputs: every design value and the DBC. Scenarios,
tolerances and the emulated plant are no inputs, so changing them needs no new law.
"""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path

from eampc_rig import Rig

from eampc.errors import UserError
from eampc.law_file import read_law


def checked_law(path: Path, rig: Rig) -> Path:
    """`path`, if the law in it was designed for this rig as it is now; else UserError."""
    origin = read_law(path)["rig"]
    mend = f"design it: eampc design {_as_typed(rig)} -o {path}"
    if origin["name"] != rig.rig.name:
        raise UserError(
            f"{path} was designed for the rig {origin['name']}, not {rig.rig.name}; {mend}"
        )
    if origin["inputs_sha256"] != rig.inputs_sha256:
        variants = f"variant {origin['variant'] or 'none'}, here {rig.variant or 'none'}"
        raise UserError(
            f"{path} was designed from other values of the rig {rig.rig.name} ({variants}); {mend}"
        )
    return path


def cached_law(rig: Rig, design_to: Callable[[Path], None]) -> Path:
    """The kept law for these very inputs; `design_to` writes it if there is no sound one."""
    path = cache_folder() / f"{rig.rig.name}-{rig.inputs_sha256[:12]}-{design_identity()}.law"
    if path.exists():
        try:
            return checked_law(path, rig)
        except Exception:  # cut short, or of an older format: whatever it is, it is designed again
            path.unlink(missing_ok=True)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(
            f"{path.parent}: cannot keep the law there ({error.strerror}); name one with --law"
        ) from None
    design_to(path)
    return path


def design_identity() -> str:
    """Of the program that designs: another build must not be given the laws of this one."""
    digest = hashlib.sha256()
    package = Path(__file__).parents[1]
    for file in sorted([*package.glob("_core*.so"), *package.glob("*.py")]):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:8]


def cache_folder() -> Path:
    """$XDG_CACHE_HOME/eampc, else ~/.cache/eampc."""
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "eampc"


def _as_typed(rig: Rig) -> str:
    return str(rig.folder) + (f" --variant {rig.variant}" if rig.variant else "")
