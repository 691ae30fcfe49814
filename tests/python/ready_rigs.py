"""The ready rigs and their variants, each designed once per test run."""

from functools import cache
from pathlib import Path

from eampc.law import Law
from eampc.law_design import design
from eampc_rig import Rig, load_rig

RIGS = Path(__file__).parents[2] / "rigs"
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
    """Its law."""
    return design(rig_of(name, variant))
