"""What the emulated GigE camera says of itself: its features and where they lie, in GenICam's XML.

Names are those of the Standard Features Naming Convention (EMVA). Registers below 0x1000 are those that Aravis' fake
camera acts on (arvfakecamera.h); the others only hold what was written, and the picture is made by it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from rig.devices.genicam.formats import PIXEL_FORMATS

WIDTH, HEIGHT, SENSOR_HEIGHT, SENSOR_WIDTH = 0x100, 0x104, 0x118, 0x11C
GAIN, EXPOSURE_US, ACQUISITION, PIXEL_FORMAT, MODE = 0x110, 0x120, 0x124, 0x128, 0x12C
PERIOD_US, TRIGGER_MODE, TRIGGERED_BY, TRIGGER_ACTIVATION, TRIGGER = 0x138, 0x300, 0x304, 0x308, 0x30C
EXPOSURE_AUTO, GAIN_AUTO, BLACK_AUTO, BLACK, GAMMA = 0x2000, 0x2004, 0x2008, 0x200C, 0x2010
TRIGGER_SOURCE, LINE, SOFTWARE = 0x2014, 0, 1
"""What programs choose, and its values; Aravis' own register says software throughout, for it knows no pulses."""
GAIN_STEPS, GAMMA_STEPS = 100, 1000
"""Of the registers of gain (per dB) and gamma (per 1)."""
AUTOMATICS: Mapping[str, int] = {"ExposureAuto": EXPOSURE_AUTO, "GainAuto": GAIN_AUTO, "BlackLevelAuto": BLACK_AUTO}
AUTO_ENTRIES: Mapping[str, int] = {"Off": 0, "Once": 1, "Continuous": 2}
_PERIODS_US = (5000, 1_000_000)
_ACTIVATIONS = {"RisingEdge": 1}
_SOURCES = {"Line0": LINE, "Software": SOFTWARE}
_FEATURES = (
    "Width Height SensorWidth SensorHeight OffsetX OffsetY PixelFormat AcquisitionMode AcquisitionStart "
    "AcquisitionStop AcquisitionFrameRate TriggerSelector TriggerMode TriggerSource TriggerActivation TriggerSoftware "
    "ExposureTime ExposureAuto Gain GainAuto BlackLevel BlackLevelAuto Gamma PayloadSize"
).split()


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulatedSensor:
    """Of the emulated camera."""

    width_px: int
    height_px: int
    formats: tuple[str, ...]
    """Names of its pixel formats."""
    exposure_range_s: tuple[float, float]
    model: str = "Emulated GigE camera"


def description(sensor: EmulatedSensor) -> str:
    """Return the XML."""
    nodes = "\n".join([*_size(sensor), *_acquisition(sensor), *_light(sensor), *_transport()])
    listed = "".join(f"<pFeature>{name}</pFeature>" for name in _FEATURES)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<RegisterDescription ModelName="{sensor.model}" VendorName="procam-rig" ToolTip="" StandardNameSpace="GEV" '
        'SchemaMajorVersion="1" SchemaMinorVersion="1" SchemaSubMinorVersion="0" MajorVersion="1" MinorVersion="0" '
        'SubMinorVersion="0" ProductGuid="00000000-0000-0000-0000-000000000001" '
        'VersionGuid="00000000-0000-0000-0000-000000000002" '
        'xmlns="http://www.genicam.org/GenApi/Version_1_1">\n'
        f'<Category Name="Root" NameSpace="Standard">{listed}</Category>\n'
        f"{nodes}\n"
        '<Port Name="Device" NameSpace="Standard"/>\n'
        "</RegisterDescription>\n"
    )


def _register(name: str, address: int) -> str:
    return (
        f'<IntReg Name="{name}Register"><Address>{address:#x}</Address><Length>4</Length><AccessMode>RW</AccessMode>'
        "<pPort>Device</pPort><Cachable>NoCache</Cachable><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>"
    )


def _integer(name: str, address: int, least: int, most: int) -> Iterator[str]:
    yield (
        f'<Integer Name="{name}" NameSpace="Standard"><pValue>{name}Register</pValue><Min>{least}</Min>'
        f"<Max>{most}</Max><Inc>1</Inc></Integer>"
    )
    yield _register(name, address)


def _enumeration(name: str, address: int, entries: Mapping[str, int]) -> Iterator[str]:
    listed = "".join(
        f'<EnumEntry Name="{entry}"><Value>{value}</Value></EnumEntry>' for entry, value in entries.items()
    )
    yield f'<Enumeration Name="{name}" NameSpace="Standard">{listed}<pValue>{name}Register</pValue></Enumeration>'
    yield _register(name, address)


