"""Aravis by ctypes: the functions that are used, their types, and their errors.

Only plain functions are called: nothing of GObject's introspection, and no callback into Python while a camera is
driven.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from ctypes import POINTER, byref, c_char_p, c_double, c_int, c_int64, c_size_t, c_uint, c_uint32, c_uint64, c_void_p
from functools import cache
from typing import Any

from rig.errors import DeviceError

LIBRARY = "libaravis-0.8.so.0"
PACKAGE = "libaravis-0.8-0"
"""Of Debian and its relatives."""

_NOT_CONNECTED, _TIMEOUT, _NOT_FOUND, _NOT_CONTROLLER = "not connected", "timeout", "not found", "not controller"
_CODES = {2: _NOT_CONNECTED, 5: _TIMEOUT, 6: _NOT_FOUND, 10: _NOT_CONTROLLER, 17: _NOT_CONTROLLER}
"""Of ArvDeviceError, as arvdevice.h of Aravis 0.8 counts them; 17 is an access that the camera denied."""
_POINTER, _TEXT = c_void_p, c_char_p
_NO_ERROR: Mapping[str, tuple[Any, tuple[Any, ...]]] = {
    "arv_update_device_list": (None, ()),
    "arv_get_n_devices": (c_uint, ()),
    **{
        f"arv_get_device_{what}": (_TEXT, (c_uint,))
        for what in ("id", "address", "vendor", "model", "serial_nbr", "protocol", "physical_id")
    },
    "arv_enable_interface": (None, (_TEXT,)),
    "arv_camera_get_device": (_POINTER, (_POINTER,)),
    "arv_camera_is_gv_device": (c_int, (_POINTER,)),
    "arv_camera_gv_set_stream_options": (None, (_POINTER, c_int)),
    "arv_gv_device_is_controller": (c_int, (_POINTER,)),
    "arv_device_get_feature": (_POINTER, (_POINTER, _TEXT)),
    "arv_device_set_register_cache_policy": (None, (_POINTER, c_int)),
    "arv_device_set_range_check_policy": (None, (_POINTER, c_int)),
    "arv_stream_push_buffer": (None, (_POINTER, _POINTER)),
    "arv_stream_try_pop_buffer": (_POINTER, (_POINTER,)),
    "arv_stream_timeout_pop_buffer": (_POINTER, (_POINTER, c_uint64)),
    "arv_stream_get_statistics": (None, (_POINTER, POINTER(c_uint64), POINTER(c_uint64), POINTER(c_uint64))),
    "arv_gv_stream_get_statistics": (None, (_POINTER, POINTER(c_uint64), POINTER(c_uint64))),
    "arv_buffer_new_allocate": (_POINTER, (c_size_t,)),
    "arv_buffer_get_status": (c_int, (_POINTER,)),
    "arv_buffer_get_timestamp": (c_uint64, (_POINTER,)),
    "arv_buffer_get_system_timestamp": (c_uint64, (_POINTER,)),
    "arv_buffer_get_frame_id": (c_uint64, (_POINTER,)),
    "arv_buffer_get_data": (_POINTER, (_POINTER, POINTER(c_size_t))),
    "arv_buffer_get_image_pixel_format": (c_uint32, (_POINTER,)),
    "arv_buffer_get_image_width": (c_int, (_POINTER,)),
    "arv_buffer_get_image_height": (c_int, (_POINTER,)),
    "arv_buffer_get_image_data": (_POINTER, (_POINTER, POINTER(c_size_t))),
    "arv_gv_fake_camera_new_full": (_POINTER, (_TEXT, _TEXT, _TEXT)),
    "arv_gv_fake_camera_is_running": (c_int, (_POINTER,)),
    "arv_gv_fake_camera_get_fake_camera": (_POINTER, (_POINTER,)),
    "arv_fake_camera_set_fill_pattern": (None, (_POINTER, c_void_p, c_void_p)),
    "arv_fake_camera_write_register": (c_int, (_POINTER, c_uint32, c_uint32)),
    "arv_fake_camera_read_register": (c_int, (_POINTER, c_uint32, POINTER(c_uint32))),
    "arv_fake_camera_set_trigger_frequency": (None, (_POINTER, c_double)),
    "g_object_unref": (None, (_POINTER,)),
    "g_free": (None, (_POINTER,)),
}
_WITH_ERROR: Mapping[str, tuple[Any, tuple[Any, ...]]] = {
    "arv_camera_new": (_POINTER, (_TEXT,)),
    "arv_camera_create_stream": (_POINTER, (_POINTER, c_void_p, c_void_p)),
    "arv_camera_start_acquisition": (None, (_POINTER,)),
    "arv_camera_stop_acquisition": (None, (_POINTER,)),
    "arv_camera_get_payload": (c_uint, (_POINTER,)),
    "arv_camera_gv_auto_packet_size": (c_uint, (_POINTER,)),
    "arv_camera_gv_get_packet_size": (c_uint, (_POINTER,)),
    "arv_camera_gv_set_packet_size": (None, (_POINTER, c_int)),
    "arv_device_is_feature_available": (c_int, (_POINTER, _TEXT)),
    "arv_device_execute_command": (None, (_POINTER, _TEXT)),
    "arv_device_get_string_feature_value": (_TEXT, (_POINTER, _TEXT)),
    "arv_device_set_string_feature_value": (None, (_POINTER, _TEXT, _TEXT)),
    "arv_device_get_integer_feature_value": (c_int64, (_POINTER, _TEXT)),
    "arv_device_set_integer_feature_value": (None, (_POINTER, _TEXT, c_int64)),
    "arv_device_get_float_feature_value": (c_double, (_POINTER, _TEXT)),
    "arv_device_set_float_feature_value": (None, (_POINTER, _TEXT, c_double)),
    "arv_device_get_boolean_feature_value": (c_int, (_POINTER, _TEXT)),
    "arv_device_set_boolean_feature_value": (None, (_POINTER, _TEXT, c_int)),
    "arv_device_get_float_feature_bounds": (None, (_POINTER, _TEXT, POINTER(c_double), POINTER(c_double))),
    "arv_device_dup_available_enumeration_feature_values_as_strings": (
        POINTER(c_char_p),
        (_POINTER, _TEXT, POINTER(c_uint)),
    ),
    "arv_device_read_register": (c_int, (_POINTER, c_uint64, POINTER(c_uint32))),
}


class _GError(ctypes.Structure):
    """GLib's error, of a domain, with a code."""

    _fields_ = (("domain", c_uint32), ("code", c_int), ("message", c_char_p))


