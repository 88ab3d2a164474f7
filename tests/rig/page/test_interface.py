"""The page's server as other programs use it: jobs, pictures, events, saved shows."""

import asyncio
import itertools
import json
import os
import signal
import struct
from collections.abc import Iterator
from pathlib import Path

import cv2
import httpx
import numpy as np
import pytest

from rig.errors import ProfileError, RigError, UsageError
from rig.page.jobs.latest import LatestFrame
from rig.page.jobs.requests import JOBS
from rig.page.routes.schema import schemas
from rig.page.server.folders import Folders
from rig.page.server.lease import HOLD_S, Lease, RigHeld
from rig.page.server.news import News
from rig.page.shows import read_saved, save_show
from rig.page.views.pictures import packed_levels
from rig.records import JsonObject
from rig.shows.saved import load_show, request_of
from tests.rig.page.conftest import ME, Served


class Clock:
    def __init__(self) -> None:
        self.time_s = 0.0

    def now_s(self) -> float:
        return self.time_s

    def wait_until_s(self, time_s: float) -> None:
        self.time_s = time_s


def test_the_lease_of_a_page_that_fell_silent_runs_out() -> None:
    clock = Clock()
    lease = Lease(clock)
    lease.take("a", "a page")
    clock.time_s = HOLD_S - 1
    lease.keep("a")
    clock.time_s += HOLD_S - 1
    with pytest.raises(RigHeld, match="a page works the rig"):
        lease.take("b", "another")
    clock.time_s += 2
    assert lease.take("b", "another").holder == "b"
    assert lease.keep("a").holder == "b"


def test_a_slow_page_gets_the_newest_picture_and_none_of_those_between() -> None:
    async def told() -> list[int]:
        latest, seen = LatestFrame(), []
        for k in range(5):
            latest.put({"k": k}, b"jpeg")
        frame = await latest.after(0, 1.0)
        seen.append(frame.number if frame else -1)
        assert await latest.after(5, 0.01) is None or seen
        asyncio.get_running_loop().call_later(0.01, latest.put, {}, b"next")
        following = await latest.after(5, 5.0)
        return [*seen, following.number if following else -1]

    assert asyncio.run(told()) == [5, 6]


def test_a_slow_listener_is_told_the_latest_of_each_subject_once() -> None:
    async def told() -> list[bytes]:
        is_over = []
        news = News(lambda: bool(is_over))
        for k in range(100):
            news.tell("job", {"k": k})
        news.tell("lease", {"holder": "a"})
        heard = []
        async for event in news.read():
            heard.append(event)
            is_over = [True] if len(heard) == 2 else []
        assert news.readers == 0
        return heard

    assert asyncio.run(told()) == [b'event: job\ndata: {"k": 99}\n\n', b'event: lease\ndata: {"holder": "a"}\n\n']


def test_numbers_of_a_picture_come_back_as_they_were() -> None:
    levels = np.array([[[0.0], [100.06], [np.nan]], [[255.0], [-3.5], [300.0]]], np.float32)
    packed = packed_levels(levels)
    width, height, bands, scale = struct.unpack("<IIII", packed[:16])
    numbers = np.frombuffer(packed[16:], "<i2").reshape(height, width, bands) / scale
    assert np.allclose(numbers[np.isfinite(levels)], levels[np.isfinite(levels)], atol=0.5 / scale)
    assert numbers[0, 2, 0] == -32768 / scale
    wide = packed_levels(np.full((1, 1, 1), 4095.0, np.float32))
    assert struct.unpack("<IIII", wide[:16])[3] * 4095 <= 32767  # places of a 4K projector fit, too


def test_a_saved_show_is_the_file_that_rig_live_plays(tmp_path: Path) -> None:
    folders = Folders(tmp_path)
    for file in ("first/session.json", "uploads/film.mp4", "profiles/lab.toml"):
        (tmp_path / file).parent.mkdir(parents=True)
        (tmp_path / file).write_text('quote = "\\u007f"' if file.startswith("profiles") else "{}")
    asked: JsonObject = {
        "session": "first",
        "profile": "lab",
        "sources": ["film.mp4", "pattern"],
        "gain": 0.5,
        "on": ["22:00-02:00"],
        "record": "kept",
        "osc": {"port": 9001},
    }
    save_show(folders, "evening", asked)
    show, path = load_show(str(tmp_path / "shows" / "evening.toml"))
    request = request_of(show, path)
    assert request.folder is not None
    assert request.folder.resolve() == (tmp_path / "first").resolve()
    assert Path(str(request.profile)).samefile(tmp_path / "profiles" / "lab.toml")
    assert Path(request.sources[0]).samefile(tmp_path / "uploads" / "film.mp4")
    assert request.sources[1] == "pattern"
    assert (request.gain, show.on, show.record, show.osc and show.osc.port) == (0.5, ("22:00-02:00",), "kept", 9001)
    again = read_saved(folders, "evening")
    assert (again.session, again.profile, again.sources) == ("first", "lab", ("film.mp4", "pattern"))
    assert folders.shows() == ["evening"]


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"session": "../../etc"}, "no name of a session"),
        ({"session": "nowhere"}, "no session of that name"),
        ({"profile": "/etc/passwd"}, "no name of a profile"),
        ({"sources": ["/etc/passwd"]}, "no name of a file"),
        ({"sources": ["none.png"]}, "upload it first"),
        ({"sources": []}, "sources"),
        ({"record": "../../tmp"}, "no name of a folder"),
        ({"on": ["9 in the morning"]}, "no span of a day"),
        ({"profile": None}, "neither a session nor a profile"),
        ({"gain": "loud"}, "gain"),
        ({"sesion": "first"}, "sesion"),
    ],
)
def test_a_show_that_could_not_begin_is_not_saved(tmp_path: Path, changed: JsonObject, says: str) -> None:
    asked: JsonObject = {"profile": "ci-tiny", "strategy": "none"}
    with pytest.raises(RigError, match=says):
        save_show(Folders(tmp_path), "evening", {**asked, **changed})
    assert not (tmp_path / "shows" / "evening.toml").exists()


