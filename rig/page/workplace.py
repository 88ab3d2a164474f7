"""What a running server has: its folder, the lease, the job that is at work, the news; and how names become paths."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from rig.by_hand.pictures import PATTERNS, SPOTS
from rig.errors import RigError, SessionError, UsageError
from rig.live.plan import LiveRequest, check_request
from rig.page.jobs.holder import Job, JobHolder
from rig.page.jobs.requests import AnyJob, CheckJob, KeepJob, LookJob, RecheckJob, RunJob, ShowJob, StrategiesJob
from rig.page.server.folders import Folders, checked_name
from rig.page.server.lease import Lease
from rig.page.server.news import News
from rig.run.plan import plan_session
from rig.run.request import SessionRequest
from rig.self_check.run import parts_of
from rig.session.folder import is_session
from rig.shows.saved import load_show
from rig.stages.target import DEFAULT

_WORDS = ("pattern", "camera:", "shm:")
"""Sources that are no files."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Workplace:
    """Everything that requests need."""

    folders: Folders
    lease: Lease
    news: News
    holder: JobHolder
    is_open: bool
    """Whether a token is needed: the server listens beyond this machine."""

    async def start(self, kind: str, job: AnyJob) -> Job:
        """Begin a job. Raises what :func:`prepared` raises, RigBusy."""
        work = prepared(job, self.folders)
        return await self.holder.start(kind, title_of(job), job.as_json(), work.as_json())

    async def prepare_spare(self, kind: str, job: AnyJob) -> None:
        """Let a second process get ready for a job that is at work; what :func:`prepared` refuses needs none."""
        with suppress(RigError):
            await self.holder.spare.prepare(kind, prepared(job, self.folders).as_json())


def prepared(job: AnyJob, folders: Folders) -> AnyJob:
    """Return a job with paths in place of names, refused if `rig` would refuse it.

    Raises
    ------
    UsageError, ProfileError, SessionError
        It names what is not there, or cannot be done.
    """
    if isinstance(job, RunJob):
        return _prepared_run(job, folders)
    if isinstance(job, StrategiesJob):
        return replace(job, session=_session(job.session, folders))
    if isinstance(job, RecheckJob):
        profile = None if job.profile is None else folders.profile(job.profile)
        return replace(job, session=_session(job.session, folders), profile=profile)
    if isinstance(job, KeepJob):
        path = folders.show(job.show)
        if not path.is_file():
            raise UsageError(f"{job.show}: no saved show of that name; save it first")
        load_show(str(path))
        return replace(job, show=str(path))
    if isinstance(job, LookJob):
        return replace(job, profile=folders.profile(job.profile), picture=_picture(job.picture, folders))
    if isinstance(job, CheckJob):
        parts_of(job.only)
        return replace(job, profile=folders.profile(job.profile))
    return _prepared_show(job, folders)


def _session(name: str, folders: Folders) -> str:
    folder = folders.session(name)
    if not is_session(folder):
        raise SessionError(f"{name}: there is no session of that name; run one first")
    return str(folder)


def _prepared_run(job: RunJob, folders: Folders) -> RunJob:
    work = replace(
        job,
        session=str(folders.session(job.session)),
        profile=None if job.profile is None else folders.profile(job.profile),
        target=job.target if job.target in (None, DEFAULT) else _upload(job.target, folders),
    )
    plan_session(session_request(work))  # reads profile, target and strategies as `rig run` does, and refuses them
    return work


def session_request(work: RunJob) -> SessionRequest:
    """Return what `rig run` would be asked, of a job with paths."""
    return SessionRequest(
        folder=work.session,
        profile=work.profile,
        target=work.target,
        fit=work.fit,
        linear=work.linear,
        strategies=work.strategies,
    )


def _prepared_show(job: ShowJob, folders: Folders) -> ShowJob:
    if not job.sources:
        raise UsageError("a show needs a source: pattern, or something that was uploaded")
    work = replace(
        job,
        session=None if job.session is None else str(folders.session(job.session)),
        profile=None if job.profile is None else folders.profile(job.profile),
        sources=tuple(source_of(word, folders) for word in job.sources),
    )
    folder = None if work.session is None else Path(work.session)
    check_request(
        LiveRequest(folder=folder, profile=work.profile, strategy=work.strategy, gain=work.gain, seconds=work.seconds)
    )
    return work


def _picture(name: str, folders: Folders) -> str:
    return name if name in PATTERNS or name == SPOTS else _upload(name, folders)


def source_of(word: str, folders: Folders) -> str:
    """Return what a show takes for a source: the word itself, or the path of an upload. Raises UsageError."""
    if word.startswith(_WORDS) and "/" not in word and (word == "pattern" or ":" in word):
        return word
    return _upload(word, folders)


def _upload(name: str | None, folders: Folders) -> str:
    path = folders.upload(checked_name(name or "", "file"))
    if not path.is_file():
        raise UsageError(f"{name}: no such picture or film; upload it first")
    return str(path)


def order_with_paths(order: dict[str, object], folders: Folders) -> dict[str, object]:
    """Return an order to a job, names of uploaded pictures as paths. Raises UsageError."""
    if order.get("do") == "picture":
        return {**order, "picture": _picture(str(order.get("picture", "")), folders)}
    return order


def title_of(job: AnyJob) -> str:
    """Return what people call a job."""
    match job:
        case RunJob():
            return f"session {job.session}"
        case StrategiesJob():
            return f"strategies of {job.session}"
        case LookJob():
            return f"look with {job.profile}"
        case CheckJob():
            return f"check of {job.profile}"
        case RecheckJob():
            return f"re-check of {job.session}"
        case KeepJob():
            return f"show {job.show}"
        case _:
            return f"show with {job.session or job.profile}"
