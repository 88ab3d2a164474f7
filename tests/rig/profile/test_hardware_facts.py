"""Facts about hardware: each has a source and its words, and every gap is named."""

import re
from collections.abc import Sequence
from pathlib import Path

import pytest

from rig.cli.app import run_command
from rig.errors import ProfileError
from rig.inventory.check_files import check_files
from rig.profile.hardware_facts import (
    CameraFile,
    Fact,
    HardwareFile,
    ProjectorFile,
    by_model,
    known_cameras,
    known_projectors,
    load_facts,
    parse_facts,
)

ROOT = Path(__file__).parents[3]
FILES = sorted(file for kind in ("cameras", "projectors") for file in (ROOT / "hw_profiles" / kind).glob("*.toml"))
CAMERA = """
schema = 1
kind = "camera"
maker = "Maker"
model = "Model 1"
to_be_measured = ["frame_rates_hz", "pixel_formats", "bit_depth", "exposure_range_s", "shutter", "chroma", "hfov_deg"]
[sources.sheet]
title = "Data sheet"
address = "https://example.org/sheet"
[facts]
width_px = { value = 640, source = "sheet", quote = "640 x 480" }
height_px = { value = 480, source = "sheet", quote = "640 x 480" }
"""


def problems(text: str) -> list[str]:
    with pytest.raises(ProfileError) as caught:
        parse_facts(text.encode(), Path("model.toml"))
    return str(caught.value).splitlines()


def changed(old: str, new: str) -> str:
    assert old in CAMERA
    return CAMERA.replace(old, new, 1)


def facts_of(file: HardwareFile) -> dict[str, Fact[object]]:
    return {key: fact for key in type(file.facts).model_fields if (fact := getattr(file.facts, key)) is not None}


def all_of(key: str, files: Sequence[HardwareFile]) -> list[object]:
    return [facts_of(file)[key].value for file in files if key in facts_of(file)]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_fact_of_every_file_names_a_document_and_quotes_it(path: Path) -> None:
    file = load_facts(path)
    for key, fact in facts_of(file).items():
        assert file.sources[fact.source].address.startswith("http"), key
        assert fact.quote.strip(), key


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_numbers_of_pixels_stand_in_the_quoted_words(path: Path) -> None:
    for key, fact in facts_of(load_facts(path)).items():
        if key in ("width_px", "height_px") and "1080p" not in fact.quote:
            assert str(fact.value) in fact.quote.replace(".", "").replace(",", ""), key


def test_the_collection_is_what_a_lab_needs() -> None:
    cameras, projectors = known_cameras(), known_projectors()
    assert len(cameras) >= 4
    assert len(projectors) >= 4
    mono_global = [c for c in cameras if all_of("chroma", [c]) == ["mono"] and all_of("shutter", [c]) == ["global"]]
    assert len(mono_global) >= 2
    assert {"LED", "laser", "lamp"} <= set(all_of("light_source", projectors))
    assert True in all_of("colour_wheel", projectors)
    assert True in all_of("ultra_short_throw", projectors)


def test_no_two_files_describe_the_same_model() -> None:
    models = [(file.maker, file.model) for file in (*known_cameras(), *known_projectors())]
    assert len(set(models)) == len(models)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (', quote = "640 x 480" }\nheight', " }\nheight", "facts.width_px.quote: missing"),
        (
            'source = "sheet", quote = "640 x 480" }\nheight',
            'quote = "640" }\nheight',
            "facts.width_px.source: missing",
        ),
        ('source = "sheet"', 'source = "blog"', "facts.width_px.source: 'blog' is not in [sources]"),
        ("value = 640", 'value = "640"', "facts.width_px.value: is '640', should be a valid integer"),
        ("width_px", "widht_px", "facts.widht_px: unknown key; did you mean width_px (pixels)?"),
        ('"shutter", ', "", "facts.shutter: missing; cite it, or name it in to_be_measured"),
        ('["frame', '["width_px", "frame', "to_be_measured: width_px is a fact already"),
        ('["frame', '["weight_kg", "frame', "to_be_measured: weight_kg is no key of a camera"),
        ('kind = "camera"', 'kind = "lens"', "kind: is 'lens', should be one of camera, projector"),
        ("https://example.org/sheet", "the internet", "sources.sheet.address: String should match pattern"),
    ],
)
def test_a_mistake_is_a_line_that_names_its_key(old: str, new: str, said: str) -> None:
    assert any(line.startswith(f"model.toml: {said}") for line in problems(changed(old, new)))


