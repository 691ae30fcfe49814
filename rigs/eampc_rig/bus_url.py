"""A bus by URL: `socketcan:can0` or `udp_multicast:239.74.163.2:43113`."""

from __future__ import annotations

import ipaddress
import logging
from dataclasses import dataclass
from pathlib import Path

import can

from eampc_rig.problem_sentences import nearest
from eampc_rig.rig_error import RigError

DEFAULT_GROUP = "239.74.163.2"  # python-can's default IPv4 group and port
DEFAULT_PORT = 43113
# A bus that could not be opened is our one sentence, not also python-can's warning on stderr.
logging.getLogger("can").addHandler(logging.NullHandler())
_TRANSPORTS = ("socketcan", "udp_multicast")
_FORMS = f"socketcan:INTERFACE or udp_multicast:{DEFAULT_GROUP}:{DEFAULT_PORT}"


@dataclass(frozen=True)
class BusAddress:
    """Which bus: transport "socketcan" (channel = interface) or "udp_multicast" (group, port)."""

    transport: str
    channel: str
    port: int = 0

    def __str__(self) -> str:
        end = f":{self.port}" if self.transport == "udp_multicast" else ""
        return f"{self.transport}:{self.channel}{end}"


def parse_bus_url(url: str) -> BusAddress:
    """Split a bus URL; group and port of udp_multicast may be left out.

    Raises RigError, one sentence, for an unknown transport, interface name, group or port.
    """
    transport, _, rest = url.partition(":")
    if transport not in _TRANSPORTS:
        found = nearest(transport, _TRANSPORTS)
        guess = f'; did you mean "{found}"?' if found else ""
        raise RigError(f'bus "{url}": unknown transport "{transport}"; use {_FORMS}{guess}')
    if transport == "socketcan":
        # IFNAMSIZ of Linux is 16 with the closing zero.
        if not 1 <= len(rest) <= 15 or "/" in rest or rest.split() != [rest]:
            raise RigError(f'bus "{url}": "{rest}" is not an interface name; use socketcan:can0')
        return BusAddress(transport, rest)
    group, _, port = (rest or DEFAULT_GROUP).partition(":")
    try:
        multicast = ipaddress.IPv4Address(group).is_multicast
    except ValueError:
        multicast = False
    if not multicast:
        raise RigError(f'bus "{url}": "{group}" is not an IPv4 multicast group; use {_FORMS}')
    if port and not (port.isascii() and port.isdigit() and 0 < int(port) < 65536):
        raise RigError(f'bus "{url}": "{port}" is not a port; use 1..65535')
    return BusAddress(transport, group, int(port or DEFAULT_PORT))


def open_bus(url: str) -> can.BusABC:
    """Open the bus that `url` names. On udp_multicast a sender hears its own frames.

    Multicast stays on this machine: time to live 0 on the interface of the multicast route, which
    is where python-can's own tools and the daemon join.
    Raises RigError, one sentence, if the interface does not exist, is down or may not be opened.
    """
    address = parse_bus_url(url)
    if address.transport == "socketcan":
        return _open_socketcan(address)
    return _open_multicast(address)


def _open_socketcan(address: BusAddress) -> can.BusABC:
    name = address.channel
    link = Path("/sys/class/net") / name
    if link.parent.is_dir() and not link.exists():
        there = sorted(p.name for p in link.parent.iterdir() if _is_can(p))
        found = f"this machine has {', '.join(there)}" if there else "this machine has none"
        raise RigError(
            f'bus "{address}": there is no interface "{name}" ({found}); create it '
            f"(ip link add {name} type vcan; ip link set {name} up) or use udp_multicast"
        )
    try:
        bus: can.BusABC = can.Bus(interface="socketcan", channel=name)
    except (OSError, can.CanError) as error:
        raise RigError(
            f'bus "{address}": cannot be opened ({_reason(error)}); check "ip link show {name}"'
        ) from None
    return bus


def _is_can(link: Path) -> bool:
    try:
        return (link / "type").read_text().strip() == "280"  # ARPHRD_CAN
    except OSError:
        return False


def _open_multicast(address: BusAddress) -> can.BusABC:
    try:
        bus: can.BusABC = can.Bus(
            interface="udp_multicast",
            channel=address.channel,
            port=address.port,
            hop_limit=0,
            fd=False,
        )
    except (OSError, can.CanError) as error:
        cause = error.__cause__ or error
        raise RigError(
            f'bus "{address}": multicast cannot be opened ({_reason(cause)}); a machine without a '
            f"network needs a route for it (ip route add {address.channel}/32 dev lo)"
        ) from None
    return bus


def _reason(error: BaseException) -> str:
    return getattr(error, "strerror", None) or " ".join(str(error).split())
