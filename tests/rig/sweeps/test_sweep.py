"""A study from its file to its page: each point once, whatever happens in between."""

import csv
import errno
import json
import os
import re

import numpy as np
import pytest

from rig.cli.app import run_command
from rig.errors import SessionCorrupt, SessionError, SessionLocked
from rig.files import lines as appended
from rig.sweeps.folder import SweepFolder, read_lines
from rig.sweeps.run import sweep


def figures_of(folder):
    return {line.id: dict(line.figures) for line in read_lines(folder)}


def test_every_point_is_there_with_its_inputs_and_figures(swept, tmp_path):
    result = swept()
    assert (result.points, result.computed_now, result.refused, result.killed) == (4, 4, 0, 0)
    rows = list(csv.DictReader((tmp_path / "points" / "points.csv").read_text().splitlines()))
    assert {(row["reflectance"], row["photograph"]) for row in rows} == {
        ("0.3", "outdoor"), ("0.3", "grey"), ("0.7", "outdoor"), ("0.7", "grey"),
    }  # fmt: skip
    assert "paper_mean" in (tmp_path / "points" / "sweep.html").read_text()


def test_a_second_start_computes_nothing(swept, here):
    swept()
    assert swept(here).computed_before == 4
    assert here.calls == 0


def test_more_light_from_walls_that_reflect_more(swept, tmp_path):
    swept()
    bright = {line.inputs["reflectance"]: line.figures["indirect_mean"] for line in read_lines(tmp_path / "points")}
    assert bright[0.7] > 3 * bright[0.3]


def test_a_study_that_changed_keeps_its_points_and_says_so(swept, study):
    swept()
    study.write_text(study.read_text().replace("[0.3, 0.7]", "[0.7, 0.8]"))
    result = swept()
    assert (result.computed_now, result.computed_before, result.others) == (2, 2, 2)
    assert "2 points in the folder are not of this study" in result.warnings[0]


def test_points_of_another_version_stay_and_are_not_used(swept, monkeypatch):
    swept()
    monkeypatch.setattr("rig.sweeps.run.__version__", "99.0")
    result = swept()
    assert (result.computed_now, result.others) == (4, 4)
    assert "of version" in result.warnings[0]


def test_the_same_point_twice_is_computed_once(swept, study):
    study.write_text(study.read_text().replace("[0.3, 0.7]", "[0.3, 0.3]"))
    result = swept()
    assert (result.points, result.computed_now) == (2, 2)
    assert "2 points of the study are the same as others" in result.warnings[0]


def test_a_line_that_a_crash_cut_short_is_computed_again(swept, tmp_path):
    swept()
    path = tmp_path / "points" / "points.jsonl"
    before, data = figures_of(tmp_path / "points"), path.read_bytes()
    path.write_bytes(data[:-20])
    assert swept().computed_now == 1
    assert figures_of(tmp_path / "points") == before


def test_a_damaged_line_is_named(swept, tmp_path):
    swept()
    path = tmp_path / "points" / "points.jsonl"
    path.write_bytes(path.read_bytes().replace(b'"status"', b'"ststus"', 1))
    with pytest.raises(SessionCorrupt, match="line 1 is damaged"):
        swept()


def test_a_digit_that_changed_in_a_finished_point_is_noticed_and_lines_without_seals_are_read(swept, tmp_path):
    swept()
    path = tmp_path / "points" / "points.jsonl"
    data, before = path.read_bytes(), figures_of(tmp_path / "points")
    place = data.index(b'"paper_mean": ') + len(b'"paper_mean": ')
    path.write_bytes(data[:place] + b"9" + data[place + 1 :])
    with pytest.raises(SessionCorrupt, match="line 1 is damaged; delete that line"):
        swept()
    path.write_bytes(re.sub(rb', "seal": "[0-9a-f]{8}"}', b"}", data))
    assert figures_of(tmp_path / "points") == before
    assert swept().computed_now == 0


def test_a_disk_that_fills_up_costs_no_point_that_was_written(swept, tmp_path, monkeypatch):
    write, written = appended.AppendedFile._write, []

    def full_after_two(file, line):
        if len(written) == 2:
            os.write(file._descriptor, line[:9])
            raise OSError(errno.ENOSPC, "No space left on device")
        written.append(line)
        write(file, line)

    with monkeypatch.context() as patch:
        patch.setattr(appended.AppendedFile, "_write", full_after_two)
        with pytest.raises(SessionError, match="the disk is full"):
            swept()
    assert len(figures_of(tmp_path / "points")) == 2
    assert swept().computed_before == 2


def test_two_sweeps_do_not_share_a_folder(swept, tmp_path):
    with SweepFolder(tmp_path / "points"), pytest.raises(SessionLocked):
        swept()


def test_a_point_without_an_answer_is_reported_with_its_inputs_and_not_asked_again(swept, study, monkeypatch):
    study.write_text(
        study.read_text().replace("[fixed]", "[fixed]\nceiling = false\nelevation_deg = 89\nhfov_deg = 10")
    )
    result = swept()
    assert result.refused == 4
    assert "no pixel of the projector lights a surface" in result.failures[0].error
    assert result.failures[0].inputs["elevation_deg"] == 89
    assert swept().computed_now == 0
    assert swept(retry=True).computed_now == 4


def test_an_error_that_nobody_expected_is_named_and_the_others_go_on(swept, monkeypatch):
    def fails(self, inputs, base):
        raise ZeroDivisionError("a fault")

    monkeypatch.setattr("rig.sweeps.subjects.paper.PaperSubject.evaluate", fails)
    result = swept()
    assert result.refused == 4
    assert "ZeroDivisionError: a fault" in result.failures[0].error


def test_arrays_lie_beside_where_the_study_wants_them(swept, study, tmp_path):
    study.write_text(study.read_text().replace('subject = "paper"', 'subject = "paper"\narrays = true'))
    swept()
    line = next(read_lines(tmp_path / "points"))
    with np.load(tmp_path / "points" / line.arrays) as arrays:
        error = np.abs(arrays["paper"] - arrays["desired"]).mean()
    assert error == pytest.approx(line.figures["paper_mean"])


def test_a_wish_for_the_page_that_no_point_has_is_refused_and_costs_nothing(study, swept):
    study.write_text(study.read_text() + '\n[page]\nfigures = ["paper_meen"]\n')
    with pytest.raises(Exception, match=r"no point has paper_meen"):
        swept()
    study.write_text(study.read_text().replace("meen", "mean"))
    assert swept().computed_before == 4


def test_a_script_gets_a_table_a_row_a_point(study, tmp_path, here):
    frame = sweep(study, tmp_path / "points", executor=here)
    assert len(frame) == 4
    assert frame.index.name == "point"
    assert (frame["status"] == "done").all()
    assert frame.groupby("reflectance")["indirect_mean"].mean().is_monotonic_increasing
    assert frame.attrs["result"]["points"] == 4


def test_the_command_line_prints_the_result(study, swept, capsys):
    swept()
    assert run_command(["sweep", str(study), "--folder", str(study.parent / "points"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["computed_before"] == 4
    assert run_command(["sweep", str(study), "--folder", str(study.parent / "points")]) == 0
    assert "4 points: 0 computed now, 4 before" in capsys.readouterr().out