def test_all_mistakes_of_a_file_are_reported_at_once() -> None:
    text = (
        changed("value = 640", "value = -640").replace('"shutter", ', "").replace("[sources.sheet]", "[sources.other]")
    )
    assert [line.split(": ")[1] for line in problems(text)] == [
        "facts.width_px.source",
        "facts.height_px.source",
        "sources.other",
        "facts.shutter",
        "facts.width_px.value",
    ]


def test_the_profile_check_takes_files_of_facts_beside_profiles(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good, bad = tmp_path / "good.toml", tmp_path / "bad.toml"
    good.write_text(CAMERA, encoding="utf-8")
    bad.write_text(changed("height_px", "heigth_px"), encoding="utf-8")
    assert run_command(["profile", "check", str(good), str(bad), str(ROOT / "hw_profiles/ci-tiny.toml")]) == 2
    said = capsys.readouterr().out.splitlines()
    assert said[0] == f"{good}: ok: camera Maker Model 1, 2 facts from 1 source, 7 to be measured"
    assert said[1].startswith(f"{bad}: facts.height_px: missing")
    assert said[-1].startswith(f"{ROOT / 'hw_profiles/ci-tiny.toml'}: ok: ci-tiny")


def test_a_missing_and_a_broken_file_hide_no_other(tmp_path: Path) -> None:
    broken = tmp_path / "broken.toml"
    broken.write_text("kind = ", encoding="utf-8")
    checked = check_files(["nosuch", str(broken), str(FILES[0])])
    assert [one.ok for one in checked] == [False, False, True]
    assert "is not TOML" in checked[1].problems[0]


def test_a_model_is_found_however_it_is_spelled() -> None:
    assert by_model("ocam 1mgn u", known_cameras()).model == "oCam-1MGN-U"
    assert by_model("lg pw800", known_projectors()).model == "PW800"


@pytest.mark.parametrize(("name", "said"), [("optoma", "fits several models"), ("beamer 9", "no facts are known")])
def test_a_model_that_is_not_clear_is_refused_with_a_list(name: str, said: str) -> None:
    with pytest.raises(ProfileError, match=rf"{said}.*; give one of .*Optoma HD20"):
        by_model(name, known_projectors())


def test_usb_ids_that_models_share_need_the_name_too() -> None:
    arducam = by_model("OV9782 USB", known_cameras())
    assert arducam.fits("0c45:6366", "Arducam OV9782 USB Camera: Ardu")
    assert not arducam.fits("0c45:6366", "USB 2.0 Camera")
    assert not arducam.fits(None, "Arducam OV9782 USB Camera: Ardu")
    assert by_model("C920", known_cameras()).fits("046d:082d", "any name")


def test_kinds_are_told_apart_by_their_folder() -> None:
    assert all(isinstance(file, CameraFile) for file in known_cameras())
    assert all(isinstance(file, ProjectorFile) for file in known_projectors())


def test_the_page_lists_every_file_and_no_other() -> None:
    page = (ROOT / "docs" / "reference" / "hardware.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ([^|]+) \| `([a-z0-9-]+)` \|", page, re.MULTILINE)
    files = {path.stem: load_facts(path) for path in FILES}
    assert {stem: name for name, stem in rows} == {
        stem: file.model if file.model.startswith(file.maker) else f"{file.maker} {file.model}"
        for stem, file in files.items()
    }
