"""The shell scripts that are process 1 in the two guests.

Each backend mounts what becomes the root ($R: the host's files under a tmpfs overlay), names its
three output devices, and goes on with the common part: device and network set-up, then the
command. The control line says START, FAIL <why> or EXIT <status>.
"""

import shlex
from pathlib import Path

from vcan import kernel_modules

_COMMON = r"""
options() { for o in $OPTIONS; do [ "${o%%:*}" = "$1" ] && echo "${o#*:}"; done; }
fail() { echo "FAIL $*" >&9; $BB sleep 1; $BB poweroff -f; }
set_up_devices() {
  $BB mount -t proc proc "$R/proc"; $BB mount -t sysfs sysfs "$R/sys"
  $BB mount -t devtmpfs dev "$R/dev"; $BB mkdir -p "$R/dev/pts" "$R/dev/shm"
  $BB mount -t devpts -o ptmxmode=666 devpts "$R/dev/pts"; $BB mount -t tmpfs shm "$R/dev/shm"
  $BB mount -t tmpfs run "$R/run"
  $BB ln -sf /proc/self/fd "$R/dev/fd"; $BB ln -sf fd/0 "$R/dev/stdin"
  $BB ln -sf fd/1 "$R/dev/stdout"; $BB ln -sf fd/2 "$R/dev/stderr"
}
set_up_network() {
  $BB ip link set lo up multicast on || fail "lo does not come up"
  $BB ip route add 224.0.0.0/4 dev lo || fail "lo takes no multicast route"
  i=0
  while [ $i -lt $BUSES ]; do
    $BB ip link add dev vcan$i type vcan && $BB ip link set vcan$i mtu 72 up \
      || fail "the kernel makes no vcan$i"
    i=$((i + 1))
  done
  i=0
  while [ $i -lt ${CONTROLLERS:-0} ]; do
    # iproute2's: busybox's ip knows no bit rate.
    $BB chroot "$R" /usr/bin/env ip link set can$i up txqueuelen 10 type can bitrate 1000000 \
      || fail "can$i does not come up"
    i=$((i + 1))
  done
}
# Pipes between the command and the lines: the command may reopen /dev/stdout, and the last close
# of a line drains it before the power goes. Descriptor 9 is the control line for the whole run.
run_command() {
  $BB mkfifo "$T/o" "$T/e"
  $BB cat < "$T/o" > "$OUT" & out=$!
  $BB cat < "$T/e" > "$ERR" & err=$!
  echo START >&9
  ( exec 9>&-; exec $BB setsid $BB chroot "$R" /bin/sh "$SCRIPT" </dev/null >"$T/o" 2>"$T/e" )
  status=$?
  # Orphans of the command would hold the pipes open: end everything but the two cats.
  for d in /proc/[0-9]*; do
    p=${d#/proc/}
    [ $p -gt 1 ] && [ $p -ne $out ] && [ $p -ne $err ] && [ -e $d/exe ] && kill -9 $p 2>/dev/null
  done
  wait $out; wait $err
  $BB sync
  echo "EXIT $status" >&9
  exec 9>&-
  $BB poweroff -f
}
"""

_UML = r"""
R=$T/root; OUT=$R/dev/ttyS0; ERR=$R/dev/ttyS1; CONTROL=/dev/ttyS2
$BB mount -t proc proc /proc
$BB mount -t tmpfs tmpfs "$T"; $BB mkdir "$T/up" "$T/work" "$R" "$T/dev"
$BB mount -t devtmpfs dev "$T/dev"
for tty in ttyS0 ttyS1 ttyS2; do $BB stty raw -echo < "$T/dev/$tty"; done
exec 9> "$T/dev/ttyS2"
for m in $MODULES; do
  $BB insmod "$RUN/modules/$m.ko" $(options $m) || fail "module $m does not load"
done
$BB mount -t overlay -o "lowerdir=/,upperdir=$T/up,workdir=$T/work" overlay "$R" \
  || fail "no overlay over the host's files"
set_up_devices
$BB mkdir -p "$R$RUN"; $BB cp "$RUN/command.sh" "$R$RUN/command.sh"; SCRIPT=$RUN/command.sh
set -- @WRITABLE@
for d in "$@"; do $BB mount -t hostfs none "$R$d" -o "$d" || fail "$d cannot be mounted"; done
set_up_network
run_command
"""

_QEMU = r"""
R=$T/root; OUT=/dev/vport0p1; ERR=/dev/vport0p2; CONTROL=/dev/vport0p3
$BB mount -t proc proc /proc; $BB mount -t sysfs sysfs /sys; $BB mount -t devtmpfs dev /dev
for m in $MODULES; do
  $BB insmod "/modules/$m.ko" $(options $m) || echo "module $m does not load"
done
i=0
while [ ! -c $CONTROL ] && [ $i -lt 1000 ]; do $BB usleep 10000; i=$((i + 1)); done
exec 9> $CONTROL
$BB mount -t tmpfs tmpfs "$T"; $BB mkdir "$T/up" "$T/work" "$R" "$T/low"
NINEP=trans=virtio,version=9p2000.L,msize=512000
$BB mount -t 9p -o $NINEP,ro,cache=loose host "$T/low" || fail "no 9p mount of the host's files"
$BB mount -t overlay -o "lowerdir=$T/low,upperdir=$T/up,workdir=$T/work" overlay "$R" \
  || fail "no overlay over the host's files"
set_up_devices
$BB mkdir -p "$R$RUN"; $BB cp /command.sh "$R$RUN/command.sh"; SCRIPT=$RUN/command.sh
set -- @WRITABLE@
i=0
for d in "$@"; do
  $BB mount -t 9p -o $NINEP,cache=mmap rw$i "$R$d" || fail "$d cannot be mounted"
  i=$((i + 1))
done
set_up_network
run_command
"""


def _script(body: str, settings: dict[str, str], writable: list[Path]) -> str:
    options = " ".join(f"{module}:{option}" for module, option in kernel_modules.OPTIONS.items())
    settings = settings | {"OPTIONS": options}
    head = "".join(f"{name}={shlex.quote(value)}\n" for name, value in settings.items())
    body = body.replace("@WRITABLE@", shlex.join(map(str, writable)))
    return f"#!{settings['BB']} sh\n{head}{_COMMON}{body}"


def for_uml(busybox: str, run_dir: Path, buses: int, modules: list[str], rw: list[Path]) -> str:
    settings = {"BB": busybox, "RUN": str(run_dir), "T": f"{run_dir}/mount"}
    return _script(_UML, settings | {"BUSES": str(buses), "MODULES": " ".join(modules)}, rw)


def for_qemu(
    run_dir: Path, buses: int, controllers: int, modules: list[str], rw: list[Path]
) -> str:
    settings = {"BB": "/bin/busybox", "RUN": str(run_dir), "T": "/t"}
    settings["CONTROLLERS"] = str(controllers)
    return _script(_QEMU, settings | {"BUSES": str(buses), "MODULES": " ".join(modules)}, rw)
