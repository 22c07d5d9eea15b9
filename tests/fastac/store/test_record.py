"""The record in a build folder: what of it cannot be read counts as not performed."""

import json

import pytest

from fastac.store.record import RECORD, read_record

STEP = {"entry": "data/a-b", "seconds": 1.5, "performed": "2026-01-01"}


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (json.dumps({"data": STEP}), {"data": STEP}),
        (json.dumps({"data": STEP, "normals": 3, "force": {"entry": "a"}}), {"data": STEP}),
        (json.dumps({"data": STEP | {"seconds": "long"}}), {}),
        ("[" * 100_000, {}),
        ("9" * 5000, {}),
        ("[]", {}),
        ("{", {}),
        ("", {}),
    ],
)
def test_what_is_damaged_was_not_performed(tmp_path, text, found):
    (tmp_path / RECORD).write_text(text)
    assert read_record(tmp_path) == found


def test_no_record(tmp_path):
    assert read_record(tmp_path) == {}
