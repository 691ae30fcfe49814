"""Which bus a demonstration runs on: a vcan interface of this kernel if there is one, else
multicast.

Only an interface of kind vcan is taken: on any other, frames would reach real valves.
"""

import json
import socket
import subprocess
from dataclasses import dataclass


@dataclass(frozen=True)
class BusChoice:
    url: str
    reason: str


def choose_bus(multicast_url: str) -> BusChoice:
    """The first vcan interface that is up, else `multicast_url`; with the reason."""
    if not _kernel_has_can():
        return BusChoice(multicast_url, "this kernel has no SocketCAN")
    links = _vcan_links()
    for name, is_up in sorted(links.items()):
        if is_up:
            return BusChoice(f"socketcan:{name}", f"{name} is a virtual CAN interface and is up")
    if links:
        name = min(links)
        return BusChoice(multicast_url, f"{name} is down (to use it: sudo ip link set {name} up)")
    return BusChoice(
        multicast_url,
        "this kernel has SocketCAN but no vcan interface "
        "(to add one: sudo ip link add vcan0 type vcan && sudo ip link set vcan0 up)",
    )


def _kernel_has_can() -> bool:
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError:
        return False
    return True


def _vcan_links() -> dict[str, bool]:
    """Name → up, of the interfaces of kind vcan. Only ip (netlink) knows the kind."""
    try:
        output = subprocess.run(
            ["ip", "-json", "link", "show", "type", "vcan"],
            capture_output=True,
            check=True,
            timeout=10,
        ).stdout
        links = json.loads(output or b"[]")
    except (OSError, subprocess.SubprocessError, ValueError):
        return {}
    return {link["ifname"]: "UP" in link.get("flags", []) for link in links if "ifname" in link}
