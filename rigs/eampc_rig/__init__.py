"""What the tools and the plant emulator share: rig file, frames of the bus, bus by URL."""

from eampc_rig.bus_url import BusAddress, open_bus, parse_bus_url
from eampc_rig.crc8 import crc8_j1850, frame_crc
from eampc_rig.frames import Frames, resolve_frames
from eampc_rig.message_codec import DecodedFrame, MessageCodec
from eampc_rig.overrides import parse_override
from eampc_rig.rig_error import RigError
from eampc_rig.rig_file import Rig, load_rig
from eampc_rig.safety_section import FAULT_NAMES
from eampc_rig.scenario_sections import DisturbanceTerm, Reference, Scenario, Tolerance

__all__ = [
    "FAULT_NAMES",
    "BusAddress",
    "DecodedFrame",
    "DisturbanceTerm",
    "Frames",
    "MessageCodec",
    "Reference",
    "Rig",
    "RigError",
    "Scenario",
    "Tolerance",
    "crc8_j1850",
    "frame_crc",
    "load_rig",
    "open_bus",
    "parse_bus_url",
    "parse_override",
    "resolve_frames",
]
