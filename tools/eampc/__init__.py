"""Explicit adaptive MPC of a pneumatic-muscle joint.

    import eampc

    rig = eampc.load_rig("rigs/reference")
    law = eampc.design(rig)
    u = law.evaluate([[0.1, 0.0, 0.0, 0.0, 0.2, 0.0]])
    run = eampc.simulate(rig, law, "step")
    law.save("rig.law")

`load_rig(path, variant=None, overrides=None)` reads a rig; `design(rig)` makes its law;
`load_law(path)` reads one; `simulate(rig, law, scenario)` runs the daemon's control code against
the simulated joint. Errors that a user can mend, one sentence each, are RigError, and UserError
with its kinds DesignError and LawFileError. `mpqp.solve(H, F, f, G, w, S, box)` solves any
multiparametric quadratic program explicitly.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from eampc_rig import Rig, RigError, load_rig

    from eampc import mpqp
    from eampc.errors import DesignError, LawFileError, UserError
    from eampc.law import Law, load_law
    from eampc.law_design import design
    from eampc.simulation import SimulationResult, simulate

__all__ = [
    "DesignError",
    "Law",
    "LawFileError",
    "Rig",
    "RigError",
    "SimulationResult",
    "UserError",
    "design",
    "load_law",
    "load_rig",
    "mpqp",
    "simulate",
]

# Imported when first used: `eampc arm` must not wait for numpy.
_HOMES = {
    "DesignError": "eampc.errors",
    "Law": "eampc.law",
    "LawFileError": "eampc.errors",
    "Rig": "eampc_rig",
    "RigError": "eampc_rig",
    "SimulationResult": "eampc.simulation",
    "UserError": "eampc.errors",
    "design": "eampc.law_design",
    "load_law": "eampc.law",
    "load_rig": "eampc_rig",
    "mpqp": "eampc.mpqp",
    "simulate": "eampc.simulation",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    home = importlib.import_module(_HOMES[name])
    value = home if _HOMES[name] == f"{__name__}.{name}" else getattr(home, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
