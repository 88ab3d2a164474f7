"""A stock Debian kernel for the device lab: downloaded, unpacked, never installed; made once and kept.

    python tests/device_lab/kernel.py        # prints the folder; about a minute the first time

The kernel is Debian's newest 6.12 (else its 6.1), with all its modules. Debian leaves out vkms, the display driver
that has real page flips and no hardware; it is compiled from Debian's own source of the same kernel.
"""

from __future__ import annotations

import gzip
import lzma
import os
import shutil
import stat
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

META_PACKAGES = {"linux-image-6.12-amd64": "linux-source-6.12", "linux-image-amd64": "linux-source-6.1"}
"""Names that Debian moves to its newest kernel, best first, and the package with their source."""
BOOT_MODULES = ("virtio_pci", "virtio_mmio", "virtio_console", "9pnet_virtio", "9p", "overlay")
RECIPE = "1"
"""Count up when the way a kernel is made changes: it is part of the cache's name."""

INIT = """#!/bin/busybox sh
b=/bin/busybox
$b mkdir -p /proc /sys /dev /host /scratch /merged
$b mount -t proc none /proc; $b mount -t sysfs none /sys; $b mount -t devtmpfs none /dev
for module in $($b cat /modules/order); do $b insmod /modules/$module || echo "cannot load $module"; done
mount9p() { $b mount -t 9p -o trans=virtio,version=9p2000.L,msize=512000,$3 $1 $2 || $b poweroff -f; }
mount9p host /host ro,cache=loose
$b mount -t tmpfs -o size=75% none /scratch
$b mkdir /scratch/upper /scratch/work
$b mount -t overlay -o lowerdir=/host,upperdir=/scratch/upper,workdir=/scratch/work none /merged || $b poweroff -f
$b mkdir -p /merged/lab /merged/proc /merged/sys /merged/dev
mount9p lab /merged/lab cache=none
for kept in proc sys dev; do $b mount --move /$kept /merged/$kept; done
exec $b switch_root /merged /bin/sh /lab/begin.sh
"""


@dataclass(frozen=True)
class Kernel:
    """An unpacked kernel: `boot/vmlinuz-RELEASE`, `lib/modules/RELEASE`, `initramfs.gz`."""

    folder: Path
    release: str

    @property
    def image(self) -> Path:
        return self.folder / "boot" / f"vmlinuz-{self.release}"

    @property
    def modules(self) -> Path:
        return self.folder / "lib/modules" / self.release

    @property
    def initramfs(self) -> Path:
        return self.folder / "initramfs.gz"


def cache_folder() -> Path:
    """Where kernels are kept: PROCAM_LAB_CACHE, or the user's cache folder."""
    default = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "procam-rig" / "device-lab"
    return Path(os.environ.get("PROCAM_LAB_CACHE") or default)


def prepare_kernel() -> Kernel:
    """The newest kernel that Debian offers, from the cache or made now; complete or not there at all."""
    package, source = _newest()
    release = package.removeprefix("linux-image-")
    folder = cache_folder() / f"{release}-{RECIPE}"
    if not folder.is_dir():
        cache_folder().mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=cache_folder()) as made:
            _make(Path(made) / "kernel", release, package, source)
            os.replace(Path(made) / "kernel", folder)
    return Kernel(folder, release)


def _newest() -> tuple[str, str]:
    for meta, source in META_PACKAGES.items():
        listed = subprocess.run(["apt-cache", "depends", meta], capture_output=True, text=True, check=False).stdout
        images = [line.split()[-1] for line in listed.splitlines() if "Depends: linux-image-" in line]
        if images:
            return images[0], source
    raise SystemExit(f"no kernel package ({', '.join(META_PACKAGES)}) is known to apt; run apt-get update")


def _make(folder: Path, release: str, package: str, source: str) -> None:
    print(f"device lab: making kernel {release} (once; about 280 MB of packages)", file=sys.stderr, flush=True)
    folder.mkdir()
    _unpack([package], folder)
    with tempfile.TemporaryDirectory() as scratch:
        _build_vkms(Path(scratch), release, source, folder / "lib/modules" / release)
    _run(["depmod", "-b", str(folder), release])
    write_initramfs(Kernel(folder, release))


