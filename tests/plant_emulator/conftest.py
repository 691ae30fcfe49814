"""The reference rig, as every test of the emulator starts from it."""

from collections.abc import Callable
from pathlib import Path

import pytest
from eampc_rig import Frames, Rig, load_rig, resolve_frames

RIGS = Path(__file__).parents[2] / "rigs"


@pytest.fixture(scope="session")
def reference_rig() -> Rig:
    return load_rig(RIGS / "reference")


@pytest.fixture(scope="session")
def reference_frames(reference_rig: Rig) -> Frames:
    return resolve_frames(reference_rig)


@pytest.fixture(scope="session")
def rig_with() -> Callable[..., Rig]:
    def load(**changes: object) -> Rig:
        """Dotted keys are written with two underscores: emulator__substeps=5."""
        overrides = {key.replace("__", "."): value for key, value in changes.items()}
        return load_rig(RIGS / "reference", overrides=overrides)

    return load
