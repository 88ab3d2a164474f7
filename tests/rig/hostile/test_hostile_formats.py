"""Files of other programs, spoilt: meshes, films, pictures, photographs of boards, facts of hardware, lamp hours.

Each test is one input, as in ``test_hostile_files.py``; of meshes and films a test shows that they were whole.
"""

import json
import math
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from rig.cli.app import run_command
from rig.files.pictures import write_png
from rig.shows.lamp import KeptLamp, lamp_file, lamp_hours
from tests.calibration.lenses.board_world import BOARD, photograph, printed, stand, truth
from tests.rig.hostile.conftest import ANSWERS, Said
from tests.rig.hostile.mutations import mutated

pytestmark = pytest.mark.timeout(60, func_only=True)
ROOT = Path(__file__).parents[3]
LIVE = ("live", "-p", "ci-tiny", "--strategy", "none", "--seconds", "0.2", "--json")
FILM, PICTURE = 21, 22


# Meshes


def box_of(folder: Path, kind: str) -> tuple[Path, Path]:
    """A closed room as one program writes it: the file that is named, and the file that is spoilt."""
    box = trimesh.creation.box((2.0, 3.0, 2.5))
    box.invert()
    room = folder / f"room.{kind.rpartition(' ')[2]}"
    if kind == "ascii stl":
        room.write_text(trimesh.exchange.stl.export_stl_ascii(box))
        return room, room
    if kind.endswith("gltf"):
        for name, data in trimesh.exchange.gltf.export_gltf(trimesh.Scene(box)).items():
            (folder / name.replace("model", "room")).write_bytes(data)
        return room, room if kind == "gltf" else next(folder.glob("*.bin"))
    if kind == "colours of obj":
        box.visual = trimesh.visual.TextureVisuals(
            material=trimesh.visual.material.SimpleMaterial(diffuse=(200, 90, 40, 255))
        )
        box.export(folder / "room.obj")
        return folder / "room.obj", next(folder.glob("*.mtl"))
    box.export(room)
    return room, room


MESHES = ("stl", "ascii stl", "gltf", "buffer of gltf", "colours of obj")


def simulated(rig: Callable[..., Said], room: Path) -> Said:
    return rig("simulate", room, "--reflectance", "0.5", "--tolerance", "50", "--memory-mb", "500", "--json")


@pytest.mark.parametrize("kind", MESHES)
@pytest.mark.parametrize("seed", range(14))
def test_a_spoilt_mesh_of_another_program(rig: Callable[..., Said], tmp_path: Path, kind: str, seed: int) -> None:
    room, spoilt = box_of(tmp_path, kind)
    spoilt.write_bytes(mutated(spoilt.read_bytes(), seed + 14 * MESHES.index(kind)))
    found = simulated(rig, room)
    if found.status == 0:
        actual = json.loads(found.out)["actual"]
        assert actual["energy_balance"] < 1e-2
        assert math.isfinite(actual["residual"])
    else:
        assert room.name in found.err or spoilt.name in found.err, "a refusal names the file"


@pytest.mark.parametrize("kind", MESHES)
def test_each_mesh_was_whole(rig: Callable[..., Said], tmp_path: Path, kind: str) -> None:
    assert simulated(rig, box_of(tmp_path, kind)[0]).status == 0


# Films and pictures that are shown