def _unpack(packages: list[str], into: Path) -> None:
    with tempfile.TemporaryDirectory() as downloads:
        os.chmod(downloads, 0o755)
        _run(["apt-get", "download", "-qq", "-o", "APT::Sandbox::User=root", *packages], cwd=Path(downloads))
        for file in sorted(Path(downloads).glob("*.deb")):
            _run(["dpkg", "-x", str(file), str(into)])


def _build_vkms(scratch: Path, release: str, source: str, modules: Path) -> None:
    base = release.removesuffix("-amd64")
    short = ".".join(base.split(".")[:2]) if source == "linux-source-6.1" else base
    _unpack([f"linux-headers-{release}", f"linux-headers-{base}-common", f"linux-kbuild-{short}", source], scratch)
    headers = scratch / "usr/src" / f"linux-headers-{release}"
    makefile = headers / "Makefile"
    makefile.write_text(makefile.read_text().replace("include /usr/src/", f"include {scratch}/usr/src/"))
    (headers / "vmlinux").unlink(missing_ok=True)  # with it, the build wants a tool for debug information
    archive = scratch / "usr/src" / f"{source}.tar.xz"
    _run(["tar", "-C", str(scratch), "-xf", str(archive), "--wildcards", "*/drivers/gpu/drm/vkms/*"])
    driver = scratch / source / "drivers/gpu/drm/vkms"
    build = driver / "Makefile"
    build.write_text(build.read_text().replace("$(CONFIG_DRM_VKMS)", "m"))
    _run(["make", "-s", "-C", str(headers), f"M={driver}", "modules"])
    (modules / "updates").mkdir()
    _run(["strip", "-g", str(driver / "vkms.ko"), "-o", str(modules / "updates/vkms.ko")])


def _run(command: list[str], cwd: Path | None = None) -> None:
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(command)} failed:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")


def write_initramfs(kernel: Kernel) -> None:
    """A first root with busybox and the modules that reach the host's files."""
    busybox = shutil.which("busybox")
    if busybox is None:
        raise SystemExit("busybox is missing: apt-get install busybox-static")
    files = {"bin/busybox": Path(busybox).read_bytes(), "init": INIT.encode()}
    modules = [kernel.modules / name for name in _in_load_order(kernel.modules)]
    names = [path.name.split(".ko")[0] for path in modules]
    files["modules/order"] = "\n".join(names).encode()
    for name, path in zip(names, modules, strict=True):
        data = path.read_bytes()
        files[f"modules/{name}"] = lzma.decompress(data) if path.suffix == ".xz" else data
    kernel.initramfs.write_bytes(gzip.compress(_cpio(files), 1))


def _in_load_order(modules: Path) -> list[str]:
    """Files of BOOT_MODULES, each after what it needs; what is built in has none."""
    needs: dict[str, list[str]] = {}
    for line in (modules / "modules.dep").read_text().splitlines():
        file, _, others = line.partition(": " if ": " in line else ":")
        needs[Path(file).name.split(".ko")[0].replace("-", "_")] = [*reversed(others.split()), file]
    return list(dict.fromkeys(file for name in BOOT_MODULES for file in needs.get(name, [])))


def _cpio(files: dict[str, bytes]) -> bytes:
    """A "newc" archive of executable files, their folders, and the console."""
    entries = [(folder, stat.S_IFDIR | 0o755, b"", (0, 0)) for folder in ("bin", "modules", "dev")]
    entries.append(("dev/console", stat.S_IFCHR | 0o600, b"", (5, 1)))
    entries += [(name, stat.S_IFREG | 0o755, data, (0, 0)) for name, data in files.items()]
    archive = b""
    for number, (name, mode, data, device) in enumerate([*entries, ("TRAILER!!!", 0, b"", (0, 0))]):
        fields = (number, mode, 0, 0, 1, 0, len(data), 0, 0, *device, len(name) + 1, 0)
        head = b"070701" + b"".join(b"%08x" % field for field in fields) + name.encode() + b"\0"
        archive += head + bytes(-len(head) % 4) + data + bytes(-len(data) % 4)
    return archive


if __name__ == "__main__":
    print(prepare_kernel().folder)
