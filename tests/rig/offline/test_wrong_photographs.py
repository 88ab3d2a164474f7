"""Photographs that are not what a manifest calls them: found from the pictures, mended or refused, never a wrong cloud.

The scene is a simulated relief whose projector stands above the camera;
`benchmarks/calibration/wrong_photographs.py` goes through every exchange, inversion, stale frame and bump on it and on
a published scan, this through a few.
"""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calibration.geometry.triangulation import parallax_px
from rig.devices.replay.photographs import load_manifest
from rig.errors import CalibrationFailed, ProfileError
from rig.files.pictures import write_png
from rig.offline.photograph_order import with_files
from rig.offline.photograph_warnings import lone_axis_warnings, parallax_warnings, refuse_implausible_unit
from rig.offline.scan import run_scan

ROOT = Path(__file__).parents[3]
SHARED = Path(os.environ.get("PROCAM_RIG_DATA", ROOT.parent / "shared" / "data")) / "graycode_scan_published_cloud"
Change = Callable[[dict[str, Any]], dict[str, Any]]


def exchanged(a: str, b: str) -> Change:
    return lambda frames: {**frames, a: frames[b], b: frames[a]}


def all_inverted(frames: dict[str, Any]) -> dict[str, Any]:
    return {name: frames[f"{name}-inverse"] for name in frames if not name.endswith("-inverse")} | {
        name: frames[name.removesuffix("-inverse")] for name in frames if name.endswith("-inverse")
    }


def bumped_from(first: str) -> Change:
    def bump(frames: dict[str, Any]) -> dict[str, Any]:
        late = list(frames)[list(frames).index(first) :]
        return {name: np.roll(frame, 20, axis=1) if name in late else frame for name, frame in frames.items()}

    return bump


def test_photographs_that_are_what_they_are_called_pass(bench: SimpleNamespace, relief: Any) -> None:
    outcome = bench.outcome_of(relief, "right", "", relief.frames)
    assert (outcome.verdict, outcome.message) == ("passed", "")
    assert outcome.off < 0.01
    assert outcome.points > 9000


@pytest.mark.parametrize(
    "change",
    [
        exchanged("gray-row-05", "gray-row-03"),
        exchanged("gray-column-01", "gray-column-00"),
        exchanged("gray-column-06-inverse", "gray-row-04"),
        exchanged("gray-row-00", "gray-row-00-inverse"),
        exchanged("gray-row-07", "gray-row-07-inverse"),
        all_inverted,
    ],
    ids=["along the baseline", "finest two", "across axes", "finest inverted", "coarsest inverted", "all inverted"],
)
def test_photographs_in_another_order_are_put_right_and_it_is_said(
    bench: SimpleNamespace, relief: Any, change: Change
) -> None:
    outcome = bench.outcome_of(relief, "order", "", change(dict(relief.frames)))
    assert outcome.verdict == "mended"
    assert "another order than the manifest's" in outcome.message
    assert ".png shows gray-" in outcome.message
    assert outcome.off < 0.01


def test_a_stale_frame_is_refused_by_its_name(bench: SimpleNamespace, relief: Any) -> None:
    frames = {**relief.frames, "gray-row-03": relief.frames["gray-row-04-inverse"]}
    outcome = bench.outcome_of(relief, "stale", "", frames)
    assert outcome.verdict == "refused"
    assert "show the same picture" in outcome.message
    assert "photograph gray-row-03.png (gray-row-03) again" in outcome.message


@pytest.mark.parametrize("first", ["gray-column-07-inverse", "gray-column-03", "gray-row-00-inverse"])
def test_a_bumped_camera_is_refused(bench: SimpleNamespace, relief: Any, first: str) -> None:
    outcome = bench.outcome_of(relief, "bump", "", bumped_from(first)(dict(relief.frames)))
    assert outcome.verdict == "refused"
    assert "bumped" in outcome.message or "not each other's inverse" in outcome.message


def test_a_bump_between_two_patterns_is_measured_and_placed(bench: SimpleNamespace, relief: Any) -> None:
    message = bench.outcome_of(relief, "bump", "", bumped_from("gray-row-05")(dict(relief.frames))).message
    assert "moves by 20 px" in message or "moves by 19 px" in message or "moves by 21 px" in message
    assert "(gray-row-06-inverse) and gray-row-05.png" in message


