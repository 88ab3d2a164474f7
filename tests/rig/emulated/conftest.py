"""A cable between an emulated device and a host made of a socket."""

import socket
from collections.abc import Iterator

import pytest

from tests.rig.emulated.usb_host import Host


@pytest.fixture
def cable() -> Iterator[tuple[socket.socket, Host]]:
    device_end, host_end = socket.socketpair()
    with device_end, host_end:
        yield device_end, Host(host_end)
