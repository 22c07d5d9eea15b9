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


def test_the_digest_is_of_what_the_top_imports(tmp_path):
    sources = {
        "top_zynq.py": "from fastac.gateware.stream import fork\nfrom fastac.gateware.divider import A\n",
        "stream/fork.py": "A = 1\n",
        "divider.py": "import numpy\n",
        "cycle_model.py": "A = 1\n",
    }
    for name, text in sources.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    first, changed = gateware_digest(tmp_path), {}
    for name, text in sources.items():
        (tmp_path / name).write_text(text + "B = 2\n")
        changed[name] = gateware_digest(tmp_path) != first
        (tmp_path / name).write_text(text)
    assert changed == {name: name != "cycle_model.py" for name in sources}