def test_one_photograph_at_half_exposure_is_scaled_and_it_is_said(bench: SimpleNamespace, relief: Any) -> None:
    frames = {**relief.frames, "gray-row-04": (relief.frames["gray-row-04"] * 0.5).astype(np.uint8)}
    outcome = bench.outcome_of(relief, "exposure", "", frames)
    assert outcome.verdict == "mended"
    assert "gray-row-04.png is 0.5" in outcome.message
    assert outcome.off < 0.01


def only(axis: str, frames: dict[str, Any]) -> dict[str, Any]:
    return {name: frame for name, frame in frames.items() if f"-{axis}-" in name}


def test_rows_alone_are_enough_where_the_projector_stands_above(bench: SimpleNamespace, relief: Any) -> None:
    outcome = bench.outcome_of(relief, "rows", "", only("row", relief.frames))
    assert outcome.verdict == "passed"
    assert outcome.off < 0.01
    assert outcome.points > 20_000


def test_rows_alone_of_lenses_that_are_not_theirs_are_refused_by_that(bench: SimpleNamespace, relief: Any) -> None:
    camera, projector = relief.devices
    other = replace(relief, devices=(camera, replace(projector, translation_m=-projector.translation_m)))
    outcome = bench.outcome_of(other, "rows", "", only("row", relief.frames))
    assert outcome.verdict == "refused"
    assert "lie behind a device or beside the projector's picture; check them" in outcome.message


def test_columns_alone_are_refused_there(bench: SimpleNamespace, relief: Any) -> None:
    outcome = bench.outcome_of(relief, "columns", "", only("column", relief.frames))
    assert outcome.verdict == "refused"
    assert "run along the line from camera to projector" in outcome.message


def without_bits(below: int, frames: dict[str, Any]) -> dict[str, Any]:
    return {name: frame for name, frame in frames.items() if int(name.split("-")[2]) >= below}


@pytest.mark.parametrize(("finest_bit", "points"), [(1, 2000), (2, 500)])
def test_without_the_finest_bits_there_are_fewer_points_in_the_right_places(
    bench: SimpleNamespace, relief: Any, finest_bit: int, points: int
) -> None:
    coarse = replace(relief, manifest=replace(relief.manifest, finest_bit=finest_bit))
    outcome = bench.outcome_of(coarse, "finest", "", without_bits(finest_bit, relief.frames))
    assert outcome.verdict == "passed"
    assert outcome.off < 0.01
    assert outcome.points > points


@pytest.mark.parametrize("finest_bit", [0, 1, 2])
def test_rows_alone_are_refined_and_err_by_what_is_said(bench: SimpleNamespace, relief: Any, finest_bit: int) -> None:
    coarse = replace(relief, manifest=replace(relief.manifest, finest_bit=finest_bit))
    frames = only("row", without_bits(finest_bit, relief.frames))
    scan = bench.scan_photographs(
        coarse.manifest, frames, coarse.devices, limit_dn=bench.LIMIT_DN, epipolar_limit_px=bench.EPIPOLAR_LIMIT_PX
    )
    error, codes = coarse.depth_errors(scan), 0.3 * 2**finest_bit
    sigma_share = scan.distance_sigma_share
    assert 0.5 < 1.48 * np.median(np.abs(error)) / sigma_share < 2
    assert np.mean(np.abs(error) > 0.01) < 0.01
    assert len(scan.points_m) > 20_000
    whole_share = codes / np.median(np.hypot(*parallax_px(scan.points_m, *coarse.devices).T))
    assert sigma_share < 0.2 * whole_share


def test_wrong_order_without_inverses_is_found_too(bench: SimpleNamespace, relief: Any) -> None:
    plain = {name: frame for name, frame in relief.frames.items() if not name.endswith("-inverse")}
    every = list(relief.frames.values())
    plain |= {"white": np.maximum.reduce(every), "black": np.minimum.reduce(every)}
    right = bench.outcome_of(relief, "plain", "", plain)
    wrong = bench.outcome_of(relief, "plain", "", exchanged("gray-row-03", "gray-row-04")(plain))
    assert (right.verdict, wrong.verdict) == ("passed", "mended")
    assert wrong.points == right.points