def test_paths_that_a_person_wrote_into_a_show_stay_and_no_page_adds_one(tmp_path: Path) -> None:
    folders, path = Folders(tmp_path), tmp_path / "shows" / "lobby.toml"
    path.parent.mkdir()
    path.write_text('session = "/srv/room"\nsources = ["/srv/film.mp4"]\nrecord = "/srv/kept"\n')
    said: JsonObject = read_saved(folders, "lobby").model_dump(mode="json", exclude_none=True)
    save_show(folders, "lobby", {**said, "gain": 0.25})
    assert load_show(str(path))[0].sources == ("/srv/film.mp4",)
    assert load_show(str(path))[0].gain == 0.25
    with pytest.raises(UsageError, match="no name of a file"):
        save_show(folders, "lobby", {**said, "sources": ["/srv/film.mp4", "/srv/other.mp4"]})
    path.write_text("session = ")
    with pytest.raises(ProfileError, match="is not TOML"):
        read_saved(folders, "lobby")


def test_names_are_names(tmp_path: Path) -> None:
    folders = Folders(tmp_path)
    assert folders.session("a-1.b") == tmp_path.resolve() / "a-1.b"
    for name in ("", "..", ".a", "a/b", "a\\b", "a..b", "ä", "a\n", "uploads"):
        with pytest.raises(UsageError):
            folders.session(name)


def test_every_job_has_a_schema(served: Served) -> None:
    found = served.get("/api/schema.json").json()
    assert found == json.loads(json.dumps(schemas()))
    assert set(found["jobs"]) == set(JOBS)
    assert found["jobs"]["run"]["required"] == ["session"]


def facts_of(stream: httpx.Response) -> Iterator[JsonObject]:
    """What a stream says of each of its frames."""
    waiting = b""
    for part in stream.iter_bytes():
        waiting += part
        while len(waiting) >= 12 and len(waiting) >= 12 + sum(lengths := struct.unpack(">III", waiting[:12])):
            yield json.loads(waiting[12 : 12 + lengths[0]])
            waiting = waiting[12 + sum(lengths) :]


def test_a_program_looks_without_a_browser(served: Served) -> None:
    started = served.post("/api/jobs/look", {"profile": "ci-tiny", "picture": "white"})
    assert started.status_code == 201
    assert served.post("/api/jobs/run", {"session": "x", "profile": "ci-tiny"}).status_code == 422  # it is at work
    served.until(lambda job: job["state"] != {} and job["label"] == "look")
    frame = served.get("/api/frame.jpg")
    picture = cv2.imdecode(np.frombuffer(frame.content, np.uint8), cv2.IMREAD_UNCHANGED)
    assert picture.shape[:2] == (240, 320)
    served.post("/api/job/order", {"do": "exposure", "exposure_s": 0.001})
    darker = served.until(lambda job: job["state"]["exposure_s"] < 0.002)
    assert darker["state"]["exposure_s"] == 0.001  # what the camera did
    assert served.post("/api/job/order", {"do": "picture", "picture": "/etc/passwd"}).status_code == 400
    served.post("/api/job/order", {"do": "exposure", "exposure_s": 99.0})
    with httpx.stream("GET", f"{served.address}api/frames?client=me", timeout=30) as stream:
        exposures = (facts["exposure_s"] for facts in facts_of(stream))
        assert 0.001 in itertools.islice(exposures, 50), "the newest frame may be of before the order"
    ended = served.post("/api/job/stop").json()
    assert ended["phase"] == "done"
    served.post("/api/lease", {"do": "release"})


def processes_of(served: Served) -> list[int]:
    """Those that the server started, the oldest first."""
    children = Path(f"/proc/{served.process.pid}/task/{served.process.pid}/children").read_text(encoding="ascii")
    return [int(each) for each in children.split()]


def test_a_show_whose_process_is_killed_is_begun_again_until_somebody_stops_it(served: Served) -> None:
    show = {"profile": "ci-tiny", "sources": ["pattern"], "strategy": "none"}
    assert httpx.put(f"{served.address}api/shows/a", json=show, headers=ME).status_code == 200
    assert served.post("/api/shows/a/keep").status_code == 202
    first = served.until(lambda job: job.get("kind") == "keep" and job["state"].get("frames", 0) > 0)["number"]
    health = served.get("/health").json()
    assert (health["ok"], health["show"]["name"], health["show"]["phase"]) == (True, "a", "running")
    served.until(lambda _: served.get("/health").json()["show"]["has_spare"])
    showing, spare = processes_of(served)
    os.kill(showing, signal.SIGKILL)
    served.until(lambda job: job["phase"] == "failed")
    served.until(lambda job: job["number"] > first and job["state"].get("frames", 0) > 0)
    assert processes_of(served)[0] == spare  # it had everything but the devices
    assert served.get("/api/shows").json()["keeper"]["restarts"] == 1
    stopped = served.post("/api/job/stop").json()
    assert stopped["phase"] == "done"
    assert stopped["result"]["ended_by"] in ("quit", "signal")
    served.until(lambda _: not processes_of(served))
    assert served.get("/api/shows").json()["shows"] == ["a"]
    assert served.get("/api/shows/a").json()["lamp_h"] > 0
    assert httpx.request("DELETE", f"{served.address}api/shows/a", json={}, headers=ME).status_code == 200
    assert served.job()["number"] == stopped["number"]
    served.post("/api/lease", {"do": "release"})
