"""What somebody tries who should not: each is refused, or harmless."""

import asyncio
import base64
import hashlib
import json
import re
import resource
import shutil
import socket
import struct
from collections.abc import AsyncIterator, Coroutine
from pathlib import Path

import httpx
import pytest
from starlette.types import Message, Send

from rig.errors import UsageError
from rig.page.app import make_app
from rig.page.jobs.latest import LatestFrame
from rig.page.routes import setup
from rig.page.serve import ServeRequest, address_of, checked_token
from rig.page.server import frame_stream
from rig.page.server.frame_stream import FrameStream, Streams
from rig.page.server.guard import GuardSettings
from tests.rig.page.conftest import ME, Served, serving


def test_a_name_that_leads_here_from_elsewhere_is_no_name_of_the_server(served: Served) -> None:
    for host in (f"evil.example:{served.port}", "127.0.0.1:1", "127.0.0.1", "", f"0.0.0.0:{served.port}"):
        assert served.get("/api/state", headers={"host": host}).status_code == 421
    assert served.get("/api/state", headers={"host": f"localhost:{served.port}"}).status_code == 200


def test_another_web_site_gets_nothing(served: Served) -> None:
    for headers in ({"origin": "http://evil.example"}, {"origin": "null"}, {"sec-fetch-site": "cross-site"}):
        assert served.get("/api/state", headers=headers).status_code == 403


@pytest.mark.parametrize(
    "content", ["text/plain", "application/x-www-form-urlencoded", "multipart/form-data; boundary=x"]
)
def test_a_form_of_another_web_site_orders_nothing(served: Served, content: str) -> None:
    answer = httpx.post(
        f"{served.address}api/jobs/look", content=b'{"profile": "ci-tiny"}', headers={**ME, "content-type": content}
    )
    assert answer.status_code == 415


def test_pages_hold_no_script_and_load_none_from_elsewhere(served: Served) -> None:
    page = served.get("/")
    assert "script-src 'self';" in page.headers["content-security-policy"]
    assert "<script>" not in page.text
    assert "style=" not in page.text
    assert page.headers["x-content-type-options"] == "nosniff"


@pytest.mark.parametrize(
    "name", ["..", "../first", "..%2Ffirst", "%2e%2e%2f%2e%2e%2fetc", "a/../first", ".hidden", "profiles", "a" * 200]
)
def test_no_path_leads_out_of_the_folder(served: Served, name: str) -> None:
    for place in (f"api/sessions/{name}", f"api/sessions/{name}/photograph", f"static/{name}/page.html"):
        answer = served.raw(
            f"GET /{place} HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\nConnection: close\r\n\r\n".encode()
        )
        assert answer.split()[1] in (b"400", b"404"), answer


def test_a_link_that_leads_out_is_not_followed(served: Served, tmp_path: Path) -> None:
    (tmp_path / "session.json").write_text("{}")
    link = served.root / "outside"
    link.symlink_to(tmp_path)
    try:
        assert served.get("/api/sessions/outside").status_code == 400
    finally:
        link.unlink()


def test_a_job_cannot_name_files_of_the_machine(served: Served) -> None:
    for kind, job in (
        ("run", {"session": "../x", "profile": "ci-tiny"}),
        ("run", {"session": "x", "profile": "/etc/passwd"}),
        ("run", {"session": "x", "profile": "ci-tiny", "target": "/etc/passwd"}),
        ("look", {"profile": "ci-tiny", "picture": "/etc/passwd"}),
        ("show", {"profile": "ci-tiny", "sources": ["/etc/passwd"]}),
        ("show", {"profile": "ci-tiny", "sources": ["pipe:/etc/passwd"]}),
        ("show", {"profile": "ci-tiny", "sources": ["shm:../passwd"]}),
        ("show", {"profile": "ci-tiny", "sources": ["-"]}),
    ):
        assert served.post(f"/api/jobs/{kind}", job).status_code == 400, job
    assert served.job()["phase"] == "none"
    assert not (served.root / "x").exists()


