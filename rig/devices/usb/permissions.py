"""What to do when the user may not open a device: a udev rule, ready to paste."""

from __future__ import annotations

import grp
import pwd
import stat
from pathlib import Path

from rig.errors import DeviceForbidden


def udev_rule(vendor_id: int, product_id: int) -> str:
    """Shell lines that let the user at the machine open a USB device: its raw node, video and hidraw nodes.

    The file's name sorts before ``73-seat-late.rules``, which is where systemd acts on the tag ``uaccess``.
    """
    ids = f'ATTRS{{idVendor}}=="{vendor_id:04x}", ATTRS{{idProduct}}=="{product_id:04x}"'
    match = [f'SUBSYSTEM=="{name}", {ids}, MODE="0660", TAG+="uaccess"' for name in ("usb", "video4linux", "hidraw")]
    file = f"/etc/udev/rules.d/70-procam-rig-{vendor_id:04x}-{product_id:04x}.rules"
    return "\n".join(
        [
            f"sudo tee {file} <<'RULE'",
            *match,
            "RULE",
            "sudo udevadm control --reload-rules",
            "sudo udevadm trigger",
        ]
    )


def forbidden(node: Path, vendor_id: int | None = None, product_id: int | None = None) -> DeviceForbidden:
    """The error for a device node that may not be opened: who may, and how to be allowed.

    With the USB ids the message holds a udev rule; without them only the group to join.
    """
    lines = [f"{node}: you may not open it{_owners(node)}"]
    group = _group(node)
    if group not in (None, "root"):
        lines.append(f"to be allowed, log in again after: sudo usermod -aG {group} $USER")
    if vendor_id is not None and product_id is not None:
        lines.append("to allow whoever sits at this machine, paste this once:")
        lines.append(udev_rule(vendor_id, product_id))
    return DeviceForbidden("\n".join(lines))


def _owners(node: Path) -> str:
    try:
        state = node.stat()
    except OSError:
        return ""
    try:
        owner = pwd.getpwuid(state.st_uid).pw_name
    except KeyError:
        owner = str(state.st_uid)
    return f": it is {stat.filemode(state.st_mode)} of {owner}, group {_group(node)}"


def _group(node: Path) -> str | None:
    try:
        number = node.stat().st_gid
    except OSError:
        return None
    try:
        return grp.getgrgid(number).gr_name
    except KeyError:
        return str(number)