class AravisError(Exception):
    """What a function of Aravis reports; never leaves this folder but as a DeviceError."""

    def __init__(self, message: str, code: int | None):
        super().__init__(message)
        self._reason = None if code is None else _CODES.get(code)

    @property
    def means_gone(self) -> bool:
        """The camera does not answer, or is not there."""
        return self._reason in (_NOT_CONNECTED, _TIMEOUT, _NOT_FOUND)

    @property
    def means_taken(self) -> bool:
        """Another program controls the camera."""
        return self._reason == _NOT_CONTROLLER


class Aravis:
    """The library, with the types of its functions set."""

    def __init__(self, path: str = LIBRARY):
        self._library = ctypes.CDLL(path)
        for table, extra in ((_NO_ERROR, ()), (_WITH_ERROR, (c_void_p,))):
            for name, (result, arguments) in table.items():
                function = getattr(self._library, name)
                function.restype, function.argtypes = result, (*arguments, *extra)
        self._set_object = self._library.g_object_set
        self._set_object.restype = None

    def call(self, name: str, *arguments: Any) -> Any:
        """Call a function. Raises AravisError when it reports an error."""
        function = getattr(self._library, name)
        if name in _NO_ERROR:
            return function(*arguments)
        error = POINTER(_GError)()
        result = function(*arguments, byref(error))
        if error:
            text, code = (error.contents.message or b"").decode(errors="replace"), self._code(error.contents)
            self._library.g_error_free(error)
            raise AravisError(text, code)
        return result

    def _code(self, error: _GError) -> int | None:
        """Of a device's error; other domains count otherwise."""
        return int(error.code) if error.domain == self._library.arv_device_error_quark() else None

    def set_properties(self, target: int, **values: int | float) -> None:
        """Set properties of an object; whole numbers are 32 bits wide."""
        for name, value in values.items():
            number = c_double(value) if isinstance(value, float) else c_int(value)
            self._set_object(c_void_p(target), name.replace("_", "-").encode(), number, c_void_p(None))


@cache
def _loaded() -> Aravis | OSError:
    try:
        return Aravis()
    except OSError as error:
        return error


def aravis() -> Aravis:
    """Return the library. Raises DeviceError, with the package to install, where there is none."""
    found = _loaded()
    if isinstance(found, OSError):
        raise DeviceError(
            f"{LIBRARY} is missing, which drives GigE and USB3 cameras; install it (Debian: apt install {PACKAGE})"
        )
    return found


def is_installed() -> bool:
    """Tell whether the library is there."""
    return isinstance(_loaded(), Aravis)
