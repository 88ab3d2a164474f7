"""A virtual machine with real kernel drivers that runs one command on this machine's own files.

    python tests/device_lab/machine.py 'ls /dev/dri'
    python tests/device_lab/machine.py --display 'modprobe vkms && .venv/bin/rig devices'

The guest sees the host's root read-only, below a scratch layer that vanishes; /lab is a shared folder that stays.
One emulated processor, no KVM: that is faster to boot than two, and works everywhere. It is one without AVX: QEMU
emulates that slowly, and wrongly (numpy's sort crashed on it with QEMU 7.2). The guest's time is the count of its
instructions, 500 million a second, so that a busy host makes nothing late in there. A command's time limit is by that
clock, too: a host that is slow only makes the run longer.
Exit status: the command's; 124 when it ran out of time, 125 when the machine did not live to its end.
"""

from __future__ import annotations

import argparse
import shlex
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from kernel import Kernel, prepare_kernel

TIMED_OUT, DIED = 124, 125
KILLED = 128 + 9
BEAT_S = 10
"""How often a machine says that it lives, by its own clock."""
SILENCE_S = 1800.0
"""A machine that says nothing for so long, by this machine's clock, is taken for dead. The longest silence of a living
one, on two processors that a dozen busy programs shared, was 226 s."""
END_WHEN_TOLD_S = 60
"""What a command has to end in after its time is over, before it is killed."""
BEGIN = """#!/bin/sh
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LANG=C.UTF-8
export PROCAM_DEVICE_LAB=1 PYTHONDONTWRITEBYTECODE=1 OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1
exec </dev/null >/dev/hvc0 2>&1
mkdir -p /dev/pts /dev/shm
mount -t devpts none /dev/pts
for folder in /dev/shm /run; do mount -t tmpfs none $folder; done
mkdir -m 1777 /run/tmp
export TMPDIR=/run/tmp
busybox ip link set lo up
mount -t debugfs none /sys/kernel/debug
rm -rf /lib/modules; mkdir /lib/modules; ln -s {modules} /lib/modules/{release}
cd {cwd}
touch /lab/began
while [ ! -e /lab/status ]; do echo >> /lab/alive; sleep {beat_s}; done &
{{ {limited} sh /lab/command.sh; echo $? > /lab/status; }} 2>&1 | cat
dmesg > /lab/dmesg
sync
busybox poweroff -f
"""


@dataclass(frozen=True)
class Machine:
    """How a machine is started. `displays`: a virtio-gpu with that many outputs; `boot`: more for the kernel."""

    memory_mb: int = 1536
    displays: int = 0
    boot: str = ""

    def command(self, kernel: Kernel, lab: Path) -> list[str]:
        """QEMU's command line."""
        boot = "console=ttyS0 quiet panic=-1 oops=panic tsc=reliable no_timer_check nokaslr mitigations=off audit=0"
        gpu = f"virtio-gpu-pci,id=gpu0,max_outputs={self.displays},xres=640,yres=480"
        return [
            *("qemu-system-x86_64", "-nodefaults", "-no-user-config", "-no-reboot", "-display", "none"),
            *("-machine", "pc", "-cpu", "Nehalem", "-smp", "1", "-m", str(self.memory_mb)),
            *("-accel", "tcg,thread=single", "-icount", "shift=1"),
            *("-kernel", str(kernel.image), "-initrd", str(kernel.initramfs), "-append", f"{boot} {self.boot}"),
            *("-chardev", f"file,id=console,path={lab}/console.log", "-serial", "chardev:console"),
            *("-device", "virtio-serial-pci", "-chardev", "stdio,id=output,signal=off"),
            *("-device", "virtconsole,chardev=output", "-device", "virtio-rng-pci"),
            *("-virtfs", "local,path=/,mount_tag=host,security_model=none,readonly=on,multidevs=remap"),
            *("-virtfs", f"local,path={lab},mount_tag=lab,security_model=none"),
            *(("-device", gpu) if self.displays else ()),
        ]


@dataclass(frozen=True)
class Ending:
    """How a command ended: its exit status, and what cut it short, if something did."""

    status: int
    cut_short: str = ""


def limited(limit_s: float) -> list[str]:
    """Begin of a command line with a time limit, by the clock of the machine that runs it.

    When the time is over it is interrupted as by Ctrl-C, so that pytest still reports what it has.
    """
    return ["timeout", "--signal=INT", f"--kill-after={END_WHEN_TOLD_S}", f"{limit_s:g}"]


