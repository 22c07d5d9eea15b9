# amaranth: UnusedElaboratable=no
"""What docs/extending.md promises: a toy of each kind goes through its tables; nobody else asks for names."""

import ast
import re
from dataclasses import dataclass, replace
from pathlib import Path

import click
import numpy as np
import pytest
from click.testing import CliRunner

from fastac.cli import main, recordings
from fastac.gateware import raster_outputs
from fastac.gateware.cycle_model import CycleModel, cycles
from fastac.gateware.datapath import Datapath
from fastac.gateware.poisson import solvers as hardware_solvers
from fastac.gateware.poisson.tridiagonal import TridiagonalPoissonSolver
from fastac.gateware.target.elaboration import to_verilog
from fastac.gateware.top_zynq import TopZynq
from fastac.models.emulator import direct
from fastac.models.emulator import solvers as emulator_solvers
from fastac.models.emulator.pipeline import Emulator
from fastac.models.emulator.tridiagonal import RecurrenceTables
from fastac.models.integer import bundle as bundles
from fastac.models.integer import solvers as integer_solvers
from fastac.models.integer.tridiagonal import TridiagonalSolver
from fastac.models.random_bundle import frames, random_bundle, scene
from fastac.scenes import outputs as scene_outputs
from fastac.scenes import solvers as scene_solvers
from fastac.scenes.schema import Scene, SceneError, parse
from fastac.scenes.strict import Strict
from fastac.sensor.mechanics.objects import OBJECTS
from fastac.store.closure import Code
from fastac.store.kinds import Kinds, UnknownKindError
from fastac.sweep import spec
from fastac.synth.estimates import energy, resources
from fastac.synth.estimates import solvers as synth_solvers
from fastac.synth.estimates.stages import stage_of
from fastac.synth.estimates.tridiagonal import TridiagonalCosts

ROOT = Path(__file__).parents[1]
GUIDE = ROOT / "docs" / "extending.md"
ROOMS = ("models", "gateware", "sim", "sensor", "scenes", "fastac")
SOLVER_TABLES = (scene_solvers, integer_solvers, emulator_solvers, hardware_solvers, synth_solvers)
OWN_FILES = {"solvers.py", "dst2d.py", "tridiagonal.py", "recurrence.py", "eigenvalue_division.py"}
"""Files of the solvers themselves."""


@dataclass(frozen=True, eq=False)
class ToySolver(TridiagonalSolver):
    """A solver whose class nobody knows: the tables have it under the name "toy"."""


class ToyTables(RecurrenceTables):
    """Its emulator."""


class ToyPoissonSolver(TridiagonalPoissonSolver):
    """Its hardware."""


class ToyCosts(TridiagonalCosts):
    """What its hardware takes."""


def enter(monkeypatch, table: Kinds, name: str, value: object) -> None:
    """Add an entry to a table as if it were written there."""
    monkeypatch.setitem(table._entries, name, value)


def guide(section: str) -> list[str]:
    """The files that a section of the guide lists."""
    text = GUIDE.read_text().split(f"## {section}\n")[1].split("\n## ")[0]
    return re.findall(r"^- `([\w./]+)`", text, flags=re.MULTILINE)


@pytest.fixture
def toy_solver(monkeypatch) -> None:
    facts = scene_solvers.SolverFacts(least_row_beats=5)
    entries = (facts, ToySolver, ToyTables, ToyPoissonSolver, ToyCosts)
    for module, entry in zip(SOLVER_TABLES, entries, strict=True):
        enter(monkeypatch, module.SOLVERS, "toy", entry)


def test_the_guide_s_tables_for_a_solver_are_these():
    listed = {file for file in guide("Add a Poisson solver") if "NAME" not in file}
    rooms = {module.__name__.removeprefix("fastac.").replace(".", "/") + ".py" for module in SOLVER_TABLES}
    assert {file.removeprefix("fastac/") for file in listed} == rooms
    assert len(guide("Add a Poisson solver")) <= 9


def test_a_toy_solver_goes_from_scene_to_bundle_and_emulator(toy_solver, tmp_path):
    wanted = scene(("depth", "force_z"), solver="toy", mode="difference")
    pipeline = random_bundle(tmp_path / "bundle", wanted).pipeline
    assert type(pipeline.solver) is ToySolver
    loaded = bundles.load(tmp_path / "bundle").pipeline
    assert type(loaded.solver) is ToySolver
    images = frames(pipeline.background, (10, 255))
    found = Emulator(loaded).run(images)
    for k, image in enumerate(images):
        expected = direct.find(loaded, image)
        np.testing.assert_array_equal(found.depth_words[k], expected["depth_words"])
        np.testing.assert_array_equal(found.force_raw[k], expected["force_raw"])


