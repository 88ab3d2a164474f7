"""What the report says of the room: walls, what stands before them, colours."""

from __future__ import annotations

from rig.files.channels import PRIMARIES
from rig.stages.light.darkness import DarknessRecord
from rig.stages.results import ByBand, GeometryResult, ModelResult
from rig.stages.surface.known import RegistrationRecord
from rig.stages.surface.openings import SeenBehind, opposite
from rig.stages.surface.positions import PositionRecord
from rig.stages.transport.evidence import evidence_words
from rig.stages.transport.records import SurfaceGloss

_FAR_WALLS = {"x": "Walls x0 and x1", "y": "Walls y0 and y1", "z": "Floor and ceiling"}
_NEAR_WALL = {"x": "x0", "y": "y0", "z": "the floor"}


def geometry_text(geometry: GeometryResult, model: ModelResult) -> str:
    """Return the paragraph about geometry and model."""
    room_size = " × ".join(f"{length:.3f}" for length in geometry.room_size_m)
    return (
        f"Baseline {1000 * geometry.baseline_m:.0f} mm. Room {room_size} m; seen: {', '.join(geometry.faces_seen)}. "
        f"{model.patches} patches, mean reflectance {_numbers(model.reflectance_mean)}; of one that is lit and "
        f"seen is known up to {_numbers(model.reflectance_sigma)} (one standard deviation). "
        f"{geometry.room_notes}{_standing_words(model, geometry)}{_placed_words(model)}{_learned_words(model)}"
        f"{_evidence_words(model)}{_colour_words(model)}"
    )


def _standing_words(model: ModelResult, geometry: GeometryResult) -> str:
    """What stands before the walls; empty of a box."""
    found = model.standing
    if found is None:
        return ""
    if found.registration is not None:
        return _known_words(found.registration, found.triangles)
    if not found.parts:
        return " Nothing stands before the walls that the camera sees."
    left_out = (
        f", {100 * found.share_left_out:.1f} % see pieces too small for a surface" if found.share_left_out else ""
    )
    return (
        f" Before the walls stand {found.parts} pieces of surface, {found.flat_parts} of them flat, in "
        f"{found.triangles} triangles: {100 * found.share_of_image:.1f} % of the decoded pixels see them{left_out}. "
        f"{_words_of_backs(found.deep)}"
        f"{''.join(_position_words(one) for one in found.positions)}"
        f"{_continued_words(found.n_continued)}"
        f"{''.join(opening_words(one, is_doubtful=one.face in geometry.openings_m) for one in found.behind)}"
    )


def _position_words(one: PositionRecord) -> str:
    """What a session with the camera elsewhere brought."""
    x_m, y_m, z_m = one.camera_m
    return (
        f" {one.session} saw the room from ({x_m:.2f}, {y_m:.2f}, {z_m:.2f}) m, {100 * one.share_of_seen:.0f} % of "
        f"this camera's points among it: half agree within {100 * one.median_apart:.3f} % of the distance, all to "
        f"{one.apart_sigmas:.1f} standard deviations (root mean square), and are merged. {one.triangles} of the "
        f"triangles, {one.area_m2:.2f} m², only it saw."
    )


def _words_of_backs(deep: bool) -> str:
    if not deep:
        return "Their backs, which nobody saw, are taken to lie close behind their fronts."
    return (
        "Bodies, of which nobody saw the backs, are taken to be as deep as they are wide: so the model explains more "
        "of the global light than with backs close behind their fronts."
    )


def _continued_words(triangles: int) -> str:
    if not triangles:
        return ""
    return (
        f" {triangles} of the triangles lie beyond the border of the picture, where a flat piece is taken to go on up "
        "to the walls: with them the model explains more of the global light."
    )


def opening_words(one: SeenBehind, *, is_doubtful: bool) -> str:
    """Return what an opening in a wall is, and what it leaves unknown of the wall opposite, unless that was seen."""
    words = f" {one.face} is open: through it something is seen {one.depth_m:.2f} m behind (a niche, a door, a window)."
    if not is_doubtful:
        return words
    return (
        f"{words} If size_m of the profile was measured to there and not to {one.face}, {opposite(one.face)}, which "
        f"nobody saw, stands {one.depth_m:.2f} m away from where it is taken to be; that is part of the standard "
        "deviations, until size_to_walls = true says that it was measured from wall to wall."
    )


