"""The process `rig` as a shell starts it: streams that are closed, pipes that end, stacks that are small, tmux."""

from __future__ import annotations

import json
import os
import pty
import select
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

RIG = f"{sys.executable} -m rig"
VERBS = (
    "--help",
    "run --help",
    "help live",
    "devices",
    "devices --json",
    "profile check hw_profiles/ci-tiny.toml",
    "run {folder}/new -p ci-tiny --dry-run",
    "simulate corner --tolerance 10",
    "report {folder}/none",
    "frobnicate",
)
STATUS = {"report {folder}/none": 4, "frobnicate": 2}


def shell(line: str, **environment: str) -> subprocess.CompletedProcess[str]:
    own = {**os.environ, **environment}
    return subprocess.run(["bash", "-c", line], capture_output=True, text=True, env=own, timeout=120, check=False)


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("closed", [">&-", ">&- 2>&-", "<&- >&- 2>&-"])
def test_closed_streams_change_no_status_and_nothing_falls_over(verb: str, closed: str, tmp_path: Path) -> None:
    if closed != ">&-" and verb not in VERBS[:4]:
        pytest.skip("one stream closed is enough for the other verbs")
    said = shell(f"{RIG} {verb.format(folder=tmp_path)} {closed}")
    assert said.returncode == STATUS.get(verb, 0)
    assert "Traceback" not in said.stderr
    assert said.stdout == ""


@pytest.mark.parametrize("verb", ["--version", "run --help", "simulate corner --tolerance 10 --json"])
@pytest.mark.parametrize("kib", [100, 512])
def test_a_small_stack_is_made_larger(verb: str, kib: int) -> None:
    said = shell(f"ulimit -S -s {kib}; {RIG} {verb}")
    assert said.returncode == 0, said.stderr
    assert said.stdout


def test_a_small_stack_that_may_not_grow_is_said() -> None:
    said = shell(f"ulimit -s 200; {RIG} --version")
    assert said.returncode == 2
    assert said.stderr.startswith("rig: the stack may have 200 KiB, the least is 1024 KiB; run `ulimit -s")


@pytest.mark.parametrize("verb", ["--help", "devices --json", "help run", "completion bash"])
def test_a_pipe_that_closes_ends_quietly(verb: str) -> None:
    said = shell(f"set -o pipefail; {RIG} {verb} | true; echo $?")
    assert said.stdout.strip() == "0"
    assert said.stderr == ""