def test_a_toy_solver_goes_through_hardware_formulas_and_estimates(toy_solver, tmp_path):
    bundle = random_bundle(tmp_path / "bundle", scene(("depth",), solver="toy", weights="baked"))
    path = Datapath(bundle.pipeline)
    assert type(path.solver) is ToyPoissonSolver
    assert path.rows_reversed
    assert CycleModel(bundle.scene, hidden=(4,)).interval == path.interval
    assert cycles(bundle.scene, hidden=(4,))["stage"] == path.modules
    known = bundle.pipeline.replace(
        scene=scene(("depth",), solver="tridiagonal", weights="baked"),
        solver=TridiagonalSolver(**vars(bundle.pipeline.solver)),
    )
    toy, same = (TopZynq(replace(bundle, pipeline=p)) for p in (bundle.pipeline, known))
    assert to_verilog(toy, name="top") == to_verilog(same, name="top")
    assert energy.works(bundle.pipeline) == energy.works(known)
    assert resources.features(bundle.pipeline) == resources.features(known)
    assert stage_of("solver.elimination") == "recurrences"


def test_a_scene_checks_what_its_solver_can_do(toy_solver, monkeypatch):
    enter(monkeypatch, scene_solvers.SOLVERS, "flat", scene_solvers.SolverFacts(finds_depth=False))
    text = 'name = "x"\noutputs = ["depth"]\nsensor.geometry = "flat"\npoisson.solver = "{}"'
    assert parse(text.format("toy"), origin="x").wants_solver
    with pytest.raises(SceneError, match="'flat' finds no depth; choose 'dst2d', 'tridiagonal' or 'toy'"):
        parse(text.format("flat"), origin="x")
    with pytest.raises(
        SceneError, match="Input should be 'dst2d', 'tridiagonal', 'adjoint', 'toy' or 'flat'"
    ):
        parse(text.format("fft"), origin="x")


def test_a_toy_output_is_measured_and_streamed(monkeypatch, tmp_path):
    """The height of the skin once more, under another name."""
    facts = scene_outputs.OutputFacts("depth_mm", "mm", "depth_words", needs_geometry=True, needs_depth=True)
    raster = replace(raster_outputs.DEPTH, order=3)
    enter(monkeypatch, scene_outputs.OUTPUTS, "height", facts)
    enter(monkeypatch, raster_outputs.RASTERS, "height", raster)
    wanted = scene(("height",))
    assert (wanted.wants_solver, wanted.wants_force, wanted.wants_slopes) == (True, False, True)
    assert scene_outputs.measured(wanted.outputs) == {"depth_mm": "mm"}
    pipeline = random_bundle(tmp_path / "bundle", wanted).pipeline
    fields = scene_outputs.hardware_words(wanted.outputs)
    found = Emulator(pipeline).run(frames(pipeline.background, (10,)), wanted=fields)
    assert found.depth_words.shape == (1, 14, 14)
    (stream,) = raster_outputs.raster_outputs(pipeline, rows_reversed=False)
    assert (stream.name, stream.rows, stream.columns, stream.words) == ("height", 14, 14, 1)


def test_an_output_touches_at_most_eight_files_which_exist():
    files = guide("Add an output")
    assert len(files) <= 8
    assert all((ROOT / file).is_file() for file in files)


def test_a_toy_importer_is_a_command(monkeypatch):
    @click.command()
    @click.argument("folder")
    def toy(folder):
        """Import nothing from FOLDER."""
        click.echo(f"{folder}: nothing")

    assert len(guide("Add an importer")) == 2
    enter(monkeypatch, recordings.IMPORTERS, "toy", toy)
    assert "Import nothing" in CliRunner().invoke(main.main, ["import", "--help"]).output
    assert CliRunner().invoke(main.main, ["import", "toy", "a"]).output == "a: nothing\n"
    assert "No such command" in CliRunner().invoke(main.main, ["import", "other"]).output


