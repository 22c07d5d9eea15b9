"""Records as lines of text."""

import csv
import json

from fastac.streaming.lines import csv_lines, json_lines, of_about
from fastac.streaming.record import StreamRecord


def test_a_line_of_json(about, make_record):
    heading, row = json_lines(about, digests=True)
    found, record = json.loads(row(make_record(3))), make_record(3)
    assert heading is None
    assert found["frame"] == 3
    assert found["force_raw"] == record.force_raw
    assert found["arrays"] == {"depth_mm": [2, 3]}
    assert found["errors"] == ["late"]
    assert found["timing"]["host_latency_s"] == 3e-3
    assert found["digest"] == record.digest
    assert "digest" not in json_lines(about, digests=False)[1](record)


def test_a_line_of_a_table(about, make_record):
    heading, row = csv_lines(about, digests=False)
    lost = row(StreamRecord(4, 40, lost=True))
    first, second = csv.DictReader([heading, row(make_record(3, reasons=("change", "level"))), lost])
    assert (first["frame"], first["suspect"], first["lost"]) == ("3", "1", "0")
    assert (first["force_z_n"], first["force_z_raw"]) == ("1.25", str(2**62 + 3))
    assert (first["reasons"], first["errors"]) == ("change level", "late")
    assert first["made_ns"] == "1700000000123456789"
    assert (second["lost"], second["force_z_n"], second["host_latency_s"]) == ("1", "", "")
    assert csv_lines(about, digests=True)[0].endswith(",digest")


def test_a_description(about):
    assert json.loads(of_about(about))["units"]["depth_mm"] == "mm"
