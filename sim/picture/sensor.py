"""What a sensor makes of linear light: exposure, noise, clipping, quantisation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.arrays import FloatArray
from sim.errors import SimulationError


@dataclass(frozen=True)
class Sensor:
    """A linear sensor."""

    full_well_e: float = 10_000.0
    """Electrons that give the largest digital number. [electrons]"""
    read_noise_e: float = 3.0
    """Standard deviation of the noise of an unlit pixel. [electrons]"""
    bits: int = 12
    black_level_dn: float = 0.0
    """Digital number of no light."""

    def __post_init__(self) -> None:
        if self.full_well_e <= 0 or self.read_noise_e < 0 or not 1 <= self.bits <= 16:
            raise SimulationError(
                f"sensor: full well {self.full_well_e:g} e, read noise {self.read_noise_e:g} e, "
                f"{self.bits} bits; they must be above 0, at least 0, and 1 ... 16"
            )
        if not 0 <= self.black_level_dn < self.full_scale_dn:
            raise SimulationError(
                f"sensor: black level {self.black_level_dn:g} dn outside 0 ... {self.full_scale_dn} dn; "
                "give one within it, or more bits"
            )

    @property
    def full_scale_dn(self) -> int:
        """The largest digital number."""
        return int(2**self.bits - 1)


def expose(
    light: FloatArray, exposure: float, sensor: Sensor, generator: np.random.Generator | None = None
) -> NDArray[np.uint16]:
    """Return the digital numbers of an image of linear light.

    Parameters
    ----------
    light : array of any shape
        Linear light, at least 0, in the scene's unit.
    exposure : float
        Share of the full well that light of 1 fills.
    sensor : Sensor
    generator : numpy Generator, optional
        Source of shot and read noise; without one the exposure is free of noise.

    Returns
    -------
    uint16 array
        Shaped as the light; between 0 and the full scale. [dn]

    Raises
    ------
    SimulationError
        For negative light or exposure.
    """
    if exposure <= 0 or np.min(light, initial=0.0) < 0:
        raise SimulationError(
            f"exposure {exposure:g}, darkest light {np.min(light, initial=0.0):.4g}; "
            "the exposure must be above 0, the light 0 or more"
        )
    electrons = np.asarray(light, dtype=np.float64) * (exposure * sensor.full_well_e)
    if generator is not None:
        # Poisson's law is a Gaussian to 1e-3 long before numpy's limit of 9.2e18 counts.
        electrons = generator.poisson(np.minimum(electrons, 1e15)).astype(np.float64)
        electrons = electrons + generator.normal(0.0, sensor.read_noise_e, electrons.shape)
    span = sensor.full_scale_dn - sensor.black_level_dn
    numbers = sensor.black_level_dn + electrons / sensor.full_well_e * span
    return np.clip(np.round(numbers), 0, sensor.full_scale_dn).astype(np.uint16)
