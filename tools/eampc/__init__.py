"""Explicit adaptive MPC of a pneumatic-muscle joint.

    from eampc import design, load_rig, simulate

    rig = load_rig("rigs/reference")
    law = design(rig)
    run = simulate(rig, law, "step")
    law.save("rig.law")

`load_rig(path, variant=None, overrides=None)` reads a rig; `design(rig)` makes its law;
`load_law(path)` reads one; `simulate(rig, law, scenario)` runs the daemon's control code against
the simulated joint. Errors a user can mend are RigError, DesignError and LawFileError.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from eampc_rig import Rig, RigError, load_rig

    from eampc.errors import DesignError, LawFileError
    from eampc.law import Law, load_law
    from eampc.law_design import design
    from eampc.simulation import simulate

__all__ = [
    "DesignError",
    "Law",
    "LawFileError",
    "Rig",
    "RigError",
    "design",
    "load_law",
    "load_rig",
    "simulate",
]

# Imported when first used: `eampc arm` must not wait for numpy.
_HOMES = {
    "DesignError": "eampc.errors",
    "Law": "eampc.law",
    "LawFileError": "eampc.errors",
    "Rig": "eampc_rig",
    "RigError": "eampc_rig",
    "design": "eampc.law_design",
    "load_law": "eampc.law",
    "load_rig": "eampc_rig",
    "simulate": "eampc.simulation",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = value
    return value
