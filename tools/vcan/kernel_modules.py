"""Load order and contents of a kernel's modules.

The order comes from the `depends=` field inside each module, so that no depmod files are needed;
a module that is not there is taken to be built into the kernel, and the guest's own checks find
out if it is not.
"""

import lzma
import re
import subprocess
from pathlib import Path

from vcan.run_request import program

# Bus, gateway and the queues that tests of full queues and late frames use.
CAN = [
    *("can", "can-raw", "can-bcm", "can-gw", "can-dev", "vcan", "vxcan"),
    *("sch_tbf", "sch_netem", "sch_plug", "sch_prio"),
]
# The driver of QEMU's emulated PCI board, an SJA1000 behind it.
CONTROLLER = ["sja1000", "kvaser_pci"]
# A guest's vcan echoes a frame when it leaves the queue, as a driver of hardware does. Without it
# the kernel hands an own frame back before it is queued at all.
OPTIONS = {"vcan": "echo=1"}


def _read(path: Path) -> bytes:
    if path.suffix == ".xz":
        return lzma.decompress(path.read_bytes())
    if path.suffix == ".zst":
        return subprocess.check_output([program("zstd", "zstd"), "-dcq", str(path)])
    return path.read_bytes()


def in_load_order(tree: Path, wanted: list[str]) -> dict[str, bytes]:
    paths = {path.name.partition(".ko")[0].replace("-", "_"): path for path in tree.rglob("*.ko*")}
    contents: dict[str, bytes] = {}

    def add(name: str) -> None:
        name = name.replace("-", "_")
        if name in contents or name not in paths:
            return
        data = _read(paths[name])
        depends = re.search(rb"\0depends=([^\0]*)\0", data)
        for needed in depends.group(1).decode().split(",") if depends else []:
            add(needed)
        contents[name] = data

    for name in wanted:
        add(name)
    return contents
