"""The ready rigs and their variants, each designed once by a build."""

from functools import cache
from pathlib import Path

import pytest
from eampc.hil.law_choice import cached_law
from eampc.law import Law, load_law
from eampc.law_design import design
from eampc_rig import Rig, load_rig

ROOT = Path(__file__).parents[2]
RIGS = ROOT / "rigs"
LAWS = ROOT / "build" / "test-cache"
READY = (
    ("paper-case1", None),
    ("paper-case1", "tracking"),
    ("paper-case1", "theorem"),
    ("paper-case2", None),
    ("paper-case2", "tracking"),
    ("paper-case2", "theorem"),
    ("reference", None),
    ("reference", "kalman"),
    ("reference", "ideal-valve-design"),
)


@cache
def rig_of(name: str, variant: str | None = None) -> Rig:
    """A ready rig."""
    return load_rig(RIGS / name, variant)


@cache
def law_of(name: str, variant: str | None = None) -> Law:
    """Its law, kept where the commands under test find it too."""
    rig = rig_of(name, variant)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(LAWS))
        return load_law(cached_law(rig, lambda path: design(rig).save(path)))