def _known_words(found: RegistrationRecord, triangles: int) -> str:
    """How a mesh from a file was found."""
    remarks = "".join(f" {remark[0].upper()}{remark[1:]}." for remark in found.remarks)
    median, p95, sigma, loose = (
        f"{1000 * one:.1f} mm" for one in (found.misfit_median_m, found.misfit_p95_m, found.sigma_m, found.loosest_m)
    )
    return (
        f" {found.file} stands in the room, in {triangles} triangles: half of what the camera sees of it is within "
        f"{median} of it, 95 % within {p95} (the points are known to {sigma}); the camera sees through "
        f"{100 * found.see_through:.1f} % of it. Held least is {found.loosest}, to {loose}.{remarks}"
    )


def _placed_words(model: ModelResult) -> str:
    """Where walls stand that nobody saw; empty where all were measured."""
    return "".join(
        f" {_FAR_WALLS[one.axis]} are where reflectances explain the light best that comes back from them: the "
        f"projector's lens is {one.projector_m:.2f} ± {one.sigma_m:.2f} m from {_NEAR_WALL[one.axis]}."
        for one in model.placed
    )


def _learned_words(model: ModelResult) -> str:
    """What photographs of known pictures brought; empty where none were asked for."""
    found = model.learned
    if found is None:
        return ""
    if not found.photographs:
        return (
            " No photograph of a known picture was taken: the best would bring "
            f"{found.another_brings:.2f} grey levels, less than the noise of {found.noise:.2f}."
        )
    return (
        f" {found.photographs} photographs of known pictures taught it where light goes that the patches do not tell: "
        f"on usual pictures an error of {found.rms_left:.2f} grey levels is expected, {found.rms_before:.2f} before; "
        f"another photograph would bring {found.another_brings:.2f}, its noise is {found.noise:.2f}. Each "
        f"photograph was held against what the others expect of it: {found.left_out_rms:.2f} grey levels rms, "
        f"{found.left_out_expected:.2f} were expected; sigmas are as much wider. Reflectances stay those of matte "
        f"patches, which leave {_numbers(model.global_rms)} of global light unexplained.{_gloss_words(found.gloss)}"
    )


def _evidence_words(model: ModelResult) -> str:
    """What photographs of earlier pictures brought; empty where there are none."""
    found = model.evidence
    if found is None:
        return ""
    names = ", ".join(one.picture for one in found.pictures)
    return f" Loops were closed on {names}: {evidence_words(found)}."


def _gloss_words(gloss: tuple[SurfaceGloss, ...]) -> str:
    """Which surfaces shine, which do not, and of which one camera cannot tell."""
    return "".join(f" Gloss of {each.surface}: {_one_gloss(each)}." for each in gloss)


def _one_gloss(each: SurfaceGloss) -> str:
    if each.says == "not told" or each.ratio is None:
        return "this camera sees too little mirrored there to tell"
    of_matte = f"{each.ratio:.2f} ± {each.sigma:.2f} of the matte reflectance"
    if each.says == "matte":
        return f"none is found, {of_matte}"
    lobe = f"of roughness {each.roughness:g} ({each.least_roughness:g} … {each.most_roughness:g})"
    return f"it shines, {of_matte}, {lobe}"


def _numbers(value: ByBand) -> str:
    """One number, or one for each band."""
    return f"{value:.3f}" if isinstance(value, float) else ", ".join(f"{each:.3f}" for each in value)


def _colour_words(model: ModelResult) -> str:
    """How the projector's colours mix; empty for a grey rig."""
    if model.mixing is None or model.white_over_channels is None:
        return ""
    rows = "; ".join(f"{band} {_numbers(row)}" for band, row in zip(PRIMARIES[3], model.mixing, strict=True))
    return (
        f" Numbers by band are red, green, blue. Share of white in each band that the projector's red, green and blue "
        f"make: {rows}; over the picture they vary by at most {model.mixing_variation:.4f}. White is "
        f"{_numbers(model.white_over_channels)} times their sum."
    )


def darkness_text(darkness: DarknessRecord | None) -> str:
    """Return what there is beside the picture; empty of a session that does not say."""
    if darkness is None:
        return ""
    words = (
        f" Without light the camera's level is {100 * darkness.sensor_share_of_full_scale:.2f} % of full scale. While "
        f"the projector shows black, {100 * darkness.black_share_of_white:.3f} % of white's light is there"
    )
    if darkness.projector_black_share is None or darkness.projector_black_sigma is None:
        return f"{words}; the border of its picture is seen too little to tell the projector's black from room light."
    return (
        f"{words}: {100 * darkness.projector_black_share:.3f} ± {100 * darkness.projector_black_sigma:.3f} % are the "
        f"projector's black, {100 * (darkness.room_light_share or 0.0):.3f} % the room's light."
    )