def test_half_an_exposure_without_inverses_is_scaled_and_said(bench: SimpleNamespace, relief: Any) -> None:
    plain = {name: frame for name, frame in relief.frames.items() if not name.endswith("-inverse")}
    every = list(relief.frames.values())
    plain |= {"white": np.maximum.reduce(every), "black": np.minimum.reduce(every)}
    half = {name: {**plain, name: (plain[name] * 0.5).astype(np.uint8)} for name in ("gray-row-03", "gray-row-06")}
    mended, untold = (bench.outcome_of(relief, "plain", "", frames) for frames in half.values())
    assert mended.verdict == "mended"
    assert "gray-row-03.png is 0.50 times as bright" in mended.message
    assert mended.off < 0.01
    assert untold.verdict in ("refused", "warned"), (
        "all lit, or all stripes are blurred: only that it does not fit is known"
    )


def test_photographs_that_are_clipped_are_refused_by_that_and_not_by_their_order(
    bench: SimpleNamespace, relief: Any
) -> None:
    clipped = {name: np.minimum(frame.astype(int) * 14, 255).astype(np.uint8) for name, frame in relief.frames.items()}
    outcome = bench.outcome_of(relief, "clipped", "", clipped)
    assert outcome.verdict == "refused"
    assert "of the bright pixels are saturated (limit 30 %)" in outcome.message
    assert "expose shorter; by that or not, gray-" in outcome.message


def test_a_scan_says_how_well_codes_tell_distances(files: Path, relief: Any) -> None:
    result = run_scan(manifest_of(files, relief), files / "cloud.ply")
    # 0.22 m apart, 1 m away, 240 px focal length: a tenth of a pixel moves a point by 0.2 % of its distance.
    assert result.distance_sigma_percent == pytest.approx(
        1.4826 * (result.epipolar_median_px or 0) / 240 / 0.0022, rel=0.3
    )


def test_devices_too_near_to_each_other_for_their_pixels_are_a_warning(files: Path, relief: Any) -> None:
    (warning,) = parallax_warnings(0.08)
    assert "known to 8 % only (median, limit 5 %)" in warning
    assert parallax_warnings(0.04) == ()


def test_a_principal_point_far_from_the_middle_is_said_where_nothing_contradicts_it(files: Path, relief: Any) -> None:
    manifest = load_manifest(manifest_of(files, relief, principal_point_px="[100.0, 143.5]"))
    (warning,) = lone_axis_warnings(manifest)
    assert "lies 24 % of the picture from its middle (limit 15 %)" in warning


def manifest_of(folder: Path, relief: Any, **changes: str) -> Path:
    """The relief as files, with some lines of its manifest changed."""
    camera, projector = relief.devices
    names = {axis: [n for n in relief.frames if f"-{axis}-" in n and "inverse" not in n] for axis in ("column", "row")}
    text = f"""
schema = 1
[camera]
width_px = {camera.width_px}
height_px = {camera.height_px}
full_scale_dn = 255
[camera.lens]
focal_px = {list(camera.focal_px)}
principal_point_px = {list(camera.principal_point_px)}
[projector]
width_px = {projector.width_px}
height_px = {projector.height_px}
[projector.lens]
focal_px = {list(projector.focal_px)}
principal_point_px = {list(projector.principal_point_px)}
[projector_from_camera]
rotation = {projector.rotation.ravel().tolist()}
translation = {projector.translation_m.tolist()}
unit = "m"
[gray_code]
columns = {[f"{n}.png" for n in names["column"]]}
columns_inverse = {[f"{n}-inverse.png" for n in names["column"]]}
rows = {[f"{n}.png" for n in names["row"]]}
rows_inverse = {[f"{n}-inverse.png" for n in names["row"]]}
"""
    for old, new in changes.items():
        lines = [f"{old} = {new}" if line.split(" = ")[0] == old else line for line in text.splitlines()]
        text = "\n".join(line for line in lines if not line.endswith("= -"))
    path = folder / "replay.toml"
    path.write_text(text)
    return path


