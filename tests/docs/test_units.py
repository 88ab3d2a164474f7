"""The units for systemd that the pages show are units."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.units import unit_of

ANALYZE = shutil.which("systemd-analyze")


@pytest.mark.skipif(ANALYZE is None, reason="systemd-analyze is missing: apt install systemd")
@pytest.mark.parametrize("page", ["shows.md", "operators-page.md"])
def test_the_unit_of_a_page_passes_systemd_s_own_check(page: str, tmp_path: Path) -> None:
    unit = tmp_path / "rig-show.service"
    # A program that is there: whether it can be run is checked as well.
    unit.write_text(unit_of(page, ExecStart=sys.executable))
    done = subprocess.run([str(ANALYZE), "verify", str(unit)], capture_output=True, text=True, check=False)
    about_it = [line for line in done.stderr.splitlines() if unit.name in line]
    assert (done.returncode, about_it) == (0, [])
