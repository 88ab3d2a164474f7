"""GigE and USB3 cameras: what is there, under which address, and why one cannot be reached."""

from __future__ import annotations

import ipaddress
import socket
import sys
from dataclasses import dataclass
from pathlib import Path

from rig.devices.genicam.aravis import aravis
from rig.devices.genicam.usb import why_usb_silent
from rig.errors import DeviceLost

CONTROL_PORT = 3956
"""UDP port on which GigE Vision cameras listen."""
_ROUTES = Path("/proc/net/route")
_USB = "usb3-"
_PROTOCOLS = {"GigEVision": "gige", "USB3Vision": "usb3"}


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundGenicam:
    """A camera that answered."""

    device_id: str
    """``gige-SERIAL`` or ``usb3-SERIAL``: which camera, wherever it is plugged in."""
    vendor: str
    model: str
    serial: str
    address: str
    """IP address, or the USB bus's."""
    aravis_id: str

    @property
    def is_gige(self) -> bool:
        """Whether it is on the network."""
        return self.device_id.startswith("gige-")

    @property
    def opened_by(self) -> str:
        """What Aravis opens it by: an address answers at once, a name is looked for on all networks."""
        return self.address if self.is_gige else self.aravis_id


def list_genicam() -> list[FoundGenicam]:
    """Look for cameras on all networks and USB; takes about half a second. Raises DeviceError without the library."""
    library = aravis()
    library.call("arv_update_device_list")
    found = []
    for index in range(library.call("arv_get_n_devices")):
        said = {
            what: (library.call(f"arv_get_device_{what}", index) or b"").decode(errors="replace")
            for what in ("id", "address", "vendor", "model", "serial_nbr", "protocol")
        }
        if (bus := _PROTOCOLS.get(said["protocol"])) is not None:
            found.append(
                FoundGenicam(
                    device_id=f"{bus}-{said['serial_nbr']}",
                    vendor=said["vendor"],
                    model=said["model"],
                    serial=said["serial_nbr"],
                    address=said["address"],
                    aravis_id=said["id"],
                )
            )
    return found


def is_address(device_id: str) -> bool:
    """Tell whether an id is an IP address."""
    try:
        ipaddress.ip_address(device_id)
    except ValueError:
        return False
    return True


def is_loopback(device_id: str) -> bool:
    """Tell whether a camera is on this machine's own network, where no packet is too small."""
    try:
        return ipaddress.ip_address(opened_by(device_id)).is_loopback
    except (ValueError, DeviceLost):
        return False


def opened_by(device_id: str) -> str:
    """Return what Aravis opens a camera by.

    Raises DeviceLost when there is none, or several; DeviceForbidden when it is on USB, and this user may not open it.
    """
    if is_address(device_id):
        return device_id
    cameras = list_genicam()
    matching = [one for one in cameras if device_id in (one.device_id, one.serial)]
    if len(matching) == 1:
        return matching[0].opened_by
    if device_id.startswith(_USB):
        raise DeviceLost(f"camera {device_id} is not there: {why_usb_silent(device_id)}")
    there = ", ".join(one.device_id for one in cameras) or "none answers"
    what = "several cameras have this serial number" if matching else "is not there"
    raise DeviceLost(
        f"camera {device_id}: {what}; there are: {there}. Check power and cable; a camera in another subnet does not "
        "answer: give its address as device_id"
    )


def why_silent(address: str) -> str:
    """Return why a camera at an address may not answer, and what to do."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((address, CONTROL_PORT))
        except OSError as error:
            return (
                f"this machine has no route to {address} ({error.strerror}); give the network card an address in the "
                "camera's subnet, e.g.: ip addr add 169.254.0.1/16 dev eth0"
            )
    if not _is_near(address):
        return (
            f"{address} is in no subnet of this machine's network cards, and GigE cameras answer only within theirs; "
            "give the card an address beside it, or the camera one beside the card's (its maker's tool sets it)"
        )
    return (
        f"nothing answers at {address}: check power and cable; a firewall has to let UDP port {CONTROL_PORT} out and "
        "all UDP from the camera in"
    )


def _is_near(address: str) -> bool:
    """Whether a network card is directly in the address's subnet, by the kernel's table; loopback is not in it."""
    number = ipaddress.ip_address(address)
    if number.is_loopback or number.version != 4:
        return True
    try:
        rows = [line.split() for line in _ROUTES.read_text().splitlines()[1:]]
    except OSError:
        return True
    direct = [(row[1], row[7]) for row in rows if len(row) > 7 and int(row[2], 16) == 0]
    return any(int(number) & _host_order(mask) == _host_order(net) != 0 for net, mask in direct)


def _host_order(text: str) -> int:
    """The kernel prints the four bytes of an address as a number of this machine's order."""
    return int.from_bytes(int(text, 16).to_bytes(4, sys.byteorder), "big")
