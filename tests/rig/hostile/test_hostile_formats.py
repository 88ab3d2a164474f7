"""Files of other programs, spoilt: meshes, films, pictures, photographs of boards, facts of hardware, lamp hours.

Each test is one input, as in ``test_hostile_files.py``; of meshes and films a test shows that they were whole.
"""

import json
import math
import struct
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from rig.cli.app import run_command
from rig.devices.gphoto2.pictures import WantedPicture, from_jpeg, from_raw
from rig.emulated.still.dng import dng
from rig.errors import DeviceError, ProfileError
from rig.files.pictures import write_png
from rig.live.sources.film_colours import film_colours
from rig.plan import paints
from rig.plan.paints import read_paints
from rig.shows.lamp import KeptLamp, lamp_file, lamp_hours
from tests.calibration.lenses.board_world import BOARD, photograph, printed, stand, truth
from tests.rig.hostile.conftest import ANSWERS, Said
from tests.rig.hostile.mutations import mutated
from tests.rig.hostile.test_hostile_plans import ROOM
from tests.still import needs_gphoto2

pytestmark = pytest.mark.timeout(60, func_only=True)
ROOT = Path(__file__).parents[3]
LIVE = ("live", "-p", "ci-tiny", "--strategy", "none", "--json", "--source")
SHORTLY = ("--seconds", "0.2")
"""For what is held until a show ends; films end by themselves."""
FILM, PICTURE, NOTHING_YET = 21, 22, 24
"""The last: a busy machine had no picture ready in so short a time, and says so."""


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
    shown = rig(*LIVE, path)
    assert shown.status in (0, FILM)
    told = json.loads(shown.out)
    assert (told["failure"] is None) == (shown.status == 0)
    assert told["frames"] > 0 or shown.status == FILM


