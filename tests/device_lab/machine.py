"""A virtual machine with real kernel drivers that runs one command on this machine's own files.

    python tests/device_lab/machine.py 'ls /dev/dri'
    python tests/device_lab/machine.py --display 'modprobe vkms && .venv/bin/rig devices'

The guest sees the host's root read-only, below a scratch layer that vanishes; /lab is a shared folder that stays.
One emulated processor, no KVM: that is faster to boot than two, and works everywhere. It is one without AVX: QEMU
emulates that slowly, and wrongly (numpy's sort crashed on it with QEMU 7.2). The guest's time is the count of its
instructions, 500 million a second, so that a busy host makes nothing late in there.
Exit status: the command's; 124 when it ran out of time, 125 when the machine died.
"""

from __future__ import annotations

import argparse
import shlex
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from kernel import Kernel, prepare_kernel

TIMED_OUT, DIED = 124, 125
BEGIN = """#!/bin/sh
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LANG=C.UTF-8
export PROCAM_DEVICE_LAB=1 PYTHONDONTWRITEBYTECODE=1 OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1
exec </dev/null >/dev/hvc0 2>&1
mkdir -p /dev/pts /dev/shm
mount -t devpts none /dev/pts
for folder in /dev/shm /run /tmp; do mount -t tmpfs none $folder; done
busybox ip link set lo up
mount -t debugfs none /sys/kernel/debug
rm -rf /lib/modules; mkdir /lib/modules; ln -s {modules} /lib/modules/{release}
cd {cwd}
touch /lab/began
{{ sh /lab/command.sh; echo $? > /lab/status; }} 2>&1 | cat
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


def run_in_machine(
    command: str,
    *,
    machine: Machine = Machine(),
    timeout_s: float = 600,
    lab: Path | None = None,
    cwd: Path | None = None,
    output: int | None = None,
    niceness: int = 0,
) -> int:
    """Boot, run a shell command, power off; `output` is a file descriptor for what it prints.

    A machine that dies before the command began is started once more; never after.
    """
    kernel = prepare_kernel()
    lab = lab or Path(tempfile.mkdtemp(prefix="device-lab-"))
    lab.mkdir(parents=True, exist_ok=True)
    begin = BEGIN.format(modules=kernel.modules, release=kernel.release, cwd=shlex.quote(str(cwd or Path.cwd())))
    (lab / "begin.sh").write_text(begin)
    (lab / "command.sh").write_text(command + "\n")
    for _ in range(2):
        for name in ("began", "status"):
            (lab / name).unlink(missing_ok=True)
        argv = ["nice", "-n", str(niceness), *machine.command(kernel, lab)]
        try:
            subprocess.run(argv, stdin=subprocess.DEVNULL, stdout=output, timeout=timeout_s, check=False)
        except subprocess.TimeoutExpired:
            print(f"device lab: stopped after {timeout_s:g} s: {command}", file=sys.stderr)
            return TIMED_OUT
        if (lab / "began").exists():
            break
    return _status(lab)


def _status(lab: Path) -> int:
    try:
        return int((lab / "status").read_text())
    except (OSError, ValueError):
        log = (lab / "console.log").read_text(errors="replace") if (lab / "console.log").exists() else ""
        print(f"device lab: the machine died\n{log[-3000:]}", file=sys.stderr)
        return DIED


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--display", action="store_true", help="add a virtio-gpu with two outputs")
    parser.add_argument("--boot", default="", help="more for the kernel's command line")
    parser.add_argument("--memory-mb", type=int, default=1536)
    parser.add_argument("--timeout", type=float, default=600, help="seconds")
    parser.add_argument("--lab", type=Path, help="folder that is /lab in the guest; default: a new one")
    parser.add_argument("command", nargs="+", help="a shell command line")
    given = parser.parse_args()
    machine = Machine(given.memory_mb, 2 if given.display else 0, given.boot)
    lab = given.lab.resolve() if given.lab else None
    return run_in_machine(" ".join(given.command), machine=machine, timeout_s=given.timeout, lab=lab)


if __name__ == "__main__":
    sys.exit(main())
