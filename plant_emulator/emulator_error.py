"""What goes wrong while the emulator runs; bad input is eampc_rig.RigError."""

from __future__ import annotations


class EmulatorError(RuntimeError):
    """The run cannot go on; the text is one sentence."""
