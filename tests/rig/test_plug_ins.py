"""Another package's drivers, strategies and codes are found, used and, where they are wrong, refused with words."""

from __future__ import annotations

import json
import shutil
import sys
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import sim
from rig.capture.rig import open_rig
from rig.cli.app import run_command
from rig.errors import ProfileError, UsageError
from rig.plug_ins import GROUPS, code_version, find_code, find_strategy, others, strategy_version
from rig.profile.schema import Profile
from rig.session import Session
from rig.stages.results import SessionResult
from tests.rig.conftest import Finished

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "tests" / "plug_in_package"
Install = Callable[..., None]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Install a package: its metadata, as an installer would write it, and where its modules are."""

    def install(name: str, version: str, entries: dict[str, dict[str, str]], modules: Path | None = None) -> None:
        site = tmp_path / f"site-{name}"
        info = site / f"{name.replace('-', '_')}-{version}.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
        lines = [f"[{group}]\n" + "\n".join(f"{k} = {v}" for k, v in named.items()) for group, named in entries.items()]
        (info / "entry_points.txt").write_text("\n".join(lines))
        for folder in (site, modules):
            if folder is not None:
                monkeypatch.syspath_prepend(folder)

    yield install
    for module in [name for name in sys.modules if name.partition(".")[0] == "acme_rig"]:
        del sys.modules[module]


@pytest.fixture
def acme(install: Install) -> None:
    """The package of the how-to."""
    project = tomllib.loads((PACKAGE / "pyproject.toml").read_text())["project"]
    install(project["name"], project["version"], project["entry-points"], PACKAGE)


@pytest.fixture
def wired(tiny_profile: Profile) -> Callable[..., Profile]:
    """The tiny rig with other drivers."""

    def wired(camera: str = "wire", projector: str = "wire", options: str = 'wire = "a"') -> Profile:
        text = tiny_profile.raw.decode()
        text = text[: text.index("[simulation]")]
        for kind, driver in (("camera", camera), ("projector", projector)):
            table = f'[[{kind}]]\nname = "{kind}"\ndriver = '
            text = text.replace(f'{table}"simulated"', f'{table}"{driver}"\noptions = {{ {options} }}')
        return Profile.parse(text.encode(), Path("lab.toml"))

    return wired


@pytest.mark.usefixtures("acme")
def test_what_a_package_offers_is_found_with_its_version() -> None:
    found = {(one.kind, one.name): one.source for kind in GROUPS for one in others(kind)}
    assert found == dict.fromkeys(
        [("camera driver", "wire"), ("projector driver", "wire"), ("strategy", "dimmed"), ("code", "mirrored")],
        "acme-rig 1.2",
    )


@pytest.mark.usefixtures("acme")
def test_a_rig_of_its_devices_is_opened_and_shoots(wired: Callable[..., Profile]) -> None:
    with open_rig(wired()) as rig:
        codes = np.tile(np.arange(0, 256, dtype=np.uint8), (192, 1))
        frame = rig.shoot(codes, name="ramp")
        assert frame.pixels.shape == rig.profile.camera.shape
        assert np.abs(frame.pixels[100, :, 0].astype(int) - np.arange(320) * 256 // 320).max() <= 1
        assert frame.exposure_s == rig.profile.camera.exposure_s


@pytest.mark.usefixtures("acme")
def test_its_settings_are_checked_by_the_driver(wired: Callable[..., Profile]) -> None:
    with pytest.raises(ProfileError, match=r"projector: options\.wire: missing; name the wire"):
        open_rig(wired(options="speed = 3"))


@pytest.mark.usefixtures("acme")
def test_its_strategy_solves_and_its_version_names_the_package() -> None:
    room = sim.paper_room(patch_size_m=0.8)
    lens = sim.Lens.from_horizontal_field_of_view(8, 6, 100.0)
    pose = sim.Pose.look_at((1.2, 1.2, 1.2), (1.0, 1.0, 0.0))
    transport = sim.coaxial_transport(room, sim.form_factors(room), lens, pose)
    found = find_strategy("dimmed").solve(transport, np.full(lens.n_pixels, 0.2))
    assert found.predicted.mean() == pytest.approx(0.1, rel=0.05)
    assert strategy_version("dimmed") == "1 of acme-rig 1.2"
    assert strategy_version("bounded") == sim.STRATEGIES["bounded"].version


@pytest.mark.usefixtures("acme")
def test_its_code_is_shown_and_read() -> None:
    code, shape = find_code("mirrored"), (6, 8)
    frames = {pattern.name: pattern.codes.astype(float) for pattern in code.patterns(shape)}
    assert tuple(frames) == code.pattern_names(shape)
    white, black = np.full(shape, 255.0), np.zeros(shape)
    found = code.decode(frames, shape, white=white, black=black, noise_limit=5.0)
    rows, columns = np.mgrid[:6, :8]
    np.testing.assert_array_equal(found.projector_xy_px, np.dstack([columns, rows]))
    assert code_version("mirrored") == "1 of acme-rig 1.2"
    assert find_code("gray").name == "gray"


@pytest.mark.usefixtures("acme")
def test_the_list_of_devices_has_them(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["devices", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)["plug_ins"]
    assert {"kind": "strategy", "name": "dimmed", "package": "acme-rig", "version": "1.2"}.items() <= next(
        one for one in listed if one["name"] == "dimmed"
    ).items()
    assert {"v4l2", "kms", "bounded", "gray"} <= {one["name"] for one in listed if one["package"] == "procam-rig"}
    assert run_command(["devices"]) == 0
    assert "acme-rig 1.2" in capsys.readouterr().out


def test_a_driver_that_nobody_offers_is_refused_by_the_profile_with_those_that_there_are(
    wired: Callable[..., Profile],
) -> None:
    with pytest.raises(ProfileError) as caught:
        wired(projector="window", options="")
    assert str(caught.value).splitlines()[0] == (
        "lab.toml: camera.driver: is 'wire', should be one of v4l2, genicam, gphoto2, simulated, replay "
        "(`rig devices` lists them)"
    )


@pytest.mark.usefixtures("acme")
def test_one_name_of_two_packages_is_refused_and_listed(
    install: Install, wired: Callable[..., Profile], capsys: pytest.CaptureFixture[str]
) -> None:
    install("other-rig", "3", {GROUPS["camera driver"]: {"wire": "x:y"}, GROUPS["strategy"]: {"bounded": "x:y"}})
    sentence = r"camera driver 'wire' is offered by acme-rig 1\.2 and by other-rig 3; uninstall all but one of them"
    with pytest.raises(UsageError, match=sentence):
        open_rig(wired())
    with pytest.raises(UsageError, match=r"strategy 'bounded' is offered by procam-rig \S+ and by other-rig 3"):
        find_strategy("bounded")
    assert find_strategy("paper") is sim.STRATEGIES["paper"]
    run_command(["devices", "--json"])
    assert len(json.loads(capsys.readouterr().out)["problems"]) == 2


def test_one_that_cannot_be_imported_is_refused_with_the_reason(install: Install) -> None:
    install("old-rig", "0.1", {GROUPS["strategy"]: {"lost": "nowhere_at_all:STRATEGY"}})
    words = r"strategy 'lost' of old-rig 0\.1 cannot be loaded \(nowhere_at_all:STRATEGY\): ModuleNotFoundError"
    with pytest.raises(UsageError, match=words):
        find_strategy("lost")


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("math:pi", "gives float, not a function of settings and clock; tell its author"),
        ("builtins:divmod", r"'wire' of odd-rig 1 fails \(builtins:divmod\): TypeError: unsupported"),
        ("operator:is_", r"gives bool, not Projector \(rig\.devices\.protocols\)"),
    ],
)
def test_a_driver_that_is_none_is_refused(
    install: Install, wired: Callable[..., Profile], value: str, words: str
) -> None:
    install("odd-rig", "1", {GROUPS["camera driver"]: {"wire": value}, GROUPS["projector driver"]: {"wire": value}})
    with pytest.raises(UsageError, match=words):
        open_rig(wired())


def test_what_is_no_strategy_or_code_is_refused(install: Install) -> None:
    install("odd-rig", "1", {GROUPS["strategy"]: {"half": "math:pi"}, GROUPS["code"]: {"stripes": "math:pi"}})
    with pytest.raises(UsageError, match=r"strategy 'half' of odd-rig 1 gives float, not a sim\.Strategy of the name"):
        find_strategy("half")
    with pytest.raises(UsageError, match=r"code 'stripes' of odd-rig 1 gives float, not a calibration\.Structured"):
        find_code("stripes")


def test_a_strategy_that_fails_is_told_by_its_name_and_line(
    install: Install, finished: Finished, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    modules = tmp_path / "modules"
    modules.mkdir()
    (modules / "broken_rig.py").write_text(
        "from sim import Strategy, compensate\n"
        "def halfway(transport, target, lower=0.0, upper=1.0):\n"
        "    return compensate('none', transport, target).image\n"
        "STRATEGY = Strategy(name='halfway', solve=halfway, summary='half')\n"
    )
    install("broken-rig", "1", {GROUPS["strategy"]: {"halfway": "broken_rig:STRATEGY"}}, modules)
    folder = tmp_path / "session"
    shutil.copytree(finished.folder, folder)
    assert run_command(["compensate", str(folder), "--strategy", "halfway"]) == 2
    said = capsys.readouterr().err
    assert "strategy 'halfway' of broken-rig 1 fails (broken_rig:STRATEGY): AttributeError" in said
    assert "(line 3 of " in said


def test_an_unknown_name_is_refused_with_what_was_meant() -> None:
    with pytest.raises(UsageError, match=r"no strategy is named 'bunded'; did you mean bounded\?; there are none, dir"):
        find_strategy("bunded")


@pytest.mark.slow
@pytest.mark.usefixtures("acme")
def test_a_session_uses_its_strategy_and_code_as_the_how_to_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (ROOT / "docs" / "how-to" / "plug-ins.md").read_text(encoding="utf-8")
    script = page.rpartition("```text\n")[2].partition("```")[0]
    monkeypatch.chdir(tmp_path)
    exec(compile(script, "plug-ins.md", "exec"), {})
    result = Session.read(tmp_path / "own").read_metrics(SessionResult)
    assert {"none", "dimmed"} <= set(result.strategies)
    assert float(capsys.readouterr().out) == result.strategies["dimmed"].measured.mean
    shown = {event.get("name", "") for event in Session.read(tmp_path / "own").frame_log()}
    assert any(name.startswith("mirrored-") for name in shown), "its patterns were photographed"


@pytest.mark.parametrize("file", sorted(PACKAGE.rglob("*.[pt]*")), ids=lambda file: file.name)
def test_the_how_to_shows_the_package_as_it_is(file: Path) -> None:
    page = (ROOT / "docs" / "how-to" / "plug-ins.md").read_text(encoding="utf-8")
    if file.suffix in (".py", ".toml") and file.name != "__init__.py":
        assert file.read_text(encoding="utf-8").strip() in page
