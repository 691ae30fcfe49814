"""The folder that a command was told to write into."""

from pathlib import Path

from eampc.errors import UserError


def make_folder(path: Path) -> Path:
    """The folder, made if need be; UserError if it cannot be."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"--out {path}: cannot be made: {error.strerror}") from None
    return path
