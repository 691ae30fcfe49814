"""Debian's stock kernel in a QEMU machine, with the host's files over 9p.

The kernel is not installed: its package is downloaded by apt-get, unpacked by dpkg-deb and kept
under ~/.cache/eampc. Boots in about 7 s; emulated user code runs 10 to 30 times slower.
"""

import contextlib
import os
import re
import subprocess
import tempfile
from pathlib import Path

from vcan import guest_init, kernel_modules
from vcan.guest_session import Emulator
from vcan.run_request import SEARCH_PATH, RunnerError, RunRequest, program

NAME = "qemu"
BOOT_LIMIT_S = 240.0  # 7 s alone on two cores, emulated; thirty times that under load
META_PACKAGES = ["linux-image-amd64", "linux-image-generic"]  # Debian's, Ubuntu's
MODULES = [
    *("virtio", "virtio_ring", "virtio_pci_legacy_dev", "virtio_pci_modern_dev", "virtio_pci"),
    *("virtio_console", "netfs", "fscache", "9pnet", "9pnet_virtio", "9p", "overlay"),
    *kernel_modules.CAN,
]
DIRECTORIES = ["bin", "dev", "proc", "sys", "modules", "t"]  # of the initial root
# Not KVM: nested KVM is often there, then aborts or hangs while the guest boots.
ACCELERATOR = ["-accel", "tcg,thread=multi", "-cpu", "max,la57=off"]
KERNEL_OPTIONS = (
    "console=ttyS0 quiet panic=-1 mitigations=off tsc=reliable no_timer_check nokaslr audit=0 "
    "random.trust_cpu=on net.ifnames=0"
)


def check() -> None:
    program("qemu-system-x86_64", "qemu-system-x86")
    program("busybox", "busybox-static")
    _cached_kernel() or program("apt-get", "apt")


def _cache_dir() -> Path:
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return Path(home, "eampc")


def _cached_kernel() -> Path | None:
    return max(_cache_dir().glob("linux-image-*/boot/vmlinuz-*"), default=None)


def _stock_kernel() -> Path:
    return _cached_kernel() or _download_kernel()


def _depends(package: str) -> list[str]:
    shown = subprocess.run(
        ["apt-cache", "depends", "--important", package],
        env={**os.environ, "LC_ALL": "C.UTF-8"},
        capture_output=True,
        text=True,
    )
    names = re.findall(r"Depends: (linux-(?:image|modules|modules-extra)-\d\S*)", shown.stdout)
    return [name for name in names if "unsigned" not in name]


def _download_kernel() -> Path:
    packages = next(filter(None, map(_depends, META_PACKAGES)), None)
    if packages is None:
        raise RunnerError("apt knows no stock kernel package; run apt-get update")
    image = next(name for name in packages if name.startswith("linux-image-"))
    wanted = sorted({*packages, *_depends(image)})
    cache = _cache_dir()
    cache.mkdir(parents=True, exist_ok=True)
    # Renamed into place when complete: a run that was cut short leaves no half a kernel.
    with tempfile.TemporaryDirectory(dir=cache, prefix="download.") as work:
        got = subprocess.run(
            ["apt-get", "download", "-q", *wanted], cwd=work, capture_output=True, text=True
        )
        if got.returncode != 0:
            raise RunnerError(f"apt-get download {' '.join(wanted)} failed; run apt-get update")
        tree = Path(work, "tree")
        for package in Path(work).glob("*.deb"):
            subprocess.run(["dpkg-deb", "-x", str(package), str(tree)], check=True)
        with contextlib.suppress(OSError):  # another runner was faster
            tree.rename(cache / image)
    kernel = _cached_kernel()
    if kernel is None:
        raise RunnerError(f"package {image} has no boot/vmlinuz; use --backend uml")
    return kernel


def _cpio(files: dict[str, tuple[int, bytes, tuple[int, int]]]) -> bytes:
    """A newc archive (linux/Documentation/driver-api/early-userspace/buffer-format.rst)."""
    archive = bytearray()
    entries = [*files.items(), ("TRAILER!!!", (0, b"", (0, 0)))]
    for inode, (name, (mode, data, (major, minor))) in enumerate(entries, 1):
        path = name.encode() + b"\0"
        fields = (inode, mode, 0, 0, 1, 0, len(data), 0, 0, major, minor, len(path), 0)
        archive += b"070701" + b"".join(b"%08X" % value for value in fields) + path
        archive += bytes(-len(archive) % 4) + data
        archive += bytes(-len(archive) % 4)
    return bytes(archive)


def _initial_files(request: RunRequest, run_dir: Path, kernel: Path) -> bytes:
    version = kernel.name.removeprefix("vmlinuz-")
    root = kernel.parent.parent
    trees = [root / "lib/modules" / version, root / "usr/lib/modules" / version]
    wanted = [*MODULES, *(kernel_modules.CONTROLLER if request.controllers else [])]
    modules = kernel_modules.in_load_order(next(filter(Path.is_dir, trees)), wanted)
    init = guest_init.for_qemu(
        run_dir, request.buses, request.controllers, list(modules), request.writable
    )
    busybox = Path(program("busybox", "busybox-static")).read_bytes()
    directory, executable, no_device = 0o040755, 0o100755, (0, 0)
    files = {name: (directory, b"", no_device) for name in DIRECTORIES}
    files["dev/console"] = (0o020600, b"", (5, 1))
    files["bin/busybox"] = (executable, busybox, no_device)
    for name, data in modules.items():
        files[f"modules/{name}.ko"] = (executable, data, no_device)
    files["command.sh"] = (executable, (run_dir / "command.sh").read_bytes(), no_device)
    files["init"] = (executable, init.encode(), no_device)
    return _cpio(files)


def prepare(request: RunRequest, run_dir: Path, fds: list[int]) -> Emulator:
    check()
    kernel = _stock_kernel()
    initrd = run_dir / "initrd"
    initrd.write_bytes(_initial_files(request, run_dir, kernel))
    emulator = program("qemu-system-x86_64", "qemu-system-x86")
    argv = [emulator, "-M", "q35", *ACCELERATOR]
    argv += ["-smp", "2", "-m", request.memory, "-nodefaults", "-no-user-config"]
    argv += ["-display", "none", "-no-reboot", "-serial", "file:/dev/fd/1"]
    argv += ["-kernel", str(kernel), "-initrd", str(initrd), "-append", KERNEL_OPTIONS]
    argv += ["-device", "virtio-serial-pci"]
    for i, fd in enumerate(fds):
        argv += ["-chardev", f"file,id=line{i},path=/dev/fd/{fd}"]
        argv += ["-device", f"virtserialport,chardev=line{i},nr={i + 1}"]
    if request.controllers:
        argv += ["-object", "can-bus,id=wire"]
        argv += ["-device", "kvaser_pci,canbus=wire"] * request.controllers
    argv += _share("host", "/", ",readonly=on")
    for i, path in enumerate(request.writable):
        argv += _share(f"rw{i}", str(path), "")
    return Emulator(argv, {**os.environ, "PATH": SEARCH_PATH}, BOOT_LIMIT_S)


def _share(tag: str, path: str, options: str) -> list[str]:
    if "," in path:
        path = path.replace(",", ",,")
    device = f"local,id={tag},path={path},security_model=none,multidevs=remap{options}"
    return ["-fsdev", device, "-device", f"virtio-9p-pci,fsdev={tag},mount_tag={tag}"]