def ending_of(status: int, limit_s: float) -> Ending:
    """What the exit status of a command with a time limit says."""
    if status == TIMED_OUT:
        return Ending(status, f"out of time, which was {limit_s:g} s by its machine's clock")
    if status == KILLED:
        return Ending(status, f"killed: out of memory, or of time ({limit_s:g} s by its machine's clock)")
    return Ending(status)


def run_in_machine(
    command: str,
    *,
    machine: Machine = Machine(),
    limit_s: float = 600,
    lab: Path | None = None,
    cwd: Path | None = None,
    output: int | None = None,
    niceness: int = 0,
) -> Ending:
    """Boot, run a shell command, power off; `output` is a file descriptor for what it prints.

    The time limit is by the machine's own clock. A machine that dies before the command began is started once more;
    never after.
    """
    kernel = prepare_kernel()
    lab = lab or Path(tempfile.mkdtemp(prefix="device-lab-"))
    lab.mkdir(parents=True, exist_ok=True)
    begin = BEGIN.format(
        modules=kernel.modules,
        release=kernel.release,
        cwd=shlex.quote(str(cwd or Path.cwd())),
        beat_s=BEAT_S,
        limited=" ".join(limited(limit_s)),
    )
    (lab / "begin.sh").write_text(begin)
    (lab / "command.sh").write_text(command + "\n")
    for _ in range(2):
        for name in ("began", "status", "alive"):
            (lab / name).unlink(missing_ok=True)
        argv = ["nice", "-n", str(niceness), *machine.command(kernel, lab)]
        by_itself = _wait_while_alive(subprocess.Popen(argv, stdin=subprocess.DEVNULL, stdout=output), lab)
        if (lab / "began").exists():
            break
    return ending_in(lab, limit_s=limit_s, by_itself=by_itself)


def _wait_while_alive(process: subprocess.Popen[bytes], lab: Path) -> bool:
    """Whether the machine ended by itself; one that falls silent is ended."""
    with process:
        try:
            signs, since_s = _signs_of_life(lab), time.monotonic()
            while time.monotonic() < since_s + SILENCE_S:
                try:
                    process.wait(1.0)
                    return True
                except subprocess.TimeoutExpired:
                    before, signs = signs, _signs_of_life(lab)
                if signs != before:
                    since_s = time.monotonic()
            return False
        finally:
            process.kill()


def _signs_of_life(lab: Path) -> list[tuple[int, int]]:
    """Sizes and times of the files that a living machine writes to."""
    found = [lab / name for name in ("console.log", "alive") if (lab / name).exists()]
    return [(file.stat().st_size, file.stat().st_mtime_ns) for file in found]


def ending_in(lab: Path, *, limit_s: float, by_itself: bool) -> Ending:
    """What the files in a machine's folder say of how its command ended; `by_itself`: the machine was not ended."""
    try:
        return ending_of(int((lab / "status").read_text()), limit_s)
    except (OSError, ValueError):
        log = (lab / "console.log").read_text(errors="replace") if (lab / "console.log").exists() else ""
    how = "died" if by_itself else f"was silent for {SILENCE_S:g} s"
    when = "" if (lab / "began").exists() else " before it began: the kernel was not loaded"
    print(f"device lab: last words of the machine that {how}:\n{log[-3000:]}", file=sys.stderr)
    return Ending(DIED, f"its machine {how}{when}")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--display", action="store_true", help="add a virtio-gpu with two outputs")
    parser.add_argument("--boot", default="", help="more for the kernel's command line")
    parser.add_argument("--memory-mb", type=int, default=1536)
    parser.add_argument("--timeout", type=float, default=600, help="seconds of the machine's clock")
    parser.add_argument("--lab", type=Path, help="folder that is /lab in the guest; default: a new one")
    parser.add_argument("command", nargs="+", help="a shell command line")
    given = parser.parse_args()
    machine = Machine(given.memory_mb, 2 if given.display else 0, given.boot)
    lab = given.lab.resolve() if given.lab else None
    ending = run_in_machine(" ".join(given.command), machine=machine, limit_s=given.timeout, lab=lab)
    if ending.cut_short:
        print(f"device lab: {ending.cut_short}", file=sys.stderr)
    return ending.status


if __name__ == "__main__":
    sys.exit(main())