@pytest.fixture
def files(tmp_path: Path, relief: Any) -> Path:
    for name, frame in relief.frames.items():
        write_png(tmp_path / f"{name}.png", frame)
    return tmp_path


def test_what_was_mended_stands_in_the_json_with_the_names_of_the_files(files: Path, relief: Any) -> None:
    path = manifest_of(files, relief)
    path.write_text(
        path.read_text().replace("'gray-row-05.png', 'gray-row-04.png'", "'gray-row-04.png', 'gray-row-05.png'")
    )
    result = run_scan(path, files / "cloud.ply").as_json()
    assert result["warnings"] == []
    assert "gray-row-05.png shows gray-row-05" in str(result["mended"])


def test_a_lens_of_other_photographs_is_a_warning_or_refused(files: Path, relief: Any) -> None:
    path = manifest_of(files, relief)
    path.write_text(path.read_text() + "\n[projector.crop]\nleft_px = 2\n")
    result = run_scan(path, files / "cloud.ply")
    assert any("from their epipolar lines" in warning for warning in result.warnings)


def test_a_projector_that_is_too_small_loses_points_and_says_so(files: Path, relief: Any) -> None:
    text = manifest_of(files, relief).read_text().replace("width_px = 192", "width_px = 130")
    (files / "replay.toml").write_text(text)
    result = run_scan(files / "replay.toml", files / "cloud.ply")
    assert any("outside the projector's 130 × 144 px" in warning for warning in result.warnings)


def test_metres_called_millimetres_are_refused(files: Path, relief: Any) -> None:
    manifest = load_manifest(manifest_of(files, relief, unit='"mm"'))
    with pytest.raises(ProfileError, match=r'is the unit "m", not "mm"\?'):
        refuse_implausible_unit(manifest)


def test_eight_bits_with_the_full_scale_of_twelve_are_refused(files: Path, relief: Any) -> None:
    with pytest.raises(ProfileError, match=r"camera\.full_scale_dn: is 4095, but the photographs have 8 bits"):
        run_scan(manifest_of(files, relief, full_scale_dn="4095"), files / "cloud.ply")


def test_a_code_of_neither_columns_nor_rows_is_refused(files: Path, relief: Any) -> None:
    nothing = dict.fromkeys(("columns", "columns_inverse", "rows", "rows_inverse"), "-")
    with pytest.raises(ProfileError, match=r"neither columns nor rows|name at least one photograph"):
        load_manifest(manifest_of(files, relief, **nothing))


def test_a_missing_bit_is_named_with_the_way_to_say_that_it_was_not_shown(files: Path, relief: Any) -> None:
    path = manifest_of(files, relief)
    path.write_text(path.read_text().replace(", 'gray-row-00.png'", "").replace(", 'gray-row-00-inverse.png'", ""))
    with pytest.raises(ProfileError, match=r"names 7 photographs, projector\.height_px = 144 needs 8.*finest_bit"):
        load_manifest(path)


def test_messages_name_files_beside_patterns_and_no_part_of_a_longer_name(files: Path, relief: Any) -> None:
    manifest = load_manifest(manifest_of(files, relief))
    said = with_files(manifest, "gray-row-00-inverse and gray-row-00")
    assert said == "gray-row-00-inverse.png (gray-row-00-inverse) and gray-row-00.png (gray-row-00)"


def test_a_published_scan_with_two_bits_exchanged_along_the_baseline_is_mended(bench: SimpleNamespace) -> None:
    if not (SHARED / "scan_0020").is_dir():
        pytest.skip(f"no published scan at {SHARED}; PROCAM_RIG_DATA names the folder that has it")
    real = bench.real_set()
    outcome = bench.outcome_of(real, "exchange", "", exchanged("gray-column-05", "gray-column-03")(dict(real.frames)))
    assert outcome.verdict == "mended"
    assert outcome.off < 0.001
    with pytest.raises(CalibrationFailed, match="bumped"):
        bench.scan_photographs(
            real.manifest,
            bumped_from("gray-row-07")(dict(real.frames)),
            real.devices,
            limit_dn=4.5,
            epipolar_limit_px=4.0,
        )
