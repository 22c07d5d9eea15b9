"""The page of what has been verified."""

from dataclasses import replace

import pytest

from fastac.report.verification import of_folders, page
from fastac.store.evidence import Evidence, Table, keep

FOUND = Evidence(
    "formal",
    "Proofs",
    "make formal",
    "All hold.",
    90.0,
    [Table("Fork", ["a", "b"], [["x|y", None]])],
    ["X."],
    "1",
)


def test_sections_tables_and_what_is_missing():
    text = page([FOUND], "1")
    assert "| Proofs | `make formal` | 1.5 min |" in text
    assert "No results here of: mutation, simulators, faults, fuzz." in text
    assert "## Proofs\n\n`make formal` (1.5 min). All hold.\n\n### Fork" in text
    assert "| x\\|y |  |" in text
    assert "Not covered:\n\n- X." in text
    assert "earlier state" not in text


def test_results_of_other_sources_say_so():
    assert "These results are of an earlier state of `gateware/`." in page([FOUND], "2")


def test_new_results_replace_kept_ones(tmp_path):
    new, kept = tmp_path / "new", tmp_path / "kept"
    with pytest.raises(FileNotFoundError, match="no results of a campaign"):
        of_folders(new, kept)
    keep(replace(FOUND, name="fuzz"), kept)
    keep(FOUND, kept)
    keep(replace(FOUND, summary="All hold again."), new)
    text = of_folders(new, kept)
    assert text.count("All hold again.") == text.count("All hold.") == 1
    (new / "formal.json").unlink()
    assert of_folders(new, kept) == text
