"""Where a verdict of `rig check` turns red, and why there."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckLimits:
    """One number a row; where a share of white is meant, white is the projector's at the working exposure."""

    lit_share: float = 0.05
    """Of the camera's picture: below, a session measures a corner of what the camera could."""
    sharpness: float = 0.4
    """Contrast of a session's checks, median over the lit pixels: blur of about a quarter of their side."""
    overshoot_percent: float = 1.0
    """Of direct light. Seven random rigs had 0.01 at most, also with JPEG of quality 75; sharpening by 0.6 over
    1.2 px had 1.7 to 4.6 where lenses are in focus, and nothing where their blur is wider."""
    walls: int = 2
    """Of a closed room: one flat wall leaves lenses and depth undetermined, and tells nothing of the others."""
    walls_of_open_scene: int = 1
    """Where `[surface] closed = false`: lenses may rest on data sheets, and the sigmas say so."""
    signal_share: float = 0.05
    """White over black, at least this share of full scale: below, a dark wall has fewer steps than the display."""
    clipped_share: float = 0.002
    """Share of pixels that clip on white: the working exposure leaves only glints above the 99.9th percentile."""
    noise_percent: float = 5.0
    """Of white, in one frame: 13 grey levels of 255; beyond it averaging costs more frames than the patterns."""
    rejected_percent: float = 5.0
    """Of all frames: a healthy pair gives an old frame after a change now and then, not one in twenty."""
    copied_percent: float = 1.0
    """Of the frames of a series: noise never comes twice, so that an equal frame is a frame that was not taken."""
    frame_rate_percent: float = 5.0
    """Off the profile's: a camera that exposes longer than its period, or a bus that is full, is slower."""
    jitter_refreshes: float = 1.0
    """Slowest over fastest: a frame is accepted a latency after the flip, and a spread of a refresh is in it."""
    misreported_frames: float = 0.0
    """Frames that say the new exposure and show the old one: nobody above the driver can tell them."""
    mismatch_percent: float = 1.0
    """|t f - round(t f)| / (t f): the most that a display that makes its light in turns can be off by."""
    flicker_percent: float = 0.4
    """Of white: half a step of an eight-bit display of gamma 2.2 at white (2.2 / 255 / 2)."""
    nonlinearity_percent: float = 1.0
    """Of the brightest level, after the camera's curve is undone; a curve that stands still leaves 0.01, one that
    bends from linear to gamma 1.5 as the picture brightens 1.4."""
    photon_transfer_chi2: float = 3.0
    """Variance about signal / gain + read noise, in its own standard errors: beyond it noise is made or removed."""
    step_dn: float = 1.0
    """Between neighbouring digital numbers: a larger step means fewer bits than the profile says."""
    clip_share: float = 0.99
    """Of full scale: a lower one (235 of 255) makes clipped pixels look good."""
    hot_percent: float = 0.1
    """Of all pixels: sensors of good grade have fewer; robust fits take that many without harm."""
    additivity_percent: float = 2.0
    """Red + green + blue against white: a white segment adds 10 to 60 %; what is left after the fit is below 2 %."""
    superposition_percent: float = 1.0
    """Two halves against the whole: the light model is linear and takes this for granted."""
    drift_percent: float = 1.0
    """White at the end against the beginning of the check: 2.5 grey levels of 255."""
    drift_percent_per_minute: float = 0.5
    """Slope of white: a lamp that is warm keeps 0.2 % a minute; a check of less than a minute tells no finer."""
    vibration_px: float = 0.1
    """Root mean square of the picture's shift: a fifth of the 0.5 px that the geometry may be off by."""
    shift_px: float = 0.2
    """Between the beginning and the end of the check."""
    dark_light_percent: float = 20.0
    """Room light and the display's black together: more than this eats a fifth of the exposure and adds its noise."""
    checker_percent: float = 2.0
    """Checker + its complement against white + black: scaling, keystone correction, sharpening mix codes, not light."""
    beat_percent: float = 2.0
    """The same in patches, 5th to 95th percentile: a scaled picture goes in and out of step with the pixels."""
    edge_share: float = 0.5
    """Light of the outermost pixels against those a little further in: overscan cuts them off."""
    step_share: float = 1.0
    """Of neighbouring codes that differ in light: an eight-bit path keeps all."""
    end_sigmas: float = 5.0
    """Light of code 15 over 0, and of 255 over 236: limited range makes both 0."""
