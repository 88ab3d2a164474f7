"""Features of a camera by name: read, set, and read back."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from ctypes import byref, c_double, c_uint
from typing import Any, NamedTuple

from rig.devices.genicam.aravis import AravisError, aravis
from rig.devices.genicam.settings import Value
from rig.errors import DeviceLost, SettingRefused

EXPOSURES = ("ExposureTime", "ExposureTimeAbs")
"""In microseconds; the second name is that of cameras before SFNC 2.0."""
AUTOMATICS = ("ExposureAuto", "GainAuto", "BlackLevelAuto", "BalanceWhiteAuto")
"""Switched off, where there are any."""
_SWITCHES = ("GammaEnable", "GammaEnabled", "ReverseX", "ReverseY", "LUTEnable")
"""Switched off as well: what bends the response or turns the picture."""
_NEUTRAL: Mapping[str, float] = {"Gamma": 1.0, "BinningHorizontal": 1, "BinningVertical": 1}
_CHECKED = 1
"""Aravis: a number outside its bounds is refused, not passed on."""
_SAME = 1e-3
"""Relative: a feature is stepped, and says what it took."""


class Feature(NamedTuple):
    """A feature, and what it has to be."""

    name: str
    value: Value


class Features:
    """The features of an open camera.

    Parameters
    ----------
    device
        Aravis' pointer.
    name
        How messages call the camera.
    """

    def __init__(self, device: int, name: str):
        self._device, self._name = device, name
        aravis().call("arv_device_set_range_check_policy", device, _CHECKED)

    def has(self, feature: str) -> bool:
        """Tell whether there is such a feature, and it may be used now."""
        with suppress(AravisError):
            return bool(self._call("arv_device_is_feature_available", feature))
        return False

    def first_of(self, features: Iterable[str]) -> str | None:
        """Return the first feature that there is."""
        return next((one for one in features if self.has(one)), None)

    def text(self, feature: str) -> str:
        """Return an enumeration's entry, or a text."""
        return (self._called("arv_device_get_string_feature_value", feature) or b"").decode(errors="replace")

    def number(self, feature: str) -> float:
        """Return a whole number or another."""
        with suppress(AravisError):
            return float(self._call("arv_device_get_float_feature_value", feature))
        return float(self._called("arv_device_get_integer_feature_value", feature))

    def bounds(self, feature: str) -> tuple[float, float]:
        """Return least and most of a number, in its own unit."""
        least, most = c_double(), c_double()
        self._called("arv_device_get_float_feature_bounds", feature, byref(least), byref(most))
        return least.value, most.value

    def entries(self, feature: str) -> list[str]:
        """Return the entries of an enumeration that can be chosen now."""
        count = c_uint()
        name = "arv_device_dup_available_enumeration_feature_values_as_strings"
        found = self._called(name, feature, byref(count))
        listed = [(found[k] or b"").decode() for k in range(count.value)]
        aravis().call("g_free", found)
        return listed

    def do(self, command: str) -> None:
        """Give a command."""
        self._called("arv_device_execute_command", command)

    def set_number(self, feature: str, value: float) -> float:
        """Set a number, whole or not, and return what the camera took."""
        try:
            self._call("arv_device_set_float_feature_value", feature, float(value))
        except AravisError:
            self._called("arv_device_set_integer_feature_value", feature, round(value))
        return self.number(feature)

    def hold(self, setting: Feature) -> None:
        """Set a feature and read it back. Raises SettingRefused for another value, or when there is none."""
        name, value = setting
        if not self.has(name):
            raise SettingRefused(f"{self._name} has no feature {name!r} that can be set now; remove it")
        got = self._set(name, value)
        if not _same(got, value):
            raise SettingRefused(f"{self._name}: {name} was set to {value}, the camera has {got}{self._offer(name)}")

    def _set(self, name: str, value: Value) -> Value:
        if isinstance(value, bool):
            self._called("arv_device_set_boolean_feature_value", name, int(value))
            return bool(self._called("arv_device_get_boolean_feature_value", name))
        if isinstance(value, str):
            try:
                self._call("arv_device_set_string_feature_value", name, value.encode())
            except AravisError as error:
                raise self._failure(error, f"setting {name} to {value}{self._offer(name)}") from error
            return self.text(name)
        return self.set_number(name, value)

    def is_as_set(self, setting: Feature) -> bool:
        """Tell whether a feature still has its value."""
        value = setting.value
        got: Value = self.text(setting.name) if isinstance(value, str) else self.number(setting.name)
        return _same(got, float(value) if isinstance(value, bool) else value)

    def _offer(self, name: str) -> str:
        with suppress(SettingRefused, DeviceLost):
            return f"; it offers {', '.join(self.entries(name))}"
        return ""

    def _call(self, function: str, feature: str, *arguments: object) -> Any:
        return aravis().call(function, self._device, feature.encode(), *arguments)

    def _called(self, function: str, feature: str, *arguments: object) -> Any:
        """Call; errors become those of this program."""
        try:
            return aravis().call(function, self._device, feature.encode(), *arguments)
        except AravisError as error:
            raise self._failure(error, f"feature {feature}") from error

    def _failure(self, error: AravisError, doing: str) -> SettingRefused | DeviceLost:
        if error.means_gone:
            return DeviceLost(f"{self._name} does not answer ({doing}: {error}); check its cable and power")
        return SettingRefused(f"{self._name}: {doing}: {error}")


def _same(got: Value, wanted: Value) -> bool:
    if isinstance(wanted, str) or isinstance(got, str) or isinstance(wanted, bool):
        return got == wanted
    return math.isclose(got, wanted, rel_tol=_SAME, abs_tol=_SAME)


def manual(features: Features) -> list[Feature]:
    """Return what has to be set so that nothing of a camera is automatic, amplified, bent or turned."""
    off: list[Feature] = [Feature(name, "Off") for name in AUTOMATICS if features.has(name)]
    off += [Feature("Gain", features.bounds("Gain")[0])] if features.has("Gain") else []
    off += [Feature(name, False) for name in _SWITCHES if features.has(name)]
    return off + [Feature(name, value) for name, value in _NEUTRAL.items() if features.has(name)]
