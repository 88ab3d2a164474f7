"""The page's server as other programs use it: jobs, pictures, events, saved shows."""

import asyncio
import json
import struct
from datetime import time
from pathlib import Path

import cv2
import httpx
import numpy as np
import pytest

from rig.errors import UsageError
from rig.page.jobs.latest import LatestFrame
from rig.page.jobs.requests import JOBS, ShowJob
from rig.page.routes.schema import schemas
from rig.page.server.folders import Folders
from rig.page.server.lease import HOLD_S, Lease, RigHeld
from rig.page.server.news import News
from rig.page.shows import PageShow, read_show, write_show
from rig.page.views.pictures import packed_levels
from rig.records import JsonObject
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


def test_saved_shows_keep_their_hours_also_over_midnight(tmp_path: Path) -> None:
    show = PageShow(show=ShowJob(profile="ci-tiny"), on_at="22:00", off_at="02:00")
    assert [show.runs_at(time(hour)) for hour in (21, 22, 1, 2)] == [False, True, True, False]
    write_show(tmp_path / "shows" / "a.json", show)
    assert read_show(tmp_path / "shows" / "a.json") == show
    with pytest.raises(UsageError, match="times of day"):
        PageShow(show=ShowJob(profile="ci-tiny"), on_at="9 in the morning").runs_at(time(9))
    (tmp_path / "shows" / "b.json").write_text("{")
    with pytest.raises(UsageError, match="no saved show"):
        read_show(tmp_path / "shows" / "b.json")


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
        first = next(stream.iter_bytes())
        header, _, _ = struct.unpack(">III", first[:12])
        facts: JsonObject = json.loads(first[12 : 12 + header])
        assert facts["exposure_s"] == 0.001
    ended = served.post("/api/job/stop").json()
    assert ended["phase"] == "done"
    served.post("/api/lease", {"do": "release"})


def test_a_show_that_ends_is_begun_again(served: Served) -> None:
    show = {"show": {"profile": "ci-tiny", "sources": ["pattern"], "seconds": 0.5, "strategy": "none"}}
    assert httpx.put(f"{served.address}api/shows/a", json=show, headers=ME).status_code == 200
    assert served.post("/api/shows/a/keep").status_code == 202
    served.until(lambda job: job.get("kind") == "show" and job["number"] > 0)
    first = served.job()["number"]
    served.until(lambda job: job["number"] > first)
    assert served.get("/health").json()["show"]["name"] == "a"
    served.post("/api/job/stop")
    after = served.job()["number"]
    assert served.get("/api/shows").json()["shows"] == ["a"]
    assert httpx.request("DELETE", f"{served.address}api/shows/a", json={}, headers=ME).status_code == 200
    assert served.job()["number"] == after
    served.post("/api/lease", {"do": "release"})