@pytest.mark.parametrize(
    "body", [b"", b"{", b"[]", b"nul", b"[" * 100_000, b'{"profile": 3}', b'{"profil": "x"}', b"\xff"]
)
def test_malformed_json_is_refused_with_a_sentence(served: Served, body: bytes) -> None:
    headers = {**ME, "content-type": "application/json"}
    answer = httpx.post(f"{served.address}api/jobs/look", content=body, headers=headers)
    assert answer.status_code == 400
    assert answer.json()["error"]


def test_two_gigabytes_are_refused_before_they_are_sent(served: Served) -> None:
    for size in (2 << 30, 1 << 60, -1):
        answer = served.raw(
            f"PUT /api/uploads/a.png HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\nX-Rig-Client: me\r\n"
            f"Content-Type: application/octet-stream\r\nContent-Length: {size}\r\n\r\n".encode()
        )
        assert answer.split()[1] in (b"413", b"400"), answer
    assert served.get("/api/uploads").json()["uploads"] == []


def test_an_upload_that_does_not_say_how_large_it_is_ends_at_the_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(setup, "MOST_UPLOAD_BYTES", 1 << 20)
    sent = []

    async def endless() -> AsyncIterator[bytes]:
        for k in range(2 << 10):  # 2 GB in pieces of 1 MB
            sent.append(k)
            yield bytes(1 << 20)

    async def upload() -> int:
        app = make_app(tmp_path, GuardSettings(host="127.0.0.1", port=80, token=None))
        transport = httpx.ASGITransport(app)
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
            headers = {**ME, "content-type": "application/octet-stream"}
            return (await client.put("/api/uploads/a.mp4", content=endless(), headers=headers)).status_code

    assert asyncio.run(upload()) == 413
    assert len(sent) < 10
    assert list((tmp_path / "uploads").iterdir()) == []


def test_a_page_that_takes_nothing_is_let_go_and_others_get_their_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frame_stream, "_STALL_S", 0.05)

    async def told() -> tuple[int, int, list[bytes]]:
        closing: list[bool] = []
        latest, streams, taken = LatestFrame(), Streams(lambda: bool(closing)), list[bytes]()
        latest.put({}, b"first")

        async def receive() -> Message:
            await asyncio.sleep(60)
            return {"type": "http.disconnect"}

        async def stalled(message: Message) -> None:
            if message["type"] == "http.response.body":
                await asyncio.sleep(60)

        async def ready(message: Message) -> None:
            taken.append(message.get("body", b""))

        def stream(client: str, send: Send) -> Coroutine[None, None, None]:
            answer = FrameStream(client, latest, streams, streams.begin(client) or object())
            return answer({"type": "http"}, receive, send)

        other = asyncio.create_task(stream("ready", ready))
        await stream("stalled", stalled)
        latest.put({}, b"second")
        while not taken or b"second" not in taken[-1]:
            await asyncio.sleep(0.001)
        left = latest.readers
        closing.append(True)
        latest.put({}, b"third")
        await other
        return left, latest.readers, taken

    left, none, taken = asyncio.run(told())
    assert (left, none) == (1, 0)
    assert b"first" in taken[1]


def test_what_is_no_picture_is_not_kept(served: Served) -> None:
    headers = {**ME, "content-type": "application/octet-stream"}
    for name, status in (("a.png", 400), ("a.exe", 400), ("..png", 400), ("%2e%2e%2fa.png", 404)):
        answer = httpx.put(f"{served.address}api/uploads/{name}", content=b"no picture", headers=headers)
        assert answer.status_code == status, answer.text
        assert str(served.root) not in answer.text
    assert [path for path in served.root.rglob("*") if path.suffix in (".png", ".exe")] == []