def test_the_first_line_comes_before_anything_heavy_is_imported(tmp_path: Path) -> None:
    code = (
        "import sys\n"
        "class Stop:\n"
        "    def find_spec(self, name, path, target=None):\n"
        "        if name == 'numpy':\n"
        "            raise SystemExit(7)\n"
        "sys.meta_path.insert(0, Stop())\n"
        f"sys.argv = ['rig', 'run', {str(tmp_path / 'new')!r}, '-p', 'ci-tiny']\n"
        "from rig.__main__ import main\n"
        "main()\n"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert said.returncode == 7
    assert said.stderr == "starting\n"


@pytest.mark.parametrize("shell_name", ["bash", "zsh", "fish"])
def test_completion_knows_every_verb(shell_name: str) -> None:
    said = shell(f"{RIG} completion {shell_name}")
    assert said.returncode == 0
    for verb in ("run", "show", "compare-strategies", "--strategies", "--dry-run", "profile"):
        assert verb.removeprefix("--") in said.stdout
    if shutil.which(shell_name):
        checked = subprocess.run([shell_name, "-n"], input=said.stdout, capture_output=True, text=True, check=False)
        assert checked.returncode == 0, checked.stderr


COMPLETED = {
    "bash": 'source <({rig} completion bash); COMP_WORDS=(rig re); COMP_CWORD=1; _rig; echo "${{COMPREPLY[@]}}"',
    "fish": "{rig} completion fish | source; complete -C 'rig re'",
}


@pytest.mark.parametrize("shell_name", COMPLETED)
def test_a_shell_completes_a_verb(shell_name: str) -> None:
    if not shutil.which(shell_name):
        pytest.skip(f"{shell_name} is not installed")
    line = COMPLETED[shell_name].format(rig=RIG)
    said = subprocess.run([shell_name, "-c", line], capture_output=True, text=True, timeout=120, check=False)
    assert {"recheck", "report"} <= set(said.stdout.split()), said.stderr


@pytest.mark.skipif(not shutil.which("zsh"), reason="zsh is not installed")
@pytest.mark.parametrize("way", ["file of fpath", "sourced"])
def test_zsh_completes_a_verb(way: str, tmp_path: Path) -> None:
    (tmp_path / "_rig").write_text(shell(f"{RIG} completion zsh").stdout, encoding="utf-8")
    begin = f"autoload -Uz compinit; compinit -u -d {tmp_path}/dump"
    begin = f"fpath=({tmp_path} $fpath); {begin}" if way == "file of fpath" else f"{begin}; source {tmp_path}/_rig"
    master, slave = pty.openpty()
    zsh = subprocess.Popen(["zsh", "-f", "-i"], stdin=slave, stdout=slave, stderr=slave, start_new_session=True)
    os.close(slave)
    try:
        os.write(master, f"{begin}; print BEG''UN\n".encode())
        until(master, b"BEGUN")
        os.write(master, b"rig re\t\t")
        assert b"recheck" in until(master, b"recheck")
    finally:
        zsh.kill()
        zsh.wait()
        os.close(master)


def until(terminal: int, words: bytes) -> bytes:
    """What a terminal says until these words, or for half a minute of silence."""
    seen = b""
    while words not in seen and select.select([terminal], [], [], 30)[0]:
        seen += os.read(terminal, 4096)
    return seen


def test_the_version_has_a_short_option() -> None:
    assert shell(f"{RIG} -V").stdout == shell(f"{RIG} --version").stdout != ""


def test_help_of_a_verb_is_that_of_its_option_and_an_unknown_verb_is_refused() -> None:
    assert shell(f"{RIG} help profile check").stdout == shell(f"{RIG} profile check --help").stdout
    said = shell(f"{RIG} help nothing")
    assert said.returncode == 2
    assert "rig --help lists all" in said.stderr


def test_verbs_stand_in_the_order_of_use() -> None:
    out = shell(f"{RIG} --help", COLUMNS="80").stdout
    verbs = ["devices", "profile", "show", "look", "check", "run", "calibrate", "separate", "model", "compensate"]
    places = [out.index(f"│ {verb} ") for verb in [*verbs, "compare", "report", "export", "live", "simulate"]]
    assert places == sorted(places)


@pytest.mark.skipif(shutil.which("tmux") is None, reason="tmux is not installed")
@pytest.mark.parametrize("columns", [80, 60])
def test_a_long_error_and_a_table_fit_into_a_window_of_tmux(columns: int, tmp_path: Path) -> None:
    server = ["tmux", "-L", f"rig-test-{os.getpid()}-{columns}"]
    (tmp_path / "bad.toml").write_text("schema = 2\nname = 3\n", encoding="utf-8")
    done = tmp_path / "done"
    line = f"cd {tmp_path}; {RIG} profile check bad.toml; {RIG} run new -p nowhere; {RIG} run new -p ci-tiny --dry-run"
    start = [*server, "new-session", "-d", "-x", str(columns), "-y", "100"]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])}
    subprocess.run(
        [*start, "bash", "-c", f"{line}; tmux -L {server[2]} wait-for -S {done.name}; sleep 60"],
        check=True, env=environment,
    )  # fmt: skip
    try:
        subprocess.run([*server, "wait-for", done.name], check=True, timeout=60)
        shown = subprocess.run([*server, "capture-pane", "-p"], capture_output=True, text=True, check=True).stdout
    finally:
        subprocess.run([*server, "kill-server"], check=False)
    lines = [line.rstrip() for line in shown.splitlines() if line.strip()]
    assert "no such profile" in " ".join(lines)
    assert "ci-tiny" in " ".join(lines)
    assert max(map(len, lines)) <= columns
    words = json.dumps(lines)
    assert "exposure" in words  # the plan's table
