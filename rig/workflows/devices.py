"""What this machine's kernel shows of cameras, display outputs and USB: verb `devices`."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def list_devices(root: Path = Path("/")) -> dict[str, Any]:
    """Cameras (V4L2 nodes with their stable names) and display connectors, from sysfs; opens nothing."""
    return {"cameras": _cameras(root), "outputs": _outputs(root)}


def _cameras(root: Path) -> list[dict[str, Any]]:
    by_id = root / "dev/v4l/by-id"
    names = {link.resolve().name: link.name for link in sorted(by_id.iterdir())} if by_id.is_dir() else {}
    nodes = sorted((root / "sys/class/video4linux").glob("video*"))
    return [{"node": node.name, "name": _text(node / "name"), "stable_id": names.get(node.name)} for node in nodes]


def _outputs(root: Path) -> list[dict[str, Any]]:
    connectors = sorted((root / "sys/class/drm").glob("card*-*"))
    return [
        {
            "connector": connector.name.split("-", 1)[1],
            "status": _text(connector / "status"),
            "modes": _text(connector / "modes").splitlines(),
        }
        for connector in connectors
    ]


def _text(path: Path) -> str:
    try:
        return path.read_text().strip()
    except OSError:
        return ""