def test_a_thousand_idle_connections_and_a_reader_who_reads_nothing_lock_nobody_out(served: Served) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = 1000 if hard == resource.RLIM_INFINITY else min(1000, hard - 300)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, wanted + 300), hard))
    connections = [socket.create_connection(("127.0.0.1", served.port), 30) for _ in range(wanted)]
    try:
        for path in ("events", "frames?client=slow", "sessions/first/pages/report.html"):
            lazy = connections.pop()
            lazy.sendall(f"GET /api/{path} HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\n\r\n".encode())
            lazy.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            connections.insert(0, lazy)
        assert served.get("/health").status_code == 200
        assert served.get("/api/sessions").json()["sessions"][0]["name"] == "first"
    finally:
        for connection in connections:
            connection.close()
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def test_scripts_in_names_and_texts_stay_texts(served: Served) -> None:
    session = served.root / "first"
    evil = served.root / "evil"
    shutil.copytree(session, evil)
    try:
        (evil / "report.html").write_text("<script>parent.alert(1)</script><b>report</b>")
        page = served.get("/api/sessions/evil/pages/report.html")
        policy = page.headers["content-security-policy"]
        assert "sandbox allow-scripts" in policy
        assert "allow-same-origin" not in policy
        assert "'unsafe-inline'" not in policy.split("script-src")[1].split(";")[0]
        own = re.findall(r"<script>(.*?)</script>", (session / "report.html").read_text("utf-8"), re.DOTALL)
        hashes = [base64.b64encode(hashlib.sha256(one.encode()).digest()).decode() for one in own]
        assert len(own) == 2
        assert all(f"'sha256-{one}'" in policy for one in hashes)  # the report's own scripts run
        assert served.get("/api/sessions/%3Cscript%3E").status_code == 400
        text = 'schema = 2\nname = "<img src=x onerror=alert(1)>"\n'
        answer = httpx.put(f"{served.address}api/profiles/x", json={"text": text}, headers=ME)
        assert answer.status_code == 400
        assert answer.headers["content-type"] == "application/json"
    finally:
        shutil.rmtree(evil)


def test_one_operator_holds_the_rig_and_others_watch(served: Served) -> None:
    assert served.post("/api/lease", {"do": "take"}).json()["holder"] == "me"
    answer = served.post("/api/jobs/look", {"profile": "ci-tiny"}, client="other")
    assert answer.status_code == 409
    assert "works the rig" in answer.json()["error"]
    assert served.post("/api/job/stop", client="other").status_code == 409
    assert served.post("/api/lease", {"do": "take"}, client="other").status_code == 409
    assert served.post("/api/lease", {"do": "take", "by_force": True}, client="other").json()["holder"] == "other"
    assert served.post("/api/lease", {"do": "release"}, client="other").json()["holder"] == ""
    assert served.post("/api/jobs/look", {"profile": "ci-tiny"}, client="").status_code == 409


def test_other_machines_are_let_in_by_a_token_only(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="--token"):
        checked_token(ServeRequest(root=tmp_path, host="0.0.0.0"))
    with pytest.raises(UsageError, match="at least 16"):
        checked_token(ServeRequest(root=tmp_path, token="short"))
    assert len(checked_token(ServeRequest(root=tmp_path, token="new")) or "") >= 32
    assert checked_token(ServeRequest(root=tmp_path)) is None
    assert address_of("::1", 80, None) == "http://[::1]:80/"


def test_without_the_token_nothing_is_told(tmp_path: Path) -> None:
    with serving(tmp_path / "runs", "--token", "a-token-of-some-length") as server:
        base = server.address.split("?")[0]
        assert httpx.get(f"{base}api/state").status_code == 401
        assert httpx.get(f"{base}api/state", headers={"authorization": "Bearer wrong"}).status_code == 401
        assert httpx.get(f"{base}static/js/main.js").status_code == 401
        assert httpx.get(f"{base}health").status_code == 200
        token = {"authorization": "Bearer a-token-of-some-length"}
        assert httpx.get(f"{base}api/state", headers=token).status_code == 200
        with httpx.Client(follow_redirects=True) as browser:
            assert "<title>" in browser.get(server.address).text
            assert json.loads(browser.get(f"{base}api/state").text)["lease"]["holder"] == ""