def _float(name: str, address: int, bounds: tuple[float, float], steps: int = 1) -> Iterator[str]:
    """The register counts so many steps for 1."""
    yield (
        f'<Float Name="{name}" NameSpace="Standard"><pValue>{name}Converter</pValue><Min>{bounds[0]!r}</Min>'
        f"<Max>{bounds[1]!r}</Max></Float>"
    )
    yield (
        f'<Converter Name="{name}Converter"><FormulaTo>FROM*{steps}</FormulaTo><FormulaFrom>TO/{steps}.0</FormulaFrom>'
        f"<pValue>{name}Register</pValue></Converter>"
    )
    yield _register(name, address)


def _command(name: str, address: int, value: int, is_available: str = "") -> Iterator[str]:
    yield (
        f'<Command Name="{name}" NameSpace="Standard">{is_available}<pValue>{name}Register</pValue>'
        f"<CommandValue>{value}</CommandValue></Command>"
    )
    yield _register(name, address)


def _size(sensor: EmulatedSensor) -> Iterator[str]:
    yield from _integer("Width", WIDTH, 1, sensor.width_px)
    yield from _integer("Height", HEIGHT, 1, sensor.height_px)
    yield f'<Integer Name="SensorWidth" NameSpace="Standard"><Value>{sensor.width_px}</Value></Integer>'
    yield f'<Integer Name="SensorHeight" NameSpace="Standard"><Value>{sensor.height_px}</Value></Integer>'
    yield '<Integer Name="OffsetX" NameSpace="Standard"><Value>0</Value><Min>0</Min><Max>0</Max></Integer>'
    yield '<Integer Name="OffsetY" NameSpace="Standard"><Value>0</Value><Min>0</Min><Max>0</Max></Integer>'
    formats = {name: PIXEL_FORMATS[name].code for name in sensor.formats}
    yield from _enumeration("PixelFormat", PIXEL_FORMAT, formats)


def _acquisition(sensor: EmulatedSensor) -> Iterator[str]:
    yield from _enumeration("AcquisitionMode", MODE, {"Continuous": 1})
    yield from _command("AcquisitionStart", ACQUISITION, 1)
    yield from _command("AcquisitionStop", ACQUISITION, 0)
    yield from _integer("AcquisitionFramePeriod", PERIOD_US, *_PERIODS_US)
    yield (
        '<Float Name="AcquisitionFrameRate" NameSpace="Standard"><pValue>AcquisitionFrameRateConverter</pValue></Float>'
        '<Converter Name="AcquisitionFrameRateConverter"><FormulaTo>1000000/FROM</FormulaTo>'
        "<FormulaFrom>1000000/TO</FormulaFrom><pValue>AcquisitionFramePeriod</pValue></Converter>"
    )
    yield (
        '<Enumeration Name="TriggerSelector" NameSpace="Standard"><EnumEntry Name="FrameStart"><Value>0</Value>'
        "</EnumEntry><Value>0</Value></Enumeration>"
    )
    yield from _enumeration("TriggerMode", TRIGGER_MODE, {"Off": 0, "On": 1})
    yield from _enumeration("TriggerSource", TRIGGER_SOURCE, _SOURCES)
    yield from _enumeration("TriggerActivation", TRIGGER_ACTIVATION, _ACTIVATIONS)
    yield from _command("TriggerSoftware", TRIGGER, 1, is_available="<pIsAvailable>TriggerIsSoftware</pIsAvailable>")
    yield (
        '<IntSwissKnife Name="TriggerIsSoftware"><pVariable Name="S">TriggerSourceRegister</pVariable>'
        f"<Formula>S={SOFTWARE}</Formula></IntSwissKnife>"
    )
    bounds_us = (sensor.exposure_range_s[0] * 1e6, sensor.exposure_range_s[1] * 1e6)
    yield from _float("ExposureTime", EXPOSURE_US, bounds_us)


def _light(_: EmulatedSensor) -> Iterator[str]:
    for name, address in AUTOMATICS.items():
        yield from _enumeration(name, address, AUTO_ENTRIES)
    yield from _float("Gain", GAIN, (0.0, 24.0), GAIN_STEPS)
    yield from _float("BlackLevel", BLACK, (0.0, 255.0))
    yield from _float("Gamma", GAMMA, (0.25, 4.0), GAMMA_STEPS)


def _transport() -> Iterator[str]:
    yield (
        '<IntSwissKnife Name="PayloadSize" NameSpace="Standard"><pVariable Name="W">Width</pVariable>'
        '<pVariable Name="H">Height</pVariable><pVariable Name="F">PixelFormat</pVariable>'
        "<Formula>W*H*((F&gt;&gt;16)&amp;0xFF)/8</Formula></IntSwissKnife>"
    )
    yield '<Integer Name="TLParamsLocked"><Value>0</Value><Min>0</Min><Max>1</Max></Integer>'