@pytest.fixture(scope="module")
def films(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder, found = tmp_path_factory.mktemp("films"), {}
    for kind, code in (("avi", "MJPG"), ("mp4", "mp4v")):
        writer = cv2.VideoWriter(str(folder / f"film.{kind}"), cv2.VideoWriter.fourcc(*code), 25.0, (64, 48))
        for k in range(6):
            writer.write(np.full((48, 64, 3), 40 * k + 20, np.uint8))
        writer.release()
        found[kind] = (folder / f"film.{kind}").read_bytes()
    return found


@pytest.mark.parametrize("seed", range(28))
def test_a_spoilt_film(rig: Callable[..., Said], films: dict[str, bytes], tmp_path: Path, seed: int) -> None:
    kind = ("avi", "mp4")[seed // 14]
    path = tmp_path / f"film.{kind}"
    path.write_bytes(mutated(films[kind], seed))
    shown = rig(*LIVE, "--source", path)
    assert shown.status in (0, FILM)
    told = json.loads(shown.out)
    assert (told["failure"] is None) == (shown.status == 0)
    assert told["frames"] > 0 or shown.status == FILM or told["ended_by"] == "time"


def picture_of(kind: str) -> bytes:
    picture = np.random.default_rng(6).integers(0, 255, (192, 256, 3)).astype(np.uint8)
    return bytes(cv2.imencode(f".{kind}", picture)[1])


@pytest.mark.parametrize("seed", range(28))
def test_a_spoilt_picture_that_is_shown(rig: Callable[..., Said], tmp_path: Path, seed: int) -> None:
    path = tmp_path / f"still.{('bmp', 'webp', 'ppm', 'png')[seed // 7]}"
    path.write_bytes(mutated(picture_of(path.suffix[1:]), seed))
    if seed % 2:
        assert rig("show", path, "-p", "ci-tiny", "--seconds", "0.01").status in (0, 2)
    else:
        assert rig(*LIVE, "--source", path).status in (0, PICTURE)


@pytest.mark.parametrize("seed", range(14))
def test_a_spoilt_mask_of_what_stays_dark(rig: Callable[..., Said], tmp_path: Path, seed: int) -> None:
    mask = np.zeros((240, 320), np.uint8)
    mask[60:120, 80:160] = 255
    write_png(tmp_path / "mask.png", mask)
    (tmp_path / "mask.png").write_bytes(mutated((tmp_path / "mask.png").read_bytes(), seed))
    text = (ROOT / "hw_profiles" / "ci-tiny.toml").read_text(encoding="utf-8")
    (tmp_path / "dark.toml").write_text(f'{text}\n[target]\ndark = "{tmp_path / "mask.png"}"\n', encoding="utf-8")
    planned = rig("run", tmp_path / "new", "-p", tmp_path / "dark.toml", "--dry-run")
    assert planned.status in (0, 2)
    assert not (tmp_path / "new").exists()


# Photographs of boards


@pytest.fixture(scope="module")
def boards(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five photographs of a board."""
    folder = tmp_path_factory.mktemp("boards")
    world = truth(5, seed=11)
    for view in range(5):
        write_png(folder / f"{view}.png", photograph(stand(world, view, printed(BOARD)), seed=view))
    marker = f"marker_m = {BOARD.marker_m}\n" if BOARD.marker_m else ""
    size = f"columns = {BOARD.columns}\nrows = {BOARD.rows}\nsquare_m = {BOARD.square_m}\n{marker}"
    views = "".join(f'[[view]]\nname = "{view}"\nphotograph = "{view}.png"\n' for view in range(5))
    (folder / "lenses.toml").write_text(f'schema = 1\n[camera]\n[board]\nkind = "{BOARD.kind}"\n{size}{views}', "utf-8")
    return folder


@pytest.mark.parametrize("seed", [3, 11])
def test_a_spoilt_photograph_of_a_board_is_named(
    rig: Callable[..., Said], boards: Path, tmp_path: Path, seed: int
) -> None:
    path = boards / f"{seed % 5}.png"
    data = path.read_bytes()
    path.write_bytes(mutated(data, seed))
    try:
        found = rig("lenses", boards / "lenses.toml", "-o", tmp_path / "out.toml", "--json")
    finally:
        path.write_bytes(data)
    assert path.name in found.err + found.out, "what is spoilt is named"
    assert (tmp_path / "out.toml").exists() == (found.status in ANSWERS and bool(found.out))


# Facts and hours


@pytest.mark.parametrize("seed", range(28))
def test_a_spoilt_file_of_facts(rig: Callable[..., Said], tmp_path: Path, seed: int) -> None:
    facts = sorted((ROOT / "hw_profiles").glob("*/*.toml"))
    source = facts[(7 * seed) % len(facts)]
    path = tmp_path / source.parent.name / source.name
    path.parent.mkdir()
    path.write_bytes(mutated(source.read_bytes(), seed))
    checked = rig("profile", "check", path)
    assert checked.status in (0, 2)
    assert path.name in checked.out


@pytest.mark.parametrize("seed", range(14))
def test_spoilt_hours_of_a_lamp_begin_again_and_are_never_no_number(tmp_path: Path, seed: int) -> None:
    show = tmp_path / "show.toml"
    lamp_file(show).write_bytes(mutated(b'{"lit_s": 36000.0}', seed))
    assert 0 <= lamp_hours(show) < math.inf
    KeptLamp(lamp_file(show), None, None).lit(3600.0)
    assert 1 <= lamp_hours(show) < math.inf


def test_a_film_was_whole(rig: Callable[..., Said], films: dict[str, bytes], tmp_path: Path) -> None:
    for kind, data in films.items():
        (tmp_path / f"film.{kind}").write_bytes(data)
        assert run_command([*LIVE, "--source", str(tmp_path / f"film.{kind}")]) == 0
