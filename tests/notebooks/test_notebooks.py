"""The notebooks are stored without outputs, and each runs and finds what it says."""

import json
from pathlib import Path

import pytest

pytest.importorskip("nbclient")
pytest.importorskip("nbformat")
import execute
import nbformat

ROOT = Path(__file__).parents[2]
PICTURES = ROOT / "docs" / "images" / "notebooks"
PICTURE_BYTES = 120_000
METADATA = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}
STRICT = "import warnings\n\nwarnings.simplefilter('error')"
LENIENT = "warnings.simplefilter('default')  # how the kernel ends is not the notebook's"

RESULTS = {
    "a_design_from_the_front": {
        "simulated['mismatches']": lambda count: count == 0,
        "simulated['values_compared']": lambda count: count > 500,
        "cycles == chosen.metrics['latency_cycles']": lambda same: same,
        "chosen.metrics['dsp']": lambda slices: slices <= 60,
        "[len(rows) for rows in fronts.values()]": lambda counts: min(counts) >= 2,
    },
    "from_bundle_to_waveform": {
        "report.mismatches": lambda count: count == 0,
        "len(words)": lambda count: count == 2 * 14 * 14,
        "bool((words == from_model).all())": lambda equal: equal,
        "int((valid & ~ready & 1).sum())": lambda clocks: clocks > 20,  # in which words waited
        "rows[:14].tolist()": lambda rows: rows == [13] * 14,
    },
    "how_the_solver_works": {
        "float(difference_px)": lambda px: px < 1e-9,
        "float(np.abs(found_px - exact_px).max())": lambda px: 0 < px < 1e-3,
        "bool(errors_um['dst2d', 'nearest'][0] < errors_um['dst2d', 'floor'][0])": bool,
        "errors_um['tridiagonal', 'nearest'][-1]": lambda um: um < 0.01,
    },
    "what_a_bit_costs": {
        "counts": lambda counts: (counts["failed"], counts["done"] + counts["known"]) == (0, 33),
        "lean['lut'] / base['lut']": lambda share: 0.7 < share < 0.95,
        "max(row.metrics['dsp'] for row in zynq) > min(row.metrics['dsp'] for row in zynq)": bool,
    },
    "your_gel_in_ten_minutes": {
        "simulated": bool,
        "errors['integer']['normal_mae_deg']": lambda deg: deg < 3,
        "float(pressed_mm / cap_mm)": lambda ratio: 0.75 < ratio < 1.25,
        "[len(train), len(test)]": lambda counts: counts == [34, 9],
    },
}
"""Of each notebook: expressions over its variables, and what must hold of their values."""


@pytest.fixture
def folder(tmp_path) -> Path:
    """A folder to execute in, with the repository's compiled simulators and Verilator's runtime."""
    cache = ROOT / "build" / "cache"
    cache.mkdir(parents=True, exist_ok=True)
    (tmp_path / "build").mkdir()
    (tmp_path / "build" / "cache").symlink_to(cache)
    return tmp_path


def executed(name: str, folder: Path, **variables: str) -> tuple[nbformat.NotebookNode, list]:
    """The notebook with warnings as errors, and the values of its RESULTS."""
    values = f"{LENIENT}\nimport json\n\nprint(json.dumps([{', '.join(RESULTS[name])}]))"
    notebook = execute.execute(name, folder, before=STRICT, after=values, environment=variables)
    return notebook, json.loads(notebook.cells[-1].outputs[0].text)


@pytest.mark.parametrize("name", execute.names())
def test_is_stored_without_outputs(name):
    path = execute.FOLDER / f"{name}.ipynb"
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    assert notebook.metadata == METADATA
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.id for cell in code if cell.outputs or cell.execution_count is not None] == []
    marked = [cell.metadata for cell in notebook.cells if cell.metadata]
    assert marked == [{"tags": [execute.TAG]}]
    assert not any(cell.id.isdigit() or len(cell.id) > 32 for cell in notebook.cells)
    # As Jupyter writes it, so that saving it there changes no line but those that were edited.
    assert path.read_text() == nbformat.writes(notebook) + "\n"


@pytest.mark.parametrize("name", execute.names())
def test_has_its_picture_in_the_docs(name):
    png = (PICTURES / f"{name}.png").read_bytes()
    assert png[:4] == b"\x89PNG"
    assert len(png) < PICTURE_BYTES


@pytest.mark.full
@pytest.mark.parametrize("name", execute.names())
def test_finds_what_it_says(name, folder):
    notebook, values = executed(name, folder, PHOTOGRAPHS="none")
    wrong = [
        f"{expression}: {value}"
        for (expression, is_right), value in zip(RESULTS[name].items(), values, strict=True)
        if not is_right(value)
    ]
    assert wrong == []
    printed = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    assert [output.text for output in printed if output.get("name") == "stderr"] == []
    assert len(execute.picture(notebook)) < PICTURE_BYTES
    assert {path.name for path in folder.iterdir()} == {"build"}
    assert {path.name for path in (folder / "build").iterdir()} <= {"cache", "notebooks"}


@pytest.mark.full
def test_trains_on_photographs(folder):
    photographs = ROOT.parent / "shared" / "data" / "fots"
    if not photographs.is_dir():
        pytest.skip(f"{photographs}: no photographs of ball presses")
    _, (simulated, normal_deg, _, counts) = executed(
        "your_gel_in_ten_minutes", folder, PHOTOGRAPHS=str(photographs)
    )
    assert not simulated
    assert normal_deg < 10
    assert counts == [34, 9]


def test_a_notebook_that_there_is_not(capsys):
    with pytest.raises(SystemExit):
        execute.main(["your_gell"])
    assert "your_gell: there are a_design_from_the_front, " in capsys.readouterr().err