def tagged(film: bytes, primaries: int, transfer: int) -> bytes:
    """An MP4 whose only track says what its colours are, by ISO/IEC 14496-12; its description comes last."""
    at, before = 0, film
    for kind in (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stsd", b"mp4v"):
        at = before.index(kind, at)
        size = struct.unpack_from(">I", before, at - 4)[0] + 19
        before = before[: at - 4] + struct.pack(">I", size) + before[at:]
    end = at - 4 + size - 19
    return before[:end] + struct.pack(">I8sHHHB", 19, b"colrnclx", primaries, transfer, 1, 0) + before[end:]


@pytest.mark.parametrize(
    ("primaries", "transfer", "status", "words"),
    [
        (1, 1, 0, ""),
        (9, 1, 0, "its colours are those of BT.2020, shown as BT.709"),
        (12, 13, 0, "its colours are those of Display P3"),
        (9, 16, FILM, "high dynamic range (PQ), which would look wrong here; convert it to BT.709"),
        (9, 18, FILM, "high dynamic range (HLG)"),
        (1, 8, FILM, "linear light"),
    ],
)
def test_a_films_colours_are_said_or_refused(
    rig: Callable[..., Said],
    films: dict[str, bytes],
    tmp_path: Path,
    primaries: int,
    transfer: int,
    status: int,
    words: str,
) -> None:
    path = tmp_path / "film.mp4"
    path.write_bytes(tagged(films["mp4"], primaries, transfer))
    shown = rig(*LIVE, path)
    told = json.loads(shown.out)
    notes = " ".join((*told["notes"], str(told["failure"])))
    assert shown.status == status
    assert words in notes
    assert ("shown as BT.709" in notes) == (status == 0 and bool(words))


@pytest.mark.parametrize("seed", range(56))
def test_spoilt_colours_of_a_film_say_something_else_or_nothing(
    films: dict[str, bytes], tmp_path: Path, seed: int
) -> None:
    """Read here alone: what the decoder makes of the rest is tried above."""
    film = tagged(films["mp4"], 9, 16)
    at = film.index(b"moov") - 4
    path = tmp_path / "film.mp4"
    path.write_bytes(film[:at] + mutated(film[at:], seed))
    said = film_colours(path)
    assert said is None or all(0 <= value < 1 << 16 for value in said)


def matroska(*elements: tuple[bytes, bytes]) -> bytes:
    """The beginning of a Matroska file with some elements of one byte, and its first cluster."""
    own = b"".join(name + bytes([0x80 | len(value)]) + value for name, value in elements)
    return b"\x1a\x45\xdf\xa3\x84abcd" + own + b"\x1f\x43\xb6\x75" + bytes(40)


def test_colours_of_matroska_are_read_before_its_first_picture(tmp_path: Path) -> None:
    path = tmp_path / "film.mkv"
    path.write_bytes(matroska((b"\x55\xbb", b"\x09"), (b"\x55\xba", b"\x10")))
    assert film_colours(path) == (9, 16)
    path.write_bytes(matroska() + b"\x55\xba\x81\x10")
    assert film_colours(path) is None
    path.write_bytes(matroska((b"\x55\xba", b"\x10"))[:13])
    assert film_colours(path) is None


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
        assert rig(*LIVE, path, *SHORTLY).status in (0, PICTURE, NOTHING_YET)


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


# Photographs of still cameras


BAYER, GREY = WantedPicture((40, 60, 1), 16383, "RGGB"), WantedPicture((240, 320, 1), 255, None)


def read_or_refused(read: Callable[[], np.ndarray], wanted: WantedPicture) -> np.ndarray | None:
    """A whole picture, or None after a refusal that says what to do."""
    try:
        pixels = read()
    except DeviceError as error:
        refused = str(error)
    else:
        assert (pixels.shape, pixels.dtype) == (wanted.shape, np.uint16)
        return pixels
    assert "; " in refused
    return None


@needs_gphoto2
@pytest.mark.parametrize("seed", range(84))
def test_a_spoilt_raw_file_of_a_still_camera(seed: int) -> None:
    """Half of them in the header alone, which says where the picture lies, how large it is, and what numbers mean."""
    pixels = np.random.default_rng(1).integers(300, 16000, BAYER.shape[:2]).astype(np.uint16)
    data = dng(pixels, BAYER.full_scale_dn, "RGGB", (256, 256, 256, 256))
    head = 420 if seed % 2 else len(data)
    read = read_or_refused(lambda: from_raw(mutated(data[:head], seed // 2) + data[head:], BAYER), BAYER)
    assert read is None or read.max() <= BAYER.full_scale_dn


def still_jpeg() -> bytes:
    y, x = np.mgrid[: GREY.shape[0], : GREY.shape[1]]
    return bytes(cv2.imencode(".jpg", (127 + 100 * np.sin(x / 9) * np.cos(y / 7)).astype(np.uint8))[1])


@pytest.mark.parametrize("seed", range(42))
def test_a_spoilt_jpeg_of_a_still_camera(seed: int) -> None:
    read_or_refused(lambda: from_jpeg(mutated(still_jpeg(), seed), GREY), GREY)


@needs_gphoto2
@pytest.mark.parametrize("share", [0.0, 0.02, 0.3, 0.6, 0.9, 0.999])
def test_a_photograph_that_breaks_off_is_never_taken(share: float) -> None:
    """The decoder of JPEG makes grey of what is missing."""
    photograph = still_jpeg()
    with pytest.raises(DeviceError, match=r"breaks off|no JPEG"):
        from_jpeg(photograph[: int(share * len(photograph))], GREY)
    raw = dng(np.full(BAYER.shape[:2], 900, np.uint16), BAYER.full_scale_dn, "RGGB")
    with pytest.raises(DeviceError, match="no raw file"):
        from_raw(raw[: int(share * len(raw))], BAYER)


# Facts and hours


@pytest.mark.parametrize("seed", range(56))
def test_a_spoilt_list_of_paints_never_paints_another_grey(tmp_path: Path, seed: int) -> None:
    path = tmp_path / "paints.toml"
    path.write_bytes(mutated((ROOT / "hw_profiles" / "paints" / "paints.toml").read_bytes(), seed))
    known, refused = paints.known_paints().paints, ""
    try:
        read = read_paints(path).paints
    except ProfileError as error:
        read, refused = {}, str(error)
    assert not [name for name in read if name in known and read[name].value != known[name].value]
    assert read or str(path) in refused, "the message names the file"


def test_a_plan_with_a_spoilt_list_of_paints_names_it(
    rig: Callable[..., Said], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "paints.toml"
    text = (ROOT / "hw_profiles" / "paints" / "paints.toml").read_text("utf-8")
    (tmp_path / "room.toml").write_bytes(ROOM)
    monkeypatch.setattr(paints, "_PAINT_FILE", path)
    for spoilt, words in (
        (text.replace("0.7478,", "0.7487,"), "paints.classic-gray.value: is 0.7487, which its quotation does not say"),
        (text.replace('source = "glass"', 'source = "gloss"'), "no source is called 'gloss'"),
        (text.replace("0.40,", "40.0,"), "paints.yellow-wall.value: is 40; paints lie in 0.001 ... 0.99"),
        (None, "cannot be read: No such file or directory"),
    ):
        path.write_text(spoilt, encoding="utf-8") if spoilt is not None else path.unlink()
        paints.known_paints.cache_clear()
        refused = rig("plan", tmp_path / "room.toml", "--report", tmp_path / "plan.html")
        assert refused.status == 2
        assert words in " ".join(refused.err.split())
    paints.known_paints.cache_clear()


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
        assert run_command([*LIVE, str(tmp_path / f"film.{kind}")]) == 0
