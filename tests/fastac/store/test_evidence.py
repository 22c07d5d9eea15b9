"""Results of campaigns survive writing and reading, and a damaged file is refused in one line."""

import json
from dataclasses import asdict

import pytest

from fastac.store.evidence import Evidence, Table, gateware_digest, keep, load
from fastac.store.files import DamagedFileError

FOUND = Evidence(
    "formal", "Proofs", "make formal", "All hold.", 90.0, [Table("Fork", ["a"], [["b|c"]])], ["X."]
)
FULL = json.dumps(asdict(FOUND))


def test_kept_and_loaded(tmp_path):
    path = keep(FOUND, tmp_path)
    assert path == tmp_path / "formal.json"
    again = load(path)
    assert again == FOUND
    assert again.gateware == gateware_digest()


@pytest.mark.parametrize(
    "text",
    [
        *("{}", "[]", '{"tables": [{}]}', "{"),
        *(FULL.replace("90.0", '"long"'), FULL.replace('["X."]', "3")),
        *(FULL.replace('"formal"', name) for name in ('"faults"', '"../formal"', '"\\u0000"')),
    ],
)
def test_damaged(tmp_path, text):
    path = tmp_path / "formal.json"
    path.write_text(text)
    with pytest.raises(DamagedFileError, match=r"formal\.json: "):
        load(path)