def keys(table: type[Strict], prefix: str = "") -> list[str]:
    """Every key of a scene's table, dotted."""
    found = []
    for name, field in table.model_fields.items():
        nested = isinstance(field.annotation, type) and issubclass(field.annotation, Strict)
        found += keys(field.annotation, f"{prefix}{name}.") if nested else [f"{prefix}{name}"]
    return found


def test_every_key_of_a_scene_is_a_sweep_axis(tmp_path):
    (tmp_path / "base.toml").write_text('name = "x"\noutputs = ["depth"]\nsensor.geometry = "flat"')
    file = tmp_path / "sweep.toml"
    assert len(guide("Add a sweep axis")) == 1
    axes = [key for key in keys(Scene) if key != "name"]
    assert "poisson.solver" in axes
    file.write_text('scene = "base.toml"\n[axes]\n' + "\n".join(f'"{key}" = [0]' for key in axes))
    found, _ = spec.load(file)
    assert list(found.axes[0]) == axes


def test_an_object_is_an_entry(monkeypatch):
    class Step:
        def surface(self, x, y):
            return np.where(x > 0, 0.0, 1.0), np.zeros_like(x), np.zeros_like(x)

    enter(monkeypatch, OBJECTS, "step", Step)
    assert OBJECTS["step"]().surface(np.array([1.0]), np.array([0.0]))[0] == [0]
    with pytest.raises(UnknownKindError, match="there is strawberry, fingerprint, led_pads, step"):
        OBJECTS["cube"]


@pytest.mark.parametrize(
    "start",
    [
        "fastac.models.integer.bundle:load",
        "fastac.models.random_bundle:random_bundle",
        "fastac.flow.force_training:force",
        "fastac.flow.hardware:write_verilog",
        "fastac.flow.hardware:simulate",
    ],
)
@pytest.mark.quick("fastac.models.random_bundle:random_bundle", "fastac.flow.hardware:simulate")
def test_a_new_entry_makes_no_result_out_of_date(start):
    """No step has a table as a whole in its code: what it looks up is recorded when it runs."""
    symbols = Code().closure(start).symbols
    assert "fastac.models.integer.pipeline.IntegerPipeline" in symbols
    assert not {s for s in symbols if s.endswith((".SOLVERS", ".OUTPUTS", ".FITS", ".RASTERS"))}
    assert not {s for s in symbols if "tridiagonal" in s or "dst2d" in s}


def sources() -> list[Path]:
    """All our modules, each once, but the solvers' own."""
    files = {file.resolve() for room in ROOMS for file in (ROOT / room).rglob("*.py")}
    return sorted(file for file in files if file.name not in OWN_FILES)


def offences(text: str) -> list[str]:
    """Comparisons with a solver's name, and questions for a solver's class, in a module's text."""
    names = {"dst2d", "tridiagonal", "adjoint"}
    classes = {
        *("IntegerSolver", "Solver", "TridiagonalSolver", "PoissonSolver", "TridiagonalPoissonSolver"),
        *("EigenvalueDivision", "Recurrence", "Elimination", "Substitution", "EigenvalueDivider"),
        *("RowRecurrence", "TransformTables", "RecurrenceTables"),
    }
    found = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Compare):
            used = {n.value for n in ast.walk(node) if isinstance(n, ast.Constant)}
            found += [f"line {node.lineno}: compares {name}" for name in names & used]
        elif isinstance(node, ast.MatchValue) and isinstance(node.value, ast.Constant):
            found += [f"line {node.lineno}: matches {node.value.value}"] * (node.value.value in names)
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("isinstance", "issubclass"):
            used = {getattr(n, "id", getattr(n, "attr", "")) for n in ast.walk(node.args[1])}
            found += [f"line {node.lineno}: asks for {name}" for name in classes & used]
    return found


def test_nobody_compares_a_solver_s_name_or_asks_for_its_class():
    found = {str(file.relative_to(ROOT)): offences(file.read_text()) for file in sources()}
    assert {file: lines for file, lines in found.items() if lines} == {}


@pytest.mark.parametrize(
    "text",
    [
        'if scene.poisson.solver == "tridiagonal": pass',
        'kind = "x" if solver in ("dst2d", "tridiagonal") else "y"',
        "if isinstance(pipeline.solver, TridiagonalSolver): pass",
        "found = isinstance(stage, Depth | tridiagonal.Elimination)",
        'match name:\n    case "adjoint":\n        pass',
    ],
)
def test_such_questions_are_noticed(text):
    assert len(offences(text)) >= 1
